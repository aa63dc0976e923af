"""Columns of seeding at points of Halton's sequence.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math

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


@jit
def covered(u, v, columns, rim_key, rim_start, spans, span_start, edges, edge_start, edge_index):
    """Is (u, v) inside the polygon? Edges are tested in rim cells only.

    Kernels ask `_in_whole_cell` first: a call with so many arrays costs more than that answer.
    """
    if _in_whole_cell(u, v, columns, spans, span_start):
        return True
    row, column = math.floor(v), math.floor(u)
    if row < 0 or row >= rim_start.size - 1 or column < 0 or column >= columns:
        return False
    if find(rim_key, rim_start[row], rim_start[row + 1], row * columns + column) < 0:
        return False
    return is_inside(u, v, edges, edge_start, edge_index)


@jit
def halton_chunk(
    index, size, quota, shift, box, columns, rim_key, rim_start, spans, span_start, edges, edge_start, edge_index, beta,
    slope, slope_map, seed, area, points,
):  # fmt: skip
    """Fill points float64[:, 3] (u, v, area [m2]) with those of `size` Halton points from `index` on that lie inside.

    Returns
    -------
    taken, weights : int, float
        Their number (at most `quota`) and sum of weights.
    """
    taken, weights = 0, 0.0
    for k in range(index, index + size):
        if taken >= quota:
            break
        s, t = halton(k)
        s, t = s + shift[0], t + shift[1]
        u, v = box[0] + box[2] * (s - math.floor(s)), box[1] + box[3] * (t - math.floor(t))
        if not _in_whole_cell(u, v, columns, spans, span_start) and not covered(
            u, v, columns, rim_key, rim_start, spans, span_start, edges, edge_start, edge_index
        ):
            continue
        weight = 1.0
        if beta > 0.0:
            i, j = mapped(slope_map, u, v)
            density = 1.0 + beta * min(valid_at(slope, i, j), 1.0)
            if uniform(seed, k, 7, 7) * (1.0 + beta) >= density:
                continue
            weight = 1.0 / density
        points[taken, 0], points[taken, 1], points[taken, 2] = u, v, weight * area
        taken += 1
        weights += weight
    return taken, weights


@jit_parallel
def halton_chunks(
    first, last, size, quota, write, offsets, shift, box, columns, rim_key, rim_start, spans, span_start, edges,
    edge_start, edge_index, beta, slope, slope_map, seed, area, place, bed, bed_map, thick, thick_map, law, position,
    out,
):  # fmt: skip
    """Points of Halton's sequence (bases 2 and 3, shifted) inside a polygon; chunks of `size` indices.

    With `beta` a point survives with the probability (1 + beta min(tan slope, 1)) / (1 + beta) and stands for an area
    in inverse proportion. `area` [m2] is that of a point of weight 1; `quota` int64[chunks] the most
    points that a chunk gives; `box` is (u0, v0, width, height).

    Returns
    -------
    float64[last - first, 5]
        Sum, smallest and largest of thickness times area [m3] of a chunk, its points, sum of their weights.
    """
    sums = np.zeros((last - first, 5))
    sums[:, 1] = np.inf
    for c in prange(last - first):
        points = np.empty((size, 3))
        taken, weights = halton_chunk(
            (first + c) * size + 1, size, quota[first + c], shift, box, columns, rim_key, rim_start, spans, span_start,
            edges, edge_start, edge_index, beta, slope, slope_map, seed, area, points,
        )  # fmt: skip
        evaluate(points, taken, offsets[c], write, place, bed, bed_map, thick, thick_map, law, position, out, sums[c])
        sums[c, 3], sums[c, 4] = taken, weights
    return sums
