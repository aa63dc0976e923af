"""Folds of the ground within a cell, and the distance of the nodes there from the ground.

At the edge of a cliff the plane below a node column deviates from the ground by up to the height of the cliff. Such
columns and their neighbours store the exact distance and direction of the nearest ground for each node that the flow
can reach.
"""

import numpy as np
from scipy import ndimage

from ...system.errors import SceneError
from .ground_distance import distances_to_ground
from .point_ground import EXACT_ENTRIES, FOLD_ENTRIES, Ground
from .point_rows import GHOSTS

FOLD_CELLS = 0.5  # [cells] deviation of the ground from the plane of a node at its neighbours that makes a fold
REACH = 3  # [cells] distance to each side within which the nearest ground is searched; nodes with mass are nearer
MOST_NODES = 1 << 27  # largest number of nodes on folds: 2 GiB
SUNK = 3  # [cells] depth of the lowest node that can have mass, below the lowest ground near it


def folded_ground(nodes: np.ndarray, height: np.ndarray, dx: float, clearance: float) -> Ground:
    """Make the `Ground` of node columns, with its folds.

    Parameters
    ----------
    nodes : float64[rows, columns, GROUND_ENTRIES]
        Height [m] and slopes first.
    height : float64[rows, columns] [m]
        Of the terrain at the nodes: a cliff is one cell wide there and has no ramp, unlike that of the spline.
    dx : float [m]
    clearance : float [cells]
        Height above the ground at which a node is in contact with it.

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
            f"the DTM folds within a cell of {dx:g} m on {share:.0f} % of the terrain, {levels.sum():.3g} nodes "
            f"with a nearest ground, expected at most {MOST_NODES:.3g}; clip it by [terrain] window, smooth it or "
            "take larger cells"
        )
    firsts = np.cumsum(levels) - levels
    exact = np.zeros((int(levels.sum()), EXACT_ENTRIES), np.float32)
    distances_to_ground(np.asarray(height, float), dx, rows, columns, firsts, lowest, levels, REACH, exact)
    folds = np.zeros((*folded.shape, FOLD_ENTRIES), np.int32)
    folds[folded] = np.column_stack([firsts, lowest, levels])
    return Ground(nodes, folds, exact)


def departure(nodes: np.ndarray, height: np.ndarray, dx: float) -> np.ndarray:
    """Compute how far the ground at the neighbours of a node is from the plane of the node, at most and normal to it.

    Parameters
    ----------
    nodes : float64[rows, columns, GROUND_ENTRIES]
        Height [m] and slopes first.
    height : float64[rows, columns] [m]
        Of the terrain at the nodes.
    dx : float [m]

    Returns
    -------
    float64[rows, columns] [m]
    """
    foot, slope_x, slope_y = (nodes[..., k] for k in range(3))
    padded, worst = np.pad(height, 1, mode="edge"), np.zeros(height.shape)
    rows, columns = height.shape
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            there = padded[1 + j : 1 + j + rows, 1 + i : 1 + i + columns]
            apart = np.abs(there - foot - dx * (i * slope_x + j * slope_y))
            worst = np.maximum(worst, apart)
    worst /= np.sqrt(1.0 + slope_x**2 + slope_y**2)
    rim = np.zeros(height.shape, bool)  # the ground is only extended beyond, without folds
    rim[GHOSTS : -GHOSTS - 2, GHOSTS : -GHOSTS - 2] = True
    return np.where(rim, worst, 0.0)


def padded(values: np.ndarray) -> np.ndarray:
    """Extend values at the nodes, from one node outside the corner of the domain, to the ghost nodes.

    Parameters
    ----------
    values : float64[ny + 3, nx + 3, k]
    """
    before, after = GHOSTS - 1, GHOSTS + 1
    return np.ascontiguousarray(np.pad(values, ((before, after), (before, after), (0, 0)), mode="edge"))
