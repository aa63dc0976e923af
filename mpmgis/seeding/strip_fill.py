"""Columns of equal mass in a polygon, by strips of lattice cells.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_inline, jit_parallel, prange
from .cell_fill import Ground, Output, evaluate_columns, map_point
from .polygon_cover import Cover, find_key, in_span
from .polygon_points import Edges, covered, in_whole_cell
from .random_numbers import halton, uniform
from .raster_values import valid_at


class Strips(NamedTuple):
    """Strips of cells: strip s lies between ``borders[s] <= v < borders[s + 1]``.

    Parameters
    ----------
    borders : float64[strips + 1]
    counts : int64[strips]
        Number of pieces, with one column each, into which a strip is cut.
    start : int64[strips]
        Number of the first piece of each strip.
    """

    borders: np.ndarray
    counts: np.ndarray
    start: np.ndarray


class Spread(NamedTuple):
    """Place of a column in its piece.

    With `width` 0 it is the centroid. Otherwise random numbers pick the quantile of mass along the strip and the height
    in it, over the middle `width` of both.

    Parameters
    ----------
    width : float
        0 to 1.
    sequence : bool
        Take the numbers of Halton's sequence instead of random ones.
    seed : int
        Of the random numbers.
    shift : float64[2]
        Added to the numbers of the sequence, modulo 1.
    """

    width: float
    sequence: bool
    seed: int
    shift: np.ndarray


@jit
def cover_row_sum(row: int, cover: Cover, thick: np.ndarray, thick_map: np.ndarray, sums: np.ndarray) -> None:
    """Sum up thickness and covered share of a row of cells.

    Parameters
    ----------
    row : int
    cover : Cover
    thick : float64[rows, columns] [m]
    thick_map : float64[6]
        Affine from (u, v) to the pixels of `thick`.
    sums : float64[2]
        Updated: sum of thickness times covered share, and of covered share.
    """
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
def cover_row_sums(cover: Cover, thick: np.ndarray, thick_map: np.ndarray) -> np.ndarray:
    """Compute `cover_row_sum` of every row of cells.

    Parameters
    ----------
    cover : Cover
    thick : float64[rows, columns] [m]
    thick_map : float64[6]
        Affine from (u, v) to the pixels of `thick`.

    Returns
    -------
    float64[rows, 2]
    """
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
def strip_columns(v0: float, v1: float, cover: Cover, thick: np.ndarray, thick_map: np.ndarray) -> np.ndarray:
    """Sum up thickness times area of each column of cells of a strip.

    Parameters
    ----------
    v0, v1 : float
        Borders of the strip.
    cover : Cover
    thick : float64[rows, columns] [m]
    thick_map : float64[6]
        Affine from (u, v) to the pixels of `thick`.

    Returns
    -------
    float64[3, columns]
        Thickness times area, and its u- and v-moment.
    """
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
def _thickest(column: int, v0: float, v1: float, cover: Cover) -> tuple[float, float]:
    """Return a point inside the polygon in the cell of `column` that the strip covers most."""
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
def cut_equal(sums: np.ndarray, count: int, quantile: np.ndarray) -> np.ndarray:
    """Cut a strip's columns of cells into pieces of equal mass, from left to right.

    Parameters
    ----------
    sums : float64[3, columns]
        From `strip_columns`.
    count : int
        Number of pieces.
    quantile : float64[count]
        0 to 1.

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
    strip: int, strips: Strips, spread: Spread, cover: Cover, edges: Edges, thick: np.ndarray, thick_map: np.ndarray
) -> np.ndarray:
    """Place a strip's columns of equal mass.

    A column that would lie outside the polygon goes to the cell, at the piece's median, that the strip covers most.

    Parameters
    ----------
    strip : int
    strips : Strips
    spread : Spread
    cover : Cover
    edges : Edges
    thick : float64[rows, columns] [m]
    thick_map : float64[6]
        Affine from (u, v) to the pixels of `thick`.

    Returns
    -------
    float64[count, 3]
        u, v, 0.
    """
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
def fill_strips(
    first: int,
    last: int,
    offsets: np.ndarray,
    strips: Strips,
    spread: Spread,
    cover: Cover,
    edges: Edges,
    ground: Ground,
    out: Output,
) -> None:
    """Write columns of equal mass in the strips first <= strip < last.

    Parameters
    ----------
    first, last : int
    offsets : int64[last - first]
        Strip `first + c` is written from number ``offsets[c]`` on.
    strips : Strips
    spread : Spread
    cover : Cover
    edges : Edges
    ground : Ground
    out : Output
    """
    sums = np.zeros((last - first, 3))
    for c in prange(last - first):
        s = first + c
        points = strip_points(s, strips, spread, cover, edges, ground.thick, ground.thick_map)
        evaluate_columns(points, strips.counts[s], offsets[c], ground, out, sums[c])
