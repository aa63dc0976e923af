"""Columns of seeding at points of Halton's sequence.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math
from typing import NamedTuple

import numpy as np

from .cell_fill import evaluate, mapped
from .inside_polygon import is_inside
from .jit import jit, jit_inline, jit_parallel, prange
from .polygon_cover import find, in_span
from .random_numbers import halton, uniform
from .raster_values import valid_at


@jit_inline
def _in_whole_cell(u, v, columns, spans, span_start):
    """Is (u, v) in a cell that the polygon covers whole?"""
    row, column = math.floor(v), math.floor(u)
    if row < 0 or row >= span_start.size - 1 or column < 0 or column >= columns:
        return False
    return in_span(spans, span_start[row], span_start[row + 1], column)


class Sequence(NamedTuple):
    """Points of Halton's sequence (bases 2 and 3), moved by `shift` and mapped to `box` (u0, v0, width, height).

    With `beta` a point survives with the probability (1 + beta min(tan slope, 1)) / (1 + beta), by random numbers of
    `seed`, and stands for an area in inverse proportion. `slope` float64[rows, columns] is tan of the slope and
    `slope_map` the affine from (u, v) to its pixels; `area` [m2] is that of a point of weight 1.
    """

    shift: np.ndarray
    box: np.ndarray
    beta: float
    slope: np.ndarray
    slope_map: np.ndarray
    seed: int
    area: float


@jit
def covered(u, v, cover, edges):
    """Is (u, v) inside the polygon of `cover` and `edges` (Edges)? Edges are tested in rim cells only.

    Kernels call `_in_whole_cell` first, because a call with many arrays is more expensive.
    """
    columns, rim_start = cover.columns, cover.rim_start
    if _in_whole_cell(u, v, columns, cover.spans, cover.span_start):
        return True
    row, column = math.floor(v), math.floor(u)
    if row < 0 or row >= rim_start.size - 1 or column < 0 or column >= columns:
        return False
    if find(cover.rim_key, rim_start[row], rim_start[row + 1], row * columns + column) < 0:
        return False
    return is_inside(u, v, edges.ends, edges.start, edges.index)


@jit
def halton_chunk(index, size, quota, sequence, cover, edges, points):
    """Fill points float64[:, 3] (u, v, area [m2]) with those of `size` Halton points from `index` on that lie inside.

    Returns
    -------
    taken, weights : int, float
        Their number (at most `quota`) and sum of weights.
    """
    taken, weights = 0, 0.0
    columns, spans, span_start = cover.columns, cover.spans, cover.span_start
    shift, box, beta, slope = sequence.shift, sequence.box, sequence.beta, sequence.slope
    for k in range(index, index + size):
        if taken >= quota:
            break
        s, t = halton(k)
        s, t = s + shift[0], t + shift[1]
        u, v = box[0] + box[2] * (s - math.floor(s)), box[1] + box[3] * (t - math.floor(t))
        if not _in_whole_cell(u, v, columns, spans, span_start) and not covered(u, v, cover, edges):
            continue
        weight = 1.0
        if beta > 0.0:
            i, j = mapped(sequence.slope_map, u, v)
            density = 1.0 + beta * min(valid_at(slope, i, j), 1.0)
            if uniform(sequence.seed, k, 7, 7) * (1.0 + beta) >= density:
                continue
            weight = 1.0 / density
        points[taken, 0], points[taken, 1], points[taken, 2] = u, v, weight * sequence.area
        taken += 1
        weights += weight
    return taken, weights


@jit_parallel
def halton_chunks(first, last, size, quota, offsets, sequence, cover, edges, ground, out):
    """Columns at points of Halton's sequence inside a polygon; chunks of `size` indices.

    `quota` int64[chunks] is the most points that a chunk gives; chunk `first + c` is written from number
    ``offsets[c]`` on.

    Returns
    -------
    float64[last - first, 5]
        Sum, smallest and largest of thickness times area [m3] of a chunk, its points, sum of their weights.
    """
    sums = np.zeros((last - first, 5))
    sums[:, 1] = np.inf
    for c in prange(last - first):
        points = np.empty((size, 3))
        index = (first + c) * size + 1
        taken, weights = halton_chunk(index, size, quota[first + c], sequence, cover, edges, points)
        evaluate(points, taken, offsets[c], ground, out, sums[c])
        sums[c, 3], sums[c, 4] = taken, weights
    return sums
