"""Folds of the ground within a cell, and the distance of the nodes there from the ground.

At a cliff's edge the plane under a node column leaves the ground by up to the cliff's height. Such columns, and those
beside them, keep the exact distance and direction of the nearest ground for each node that the flow can reach; all
others cost nothing.
"""

import numpy as np
from scipy import ndimage

from ..errors import SceneError
from ..kernels.ground_distance import distances_to_ground
from ..kernels.points import EXACT_ENTRIES, FOLD_ENTRIES, GHOSTS, Ground

FOLD_CELLS = 0.5  # [cells] by which the ground leaves a node's plane at its neighbours to be a fold
REACH = 3  # [cells] to each side in which the nearest ground is looked for; a node with mass is nearer
MOST_NODES = 1 << 27  # on folds, 2 GiB
SUNK = 3  # [cells] under the lowest ground near by, of the lowest node that can have mass


def folded_ground(nodes, height, dx, clearance):
    """The `Ground` of node columns `nodes`, with what is known of its folds.

    Parameters
    ----------
    nodes : float[rows, columns, GROUND_ENTRIES]
        Height [m] and slopes first.
    height : float[rows, columns] [m]
        Of the terrain at the nodes: a cliff there is a cell wide, and its foot no ramp, as that of the spline is.
    dx : float [m]
    clearance : float [cells]
        Height above the ground at which a node touches it.

    Raises
    ------
    SceneError
        Ground so rough that its folds do not fit into memory.
    """
    folded = ndimage.maximum_filter(departure(nodes, height, dx) > FOLD_CELLS * dx, 3)
    if not folded.any():
        return Ground(nodes, np.zeros((1, 1, FOLD_ENTRIES), np.int32), np.zeros((1, EXACT_ENTRIES), np.float32))
    beside = 1 + int(np.ceil(clearance))
    rows, columns = np.nonzero(folded)
    least = ndimage.minimum_filter(height, 5)[folded]
    most = ndimage.maximum_filter(height, 2 * beside + 1)[folded]
    lowest = np.floor(least / dx).astype(np.int64) - SUNK + GHOSTS
    levels = np.ceil(most / dx).astype(np.int64) + beside + GHOSTS + 1 - lowest
    if levels.sum() > MOST_NODES:
        share = 100.0 * len(rows) / folded.size
        raise SceneError(
            f"the DTM folds within a cell of {dx:g} m on {share:.0f} % of the terrain, {levels.sum():.3g} nodes to "
            f"keep the nearest ground of, expected at most {MOST_NODES:.3g}; clip it by [terrain] window, smooth it or "
            "take larger cells"
        )
    firsts = np.cumsum(levels) - levels
    exact = np.zeros((int(levels.sum()), EXACT_ENTRIES), np.float32)
    distances_to_ground(np.asarray(height, float), dx, rows, columns, firsts, lowest, levels, REACH, exact)
    folds = np.zeros((*folded.shape, FOLD_ENTRIES), np.int32)
    folds[folded] = np.column_stack([firsts, lowest, levels])
    return Ground(nodes, folds, exact)


def departure(nodes, height, dx):
    """float[rows, columns] [m]: by how much the ground leaves a node's plane, normal to it, at its neighbours."""
    foot, slope_x, slope_y = (nodes[..., k] for k in range(3))
    padded, worst = np.pad(height, 1, mode="edge"), np.zeros(height.shape)
    rows, columns = height.shape
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            there = padded[1 + j : 1 + j + rows, 1 + i : 1 + i + columns]
            apart = np.abs(there - foot - dx * (i * slope_x + j * slope_y))
            worst = np.maximum(worst, apart)
    worst /= np.sqrt(1.0 + slope_x**2 + slope_y**2)
    rim = np.zeros(height.shape, bool)  # where the ground is only continued, nothing is known of folds
    rim[GHOSTS : -GHOSTS - 2, GHOSTS : -GHOSTS - 2] = True
    return np.where(rim, worst, 0.0)
