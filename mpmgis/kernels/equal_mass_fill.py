"""Columns of equal mass: strips of a polygon, cut into pieces of equal mass.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math

import numpy as np

from .cell_fill import evaluate, mapped
from .halton_fill import _in_whole_cell, covered
from .jit import jit, jit_inline, jit_parallel, prange
from .polygon_cover import find, in_span
from .random_numbers import halton, uniform
from .raster_values import valid_at


@jit
def cover_row_sum(row, columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map, sums):
    """Fill sums float64[2]: sum of thickness times covered share, and of covered share, of a row of cells."""
    for s in range(span_start[row], span_start[row + 1]):
        for column in range(spans[s, 1], spans[s, 2]):
            i, j = mapped(thick_map, column + 0.5, row + 0.5)
            sums[0] += valid_at(thick, i, j)
            sums[1] += 1.0
    for m in range(rim_start[row], rim_start[row + 1]):
        i, j = mapped(thick_map, rim_key[m] - row * columns + rim[m, 1], row + rim[m, 2])
        sums[0] += valid_at(thick, i, j) * rim[m, 0]
        sums[1] += rim[m, 0]


@jit_parallel
def cover_row_sums(rows, columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map):
    """float64[rows, 2]: `cover_row_sum` of every row of cells."""
    sums = np.zeros((rows, 2))
    for row in prange(rows):
        cover_row_sum(np.int64(row), columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map, sums[row])
    return sums


@jit_inline
def _add_cell(sums, column, u, v, mass):
    sums[0, column] += mass
    sums[1, column] += mass * u
    sums[2, column] += mass * v


@jit
def strip_columns(v0, v1, columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map):
    """float64[3, columns]: thickness times area, and its u- and v-moment, of each column of cells of a strip."""
    sums = np.zeros((3, columns))
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
            column = rim_key[m] - row * columns
            u = column + rim[m, 1]
            i, j = mapped(thick_map, u, row + rim[m, 2])
            v = min(max(middle + rim[m, 2] - 0.5, low), high)
            _add_cell(sums, column, u, v, share * rim[m, 0] * valid_at(thick, i, j))
    return sums


@jit_inline
def _thickest(column, v0, v1, columns, rim_key, rim, rim_start, spans, span_start):
    """A point inside the polygon in the cell of `column` that the strip covers most."""
    best, u, v = -1.0, 0.0, 0.0
    for row in range(math.floor(v0), math.ceil(v1)):
        share = min(v1, row + 1.0) - max(v0, row)
        at = find(rim_key, rim_start[row], rim_start[row + 1], row * columns + column)
        if at >= 0 and share * rim[at, 0] > best:
            best, u, v = share * rim[at, 0], column + rim[at, 1], row + rim[at, 2]
        elif at < 0 and share > best and in_span(spans, span_start[row], span_start[row + 1], column):
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
def strip_points(
    strip, v0, v1, count, start, spread, sequence, seed, shift, columns, rim_key, rim, rim_start, spans, span_start,
    edges, edge_start, edge_index, thick, thick_map,
):  # fmt: skip
    """float64[count, 3]: (u, v, 0) of a strip's columns of equal mass; see `fill_strips`."""
    across, up = np.full(count, 0.5), np.full(count, 0.5)
    if spread > 0.0:
        for k in range(count):
            if sequence:
                a, b = halton(start + k + 1)
                a, b = a + shift[0], b + shift[1]
                a, b = a - math.floor(a), b - math.floor(b)
            else:
                a, b = uniform(seed, strip, k, 0), uniform(seed, strip, k, 1)
            across[k], up[k] = 0.5 + spread * (a - 0.5), 0.5 + spread * (b - 0.5)
    sums = strip_columns(v0, v1, columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map)
    pieces = cut_equal(sums, count, across)
    points = np.zeros((count, 3))
    for k in range(count):
        u, v = pieces[k, 0], pieces[k, 1]
        if spread > 0.0:
            u, v = pieces[k, 2], v0 + up[k] * (v1 - v0)
        if not _in_whole_cell(u, v, columns, spans, span_start) and not covered(
            u, v, columns, rim_key, rim_start, spans, span_start, edges, edge_start, edge_index
        ):
            u, v = _thickest(np.int64(pieces[k, 3]), v0, v1, columns, rim_key, rim, rim_start, spans, span_start)
        points[k, 0], points[k, 1] = u, v
    return points


@jit_parallel
def fill_strips(
    first, last, write, borders, counts, offsets, start, spread, sequence, seed, shift, columns, rim_key, rim,
    rim_start, spans, span_start, edges, edge_start, edge_index, place, bed, bed_map, thick, thick_map,
    law, position, out,
):  # fmt: skip
    """Columns of equal mass: every strip borders[s] <= v < borders[s + 1] is cut into counts[s] pieces.

    With `spread` 0 a column lies at its piece's centroid; otherwise at a place of the piece: random numbers (or
    Halton's, if `sequence`) pick the quantile of mass along the strip and the height in it, over the middle `spread` of
    both. What would fall outside the polygon goes to the thickest cell at the piece's median.
    """
    sums = np.zeros((last - first, 3))
    for c in prange(last - first):
        s = first + c
        points = strip_points(
            s, borders[s], borders[s + 1], counts[s], start[s], spread, sequence, seed, shift, columns, rim_key, rim,
            rim_start, spans, span_start, edges, edge_start, edge_index, thick, thick_map,
        )  # fmt: skip
        evaluate(
            points, counts[s], offsets[c], write, place, bed, bed_map, thick, thick_map, law, position, out, sums[c]
        )
