"""Sum the points in each cell of a raster, without arrays of the raster's size.

A table of sums has one row per cell and the columns MASS to VOLUME.
"""

from typing import NamedTuple

import numpy as np

from ...compiled.jit import jit, jit_inline
from .cell_places import upward_part_of_normal

# Columns of the table of sums, one row per cell.
MASS = 0  # [kg] sum of m
SLOPED = 1  # [kg] sum of m of the particles on a known slope: the weight of the means of columns 2 to 9
UPRIGHT = 2  # [kg] sum of m n_H
MOMENTUM = 3  # [kg m s-1] sum of m U, three columns: east, north, up
NORMAL = 6  # [kg m s-1] sum of m (U . n)
PARALLEL = 7  # [kg m s-1] sum of m U_pt, three columns: east, north, up
COVERED = 10  # [cells] plan area covered by columns
VOLUME = 11  # [m3] sum of V
SUMS = 12  # columns of the table

# Columns of the table of `bin_points`, which begins with the sums.
TOP = 12  # [m] largest distance from the bed
LOWEST = 13  # [m] smallest distance from the bed
COUNT = 14  # [1] number of points
ROW = 16  # columns of that table: two lines of the processor's cache

RECORD = 8  # columns of a sorted point: velocity (3), mass, volume, distance, pixel, place of its cell in the window
# [cells] along a tile's side. The rows of 64 cells stay in the first cache while the points of a tile are summed: 11 ns
# a point less than with a side of 32 cells (measured 2026-11-28).
TILE = 8
FAR = 32  # [cells] between two points that follow each other, from which on they count as far apart
JUMPS_SEEN = 4096  # [pairs of points] of the sample by which a random order is detected
SLAB = 1 << 19  # [points] that are sorted by tile at a time, so that memory does not grow with their number


@jit
def mark_points(row: np.ndarray, column: np.ndarray, bounds: np.ndarray, mark: np.ndarray) -> None:
    """Set `mark` to 1 in every cell with a particle.

    Parameters
    ----------
    row, column : int32[n]
        Cell of each particle; -1 without one.
    bounds : int64[4]
        First row, row after the last, first column, column after the last of the window.
    mark : int32[window rows, window columns], out
    """
    for p in range(row.shape[0]):
        if row[p] >= 0:
            mark[row[p] - bounds[0], column[p] - bounds[2]] = 1


@jit
def number_cells(mark: np.ndarray, bounds: np.ndarray, columns: int, cells: np.ndarray) -> int:
    """Number the marked cells row by row.

    Parameters
    ----------
    mark : int32[window rows, window columns], out
        Above 0 in the marked cells; becomes their number, -1 in the others.
    bounds : int64[4]
        As in `mark_points`.
    columns : int
        Of the grid.
    cells : int64[k], out
        Flat number in the grid of each marked cell.

    Returns
    -------
    int
        Number of marked cells.
    """
    count = 0
    for i in range(mark.shape[0]):
        for j in range(mark.shape[1]):
            if mark[i, j] > 0:
                mark[i, j] = count
                cells[count] = (i + bounds[0]) * columns + j + bounds[2]
                count += 1
            else:
                mark[i, j] = -1
    return count


@jit_inline
def add_motion(
    sums: np.ndarray, k: int, weight: float, u: float, v: float, w: float, slope_east: float, slope_north: float
) -> None:
    """Add a mass with its velocity, along and across the bed, to a row of sums (Eqs 9, 10; sums of 13, 14).

    Parameters
    ----------
    sums : float64[cells, SUMS], out
    k : int
        Row.
    weight : float [kg]
    u, v, w : float [m s-1]
    slope_east, slope_north : float [1]
    """
    up = upward_part_of_normal(slope_east, slope_north)
    n_east, n_north = -slope_east * up, -slope_north * up
    normal = u * n_east + v * n_north + w * up
    sums[k, SLOPED] += weight
    sums[k, UPRIGHT] += weight * up
    sums[k, MOMENTUM] += weight * u
    sums[k, MOMENTUM + 1] += weight * v
    sums[k, MOMENTUM + 2] += weight * w
    sums[k, NORMAL] += weight * normal
    sums[k, PARALLEL] += weight * (u - normal * n_east)
    sums[k, PARALLEL + 1] += weight * (v - normal * n_north)
    sums[k, PARALLEL + 2] += weight * (w - normal * up)


