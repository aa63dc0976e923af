"""Columns of seeding in whole cells and rim pieces, by lattice rows.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math

import numpy as np

from .jit import jit, jit_inline, jit_parallel, prange
from .random_numbers import uniform
from .raster_values import linear_at, valid_at

JITTER = 0.5  # full width of a vertex's displacement over the sub-square's side; no more than 0.5
CENTRED, JITTERED, RANDOM, STAGGERED = 0, 1, 2, 3
_DITHER = 1 << 40  # the number by which a cell's random numbers decide its count


@jit_inline
def cell_count(n0, beta, slope, slope_map, row, column, seed, row0, column0, largest):
    """Particles of a whole cell: n0 (1 + beta min(tan slope, 1)), its fraction decided by chance per cell."""
    if beta == 0.0:
        return int(n0)
    u, v = column + 0.5, row + 0.5
    i = slope_map[0] * u + slope_map[1] * v + slope_map[2]
    j = slope_map[3] * u + slope_map[4] * v + slope_map[5]
    wanted = n0 * (1.0 + beta * min(valid_at(slope, i, j), 1.0))
    count = math.floor(wanted + uniform(seed, column + column0, row + row0, _DITHER))
    return min(max(count, 1), largest)


@jit
def cell_counts(cells, n0, beta, slope, slope_map, seed, row0, column0, largest):
    """int64[m]: `cell_count` of each cell (row, column)."""
    counts = np.empty(cells.shape[0], np.int64)
    for m in range(cells.shape[0]):
        counts[m] = cell_count(n0, beta, slope, slope_map, cells[m, 0], cells[m, 1], seed, row0, column0, largest)
    return counts


@jit
def count_rows(rows, inner, inner_start, n0, beta, slope, slope_map, seed, row0, column0, largest):
    """int64[rows]: particles in the inner cells of each row."""
    counts = np.zeros(rows, np.int64)
    for row in range(rows):
        for s in range(inner_start[row], inner_start[row + 1]):
            if beta == 0.0:
                counts[row] += (inner[s, 2] - inner[s, 1]) * int(n0)
                continue
            for column in range(inner[s, 1], inner[s, 2]):
                counts[row] += cell_count(n0, beta, slope, slope_map, row, column, seed, row0, column0, largest)
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
def mapped(affine, u, v):
    """The point (u, v) under an affine of six numbers."""
    return affine[0] * u + affine[1] * v + affine[2], affine[3] * u + affine[4] * v + affine[5]


@jit
def evaluate(points, count, n, write, place, bed, bed_map, thick, thick_map, law, position, columns, sums):
    """Evaluate columns at `count` points float64[:, 3] (u, v, area [m2]); write them to the rows from n on if `write`.

    `law` is (closure factor, density, volume of every column or 0 where mass follows thickness); `columns` is
    float64[4, n]: thickness, area, volume, mass. `sums` float64[3] takes sum, smallest and largest of thickness times
    area [m3] before closure.
    """
    for k in range(count):
        u, v, area = points[k, 0], points[k, 1], points[k, 2]
        i, j = mapped(thick_map, u, v)
        thickness = valid_at(thick, i, j)
        volume = thickness * area
        sums[0] += volume
        sums[1], sums[2] = min(sums[1], volume), max(sums[2], volume)
        if write:
            x, y = mapped(place, u, v)
            i, j = mapped(bed_map, u, v)
            position[n + k, 0], position[n + k, 1], position[n + k, 2] = x, y, linear_at(bed, i, j)
            if law[2] > 0.0:
                thickness, area, volume = thickness, law[2] / thickness, law[2]
            else:
                thickness = law[0] * thickness
                volume = thickness * area
            columns[0, n + k], columns[1, n + k], columns[2, n + k] = thickness, area, volume
            columns[3, n + k] = law[1] * volume


@jit
def cell_points(points, corners, row, column, count, down, kind, seed, row0, column0, cell_area):
    """Fill points float64[:, 3] (u, v, area [m2]) with the `count` particles of a whole cell.

    The cell is cut into `down` rows that share `count` as evenly as whole numbers allow; every tile has the area
    cell / count and its particle at its centre (`kind` CENTRED), or is displaced (JITTERED), or the particle lies
    anywhere in the cell (RANDOM). STAGGERED particles lie in their tiles so that no two of a cell share u or v: the
    canonical arrangement of Chiu, Shirley and Wang (1994), whose sums stay even when the flow stretches it.
    """
    i, j, across = column + column0, row + row0, count // down
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
            points[k, 0], points[k, 1], points[k, 2] = column + u, row + v, share * cell_area


@jit
def fill_row(
    row, n, write, inner, first_span, last_span, piece, first_piece, last_piece, kind, n0, beta, tile_rows, slope,
    slope_map, seed, row0, column0, cell_area, place, bed, bed_map, thick, thick_map, law, position, columns, sums,
):  # fmt: skip
    """Particles of one row of the lattice, written from n on: whole cells tiled, rim pieces as they are."""
    largest = tile_rows.size - 1
    points = np.empty((max(largest, last_piece - first_piece), 3))
    corners = np.empty((2 * largest + 2 if kind == JITTERED else 0, 2))
    for s in range(first_span, last_span):
        for column in range(inner[s, 1], inner[s, 2]):
            count = cell_count(n0, beta, slope, slope_map, row, column, seed, row0, column0, largest)
            cell_points(points, corners, row, column, count, tile_rows[count], kind, seed, row0, column0, cell_area)
            evaluate(points, count, n, write, place, bed, bed_map, thick, thick_map, law, position, columns, sums)
            n += count
    count = last_piece - first_piece
    for p in range(count):
        points[p, 0], points[p, 1] = piece[first_piece + p, 0], piece[first_piece + p, 1]
        points[p, 2] = piece[first_piece + p, 2] * cell_area
    evaluate(points, count, n, write, place, bed, bed_map, thick, thick_map, law, position, columns, sums)


@jit_parallel
def fill_rows(
    first, last, write, offsets, inner, inner_start, piece, piece_start, kind, n0, beta, tile_rows, slope, slope_map,
    seed, row0, column0, cell_area, place, bed, bed_map, thick, thick_map, law, position, columns,
):  # fmt: skip
    """`fill_row` of the lattice rows first <= row < last; a whole cell of K particles has ``tile_rows[K]`` rows.

    Returns
    -------
    float64[last - first, 3]
        Sum, smallest and largest of thickness times area [m3] before closure, a row.
    """
    sums = np.zeros((last - first, 3))
    sums[:, 1] = np.inf
    for r in prange(last - first):
        row = first + r
        fill_row(
            row, offsets[r], write, inner, inner_start[row], inner_start[row + 1], piece, piece_start[row],
            piece_start[row + 1], kind, n0, beta, tile_rows, slope, slope_map, seed, row0, column0, cell_area, place,
            bed, bed_map, thick, thick_map, law, position, columns, sums[r],
        )  # fmt: skip
    return sums
