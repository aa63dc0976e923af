"""Pieces of cells at the rim of a polygon, and slivers that join their neighbours.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1].
"""

import numpy as np

from ..compiled.jit import jit, jit_inline
from .polygon_cover import Cover, find_key, in_span

SLIVER = 0.05  # [1] share of a sub-square; a smaller rim piece would be a column of little mass and joins another


@jit
def cells_with_slivers(
    cell_key: np.ndarray, columns: int, rim_key: np.ndarray, share: np.ndarray, across: int, down: int
) -> np.ndarray:
    """Return which cells hold a sub-square that is covered by less than SLIVER.

    Parameters
    ----------
    cell_key : int64[m]
        row * columns + column of each cell, ascending.
    columns : int
    rim_key : int64[n]
        Rim of the lattice with every cell cut into sub-squares, as in Cover.
    share : float64[n]
        Covered share of each sub-square of the rim.
    across, down : int
        Number of sub-squares along the cell's sides.

    Returns
    -------
    bool[m]
    """
    sliver = np.zeros(cell_key.size, np.bool_)
    for i in range(rim_key.size):
        if share[i] < SLIVER:
            row, column = rim_key[i] // (columns * across), rim_key[i] % (columns * across)
            at = find_key(cell_key, 0, cell_key.size, (row // down) * columns + column // across)
            if at >= 0:
                sliver[at] = True
    return sliver


@jit
def gather_pieces(cells: np.ndarray, across: int, down: int, cover: Cover) -> tuple[np.ndarray, np.ndarray]:
    """Return the pieces of polygon in the sub-squares of each cell.

    Parameters
    ----------
    cells : int64[m, 2]
        Row and column.
    across, down : int
        Number of sub-squares along the cell's sides.
    cover : Cover
        Cover of the sub-squares.

    Returns
    -------
    owner : int64[n]
        Index into `cells`.
    pieces : float64[n, 5]
        Centroid (u, v) and area in cell units, area of a whole sub-square, number of edge pieces (0 = whole).
    """
    n = 0
    owner = np.empty(cells.shape[0] * across * down, np.int64)
    pieces = np.empty((owner.size, 5))
    unit = 1.0 / (across * down)
    rim, spans, columns = cover.rim, cover.spans, cover.columns
    for m in range(cells.shape[0]):
        for sy in range(down):
            row = cells[m, 0] * down + sy
            for sx in range(across):
                column = cells[m, 1] * across + sx
                at = find_key(cover.rim_key, cover.rim_start[row], cover.rim_start[row + 1], row * columns + column)
                if at >= 0:
                    share, cu, cv, edges = rim[at, 0], rim[at, 1], rim[at, 2], rim[at, 3]
                elif in_span(spans, cover.span_start[row], cover.span_start[row + 1], column):
                    share, cu, cv, edges = 1.0, 0.5, 0.5, 0.0
                else:
                    continue
                owner[n] = m
                pieces[n, 0], pieces[n, 1] = (column + cu) / across, (row + cv) / down
                pieces[n, 2], pieces[n, 3], pieces[n, 4] = share * unit, unit, edges
                n += 1
    return owner[:n], pieces[:n]


@jit
def merge_slivers(
    pieces: np.ndarray, starts: np.ndarray, cells: np.ndarray, columns: int, order: np.ndarray, forced: int
) -> np.ndarray:
    """Join slivers (below SLIVER of their sub-square) to the nearest piece, area and first moment kept.

    Parameters
    ----------
    pieces : float64[n, 5]
        From `gather_pieces`, sorted by cell; changed in place.
    starts : int64[m + 1]
        Start of each cell's pieces.
    cells : int64[m, 2]
        Row and column, ascending.
    columns : int
    order : int64[n]
        Pieces from small to large.
    forced : int
        So many of the smallest are joined whatever their size.

    Returns
    -------
    alive : bool[n]
        Pieces that were not joined to others.
    """
    alive = np.ones(pieces.shape[0], np.bool_)
    key = cells[:, 0] * columns + cells[:, 1]
    owner = np.empty(pieces.shape[0], np.int64)
    for m in range(cells.shape[0]):
        owner[starts[m] : starts[m + 1]] = m
    done = 0
    for i in order:
        small = pieces[i, 2] < SLIVER * pieces[i, 3]
        if not small and done >= forced:
            continue
        j = np.int64(-1)
        for large in (True, False):
            if j < 0:
                j = _nearest(i, pieces, starts, cells, key, columns, owner[i], alive, large)
        if j < 0:
            continue
        area = pieces[i, 2] + pieces[j, 2]
        for axis in range(2):
            pieces[j, axis] = (pieces[i, axis] * pieces[i, 2] + pieces[j, axis] * pieces[j, 2]) / area
        pieces[j, 2] = area
        pieces[j, 4] = 99.0  # no longer known to be convex
        alive[i] = False
        done += 1
    return alive


@jit_inline
def _nearest(i, pieces, starts, cells, key, columns, home, alive, large):
    """Return the nearest other piece alive in the 3 x 3 cells around, or -1; `large`: no sliver."""
    best, distance = np.int64(-1), np.inf
    for dr in range(-1, 2):
        for dc in range(-1, 2):
            m = find_key(key, 0, key.size, (cells[home, 0] + dr) * columns + cells[home, 1] + dc)
            if m < 0:
                continue
            for j in range(starts[m], starts[m + 1]):
                if j == i or not alive[j] or (large and pieces[j, 2] < SLIVER * pieces[j, 3]):
                    continue
                du, dv = pieces[i, 0] - pieces[j, 0], pieces[i, 1] - pieces[j, 1]
                if du * du + dv * dv < distance:
                    best, distance = np.int64(j), du * du + dv * dv
    return best
