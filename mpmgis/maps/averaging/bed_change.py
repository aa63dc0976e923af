"""Compute eroded depth and rate of erosion on the cells of an export, from what frames store of the bed."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .cell_places import along
from .square_shares import share_squares

if TYPE_CHECKING:
    from ...terrain.grid import Grid


def eroded_depth(change: dict, grid: "Grid") -> np.ndarray:
    """Compute the vertical depth [m] that the flow took from the bed; 0 where it took nothing.

    Parameters
    ----------
    change : dict
        As in `on_cells`.
    grid : Grid

    Returns
    -------
    float64[rows, columns]
    """
    depth = np.asarray(change["eroded_mass"], dtype=float) / float(np.asarray(change["bed_density"]))
    return on_cells(change, depth, grid)


def on_cells(change: dict, depth: np.ndarray, grid: "Grid") -> np.ndarray:
    """Share values at the nodes of the bed among the cells of a grid.

    A node stands for the square around it. Every cell takes the part of each square that lies in it, also on a
    rotated Grid, so that depth times area has the sum of the frame.

    Parameters
    ----------
    change : dict
        `frame_files.read_bed_change`: eroded_mass [kg m-2], row 0 in the south; transform; bed_density [kg m-3]; with
        forest detrained_mass and broken_forest.
    depth : float64[node rows, node columns]
        Depth, or another value per area, at the nodes of `change`.
    grid : Grid

    Returns
    -------
    float64[rows, columns]
        0 beyond the nodes.
    """
    side, _, west, _, _, south = np.asarray(change["transform"]).tolist()
    corner_east, corner_north = grid.corner
    vectors = (west - corner_east, south - corner_north), (side, 0.0), (0.0, side)
    corner, to_east, to_north = (np.array([along(grid.axes, k, *vector) for k in (0, 1)]) for vector in vectors)
    cells = np.zeros(grid.shape)
    amount = np.ascontiguousarray(depth, float) * (side * side / grid.cell_area)
    share_squares(amount, corner, to_east, to_north, cells)
    return cells


def share_beyond(change: dict, mass: np.ndarray, grid: "Grid") -> float:
    """Compute the share [1] of a mass at the nodes of the bed that lies beyond a grid.

    The square of a node on the edge of the DTM is half beyond it.

    Parameters
    ----------
    change : dict
        As in `on_cells`.
    mass : float64[node rows, node columns] [kg m-2]
    grid : Grid
    """
    total = float(np.sum(mass)) * float(np.asarray(change["transform"])[0]) ** 2
    if total == 0.0:
        return 0.0
    return max(1.0 - float(on_cells(change, mass, grid).sum()) * grid.cell_area / total, 0.0)


def largest_rate(changes: Iterable, times: Sequence, grid: "Grid") -> np.ndarray:
    """Compute the largest speed [m s-1] at which the bed receded between two frames.

    Parameters
    ----------
    changes : iterable of dict
        One for each frame, in order of time; empty where a frame stores none.
    times : sequence of float [s]
    grid : Grid

    Returns
    -------
    float64[rows, columns]
    """
    largest, before = np.zeros(grid.shape), None
    for time, change in zip(times, changes, strict=True):
        if not change:
            continue
        depth = eroded_depth(change, grid)
        if before is not None and time > before[0]:
            np.maximum(largest, (depth - before[1]) / (time - before[0]), out=largest)
        before = time, depth
    return largest


def bounds_of(change: dict) -> tuple | None:
    """Find the bounds of the nodes whose bed changed.

    Parameters
    ----------
    change : dict
        As in `on_cells`.

    Returns
    -------
    (float, float, float, float) or None
        West, south, east, north [m]; None where no bed changed.
    """
    mass = change["eroded_mass"]
    changed = [change[name] for name in ("eroded_mass", "detrained_mass", "broken_forest") if name in change]
    if not any((values > 0).any() for values in changed):
        return None
    side, _, west, _, _, south = np.asarray(change["transform"]).tolist()
    return west, south, west + side * mass.shape[1], south + side * mass.shape[0]
