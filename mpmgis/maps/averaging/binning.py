"""Sums over the particles in each cell of a raster, without arrays of the raster's size.

Squares of columns on the cells of a raster: their extent and the sums over each cell.
"""

import numpy as np

from ...compiled.jit import jit, jit_inline
from .cell_places import ROUNDING, along, upward_part_of_normal

# Columns of the table of sums, one row a cell.
MASS = 0  # sum of m over the cell
SLOPED = 1  # sum of m over particles on a known slope: the weight of the following entries
UPRIGHT = 2  # sum of m n_H
MOMENTUM = 3  # 3..5: sum of m U
NORMAL = 6  # sum of m (U . n)
PARALLEL = 7  # 7..9: sum of m U_pt
COVERED = 10  # plan area covered by columns [cells]
VOLUME = 11  # sum of V
SUMS = 12
ROW = 16  # of a cell while points are summed: the sums, then these
TOP, LOWEST, COUNT = 12, 13, 14
RECORD = 8  # of a point between two passes: velocity, mass, volume, distance, pixel, number of its cell
TILE = 32  # cells along a tile's side: its rows stay in the cache while its points are summed
JUMPS_SEEN = 4096  # pairs of points by which a random order is detected
SLAB = 1 << 19  # points that are sorted by tile at a time, so that memory does not grow with their number


@jit
def mark_points(row, column, bounds, mark):
    """Set `mark` int32[window rows, window columns] to 1 in every cell with a particle."""
    for p in range(row.shape[0]):
        if row[p] >= 0:
            mark[row[p] - bounds[0], column[p] - bounds[2]] = 1


@jit
def number_cells(mark, bounds, columns, cells):
    """Number the marked cells row by row: `mark` becomes number or -1, `cells` their flat index in the grid."""
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
def add_motion(sums, k, weight, u, v, w, slope_east, slope_north):
    """Add mass with velocity (`u`, `v`, `w`), along and across the bed, to row `k` (Eqs 9, 10; sums of 13, 14)."""
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


@jit
def bin_points(row, column, bounds, mark, pixel, distance, gradient, velocity, mass, volume, table, records, start):
    """Sum the points of a frame into their cells, with the largest and smallest distance of each (Eqs 7 to 14).

    Where points that follow each other lie far apart, the rows of their cells are not in the cache. Such points are
    sorted by tiles of cells first, SLAB at a time, as records that lie one after the other. Within a tile they keep
    their order, so that every sum has the order of the points either way, to the last bit.

    `gradient` float64[pixels, 2]; `table` float64[cells, ROW] takes the sums, then TOP, LOWEST (-inf and inf in a cell
    where no point has a slope) and COUNT; `records` float64[SLAB or less, RECORD] and `start` int64[tiles + 1] are room
    to work in.
    """
    across = (bounds[3] - bounds[2] + TILE - 1) // TILE
    for k in range(table.shape[0]):
        table[k, :] = 0.0
        table[k, TOP], table[k, LOWEST] = -np.inf, np.inf
    n, size = row.shape[0], records.shape[0]
    if not _jumps(row, column):
        _sum_points(row, column, bounds, mark, pixel, distance, gradient, velocity, mass, volume, table)
        return
    for first in range(0, n, size):
        end = min(first + size, n)
        _sort_by_tile(
            first, end, row, column, bounds, across, mark, pixel, distance, velocity, mass, volume, records, start
        )
        _sum_records(records, start[start.shape[0] - 1], gradient, table)


