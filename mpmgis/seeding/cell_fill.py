"""Columns of seeding in whole cells and rim pieces, by lattice rows.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.

Pieces of cells at the rim of a polygon, and slivers that join their neighbours.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1].
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_inline, jit_parallel, prange
from .random_numbers import uniform
from .raster_values import linear_at, valid_at

JITTER = 0.5  # full width of a vertex's displacement over the sub-square's side; no more than 0.5
CENTRED, JITTERED, RANDOM, STAGGERED = 0, 1, 2, 3
_DITHER = 1 << 40  # the number by which a cell's random numbers decide its count


class Counting(NamedTuple):
    """Particles of a whole cell: ``n0 (1 + beta min(tan slope, 1))``, at most `largest`.

    `slope` float64[rows, columns] is tan of the slope and `slope_map` the affine from (u, v) to its pixels. Random
    numbers are those of `seed` in the cell (row + row0, column + column0).
    """

    n0: float
    beta: float
    slope: np.ndarray
    slope_map: np.ndarray
    seed: int
    row0: int
    column0: int
    largest: int


class Tiles(NamedTuple):
    """How a whole cell of K particles is cut: into ``rows[K]`` rows, by arrangement `kind`; `cell_area` [m2]."""

    kind: int
    rows: np.ndarray
    cell_area: float


class Ground(NamedTuple):
    """What a column takes from its place (u, v), each with the affine of six numbers from (u, v).

    `place` leads to map coordinates [m] relative to the particles' origin, `bed_map` and `thick_map` to the pixels of
    `bed` [m] and `thick` [m]. `law` is (closure factor, density [kg/m3], volume [m3] of every column or 0 where mass
    follows thickness).
    """

    place: np.ndarray
    bed: np.ndarray
    bed_map: np.ndarray
    thick: np.ndarray
    thick_map: np.ndarray
    law: np.ndarray


class Output(NamedTuple):
    """Where columns are written if `write`: `position` float64[n, 3] [m], and `columns` float64[4, n]: thickness [m],
    area [m2], volume [m3], mass [kg]."""

    write: bool
    position: np.ndarray
    columns: np.ndarray


@jit_inline
def cell_count(counting, row, column):
    """Particles of a whole cell by `counting`; the fraction is decided by chance per cell."""
    n0, beta, slope_map = counting.n0, counting.beta, counting.slope_map
    if beta == 0.0:
        return int(n0)
    u, v = column + 0.5, row + 0.5
    i = slope_map[0] * u + slope_map[1] * v + slope_map[2]
    j = slope_map[3] * u + slope_map[4] * v + slope_map[5]
    wanted = n0 * (1.0 + beta * min(valid_at(counting.slope, i, j), 1.0))
    count = math.floor(wanted + uniform(counting.seed, column + counting.column0, row + counting.row0, _DITHER))
    return min(max(count, 1), counting.largest)


@jit
def cell_counts(cells, counting):
    """int64[m]: `cell_count` of each cell (row, column)."""
    counts = np.empty(cells.shape[0], np.int64)
    for m in range(cells.shape[0]):
        counts[m] = cell_count(counting, cells[m, 0], cells[m, 1])
    return counts


@jit
def count_rows(rows, inner, inner_start, counting):
    """int64[rows]: particles in the inner cells of each row."""
    counts = np.zeros(rows, np.int64)
    for row in range(rows):
        for s in range(inner_start[row], inner_start[row + 1]):
            if counting.beta == 0.0:
                counts[row] += (inner[s, 2] - inner[s, 1]) * int(counting.n0)
                continue
            for column in range(inner[s, 1], inner[s, 2]):
                counts[row] += cell_count(counting, row, column)
    return counts


@jit
def displaced_corners(corners, seed, i, j, across, down):
    """Fill corners float64[:, 2] with the corners of a cell's sub-squares, displaced: those on its border slide on it.

    The quads between them still tile the cell exactly, whatever its neighbours do.
    """
    n = 0
    for sy in range(down + 1):
        for sx in range(across + 1):
            moved_u = JITTER / across if 0 < sx < across else 0.0
            moved_v = JITTER / down if 0 < sy < down else 0.0
            corners[n, 0] = sx / across + moved_u * (uniform(seed, i, j, 2 * n) - 0.5)
            corners[n, 1] = sy / down + moved_v * (uniform(seed, i, j, 2 * n + 1) - 0.5)
            n += 1


@jit_inline
def _quad(corners, first, second):
    """(centroid u, v, area) of the quad with lower corners first, first + 1 and upper corners second, second + 1."""
    x0, y0, x1, y1 = corners[first, 0], corners[first, 1], corners[first + 1, 0], corners[first + 1, 1]
    x3, y3, x2, y2 = corners[second, 0], corners[second, 1], corners[second + 1, 0], corners[second + 1, 1]
    lower = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    upper = (x2 - x0) * (y3 - y0) - (x3 - x0) * (y2 - y0)
    area = 0.5 * (lower + upper)
    u = (lower * (x0 + x1 + x2) + upper * (x0 + x2 + x3)) / (6.0 * area)
    v = (lower * (y0 + y1 + y2) + upper * (y0 + y2 + y3)) / (6.0 * area)
    return u, v, area


@jit_inline
def map_point(affine, u, v):
    """The point (u, v) under an affine of six numbers."""
    return affine[0] * u + affine[1] * v + affine[2], affine[3] * u + affine[4] * v + affine[5]


@jit
def evaluate_columns(points, count, n, ground, out, sums):
    """Evaluate columns at `count` points float64[:, 3] (u, v, area [m2]); write them from number n on if `out.write`.

    `sums` float64[3] takes sum, smallest and largest of thickness times area [m3] before closure.
    """
    thick, thick_map, bed, bed_map = ground.thick, ground.thick_map, ground.bed, ground.bed_map
    place, law, position, columns = ground.place, ground.law, out.position, out.columns
    for k in range(count):
        u, v, area = points[k, 0], points[k, 1], points[k, 2]
        i, j = map_point(thick_map, u, v)
        thickness = valid_at(thick, i, j)
        volume = thickness * area
        sums[0] += volume
        sums[1], sums[2] = min(sums[1], volume), max(sums[2], volume)
        if out.write:
            x, y = map_point(place, u, v)
            i, j = map_point(bed_map, u, v)
            position[n + k, 0], position[n + k, 1], position[n + k, 2] = x, y, linear_at(bed, i, j)
            if law[2] > 0.0:
                thickness, area, volume = thickness, law[2] / thickness, law[2]
            else:
                thickness = law[0] * thickness
                volume = thickness * area
            columns[0, n + k], columns[1, n + k], columns[2, n + k] = thickness, area, volume
            columns[3, n + k] = law[1] * volume


@jit
def cell_points(points, corners, row, column, count, counting, tiles):
    """Fill points float64[:, 3] (u, v, area [m2]) with the `count` particles of a whole cell.

    The cell is cut into ``tiles.rows[count]`` rows that share `count` as evenly as whole numbers allow; every tile has
    the area cell / count and its particle at its centre (`tiles.kind` CENTRED), or is displaced (JITTERED), or the
    particle lies anywhere in the cell (RANDOM). STAGGERED particles lie in their tiles so that no two of a cell share u
    or v: the canonical arrangement of Chiu, Shirley and Wang (1994), whose sums stay even when the flow stretches it.
    """
    kind, down, seed = tiles.kind, tiles.rows[count], counting.seed
    i, j, across = column + counting.column0, row + counting.row0, count // down
    if kind == JITTERED:
        displaced_corners(corners, seed, i, j, across, down)
    for sy in range(down):
        k0, k1 = (sy * count) // down, ((sy + 1) * count) // down
        for k in range(k0, k1):
            u, v, share = (k - k0 + 0.5) / (k1 - k0), 0.5 * (k0 + k1) / count, 1.0 / count
            if kind == JITTERED:
                corner = sy * (across + 1) + k - k0
                u, v, share = _quad(corners, corner, corner + across + 1)
            elif kind == RANDOM:
                u, v = uniform(seed, i, j, 2 * k), uniform(seed, i, j, 2 * k + 1)
            elif kind == STAGGERED:
                u, v = (k - k0 + (sy + 0.5) / down) / (k1 - k0), (k1 - (k - k0 + 0.5)) / count
            points[k, 0], points[k, 1], points[k, 2] = column + u, row + v, share * tiles.cell_area


@jit
def fill_row(row, n, inner, pieces, counting, tiles, ground, out, sums):
    """Particles of one row of the lattice, written from n on: whole cells tiled, rim pieces as they are.

    `inner` int64[:, 3] are the spans of whole cells in this row, `pieces` float64[:, 3] its rim pieces (u, v, area
    [cells]).
    """
    largest = counting.largest
    points = np.empty((max(largest, len(pieces)), 3))
    corners = np.empty((2 * largest + 2 if tiles.kind == JITTERED else 0, 2))
    for s in range(len(inner)):
        for column in range(inner[s, 1], inner[s, 2]):
            count = cell_count(counting, row, column)
            cell_points(points, corners, row, column, count, counting, tiles)
            evaluate_columns(points, count, n, ground, out, sums)
            n += count
    for p in range(len(pieces)):
        points[p, 0], points[p, 1], points[p, 2] = pieces[p, 0], pieces[p, 1], pieces[p, 2] * tiles.cell_area
    evaluate_columns(points, len(pieces), n, ground, out, sums)


@jit_parallel
def fill_rows(first, last, offsets, inner, inner_start, piece, piece_start, counting, tiles, ground, out):
    """`fill_row` of the lattice rows first <= row < last, row `first + r` written from number ``offsets[r]`` on.

    Returns
    -------
    float64[last - first, 3]
        Sum, smallest and largest of thickness times area [m3] before closure, a row.
    """
    sums = np.zeros((last - first, 3))
    sums[:, 1] = np.inf
    for r in prange(last - first):
        row = first + r
        spans = inner[inner_start[row] : inner_start[row + 1]]
        pieces = piece[piece_start[row] : piece_start[row + 1]]
        fill_row(row, offsets[r], spans, pieces, counting, tiles, ground, out, sums[r])
    return sums
