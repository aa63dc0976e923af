"""Columns at those points of Halton's sequence that lie in a polygon."""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_parallel, prange
from .cell_fill import evaluate_columns, map_point
from .polygon_points import covered, in_whole_cell
from .random_numbers import halton, uniform
from .raster_values import valid_at


class Sequence(NamedTuple):
    """Points of Halton's sequence (bases 2 and 3), moved by `shift` and map_point to `box` (u0, v0, width, height).

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
        if not in_whole_cell(u, v, columns, spans, span_start) and not covered(u, v, cover, edges):
            continue
        weight = 1.0
        if beta > 0.0:
            i, j = map_point(sequence.slope_map, u, v)
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
        evaluate_columns(points, taken, offsets[c], ground, out, sums[c])
        sums[c, 3], sums[c, 4] = taken, weights
    return sums
