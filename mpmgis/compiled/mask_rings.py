"""Polygons on a lattice: rings around the marked cells of a mask, and points inside a polygon.

Cells belong together where they share a side (not a corner), as GDAL polygonises. Every ring is simple: where cells
touch at a corner, rings of one part run around the gap between them and rings of two parts run around the cells, so
that parts touch at points only, which is what valid polygons may do.
"""

import numpy as np

from .jit import jit, jit_inline

# Directions along cell sides, each a left turn after the one before, and the cells ahead on the left and on the right
# of a corner (row, column) for each: corner (r, c) is the upper left one of cell (r, c).
WEST, SOUTH, EAST, NORTH = range(4)
STEP = np.array([[0, -1], [1, 0], [0, 1], [-1, 0]])
AHEAD_LEFT = np.array([[0, -1], [0, 0], [-1, 0], [-1, -1]])
AHEAD_RIGHT = np.array([[-1, -1], [0, -1], [0, 0], [-1, 0]])


@jit_inline
def root_of(parent: np.ndarray, k: int) -> int:
    """Find the smallest label that a label belongs with, and shorten the way there for the next time.

    Parameters
    ----------
    parent : int32[labels]
        Label that each label belongs with; working space: one more than half of the cells is enough.
    k : int
        Label.
    """
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@jit
def label_parts(part: np.ndarray, parent: np.ndarray) -> int:
    """Number the marked cells by parts, from 1.

    Parameters
    ----------
    part : int32[rows + 2, columns + 2]
        Number of each cell's part, 0 in its rim; for `label_parts` 1 where a cell is marked.
    parent : int32[labels]
        Label that each label belongs with; working space: one more than half of the cells is enough.

    Returns
    -------
    int
        Number of parts.
    """
    rows, columns = part.shape
    labels = 0
    parent[0] = 0
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            if part[i, j] == 0:
                continue
            above, left = part[i - 1, j], part[i, j - 1]
            if above == 0 and left == 0:
                labels += 1
                parent[labels] = labels
                part[i, j] = labels
            elif above == 0 or left == 0:
                part[i, j] = max(above, left)
            else:
                a, b = root_of(parent, above), root_of(parent, left)
                parent[max(a, b)] = min(a, b)
                part[i, j] = min(a, b)
    parts = 0
    for k in range(1, labels + 1):  # a root precedes all its members
        if parent[k] == k:
            parts += 1
            parent[k] = parts
        else:
            parent[k] = parent[parent[k]]
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            part[i, j] = parent[part[i, j]]
    return parts


@jit
def count_corners(part: np.ndarray) -> int:
    """Count the corners that the rings around the cells of all parts have.

    Parameters
    ----------
    part : int32[rows + 2, columns + 2]
        Number of each cell's part, 0 in its rim; for `label_parts` 1 where a cell is marked.
    """
    rows, columns = part.shape
    corners = 0
    for i in range(1, rows):
        for j in range(1, columns):
            marked = (part[i - 1, j - 1] != 0) + (part[i - 1, j] != 0) + (part[i, j - 1] != 0) + (part[i, j] != 0)
            if marked == 1 or marked == 3:
                corners += 1
            elif marked == 2 and (part[i, j] != 0) == (part[i - 1, j - 1] != 0):
                corners += 2
    return corners


@jit_inline
def turn_at(part: np.ndarray, row: int, column: int, heading: int) -> int:
    """Count the left turns to make at a corner, with the part's cells on the left: 1, 0 or -1 (to the right).

    Parameters
    ----------
    part : int32[rows + 2, columns + 2]
        Number of each cell's part, 0 in its rim; for `label_parts` 1 where a cell is marked.
    row, column : int
        Corner.
    heading : int
        Direction of the way to the corner: WEST, SOUTH, EAST or NORTH.
    """
    left = part[row + AHEAD_LEFT[heading, 0], column + AHEAD_LEFT[heading, 1]]
    right = part[row + AHEAD_RIGHT[heading, 0], column + AHEAD_RIGHT[heading, 1]]
    if left != 0:
        return 0 if right == 0 else -1
    if right == 0:
        return 1
    behind = (heading + 1) % 4  # two cells that touch at this corner: the one behind on the left is ours
    ours = part[row + AHEAD_LEFT[behind, 0], column + AHEAD_LEFT[behind, 1]]
    return -1 if abs(ours) == abs(right) else 1


@jit
def trace_rings(part: np.ndarray, corners: np.ndarray, ends: np.ndarray, parts: np.ndarray, area: np.ndarray) -> int:
    """Follow every ring around the cells of all parts, counter-clockwise on the map, holes clockwise.

    Parameters
    ----------
    part : int32[rows + 2, columns + 2]
        As `label_parts` gives it; cells under a side that was followed turn negative.
    corners : float64[corners, 2], out
        Row and column of each ring's corners, counted in cells of the mask without its rim.
    ends : int64[rings], out
        One past the last corner of each ring. A fourth of the number of corners is enough for `ends`, `parts`, `area`.
    parts, area : int64[rings], out
        The part that a ring belongs to, and twice its area [cells], negative for a hole.

    Returns
    -------
    int
        Number of rings.
    """
    rows, columns = part.shape
    rings, k = 0, 0
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            if part[i, j] <= 0 or part[i - 1, j] != 0:
                continue  # every ring has a side that lies on top of a cell: start at its right end
            row, column, heading, twice = i, j + 1, WEST, 0
            parts[rings] = part[i, j]
            while True:
                if heading == WEST:
                    cell = part[row, column - 1]
                    if cell < 0:
                        break
                    part[row, column - 1] = -cell
                row_before, column_before = row, column
                row += STEP[heading, 0]
                column += STEP[heading, 1]
                twice += row_before * column - column_before * row
                turn = turn_at(part, row, column, heading)
                if turn != 0:
                    corners[k, 0], corners[k, 1] = row - 1, column - 1
                    k += 1
                    heading = (heading + turn) % 4
            ends[rings], area[rings] = k, twice
            rings += 1
    return rings
