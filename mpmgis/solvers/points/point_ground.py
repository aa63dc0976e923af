"""The ground at the nodes of the 3D grid: their distance from it and its normal, on smooth and on folded ground.

Smooth ground is the plane at the foot of a node column. Where the ground folds within a cell (edge and foot of a cliff,
a kink) the error of the plane is up to the height of the cliff. Columns there store, for every node that the flow can
reach, the distance from the nearest ground and its direction (`ground_distance`).
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from ...compiled.jit import jit_inline

# entries of the ground below a node column
(
    GROUND_HEIGHT,  # [m] above the domain's lowest level
    GROUND_SLOPE_X,  # [1] slope to the east
    GROUND_SLOPE_Y,  # [1] slope to the north
    GROUND_DEEP,  # [m] height below which a point near the column may be below the ground and is checked
    GROUND_ENTRIES,  # number of entries
) = range(5)
# entries of a node column on a fold
(
    FOLD_FIRST,  # index of its lowest node in `Ground.exact`
    FOLD_LEVEL,  # level of that node
    FOLD_LEVELS,  # number of its nodes; 0: no fold
    FOLD_ENTRIES,  # number of entries
) = range(4)
# entries of a node of such a column
(
    AWAY,  # [m] distance from the ground, negative below it
    EXACT_X,  # [1] unit normal of the ground there, east
    EXACT_Y,  # [1] north
    EXACT_Z,  # [1] up
    EXACT_ENTRIES,  # number of entries
) = range(5)
FAR_ABOVE = 1e30  # [m] distance from the ground of a node above those of its column


class Ground(NamedTuple):
    """Ground of a 3D run.

    Parameters
    ----------
    nodes : float64[rows, columns, GROUND_ENTRIES]
        The ground below each node column.
    folds : int32[rows, columns, FOLD_ENTRIES]
        Folds of the ground; [1, 1, FOLD_ENTRIES] where the ground has none.
    exact : float32[n, EXACT_ENTRIES]
        Distance and normal at the nodes of columns on folds.
    """

    nodes: np.ndarray
    folds: np.ndarray
    exact: np.ndarray


@jit_inline
def plane_at(nodes: np.ndarray, j: int, i: int) -> tuple[float, float, float, float]:
    """Return the ground's plane at a node column.

    Parameters
    ----------
    nodes : float64[rows, columns, GROUND_ENTRIES]
    j, i : int
        Row and column.

    Returns
    -------
    (float [m], float, float, float)
        Height; unit normal.
    """
    slope_x, slope_y = nodes[j, i, GROUND_SLOPE_X], nodes[j, i, GROUND_SLOPE_Y]
    flat = 1.0 / sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return nodes[j, i, GROUND_HEIGHT], -slope_x * flat, -slope_y * flat, flat


@jit_inline
def fold_at(folds: np.ndarray, j: int, i: int) -> tuple[int, int, int]:
    """Return first entry, lowest level and number of levels of a node column; no levels where the ground is smooth.

    Parameters
    ----------
    folds : int32[rows, columns, FOLD_ENTRIES]
        Of the `Ground`.
    j, i : int
        Row and column.
    """
    if folds.shape[0] == 1:
        return 0, 0, 0
    return folds[j, i, FOLD_FIRST], folds[j, i, FOLD_LEVEL], folds[j, i, FOLD_LEVELS]


@jit_inline
def exact_at(exact: np.ndarray, first: int, lowest: int, levels: int, level: int) -> tuple[float, float, float, float]:
    """Return the distance of a node in a column on a fold from the ground, and the unit normal.

    Parameters
    ----------
    exact : float32[n, EXACT_ENTRIES]
        Of the `Ground`.
    first, lowest, levels : int
        The result of `fold_at`.
    level : int
        Of the node.

    Returns
    -------
    (float [m], float, float, float)
        Distance; unit normal.
    """
    above = level - lowest
    entry = first + min(max(above, 0), levels - 1)
    away = FAR_ABOVE if above >= levels else exact[entry, AWAY]
    return away, exact[entry, EXACT_X], exact[entry, EXACT_Y], exact[entry, EXACT_Z]
