"""Cubes under and around the points of a start, for solvers that need the nodes of their grid."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..system.errors import InputError

# corners of a cube in the order of gmsh, VTK, Kratos and CB-Geo, in steps along x, y, z
CORNERS = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=np.int64
)
UNDER_BED = 1  # layers of cells completely below the bed
ON_BED = 1e-6  # [cells] a node up to this far above the bed is on it: rounding
MOST_CELLS = 5_000_000  # of a grid


@dataclass(frozen=True)
class SolverGrid:
    """Cubes by their corners, in local coordinates.

    Parameters
    ----------
    nodes : float64[m, 3] [m]
    cells : int64[k, 8]
        Rows of `nodes`, in the order of CORNERS.
    bed, side_x, side_y : int64[...]
        Nodes at or under the bed, on the west and east side, and on the south and north side of the box.
    cell_of : int64[n]
        The cell of each particle.
    """

    nodes: np.ndarray
    cells: np.ndarray
    bed: np.ndarray
    side_x: np.ndarray
    side_y: np.ndarray
    cell_of: np.ndarray


def solver_grid(start: Any) -> SolverGrid:
    """Make the grid of a start: from under the bed up to its `headroom` over the bed.

    Parameters
    ----------
    start : SolverStart
        With a cell.

    Returns
    -------
    SolverGrid

    Raises
    ------
    InputError
        Too many cells, or particles without ground under them.
    """
    height = start.box.bed_at_nodes()[..., 2]
    corners = np.stack([height[:-1, :-1], height[1:, :-1], height[:-1, 1:], height[1:, 1:]])
    ground = np.isfinite(corners).all(axis=0)
    low, high = (np.where(ground, bed, 0.0) / start.cell for bed in (corners.min(axis=0), corners.max(axis=0)))
    first = np.clip(np.floor(low).astype(np.int64) - UNDER_BED, 0, None)
    last = np.minimum(np.ceil(high + start.headroom / start.cell).astype(np.int64), start.cells[2])
    i, j, k = place = _places(start)
    np.minimum.at(first, (i, j), np.maximum(k - UNDER_BED, 0))  # where the ground dips between the nodes
    np.maximum.at(last, (i, j), k + 1)
    count = np.where(ground, last - first, 0)
    if not ground[i, j].all():
        raise InputError(
            f"{(~ground[i, j]).sum()} of {len(k)} points have no ground under them; use the DTM that they were made "
            "on, without holes there"
        )
    if count.sum() > MOST_CELLS:
        raise InputError(
            f"the grid would have {count.sum():.3g} cells of {start.cell:g} m, expected at most {MOST_CELLS:.3g}; take "
            "a larger --cell or a smaller --window"
        )
    return _numbered(start, place, first, count, height)


def _places(start: Any) -> np.ndarray:
    """Return int64[3, n]: steps along x, y, z to the cube of each particle."""
    steps = (start.position / start.cell).astype(np.int64)
    return np.clip(steps, 0, np.array(start.cells) - 1).T


def _numbered(start: Any, place: np.ndarray, first: np.ndarray, count: np.ndarray, height: np.ndarray) -> SolverGrid:
    """Return the SolverGrid of columns that begin at cell `first` and have `count` of them."""
    _, ny, nz = start.cells
    before = np.cumsum(count).reshape(count.shape) - count
    column = np.repeat(np.arange(count.size), count.ravel())
    up = np.arange(len(column)) - np.repeat(before.ravel(), count.ravel())
    index = np.column_stack([column // ny, column % ny, up + first.ravel()[column]])
    strides = np.array([(ny + 1) * (nz + 1), nz + 1, 1])
    every = ((index[:, None, :] + CORNERS) * strides).sum(axis=2)
    used, cells = np.unique(every, return_inverse=True)
    i, j, k = (used // strides[0], used % strides[0] // strides[1], used % strides[1])
    nodes = start.cell * np.column_stack([i, j, k])
    return SolverGrid(
        nodes=nodes,
        cells=cells.reshape(-1, len(CORNERS)),
        bed=np.flatnonzero(nodes[:, 2] <= height[i, j] + ON_BED * start.cell),
        side_x=np.flatnonzero((i == 0) | (i == start.cells[0])),
        side_y=np.flatnonzero((j == 0) | (j == ny)),
        cell_of=before[place[0], place[1]] + place[2] - first[place[0], place[1]],
    )
