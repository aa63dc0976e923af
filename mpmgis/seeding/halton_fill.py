"""Columns at those points of Halton's sequence that lie in a polygon.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_parallel, prange
from .cell_fill import Ground, Output, evaluate_columns, map_point
from .polygon_cover import Cover
from .polygon_points import Edges, covered, in_whole_cell
from .random_numbers import halton, uniform
from .raster_values import valid_at


class HaltonSequence(NamedTuple):
    """Points of Halton's sequence (bases 2 and 3), moved and mapped to a box.

    With `beta` a point survives with the probability (1 + beta min(tan slope, 1)) / (1 + beta), by random numbers of
    `seed`, and stands for an area in inverse proportion.

    Parameters
    ----------
    shift : float64[2]
        Added to the points of the unit square, modulo 1.
    box : float64[4]
        u0, v0, width, height.
    beta : float
    slope : float64[rows, columns]
        tan of the slope.
    slope_map : float64[6]
        Affine from (u, v) to the pixels of `slope`.
    seed : int
    area : float [m2]
        Area of a point of weight 1.
    """

    shift: np.ndarray
    box: np.ndarray
    beta: float
    slope: np.ndarray
    slope_map: np.ndarray
    seed: int
    area: float


@jit
def halton_chunk(
    index: int, size: int, quota: int, sequence: HaltonSequence, cover: Cover, edges: Edges, points: np.ndarray
) -> tuple[int, float]:
    """Collect those points of a chunk of Halton's sequence that lie inside the polygon.

    Parameters
    ----------
    index, size : int
        First index of the chunk, and number of its indices.
    quota : int
        Largest number of points.
    sequence : HaltonSequence
    cover : Cover
    edges : Edges
    points : float64[:, 3]
        Filled with u, v, area [m2].

    Returns
    -------
    taken, weights : int, float
        Number of points (at most `quota`) and sum of their weights.
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
def halton_chunks(
    first: int,
    last: int,
    size: int,
    quota: np.ndarray,
    offsets: np.ndarray,
    sequence: HaltonSequence,
    cover: Cover,
    edges: Edges,
    ground: Ground,
    out: Output,
) -> np.ndarray:
    """Evaluate columns at points of Halton's sequence inside a polygon, in the chunks first <= chunk < last.

    Parameters
    ----------
    first, last : int
    size : int
        Indices in a chunk.
    quota : int64[chunks]
        Largest number of points of each chunk.
    offsets : int64[last - first]
        Chunk `first + c` is written from number ``offsets[c]`` on.
    sequence : HaltonSequence
    cover : Cover
    edges : Edges
    ground : Ground
    out : Output

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
