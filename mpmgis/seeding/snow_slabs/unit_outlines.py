"""Trace the outlines of numbered groups of cells as polygons along the sides of the cells."""

import numpy as np
import shapely

from ...compiled.jit import jit
from ...terrain.grid import Grid


def outlines(labels: np.ndarray, grid: Grid) -> np.ndarray:
    """Return the polygon of each group of cells.

    Parameters
    ----------
    labels : int32[rows, columns]
        Number of the group of each cell, from 1; 0 outside. The cells of a group are connected by sides.
    grid : Grid
        Of the cells.

    Returns
    -------
    object[n]
        Of shapely.Polygon [m], in the order of the numbers.
    """
    nothing = np.empty((0, 2), np.int32)
    points, rings = _trace(labels, nothing, nothing)
    corners, ends = np.empty((points, 2), np.int32), np.empty((rings, 2), np.int32)
    _trace(labels, corners, ends)
    group, last = ends.T
    ring = np.repeat(np.arange(rings), np.diff(last, prepend=0))
    row, column = corners.T
    x, y = grid.xy(row - 0.5, column - 0.5)
    lines = shapely.linearrings(np.stack([x, y], 1), indices=ring)
    area = np.zeros(rings)  # positive for a hole: rings have their cells on the right, rows run down
    step = np.diff(ring, append=-1) == 0
    at, after = np.flatnonzero(step), np.flatnonzero(step) + 1
    np.add.at(area, ring[at], row[at].astype(float) * column[after] - row[after].astype(float) * column[at])
    order = np.lexsort((area > 0, group))
    return shapely.polygons(lines[order], indices=group[order] - 1)


@jit
def _trace(labels, corners, ends):
    """Walk along the border of each group with its cells on the right, and count the corners and the rings.

    Where there is room, corners (row, column) of the cells are written, the first of a ring also last, and for each
    ring its group and the number of corners up to its end. Cells that touch at a corner are connected there, so that
    a hole touches another ring and no ring touches itself.
    """
    rows, columns = labels.shape
    seen = np.zeros((rows, columns), np.bool_)  # upper side of a cell
    points, rings = 0, 0
    for i0 in range(rows):
        for j0 in range(columns):
            one = labels[i0, j0]
            if one == 0 or seen[i0, j0] or (i0 > 0 and labels[i0 - 1, j0] == one):
                continue
            i, j, di, dj = i0, j0, 0, 1  # at a corner of cells; eastward
            start = points
            while True:
                if di == 0 and dj == 1:
                    seen[i, j] = True
                i, j = i + di, j + dj
                ri, rj = i + (di + dj - 1) // 2, j + (dj - di - 1) // 2  # cell ahead on the right
                li, lj = i + (di - dj - 1) // 2, j + (dj + di - 1) // 2  # cell ahead on the left
                left = 0 <= li < rows and 0 <= lj < columns and labels[li, lj] == one
                right = 0 <= ri < rows and 0 <= rj < columns and labels[ri, rj] == one
                if left or not right:
                    if len(corners) > 0:
                        corners[points, 0] = i
                        corners[points, 1] = j
                    points += 1
                    di, dj = (-dj, di) if left else (dj, -di)
                if i == i0 and j == j0 and di == 0 and dj == 1:
                    break
            if len(corners) > 0:
                corners[points, 0] = corners[start, 0]
                corners[points, 1] = corners[start, 1]
            points += 1
            if len(ends) > 0:
                ends[rings, 0] = one
                ends[rings, 1] = points
            rings += 1
    return points, rings
