"""The ground at the nodes of the 3D grid: their distance from it and its normal, on smooth and on folded ground.

Smooth ground is the plane at the foot of a node column. Where the ground folds within a cell (edge and foot of a cliff,
a kink) the error of the plane is up to the height of the cliff. Columns there store, for every node that the flow can
reach, the distance from the nearest ground and its direction (`ground_distance`).

A cell of four nodes is a fan of four triangles around its middle, which is where the bilinear surface has its middle,
too; on cells that are not twisted, straight cliffs among them, the two are the same.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from ...compiled.jit import jit_inline

# ground below a node column: height [m], slopes, and height [m] below which a point near it is checked
GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y, GROUND_DEEP, GROUND_ENTRIES = range(5)
# node column on a fold: first of its nodes in `exact`, their lowest level, their number (0: no fold)
FOLD_FIRST, FOLD_LEVEL, FOLD_LEVELS, FOLD_ENTRIES = range(4)
# node of such a column: distance from the ground [m], negative below it, and the unit normal there
AWAY, EXACT_X, EXACT_Y, EXACT_Z, EXACT_ENTRIES = range(5)
FAR_ABOVE = 1e30  # [m]


class Ground(NamedTuple):
    """Ground of a 3D run.

    Parameters
    ----------
    nodes : float[rows, columns, GROUND_ENTRIES]
    folds : int32[rows, columns, FOLD_ENTRIES], or [1, 1, FOLD_ENTRIES] where the ground has none
    exact : float[n, EXACT_ENTRIES]
    """

    nodes: np.ndarray
    folds: np.ndarray
    exact: np.ndarray


@jit_inline
def plane_at(nodes, j, i):
    """(height [m], unit normal) of the ground's plane at node column [j, i]."""
    slope_x, slope_y = nodes[j, i, GROUND_SLOPE_X], nodes[j, i, GROUND_SLOPE_Y]
    flat = 1.0 / sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return nodes[j, i, GROUND_HEIGHT], -slope_x * flat, -slope_y * flat, flat


@jit_inline
def fold_at(folds, j, i):
    """(first entry, lowest level, number of levels) of node column [j, i]; no levels where the ground is smooth."""
    if folds.shape[0] == 1:
        return 0, 0, 0
    return folds[j, i, FOLD_FIRST], folds[j, i, FOLD_LEVEL], folds[j, i, FOLD_LEVELS]


@jit_inline
def exact_at(exact, first, lowest, levels, level):
    """(distance from the ground [m], unit normal) of the node at `level` in a column on a fold."""
    above = level - lowest
    entry = first + min(max(above, 0), levels - 1)
    away = FAR_ABOVE if above >= levels else exact[entry, AWAY]
    return away, exact[entry, EXACT_X], exact[entry, EXACT_Y], exact[entry, EXACT_Z]
