"""Columns of seeding in whole cells and rim pieces, by lattice rows.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_inline, jit_parallel, prange
from .random_numbers import uniform
from .raster_values import linear_at, valid_at

JITTER = 0.5  # [sub-square sides] full width of a vertex's displacement; no more than 0.5, or quads fold
# arrangements of the particles of a whole cell
CENTRED = 0  # at the centres of tiles
JITTERED = 1  # at the centroids of displaced tiles
RANDOM = 2  # anywhere in the cell
STAGGERED = 3  # in tiles, no two at the same u or v
_DITHER = 1 << 40  # number of the draw that decides a cell's count, far from the draws of its particles


class Counting(NamedTuple):
    """Number of particles of a whole cell: ``n0 (1 + beta min(tan slope, 1))``, at most `largest`.

    Parameters
    ----------
    n0, beta : float
    slope : float64[rows, columns]
        tan of the slope.
    slope_map : float64[6]
        Affine from (u, v) to the pixels of `slope`.
    seed : int
        Of the random numbers, which are those of the cell (row + row0, column + column0).
    row0, column0 : int
    largest : int
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
    """Cut of a whole cell of K particles.

    Parameters
    ----------
    kind : int
        Arrangement: CENTRED, JITTERED, RANDOM or STAGGERED.
    rows : int64[largest + 1]
        A cell of K particles is cut into ``rows[K]`` rows.
    cell_area : float [m2]
    """

    kind: int
    rows: np.ndarray
    cell_area: float


class Ground(NamedTuple):
    """Rasters from which a column takes its values at (u, v), each with the affine of six numbers from (u, v).

    Parameters
    ----------
    place : float64[6]
        Affine to map coordinates [m] relative to the particles' origin.
    bed : float64[rows, columns] [m]
    bed_map : float64[6]
        Affine to the pixels of `bed`.
    thick : float64[rows, columns] [m]
        Vertical thickness.
    thick_map : float64[6]
        Affine to the pixels of `thick`.
    law : float64[3]
        Closure factor [1], density [kg m-3], volume [m3] of every column or 0 where mass follows thickness.
    """

    place: np.ndarray
    bed: np.ndarray
    bed_map: np.ndarray
    thick: np.ndarray
    thick_map: np.ndarray
    law: np.ndarray


class Output(NamedTuple):
    """Arrays into which columns are written.

    Parameters
    ----------
    write : bool
        Write the columns; without it only sums are computed.
    position : float64[n, 3] [m]
    columns : float64[4, n]
        Thickness [m], area [m2], volume [m3], mass [kg].
    """

    write: bool
    position: np.ndarray
    columns: np.ndarray


@jit_inline
def cell_count(counting: Counting, row: int, column: int) -> int:
    """Return the number of particles of a whole cell; a fraction of a particle is decided by chance per cell.

    Parameters
    ----------
    counting : Counting
    row, column : int
    """
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
def cell_counts(cells: np.ndarray, counting: Counting) -> np.ndarray:
    """Return the number of particles of each cell.

    Parameters
    ----------
    cells : int64[m, 2]
        Row and column.
    counting : Counting

    Returns
    -------
    int64[m]
    """
    counts = np.empty(cells.shape[0], np.int64)
    for m in range(cells.shape[0]):
        counts[m] = cell_count(counting, cells[m, 0], cells[m, 1])
    return counts


