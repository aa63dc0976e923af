"""Footprints of columns on the map, stretched as the flow is.

A flow that stretches carries its columns apart along one direction and together across it; squares would then leave
gaps in rows, which a 3D code treats as fractures. The stretch of a column is known only from its neighbours.
"""

from typing import NamedTuple

import numpy as np

MOST_STRETCHED = 6.0  # [1] length over width; more is the rim of a flow, not its inside
SQUARE = 1.15  # [1] length over width below which a footprint is a square, along the axes of the map
_FAR = 4.0  # [sides of a column] to the middle of a triangle of columns, beyond which they are no neighbours


class Footprints(NamedTuple):
    """Rectangles on the map.

    Parameters
    ----------
    length, width : float64[n] [m]
    east, north : float64[n]
        Unit vector along the length.
    """

    length: np.ndarray
    width: np.ndarray
    east: np.ndarray
    north: np.ndarray


def squares(area: np.ndarray) -> Footprints:
    """Return the footprints of columns without stretch.

    Parameters
    ----------
    area : float64[n] [m2]
    """
    side = np.sqrt(area)
    return Footprints(side, side, np.ones(len(side)), np.zeros(len(side)))


def stretched(x: np.ndarray, y: np.ndarray, area: np.ndarray) -> Footprints:
    """Compute the footprints of columns, stretched as their Voronoi cells are.

    On a lattice with the steps a and b the sum of l d d^T over a point's neighbours at d, across an edge of length l of
    its cell, has the eigenvalues 2 a^2 b and 2 a b^2: their ratio is the stretch.

    Parameters
    ----------
    x, y : float64[n] [m]
    area : float64[n] [m2]
    """
    moments = _moments(x - x.mean(), y - y.mean(), np.sqrt(area))
    if moments is None:
        return squares(area)
    xx, xy, yy = moments
    half, middle = np.hypot(0.5 * (xx - yy), xy), 0.5 * (xx + yy)
    low = np.maximum(middle - half, 0.0)
    known = middle > 0
    stretch = np.where(known, (middle + half) / np.maximum(low, 1e-9 * np.where(known, middle, 1.0)), 1.0)
    stretch = np.minimum(stretch, MOST_STRETCHED)
    angle = np.where(stretch > SQUARE, 0.5 * np.arctan2(2.0 * xy, xx - yy), 0.0)
    stretch = np.where(stretch > SQUARE, stretch, 1.0)
    return Footprints(np.sqrt(area * stretch), np.sqrt(area / stretch), np.cos(angle), np.sin(angle))


def _moments(x, y, side):
    """(xx, xy, yy) of the sum of l d d^T for each column; None where there are too few to have neighbours."""
    from scipy.spatial import Delaunay, QhullError  # a tenth of a second that a run of columns alone does not need

    points = np.column_stack([x, y])
    try:
        corners = Delaunay(points).simplices
    except (QhullError, ValueError):
        return None
    corners = corners[_radius(points, corners) < _FAR * side[corners].max(axis=1)]
    total = np.zeros((3, len(x)))
    for k in range(3):
        apex, first, second = points[corners[:, k]], corners[:, (k + 1) % 3], corners[:, (k + 2) % 3]
        a, b = points[first] - apex, points[second] - apex
        twice_area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        d = points[second] - points[first]
        # the part of the cells' common edge within this triangle: half of |d| times the cotangent at the apex
        edge = 0.5 * (a * b).sum(axis=1) / np.maximum(twice_area, 1e-300) * np.hypot(d[:, 0], d[:, 1])
        for row, product in enumerate((d[:, 0] ** 2, d[:, 0] * d[:, 1], d[:, 1] ** 2)):
            for corner in (first, second):
                total[row] += np.bincount(corner, edge * product, len(x))
    return total


def _radius(points, corners):
    """Radius [m] of each triangle's circumscribed circle; infinite for a flat one."""
    a, b, c = (points[corners[:, k]] for k in range(3))
    sides = [np.hypot(*(p - q).T) for p, q in ((a, b), (b, c), (c, a))]
    twice_area = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    with np.errstate(divide="ignore", over="ignore"):
        return sides[0] * sides[1] * sides[2] / (2.0 * twice_area)
