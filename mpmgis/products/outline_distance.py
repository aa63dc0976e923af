"""How far apart the outlines of two areas lie."""

import math
from typing import NamedTuple

import numpy as np
import shapely

HIGH_SHARE = 95.0  # percentile: a distance that one spur does not make
MOST_PLACES = 200_000  # on an outline


class OutlineDistances(NamedTuple):
    """Distances [m] between two outlines, from evenly spread places on one to the nearest place on the other.

    `first_mean` and `second_mean` start from the first and from the second outline, `mean` is that of both by their
    lengths; `high` is not exceeded on 95 % of both, `largest` (Hausdorff's) nowhere.
    """

    first_mean: float
    second_mean: float
    mean: float
    high: float
    largest: float


def outline_distances(first, second, spacing):
    """The OutlineDistances of two polygonal geometries; None where one is empty.

    Parameters
    ----------
    first, second : shapely geometry [m]
        Polygons; holes have outlines too.
    spacing : float [m]
        Between places on an outline, at most.
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
    """(points, the length [m] that each stands for): evenly spread on every ring, `spacing` [m] apart at most."""
    places, weights = [], []
    for ring in shapely.get_parts(outline):
        count = max(1, math.ceil(ring.length / spacing))
        places.append(shapely.line_interpolate_point(ring, np.arange(count) * (ring.length / count)))
        weights.append(np.full(count, ring.length / count))
    return np.concatenate(places), np.concatenate(weights)