@jit
def _jumps(row, column):
    """Whether more than a quarter of a sample of points is more than a tile from the previous one."""
    n, far = row.shape[0], 0
    step = max(n // JUMPS_SEEN, 1)
    for p in range(step, n, step):
        if abs(row[p] - row[p - 1]) >= TILE or abs(column[p] - column[p - 1]) >= TILE:
            far += 1
    return 4 * far > n // step


@jit_inline
def add_point(table, k, weight, bulk, d, u, v, w, slope_east, slope_north):
    """Add a point of mass `weight` [kg] and volume `bulk` [m3] at distance `d` [m] to row `k` of `bin_points`."""
    table[k, COUNT] += 1.0
    table[k, MASS] += weight
    table[k, VOLUME] += bulk
    if np.isnan(d):
        return  # no slope under it: mass and number are all that is known
    table[k, TOP] = max(table[k, TOP], d)
    table[k, LOWEST] = min(table[k, LOWEST], d)
    add_motion(table, k, weight, u, v, w, slope_east, slope_north)


@jit
def _sum_points(row, column, bounds, mark, pixel, distance, gradient, velocity, mass, volume, table):
    """Add the points to the rows of their cells in the given order."""
    for p in range(row.shape[0]):
        if row[p] < 0:
            continue
        k, q = mark[row[p] - bounds[0], column[p] - bounds[2]], pixel[p]
        u, v, w = velocity[p, 0], velocity[p, 1], velocity[p, 2]
        add_point(table, k, mass[p], volume[p], distance[p], u, v, w, gradient[q, 0], gradient[q, 1])


@jit
def _sort_by_tile(
    first, end, row, column, bounds, across, mark, pixel, distance, velocity, mass, volume, records, start
):
    """Put the points from `first` to `end` that have a cell into `records`, tile by tile, in their order."""
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
        records[r, 6], records[r, 7] = pixel[p], mark[i, j]


@jit
def _sum_records(records, count, gradient, table):
    """Add the first `count` of `records` to the rows of their cells."""
    for r in range(count):
        k, q = int(records[r, 7]), int(records[r, 6])
        u, v, w = records[r, 0], records[r, 1], records[r, 2]
        add_point(table, k, records[r, 3], records[r, 4], records[r, 5], u, v, w, gradient[q, 0], gradient[q, 1])


@jit
def numbers_of_points(row, column, bounds, mark, distance, slot):
    """Set `slot` int64[n] to the number of each point's cell; -1 where it has none, or no known distance."""
    for p in range(row.shape[0]):
        known = row[p] >= 0 and not np.isnan(distance[p])
        slot[p] = mark[row[p] - bounds[0], column[p] - bounds[2]] if known else -1


@jit
def by_quantity(table, sums, top, lowest, count):
    """Turn the rows of `table` into `sums` float64[SUMS, cells] and three arrays of the cells; NaN where unknown."""
    for k in range(table.shape[0]):
        for q in range(SUMS):
            sums[q, k] = table[k, q]
        top[k] = table[k, TOP] if table[k, TOP] > -np.inf else np.nan
        lowest[k] = table[k, LOWEST] if table[k, LOWEST] < np.inf else np.nan
        count[k] = int(table[k, COUNT])


@jit
def group_by_cell(slot, start, order):
    """Particles in the order of their cells: `start` int64[cells + 1], `order` int64[particles in cells]."""
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
def cell_quantiles(start, order, distance, mass, share, quantile):
    """Lower mass-weighted quantile of the distances in each cell: the smallest with `share` of the mass at or below.

    Never between two particles. `share` in (0, 1]; cells without a particle are left as they are.
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


@jit
def mark_footprints(footprint, bounds, mark):
    """Set `mark` to 1 in every cell that a column's footprint (`footprints`) touches."""
    for p in range(footprint.shape[0]):
        if footprint[p, 0] < footprint[p, 1]:
            for i in range(int(footprint[p, 2]), int(np.ceil(footprint[p, 3]))):
                for j in range(int(footprint[p, 0]), int(np.ceil(footprint[p, 1]))):
                    mark[i - bounds[0], j - bounds[2]] = 1


@jit_inline
def snapped(edge):
    """`edge`, or the whole number that it misses by rounding alone: no slivers where a lattice meets the cells.

    A northing in float64 is good to 1e-9 m, which is a millionth of a cell of a millimetre.
    """
    whole = np.rint(edge)
    return whole if abs(edge - whole) < ROUNDING else edge


@jit
def footprints(position, area, row, origin, corner, axes, cell, shape, footprint, bounds):
    """Find the square that every column fills, in cells of the export grid and clipped to it.

    `row` int32[n] is below 0 for the columns left out, as `cells_of_points` answers. `footprint` float64[n, 4] takes
    (first column, last column, first row, last row) counted in cells from the first corner; the first two are equal
    where a column is left out. `cell` float64[2] [m] are the sides of a cell; the rest as in `cells_of_points`. In a
    rotated grid the square is aligned with the cells.
    """
    rows, columns = shape
    shift_east, shift_north = origin[0] - corner[0], origin[1] - corner[1]
    width, height = cell[0], cell[1]
    bounds[0], bounds[1], bounds[2], bounds[3] = rows, 0, columns, 0
    for p in range(position.shape[0]):
        footprint[p, :] = 0.0
        if row[p] < 0:
            continue
        half = max(0.5 * np.sqrt(area[p]), 1e-6 * width, 1e-6 * height)
        x, y = position[p, 0] + shift_east, position[p, 1] + shift_north
        u, v = along(axes, 0, x, y), along(axes, 1, x, y)
        west, east = max(snapped(u - half / width), 0.0), min(snapped(u + half / width), float(columns))
        north, south = max(snapped(v - half / height), 0.0), min(snapped(v + half / height), float(rows))
        footprint[p, 0], footprint[p, 1], footprint[p, 2], footprint[p, 3] = west, east, north, south
        bounds[0], bounds[1] = min(bounds[0], int(north)), max(bounds[1], int(np.ceil(south)))
        bounds[2], bounds[3] = min(bounds[2], int(west)), max(bounds[3], int(np.ceil(east)))


@jit
def bin_columns(footprint, row, column, bounds, mark, pixel, gradient, velocity, mass, volume, sums, count):
    """Share every column over the cells that its square overlaps (the columns' convention in README).

    `row`, `column` int32[n] are the cell of the column's position, for `count` alone. A square cut by the grid's rim
    fills what is left of it, so that no mass is lost.
    """
    for p in range(footprint.shape[0]):
        west, east, north, south = footprint[p, 0], footprint[p, 1], footprint[p, 2], footprint[p, 3]
        if not west < east:
            continue
        whole = (east - west) * (south - north)
        q = pixel[p]
        slope_east, slope_north = gradient[q, 0], gradient[q, 1]
        sloped = np.isfinite(slope_east) and np.isfinite(slope_north)
        count[mark[row[p] - bounds[0], column[p] - bounds[2]]] += 1
        for i in range(int(north), int(np.ceil(south))):
            tall = min(south, i + 1.0) - max(north, float(i))
            for j in range(int(west), int(np.ceil(east))):
                overlap = tall * (min(east, j + 1.0) - max(west, float(j)))
                share = overlap / whole
                k = mark[i - bounds[0], j - bounds[2]]
                sums[k, MASS] += mass[p] * share
                sums[k, VOLUME] += volume[p] * share
                sums[k, COVERED] += overlap
                if sloped:
                    add_motion(
                        sums,
                        k,
                        mass[p] * share,
                        velocity[p, 0],
                        velocity[p, 1],
                        velocity[p, 2],
                        slope_east,
                        slope_north,
                    )