@jit
def count_rows(rows: int, inner: np.ndarray, inner_start: np.ndarray, counting: Counting) -> np.ndarray:
    """Count the particles in the inner cells of each row.

    Parameters
    ----------
    rows : int
        Number of rows.
    inner : int64[s, 3]
        Spans of inner cells: row, first column, column after the last.
    inner_start : int64[rows + 1]
        Start of each row in `inner`.
    counting : Counting

    Returns
    -------
    int64[rows]
    """
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
def displaced_corners(corners: np.ndarray, seed: int, i: int, j: int, across: int, down: int) -> None:
    """Compute the displaced corners of a cell's sub-squares; those on the border of the cell slide on it.

    The quads between them still tile the cell exactly, whatever its neighbours do.

    Parameters
    ----------
    corners : float64[(across + 1) (down + 1), 2]
        Filled, in units of the cell.
    seed : int
    i, j : int
        Column and row of the cell, for the random numbers.
    across, down : int
        Number of sub-squares along the cell's sides.
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
def _quad(corners: np.ndarray, first: int, second: int) -> tuple[float, float, float]:
    """Return centroid (u, v) and area of the quad with corners first, first + 1 below and second, second + 1 above."""
    x0, y0, x1, y1 = corners[first, 0], corners[first, 1], corners[first + 1, 0], corners[first + 1, 1]
    x3, y3, x2, y2 = corners[second, 0], corners[second, 1], corners[second + 1, 0], corners[second + 1, 1]
    lower = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    upper = (x2 - x0) * (y3 - y0) - (x3 - x0) * (y2 - y0)
    area = 0.5 * (lower + upper)
    u = (lower * (x0 + x1 + x2) + upper * (x0 + x2 + x3)) / (6.0 * area)
    v = (lower * (y0 + y1 + y2) + upper * (y0 + y2 + y3)) / (6.0 * area)
    return u, v, area


@jit_inline
def map_point(affine: np.ndarray, u: float, v: float) -> tuple[float, float]:
    """Apply an affine to the point (u, v).

    Parameters
    ----------
    affine : float64[6]
    u, v : float
    """
    return affine[0] * u + affine[1] * v + affine[2], affine[3] * u + affine[4] * v + affine[5]


@jit
def evaluate_columns(points: np.ndarray, count: int, n: int, ground: Ground, out: Output, sums: np.ndarray) -> None:
    """Evaluate columns at points; write them from number `n` on if `out.write`.

    Parameters
    ----------
    points : float64[:, 3]
        u, v, area [m2].
    count : int
        Number of points.
    n : int
    ground : Ground
    out : Output
    sums : float64[3]
        Updated: sum, smallest and largest of thickness times area [m3] before closure.
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
def cell_points(
    points: np.ndarray, corners: np.ndarray, row: int, column: int, count: int, counting: Counting, tiles: Tiles
) -> None:
    """Place the particles of a whole cell.

    The cell is cut into ``tiles.rows[count]`` rows that share `count` as evenly as whole numbers allow; every tile has
    the area cell / count and its particle at its centre (`tiles.kind` CENTRED), or is displaced (JITTERED), or the
    particle lies anywhere in the cell (RANDOM). STAGGERED particles lie in their tiles so that no two of a cell share u
    or v: the canonical arrangement of Chiu, Shirley and Wang (1994), whose sums stay even when the flow stretches it.

    Parameters
    ----------
    points : float64[:, 3]
        Filled with u, v, area [m2].
    corners : float64[:, 2]
        Working memory for JITTERED.
    row, column : int
    count : int
        Number of particles.
    counting : Counting
    tiles : Tiles
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
def fill_row(
    row: int,
    n: int,
    inner: np.ndarray,
    pieces: np.ndarray,
    counting: Counting,
    tiles: Tiles,
    ground: Ground,
    out: Output,
    sums: np.ndarray,
) -> None:
    """Evaluate the particles of one row of the lattice: whole cells tiled, rim pieces as they are.

    Parameters
    ----------
    row : int
    n : int
        Number of the first particle in `out`.
    inner : int64[:, 3]
        Spans of whole cells in this row.
    pieces : float64[:, 3]
        Rim pieces of this row: u, v, area [cells].
    counting : Counting
    tiles : Tiles
    ground : Ground
    out : Output
    sums : float64[3]
        Updated, as by `evaluate_columns`.
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
def fill_rows(
    first: int,
    last: int,
    offsets: np.ndarray,
    inner: np.ndarray,
    inner_start: np.ndarray,
    piece: np.ndarray,
    piece_start: np.ndarray,
    counting: Counting,
    tiles: Tiles,
    ground: Ground,
    out: Output,
) -> np.ndarray:
    """Evaluate the particles of the lattice rows first <= row < last.

    Parameters
    ----------
    first, last : int
    offsets : int64[last - first]
        Row `first + r` is written from number ``offsets[r]`` on.
    inner : int64[s, 3]
        Spans of whole cells: row, first column, column after the last.
    inner_start : int64[rows + 1]
        Start of each row in `inner`.
    piece : float64[p, 3]
        Rim pieces: u, v, area [cells].
    piece_start : int64[rows + 1]
        Start of each row in `piece`.
    counting : Counting
    tiles : Tiles
    ground : Ground
    out : Output

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
