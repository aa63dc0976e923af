"""Points inside a polygon: its edges by rows of cells, and a point of the polygon in each square.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1].
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_inline
from .polygon_cover import Cover, find_key, in_span
from .random_numbers import uniform


class Edges(NamedTuple):
    """Edges of a polygon, by rows of cells: those that touch row r are ``index[start[r]:start[r + 1]]``.

    Parameters
    ----------
    ends : float64[n, 4]
        u0, v0, u1, v1.
    start : int64[rows + 1]
    index : int64[m]
    """

    ends: np.ndarray
    start: np.ndarray
    index: np.ndarray


@jit
def edges_by_row(edges: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Sort the edges of a polygon by rows of cells.

    Parameters
    ----------
    edges : float64[n, 4]
        u0, v0, u1, v1.
    rows : int

    Returns
    -------
    starts : int64[rows + 1]
    index : int64[m]
        As in Edges.
    """
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
def is_inside(u: float, v: float, edges: np.ndarray, starts: np.ndarray, index: np.ndarray) -> bool:
    """Return whether a point is inside a polygon.

    Even-odd rule with half-open edges: a point on a vertex has one owner.

    Parameters
    ----------
    u, v : float
    edges : float64[n, 4]
    starts : int64[rows + 1]
    index : int64[m]
        As in Edges.
    """
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


@jit_inline
def in_whole_cell(u: float, v: float, columns: int, spans: np.ndarray, span_start: np.ndarray) -> bool:
    """Return whether a point is in a cell that the polygon covers whole.

    Parameters
    ----------
    u, v : float
    columns : int
    spans : int64[s, 3]
    span_start : int64[rows + 1]
        As in Cover.
    """
    row, column = math.floor(v), math.floor(u)
    if row < 0 or row >= span_start.size - 1 or column < 0 or column >= columns:
        return False
    return in_span(spans, span_start[row], span_start[row + 1], column)


@jit
def covered(u: float, v: float, cover: Cover, edges: Edges) -> bool:
    """Return whether a point is inside a polygon; edges are tested in rim cells only.

    Kernels call `in_whole_cell` first, because a call with many arrays is more expensive.

    Parameters
    ----------
    u, v : float
    cover : Cover
    edges : Edges
    """
    columns, rim_start = cover.columns, cover.rim_start
    if in_whole_cell(u, v, columns, cover.spans, cover.span_start):
        return True
    row, column = math.floor(v), math.floor(u)
    if row < 0 or row >= rim_start.size - 1 or column < 0 or column >= columns:
        return False
    if find_key(cover.rim_key, rim_start[row], rim_start[row + 1], row * columns + column) < 0:
        return False
    return is_inside(u, v, edges.ends, edges.start, edges.index)


@jit
def are_inside(points: np.ndarray, edges: np.ndarray, starts: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return which points are inside a polygon.

    Parameters
    ----------
    points : float64[n, 2]
    edges : float64[n, 4]
    starts : int64[rows + 1]
    index : int64[m]
        As in Edges.

    Returns
    -------
    bool[n]
    """
    result = np.empty(points.shape[0], np.bool_)
    for n in range(points.shape[0]):
        result[n] = is_inside(points[n, 0], points[n, 1], edges, starts, index)
    return result


@jit
def points_in_squares(
    corners: np.ndarray, sizes: np.ndarray, edges: np.ndarray, starts: np.ndarray, index: np.ndarray
) -> np.ndarray:
    """Find a point of the polygon in each square: the middle of the longest stretch on seven lines across it.

    Parameters
    ----------
    corners : float64[n, 2]
        Lower corners of the squares.
    sizes : float64[n, 2]
        Sides of the squares.
    edges : float64[n, 4]
    starts : int64[rows + 1]
    index : int64[m]
        As in Edges.

    Returns
    -------
    float64[n, 2]
        NaN where none is found.
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
def scatter_in_pieces(
    points: np.ndarray,
    width: np.ndarray,
    height: np.ndarray,
    keys: np.ndarray,
    seed: int,
    edges: np.ndarray,
    starts: np.ndarray,
    index: np.ndarray,
) -> None:
    """Move each point to a random place of its sub-square inside the polygon; it stays if 32 trials fail.

    Parameters
    ----------
    points : float64[n, 2]
        Changed in place.
    width, height : float64[n] [cells]
        Sides of the sub-square that holds each point.
    keys : int64[n, 3]
        Cell column, cell row, number, for the random numbers.
    seed : int
    edges : float64[n, 4]
    starts : int64[rows + 1]
    index : int64[m]
        As in Edges.
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