class PointsInCells(NamedTuple):
    """Points of a frame, and the cells that they lie in.

    Parameters
    ----------
    row, column : int32[n]
        Cell of each point; -1 without one.
    pixel : int64[n]
        Flat number of the DTM pixel under each point.
    distance : float64[n] [m]
        From the bed, along its normal; NaN where the pixel has no slope.
    velocity : float[n, 3] [m s-1]
    mass : float[n] [kg]
    volume : float[n] [m3]
    """

    row: np.ndarray
    column: np.ndarray
    pixel: np.ndarray
    distance: np.ndarray
    velocity: np.ndarray
    mass: np.ndarray
    volume: np.ndarray


@jit
def bin_points(
    points: PointsInCells,
    bounds: np.ndarray,
    mark: np.ndarray,
    gradient: np.ndarray,
    table: np.ndarray,
    records: np.ndarray,
    start: np.ndarray,
) -> None:
    """Sum the points of a frame into their cells, with the largest and smallest distance of each (Eqs 7 to 14).

    Where points that follow each other lie far apart, the rows of their cells are not in the cache. Such points are
    sorted by tiles of cells first, SLAB at a time, as records that lie one after the other. Within a tile they keep
    their order, so that every sum has the order of the points either way, to the last bit.

    Parameters
    ----------
    points : PointsInCells
    bounds : int64[4]
        As in `mark_points`.
    mark : int32[window rows, window columns]
        Number of each cell (`number_cells`).
    gradient : float64[pixels, 2] [1]
        Slopes of the DTM pixels.
    table : float64[cells, ROW], out
        The sums, then TOP, LOWEST (-inf and inf in a cell where no point has a slope) and COUNT.
    records : float64[r, RECORD], out
        Work array for r <= SLAB points.
    start : int64[tiles + 1], out
        Work array.
    """
    across = (bounds[3] - bounds[2] + TILE - 1) // TILE
    for k in range(table.shape[0]):
        table[k, :] = 0.0
        table[k, TOP], table[k, LOWEST] = -np.inf, np.inf
    n, size = points.row.shape[0], records.shape[0]
    if not _jumps(points.row, points.column):
        _sum_points(points, bounds, mark, gradient, table)
        return
    for first in range(0, n, size):
        end = min(first + size, n)
        _sort_by_tile(points, first, end, bounds, across, records, start)
        _sum_records(records, start[start.shape[0] - 1], mark.reshape(-1), gradient, table)


