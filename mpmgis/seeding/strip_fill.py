"""Columns of equal mass in a polygon, by strips of lattice cells."""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_inline, jit_parallel, prange
from .cell_fill import evaluate_columns, map_point
from .polygon_cover import find_key, in_span
from .polygon_points import covered, in_whole_cell
from .random_numbers import halton, uniform
from .raster_values import valid_at


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
            i, j = map_point(thick_map, column + 0.5, row + 0.5)
            sums[0] += valid_at(thick, i, j)
            sums[1] += 1.0
    for m in range(rim_start[row], rim_start[row + 1]):
        i, j = map_point(thick_map, cover.rim_key[m] - row * cover.columns + rim[m, 1], row + rim[m, 2])
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
                i, j = map_point(thick_map, column + 0.5, row + 0.5)
                _add_cell(sums, column, column + 0.5, middle, share * valid_at(thick, i, j))
        for m in range(rim_start[row], rim_start[row + 1]):
            column = cover.rim_key[m] - row * cover.columns
            u = column + rim[m, 1]
            i, j = map_point(thick_map, u, row + rim[m, 2])
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
        at = find_key(cover.rim_key, rim_start[row], rim_start[row + 1], row * cover.columns + column)
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
        if not in_whole_cell(u, v, cover.columns, cover.spans, cover.span_start) and not covered(u, v, cover, edges):
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
        evaluate_columns(points, strips.counts[s], offsets[c], ground, out, sums[c])
