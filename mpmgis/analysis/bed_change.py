"""Eroded depth and rate of erosion on the cells of an export, from what frames store of the bed."""

import numpy as np

from ..terrain.elevation import bilinear


def eroded_depth(change, grid):
    """Vertical depth [m] that the flow took from the bed, float64[rows, columns] on a Grid; 0 where it took nothing."""
    depth = np.asarray(change["eroded_mass"], dtype=float) / float(np.asarray(change["bed_density"]))
    return on_cells(change, depth, grid)


def on_cells(change, depth, grid):
    """`depth` at the nodes of `change`, or another array there, float64[rows, columns] on a Grid; 0 beyond them.

    Cells along east and north take the overlapping share of each node's square, so that the sum is that of the
    frame; on rotated cells values are interpolated between nodes.

    Parameters
    ----------
    change : dict
        `io.frames.read_bed_change`: eroded_mass [kg m-2], row 0 in the south; transform; bed_density [kg m-3]; with
        forest detrained_mass and broken_forest.
    depth : float64[rows, columns]
    grid : Grid
    """
    side, _, west, _, _, south = np.asarray(change["transform"]).tolist()
    if grid.is_rotated:
        padded = np.pad(depth, 1)
        x, y = grid.xy(*np.indices(grid.shape))
        between = bilinear(padded, (y - south) / side + 0.5, (x - west) / side + 0.5)
        return np.nan_to_num(between, nan=0.0)
    t, (rows, columns) = grid.transform, grid.shape
    across = _shares(t.c + t.a * np.arange(columns + 1), west + side * np.arange(depth.shape[1] + 1))
    along = _shares(t.f + t.e * np.arange(rows + 1), south + side * np.arange(depth.shape[0] + 1))
    return along @ depth @ across.T


def share_beyond(change, mass, grid):
    """Share [1] of a `mass` per area at the nodes of `change` that lies beyond a Grid; 0 on rotated cells.

    The square of a node on the edge of the DTM is half beyond it.
    """
    total = float(np.sum(mass)) * float(np.asarray(change["transform"])[0]) ** 2
    if grid.is_rotated or total == 0.0:
        return 0.0
    return max(1.0 - float(on_cells(change, np.asarray(mass, float), grid).sum()) * grid.cell_area / total, 0.0)


def _shares(cells, squares):
    """float64[cells, squares]: share of each cell's length that lies in each square, from the edges of both."""
    low, high = np.minimum(cells[:-1], cells[1:]), np.maximum(cells[:-1], cells[1:])
    overlap = np.minimum(high[:, None], squares[1:]) - np.maximum(low[:, None], squares[:-1])
    return np.clip(overlap, 0.0, None) / (high - low)[:, None]


def largest_rate(changes, times, grid):
    """Largest speed [m s-1] at which the bed receded between two frames, on a Grid.

    Parameters
    ----------
    changes : iterable of dict
        One for each frame, in order of time; empty where a frame stores none.
    times : sequence of float [s]
    grid : Grid
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


def bounds_of(change):
    """(west, south, east, north) [m] of the nodes whose bed changed; None where none did."""
    mass = change["eroded_mass"]
    changed = [change[name] for name in ("eroded_mass", "detrained_mass", "broken_forest") if name in change]
    if not any((values > 0).any() for values in changed):
        return None
    side, _, west, _, _, south = np.asarray(change["transform"]).tolist()
    return west, south, west + side * mass.shape[1], south + side * mass.shape[0]
