"""Polygons on a lattice: rings around the marked cells of a mask, and points inside a polygon.

Cells belong together where they share a side (not a corner), as GDAL polygonises. Every ring is simple: where cells
touch at a corner, rings of one part run around the gap between them and rings of two parts run around the cells, so
that parts touch at points only, which is what valid polygons may do.
"""

import math
from typing import NamedTuple

import numpy as np

from .jit import jit, jit_inline
from .random_numbers import uniform


class Edges(NamedTuple):
    """Edges of a polygon: `ends` float64[n, 4] (u0, v0, u1, v1), and by rows of cells `start`, `index`: the edges that
    touch row r are ``index[start[r]:start[r + 1]]``."""

    ends: np.ndarray
    start: np.ndarray
    index: np.ndarray


@jit
def edges_by_row(edges, rows):
    """(starts int64[rows + 1], index int64[m]): the edges in each row of cells."""
    starts = np.zeros(rows + 1, np.int64)
    for e in range(edges.shape[0]):
        low, high = min(edges[e, 1], edges[e, 3]), max(edges[e, 1], edges[e, 3])
        for row in range(math.floor(low), min(math.floor(high), rows - 1) + 1):
            starts[row + 1] += 1
    for row in range(rows):
        starts[row + 1] += starts[row]
    index, at = np.empty(starts[rows], np.int64), starts[:-1].copy()
    for e in range(edges.shape[0]):
        low, high = min(edges[e, 1], edges[e, 3]), max(edges[e, 1], edges[e, 3])
        for row in range(math.floor(low), min(math.floor(high), rows - 1) + 1):
            index[at[row]] = e
            at[row] += 1
    return starts, index


@jit_inline
def is_inside(u, v, edges, starts, index):
    """Even-odd rule with half-open edges: a point on a vertex has one owner."""
    row = math.floor(v)
    if row < 0 or row >= starts.size - 1:
        return False
    odd = False
    for i in range(starts[row], starts[row + 1]):
        e = index[i]
        u0, v0, u1, v1 = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        if (v0 > v) != (v1 > v) and u < u0 + (u1 - u0) * ((v - v0) / (v1 - v0)):
            odd = not odd
    return odd


@jit
def inside(points, edges, starts, index):
    """bool[n]: whether the points float64[n, 2] are inside the polygon of `edges`."""
    result = np.empty(points.shape[0], np.bool_)
    for n in range(points.shape[0]):
        result[n] = is_inside(points[n, 0], points[n, 1], edges, starts, index)
    return result


@jit
def points_in_squares(corners, sizes, edges, starts, index):
    """float64[n, 2]: a point of the polygon in each square, the middle of the longest stretch on seven lines across it.

    `corners` float64[n, 2] are the squares' lower corners, `sizes` float64[n, 2] their sides; NaN where none is found.
    """
    points = np.full((corners.shape[0], 2), np.nan)
    for n in range(corners.shape[0]):
        low, high, longest = corners[n, 0], corners[n, 0] + sizes[n, 0], 0.0
        row = math.floor(corners[n, 1] + 0.5 * sizes[n, 1])
        if row < 0 or row >= starts.size - 1:
            continue
        crossings = np.empty(starts[row + 1] - starts[row])
        for line in range(1, 8):
            v = corners[n, 1] + 0.125 * line * sizes[n, 1]
            m = 0
            for i in range(starts[row], starts[row + 1]):
                e = index[i]
                if (edges[e, 1] > v) != (edges[e, 3] > v):
                    along = (v - edges[e, 1]) / (edges[e, 3] - edges[e, 1])
                    crossings[m] = edges[e, 0] + (edges[e, 2] - edges[e, 0]) * along
                    m += 1
            crossings[:m].sort()
            for k in range(0, m - 1, 2):
                u0, u1 = max(crossings[k], low), min(crossings[k + 1], high)
                if u1 - u0 > longest:
                    longest = u1 - u0
                    points[n, 0], points[n, 1] = 0.5 * (u0 + u1), v
    return points


@jit
def scatter_in_pieces(points, width, height, keys, seed, edges, starts, index):
    """Move each boundary point to a random place of its sub-square inside the polygon; it stays if 32 trials fail.

    `points` float64[n, 2] is changed in place; the squares of `width` x `height` [cells] hold them; `keys` int64[n, 3]
    are (cell column, cell row, number) for the random numbers.
    """
    for n in range(points.shape[0]):
        u0, v0 = math.floor(points[n, 0] / width[n]) * width[n], math.floor(points[n, 1] / height[n]) * height[n]
        for attempt in range(32):
            counter = (keys[n, 2] + 1) * 1024 + attempt * 2
            u = u0 + width[n] * uniform(seed, keys[n, 0], keys[n, 1], counter)
            v = v0 + height[n] * uniform(seed, keys[n, 0], keys[n, 1], counter + 1)
            if is_inside(u, v, edges, starts, index):
                points[n, 0], points[n, 1] = u, v
                break


# Directions along cell sides, each a left turn after the one before, and the cells ahead on the left and on the right
# of a corner (row, column) for each: corner (r, c) is the upper left one of cell (r, c).
WEST, SOUTH, EAST, NORTH = range(4)
STEP = np.array([[0, -1], [1, 0], [0, 1], [-1, 0]])
AHEAD_LEFT = np.array([[0, -1], [0, 0], [-1, 0], [-1, -1]])
AHEAD_RIGHT = np.array([[-1, -1], [0, -1], [0, 0], [-1, 0]])


@jit_inline
def root_of(parent, k):
    """The smallest label that label `k` belongs with; shortens the way there for the next time."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@jit
def label_parts(part, parent):
    """Number the marked cells of `part` (int32[rows + 2, columns + 2], 1 where marked, its rim 0) by parts, from 1.

    `parent` int32[labels] is working space: one more than half of the cells is enough. Answers the number of parts.
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
def count_corners(part):
    """How many corners the rings around the cells of `part` have in all, where the rim of `part` is 0."""
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
def turn_at(part, row, column, heading):
    """How many left turns to make at a corner, with the part's cells on the left: 1, 0 or -1 (to the right)."""
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
def trace_rings(part, corners, ends, parts, area):
    """Follow every ring around the cells of `part`, counter-clockwise on the map, holes clockwise.

    Parameters
    ----------
    part : int32[rows + 2, columns + 2]
        Number of each cell's part as `label_parts` gives it; cells under a side that was followed turn negative.
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