@jit
def _jumps(row, column):
    """Whether more than a quarter of a sample of points is FAR from the previous one."""
    n, far = row.shape[0], 0
    step = max(n // JUMPS_SEEN, 1)
    for p in range(step, n, step):
        if abs(row[p] - row[p - 1]) >= FAR or abs(column[p] - column[p - 1]) >= FAR:
            far += 1
    return 4 * far > n // step


@jit_inline
def add_point(
    table: np.ndarray,
    k: int,
    weight: float,
    bulk: float,
    d: float,
    u: float,
    v: float,
    w: float,
    slope_east: float,
    slope_north: float,
) -> None:
    """Add a point to a row of the table of `bin_points`.

    Parameters
    ----------
    table : float64[cells, ROW], out
    k : int
        Row.
    weight : float [kg]
        Mass.
    bulk : float [m3]
        Volume.
    d : float [m]
        Distance from the bed; NaN where it is unknown.
    u, v, w : float [m s-1]
    slope_east, slope_north : float [1]
    """
    table[k, COUNT] += 1.0
    table[k, MASS] += weight
    table[k, VOLUME] += bulk
    if np.isnan(d):
        return  # no slope under it: mass and number are all that is known
    table[k, TOP] = max(table[k, TOP], d)
    table[k, LOWEST] = min(table[k, LOWEST], d)
    add_motion(table, k, weight, u, v, w, slope_east, slope_north)


@jit
def _sum_points(points, bounds, mark, gradient, table):
    """Add the points to the rows of their cells in the given order."""
    row, column, pixel, distance, velocity, mass, volume = points
    for p in range(row.shape[0]):
        if row[p] < 0:
            continue
        k, q = mark[row[p] - bounds[0], column[p] - bounds[2]], pixel[p]
        u, v, w = velocity[p, 0], velocity[p, 1], velocity[p, 2]
        add_point(table, k, mass[p], volume[p], distance[p], u, v, w, gradient[q, 0], gradient[q, 1])


@jit
def _sort_by_tile(points, first, end, bounds, across, records, start):
    """Put the points from `first` to `end` that have a cell into `records`, tile by tile, in their order."""
    row, column, pixel, distance, velocity, mass, volume = points
    columns = bounds[3] - bounds[2]
    start[:] = 0
    for p in range(first, end):
        if row[p] >= 0:
            start[(row[p] - bounds[0]) // TILE * across + (column[p] - bounds[2]) // TILE + 1] += 1
    for t in range(1, start.shape[0]):
        start[t] += start[t - 1]
    for p in range(first, end):
        if row[p] < 0:
            continue
        i, j = row[p] - bounds[0], column[p] - bounds[2]
        t = i // TILE * across + j // TILE
        r = start[t]  # start[t] moves on to where the next tile begins
        start[t] += 1
        records[r, 0], records[r, 1], records[r, 2] = velocity[p, 0], velocity[p, 1], velocity[p, 2]
        records[r, 3], records[r, 4], records[r, 5] = mass[p], volume[p], distance[p]
        records[r, 6], records[r, 7] = pixel[p], i * columns + j


@jit
def _sum_records(records, count, mark, gradient, table):
    """Add the first `count` of `records` to the rows of their cells; `mark` is int32[cells of the window]."""
    for r in range(count):
        k, q = mark[int(records[r, 7])], int(records[r, 6])
        u, v, w = records[r, 0], records[r, 1], records[r, 2]
        add_point(table, k, records[r, 3], records[r, 4], records[r, 5], u, v, w, gradient[q, 0], gradient[q, 1])


@jit
def numbers_of_points(
    row: np.ndarray, column: np.ndarray, bounds: np.ndarray, mark: np.ndarray, distance: np.ndarray, slot: np.ndarray
) -> None:
    """Find the number of each point's cell.

    Parameters
    ----------
    row, column : int32[n]
    bounds : int64[4]
        These three as in `mark_points`.
    mark : int32[window rows, window columns]
        Number of each cell.
    distance : float64[n] [m]
    slot : int64[n], out
        Number of the cell; -1 for a point without a cell or without a known distance.
    """
    for p in range(row.shape[0]):
        known = row[p] >= 0 and not np.isnan(distance[p])
        slot[p] = mark[row[p] - bounds[0], column[p] - bounds[2]] if known else -1


@jit
def by_quantity(table: np.ndarray, sums: np.ndarray, top: np.ndarray, lowest: np.ndarray, count: np.ndarray) -> None:
    """Split the table of `bin_points` into one array per quantity.

    Parameters
    ----------
    table : float64[cells, ROW]
    sums : float64[SUMS, cells], out
    top, lowest : float64[cells], out [m]
        NaN where no distance is known.
    count : int64[cells], out
    """
    for k in range(table.shape[0]):
        for q in range(SUMS):
            sums[q, k] = table[k, q]
        top[k] = table[k, TOP] if table[k, TOP] > -np.inf else np.nan
        lowest[k] = table[k, LOWEST] if table[k, LOWEST] < np.inf else np.nan
        count[k] = int(table[k, COUNT])


@jit
def group_by_cell(slot: np.ndarray, start: np.ndarray, order: np.ndarray) -> None:
    """Sort particles by cell.

    Parameters
    ----------
    slot : int64[n]
        Number of each particle's cell; -1 without one.
    start : int64[cells + 1], out
        Place in `order` of the first particle of each cell.
    order : int64[particles in cells], out
        Numbers of the particles, cell by cell.
    """
    start[:] = 0
    for p in range(slot.shape[0]):
        if slot[p] >= 0:
            start[slot[p] + 1] += 1
    for k in range(start.shape[0] - 1):
        start[k + 1] += start[k]
    place_of_next = start.copy()
    for p in range(slot.shape[0]):
        if slot[p] >= 0:
            order[place_of_next[slot[p]]] = p
            place_of_next[slot[p]] += 1


@jit
def cell_quantiles(
    start: np.ndarray, order: np.ndarray, distance: np.ndarray, mass: np.ndarray, share: float, quantile: np.ndarray
) -> None:
    """Find the smallest distance in each cell with a `share` of the mass at or below it: a lower quantile.

    Never between two particles. Cells without a particle keep their value.

    Parameters
    ----------
    start, order : int64[cells + 1], int64[particles in cells]
        As `group_by_cell` fills them.
    distance : float64[n] [m]
    mass : float[n] [kg]
    share : float
        In (0, 1].
    quantile : float64[cells], out [m]
    """
    for k in range(start.shape[0] - 1):
        members = order[start[k] : start[k + 1]]
        if members.shape[0] == 0:
            continue
        ranked = members[np.argsort(distance[members])]
        total = 0.0
        for p in ranked:
            total += mass[p]
        wanted = share * total * (1.0 - 1e-12)  # 20 % of five equal masses is the first, whatever the rounding
        below = 0.0
        for p in ranked:
            below += mass[p]
            quantile[k] = distance[p]
            if below >= wanted:
                break
