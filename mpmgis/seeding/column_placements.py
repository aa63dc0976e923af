"""Columns of equal mass, and columns at the points of Halton's sequence, in a polygon.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_inline, jit_parallel, prange
from .cell_fill import evaluate, mapped
from .polygon_cover import find, in_span
from .polygon_points import is_inside
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


class Strips(NamedTuple):
    """Strips of cells: strip s lies between ``borders[s] <= v < borders[s + 1]`` and is cut into ``counts[s]`` pieces,
    the first of which has the number ``start[s]``."""

    borders: np.ndarray
    counts: np.ndarray
    start: np.ndarray


class Spread(NamedTuple):
    """Where a column lies in its piece: at the centroid with `width` 0, otherwise random numbers of `seed` (or those of
    Halton's sequence, moved by `shift`, if `sequence`) pick the quantile of mass along the strip and the height in it,
    over the middle `width` of both."""

    width: float
    sequence: bool
    seed: int
    shift: np.ndarray


@jit
def cover_row_sum(row, cover, thick, thick_map, sums):
    """Fill sums float64[2]: sum of thickness times covered share, and of covered share, of a row of cells."""
    spans, span_start, rim, rim_start = cover.spans, cover.span_start, cover.rim, cover.rim_start
    for s in range(span_start[row], span_start[row + 1]):
        for column in range(spans[s, 1], spans[s, 2]):
            i, j = mapped(thick_map, column + 0.5, row + 0.5)
            sums[0] += valid_at(thick, i, j)
            sums[1] += 1.0
    for m in range(rim_start[row], rim_start[row + 1]):
        i, j = mapped(thick_map, cover.rim_key[m] - row * cover.columns + rim[m, 1], row + rim[m, 2])
        sums[0] += valid_at(thick, i, j) * rim[m, 0]
        sums[1] += rim[m, 0]


@jit_parallel
def cover_row_sums(cover, thick, thick_map):
    """float64[rows, 2]: `cover_row_sum` of every row of cells."""
    sums = np.zeros((cover.rows, 2))
    for row in prange(cover.rows):
        cover_row_sum(np.int64(row), cover, thick, thick_map, sums[row])
    return sums


@jit_inline
def _add_cell(sums, column, u, v, mass):
    sums[0, column] += mass
    sums[1, column] += mass * u
    sums[2, column] += mass * v


@jit
def strip_columns(v0, v1, cover, thick, thick_map):
    """float64[3, columns]: thickness times area, and its u- and v-moment, of each column of cells of a strip."""
    sums = np.zeros((3, cover.columns))
    spans, span_start, rim, rim_start = cover.spans, cover.span_start, cover.rim, cover.rim_start
    for row in range(math.floor(v0), math.ceil(v1)):
        low, high = max(v0, row), min(v1, row + 1.0)
        share = high - low
        if share <= 0.0:
            continue
        middle = 0.5 * (low + high)
        for s in range(span_start[row], span_start[row + 1]):
            for column in range(spans[s, 1], spans[s, 2]):
                i, j = mapped(thick_map, column + 0.5, row + 0.5)
                _add_cell(sums, column, column + 0.5, middle, share * valid_at(thick, i, j))
        for m in range(rim_start[row], rim_start[row + 1]):
            column = cover.rim_key[m] - row * cover.columns
            u = column + rim[m, 1]
            i, j = mapped(thick_map, u, row + rim[m, 2])
            v = min(max(middle + rim[m, 2] - 0.5, low), high)
            _add_cell(sums, column, u, v, share * rim[m, 0] * valid_at(thick, i, j))
    return sums


@jit_inline
def _thickest(column, v0, v1, cover):
    """A point inside the polygon in the cell of `column` that the strip covers most."""
    best, u, v = -1.0, 0.0, 0.0
    rim, rim_start, span_start = cover.rim, cover.rim_start, cover.span_start
    for row in range(math.floor(v0), math.ceil(v1)):
        share = min(v1, row + 1.0) - max(v0, row)
        at = find(cover.rim_key, rim_start[row], rim_start[row + 1], row * cover.columns + column)
        if at >= 0 and share * rim[at, 0] > best:
            best, u, v = share * rim[at, 0], column + rim[at, 1], row + rim[at, 2]
        elif at < 0 and share > best and in_span(cover.spans, span_start[row], span_start[row + 1], column):
            best, u, v = share, column + 0.5, row + 0.5
    return u, v


@jit
def cut_equal(sums, count, quantile):
    """Cut a strip's columns into `count` pieces of equal mass, from left to right.

    Returns
    -------
    float64[count, 4]
        Centroid (u, v), the u below which `quantile[i]` of the piece's mass lies, the column at its median.
    """
    columns = sums.shape[1]
    pieces = np.zeros((count, 4))
    each = sums[0].sum() / count
    i, filled = 0, 0.0
    for column in range(columns):
        mass = sums[0, column]
        if mass <= 0.0:
            continue
        inverse = 1.0 / mass
        u, v, used = sums[1, column] * inverse, sums[2, column] * inverse, 0.0
        half = min(u - column, column + 1.0 - u)
        scale = 2.0 * half * inverse
        while used < mass and i < count:
            part = mass - used
            if filled + part > each and i < count - 1:
                part = each - filled
            low, high = u - half + scale * used, u - half + scale * (used + part)
            pieces[i, 0] += part * 0.5 * (low + high)
            pieces[i, 1] += part * v
            if filled <= quantile[i] * each:
                share = min(max((quantile[i] * each - filled) / part, 0.0), 1.0) if part > 0.0 else 0.0
                pieces[i, 2] = low + share * (high - low)
            if filled <= 0.5 * each:
                pieces[i, 3] = column
            filled += part
            used += part
            if filled >= each and i < count - 1:
                pieces[i, 0] /= filled
                pieces[i, 1] /= filled
                i += 1
                filled = 0.0
            elif part <= 0.0:
                break
    if filled > 0.0:
        pieces[i, 0] /= filled
        pieces[i, 1] /= filled
    return pieces


@jit
def strip_points(strip, strips, spread, cover, edges, thick, thick_map):
    """float64[count, 3]: (u, v, 0) of a strip's columns of equal mass; see `fill_strips`."""
    v0, v1, count = strips.borders[strip], strips.borders[strip + 1], strips.counts[strip]
    width, shift = spread.width, spread.shift
    across, up = np.full(count, 0.5), np.full(count, 0.5)
    if width > 0.0:
        for k in range(count):
            if spread.sequence:
                a, b = halton(strips.start[strip] + k + 1)
                a, b = a + shift[0], b + shift[1]
                a, b = a - math.floor(a), b - math.floor(b)
            else:
                a, b = uniform(spread.seed, strip, k, 0), uniform(spread.seed, strip, k, 1)
            across[k], up[k] = 0.5 + width * (a - 0.5), 0.5 + width * (b - 0.5)
    pieces = cut_equal(strip_columns(v0, v1, cover, thick, thick_map), count, across)
    points = np.zeros((count, 3))
    for k in range(count):
        u, v = pieces[k, 0], pieces[k, 1]
        if width > 0.0:
            u, v = pieces[k, 2], v0 + up[k] * (v1 - v0)
        if not _in_whole_cell(u, v, cover.columns, cover.spans, cover.span_start) and not covered(u, v, cover, edges):
            u, v = _thickest(np.int64(pieces[k, 3]), v0, v1, cover)
        points[k, 0], points[k, 1] = u, v
    return points


@jit_parallel
def fill_strips(first, last, offsets, strips, spread, cover, edges, ground, out):
    """Columns of equal mass in the strips first <= s < last, strip `first + c` written from number ``offsets[c]`` on.

    `strips` (Strips) and `spread` (Spread) place the columns. What would fall outside the polygon goes to the thickest
    cell at the piece's median.
    """
    sums = np.zeros((last - first, 3))
    for c in prange(last - first):
        s = first + c
        points = strip_points(s, strips, spread, cover, edges, ground.thick, ground.thick_map)
        evaluate(points, strips.counts[s], offsets[c], ground, out, sums[c])
