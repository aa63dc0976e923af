"""Measure distances between the outlines of two footprints."""

import math
from typing import NamedTuple

import numpy as np
import shapely

HIGH_SHARE = 95.0  # [%] percentile that does not depend on a single spur
MOST_PLACES = 200_000  # sample points on an outline, to limit time and memory


class OutlineDistances(NamedTuple):
    """Distances [m] between two outlines, from evenly spaced points on one to the nearest point on the other.

    `first_mean` and `second_mean`: from points on the first and on the second outline; `mean`: of both, weighted by
    length; `high`: 95th percentile of both; `largest`: maximum of both (Hausdorff distance).
    """

    first_mean: float
    second_mean: float
    mean: float
    high: float
    largest: float


def outline_distances(first: shapely.Geometry, second: shapely.Geometry, spacing: float) -> OutlineDistances | None:
    """Return the OutlineDistances of two polygonal geometries; None if one is empty.

    Parameters
    ----------
    first, second : shapely geometry [m]
        Polygons; holes have outlines too.
    spacing : float [m]
        Largest distance between sample points on an outline.

    Returns
    -------
    OutlineDistances or None
    """
    outlines = [shapely.boundary(shape) for shape in (first, second)]
    if any(outline.is_empty for outline in outlines):
        return None
    found, weights = [], []
    for outline, other in (outlines, outlines[::-1]):
        places, weight = _places_on(outline, max(spacing, outline.length / MOST_PLACES))
        shapely.prepare(other)
        found.append(shapely.distance(places, other))
        weights.append(weight)
    means = [float(np.average(distance, weights=weight)) for distance, weight in zip(found, weights, strict=True)]
    every, weight = np.concatenate(found), np.concatenate(weights)
    order = np.argsort(every, kind="stable")
    below = np.cumsum(weight[order])
    high = every[order][np.searchsorted(below, HIGH_SHARE / 100.0 * below[-1])]
    return OutlineDistances(*means, float(np.average(every, weights=weight)), float(high), float(every.max()))


def _places_on(outline, spacing):
    """(points, length [m] represented by each): evenly spaced on every ring, at most `spacing` [m] apart."""
    places, weights = [], []
    for ring in shapely.get_parts(outline):
        count = max(1, math.ceil(ring.length / spacing))
        places.append(shapely.line_interpolate_point(ring, np.arange(count) * (ring.length / count)))
        weights.append(np.full(count, ring.length / count))
    return np.concatenate(places), np.concatenate(weights)
