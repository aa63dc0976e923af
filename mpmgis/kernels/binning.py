"""Particles into cells: the compiled half of the depth averaging (Vicari et al. 2025, NHESS 25:3897, Eqs 2-14).

Serial loops, one frame each: the fastest there is for so little arithmetic (memory decides), and bitwise the same
however many frames are worked on at a time. They release the GIL. Only cells that hold something are stored: a
frame's cells are numbered first, then summed, so that memory follows the flow and not the raster.
"""

import numpy as np

from .jit import jit, jit_inline

# Columns of the table of sums, one row a cell.
MASS = 0  # sum of m over everything in the cell
SLOPED = 1  # sum of m over what lies on a known slope: the weight of all that follows
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
ROUNDING = 1e-5  # [cells] by which an edge may miss a border: map coordinates of 1e7 m, cells of 1 mm
JUMPS_SEEN = 4096  # pairs of points that tell whether they come in any order
SLAB = 1 << 19  # points that are sorted by tile at a time, so that memory does not grow with their number


@jit_inline
def along(axes, k, east, north):
    """Column (`k` = 0) or row (1) of a place [m] from a grid's corner; `axes` as `Grid.axes` has them."""
    return (axes[k, 0] * east + axes[k, 1] * north) / axes[k, 2]


@jit_inline
def cell_at(row, column, rows, columns, clamped):
    """(i, j) of the cell at a fractional place, which is the nearest centre, ties upward; (-1, -1) outside.

    `clamped` takes what lies outside to the nearest cell of the rim (the index range of Eq 5).
    """
    if row >= 0.0 and row < rows and column >= 0.0 and column < columns:
        return int(row), int(column)
    if clamped and np.isfinite(row) and np.isfinite(column):
        return int(min(max(row, 0.0), rows - 1.0)), int(min(max(column, 0.0), columns - 1.0))
    return -1, -1


@jit_inline
def bed_on_plane(centre, slope_east, slope_north, east, north):
    """Bed [m] on the tangent plane of a pixel, `east`, `north` [m] from its centre (Eq 6)."""
    return centre + slope_east * east + slope_north * north


@jit_inline
def bed_bilinear(elevation, row, column):
    """Bed [m] between the four pixel centres around fractional (`row`, `column`); NaN beside nodata (X3).

    Over the outermost half pixel the outer two pixels are extended, so that a plane stays a plane.
    """
    rows, columns = elevation.shape
    i = min(max(int(np.floor(row)), 0), max(rows - 2, 0))
    j = min(max(int(np.floor(column)), 0), max(columns - 2, 0))
    i1, j1 = min(i + 1, rows - 1), min(j + 1, columns - 1)
    fi, fj = row - i, column - j
    west = elevation[i, j] * (1.0 - fi) + elevation[i1, j] * fi
    east = elevation[i, j1] * (1.0 - fi) + elevation[i1, j1] * fi
    return west * (1.0 - fj) + east * fj


@jit_inline
def upward_part_of_normal(slope_east, slope_north):
    """n_H, the vertical part of the bed's unit normal (Eq 3)."""
    return 1.0 / np.sqrt(1.0 + slope_east * slope_east + slope_north * slope_north)


@jit
def place(position, origin, corner, axes, matrix, elevation, gradient, on_plane, clamped, standoff, pixel, distance):
    """Find the DTM pixel under every particle and its distance from the bed (Eqs 2, 3, 5 to 7, any affine).

    Parameters
    ----------
    position : float[n, 3] [m]
        Relative to `origin` float64[3] (E, N, H) [m].
    corner : float64[2] [m]
        Map position of the raster's corner (row 0, column 0).
    axes : float64[2, 3]
        `Grid.axes` of the raster.
    matrix : float64[2, 2] [m]
        Map vectors of one step in column and one step in row.
    elevation, gradient : float64[rows, columns] [m], float64[rows, columns, 2] [1]
    on_plane : bool
        True: Eq 6 to the letter. False: bilinear bed, and Eq 6 only beside nodata.
    clamped : bool
        True: Eq 5 to the letter, which takes what lies outside to the nearest pixel of the rim.
    standoff : float [m]
        Height of the code's own resting surface over the bed, along the normal.
    pixel : int64[n], out
        Flat index of the pixel; -1 on nodata and, unless `clamped`, outside the raster.
    distance : float64[n], out [m]
        Along the normal; NaN outside and where the pixel has no slope (X4).

    Returns
    -------
    int
        How many particles lie outside and were taken to the rim.
    """
    moved = 0
    rows, columns = elevation.shape
    a, b, d, e = matrix[0, 0], matrix[0, 1], matrix[1, 0], matrix[1, 1]
    shift_east, shift_north = origin[0] - corner[0], origin[1] - corner[1]
    for p in range(position.shape[0]):
        pixel[p] = -1
        distance[p] = np.nan
        x, y = position[p, 0] + shift_east, position[p, 1] + shift_north
        column, row = along(axes, 0, x, y), along(axes, 1, x, y)
        i, j = cell_at(row, column, rows, columns, clamped)
        if i < 0:
            continue
        if not (row >= 0.0 and row < rows and column >= 0.0 and column < columns):
            moved += 1
        if not np.isfinite(elevation[i, j]):
            continue
        pixel[p] = i * columns + j
        slope_east, slope_north = gradient[i, j, 0], gradient[i, j, 1]
        bed = np.nan
        if not on_plane:
            bed = bed_bilinear(elevation, row - 0.5, column - 0.5)
        if not np.isfinite(bed):
            u, v = column - (j + 0.5), row - (i + 0.5)
            bed = bed_on_plane(elevation[i, j], slope_east, slope_north, a * u + b * v, d * u + e * v)
        height = position[p, 2] + (origin[2] - bed)
        distance[p] = height * upward_part_of_normal(slope_east, slope_north) - standoff
    return moved


@jit
def cells_of_points(position, pixel, origin, corner, axes, shape, clamped, row, column, bounds):
    """Find the export cell of every particle that has a pixel; -1 for the others.

    `corner` [m] is where the export grid's first cell begins, `axes` its `Grid.axes`, `shape` its rows and columns;
    `clamped` as in `place`. `bounds` int64[4] takes (first row, end row, first column, end column) of the cells met.
    """
    rows, columns = shape
    shift_east, shift_north = origin[0] - corner[0], origin[1] - corner[1]
    bounds[0], bounds[1], bounds[2], bounds[3] = rows, 0, columns, 0
    for p in range(position.shape[0]):
        row[p] = -1
        column[p] = -1
        if pixel[p] < 0:
            continue
        x, y = position[p, 0] + shift_east, position[p, 1] + shift_north
        i, j = cell_at(along(axes, 1, x, y), along(axes, 0, x, y), rows, columns, clamped)
        if i < 0:
            continue
        row[p] = i
        column[p] = j
        bounds[0], bounds[1] = min(bounds[0], i), max(bounds[1], i + 1)
        bounds[2], bounds[3] = min(bounds[2], j), max(bounds[3], j + 1)


@jit
def reach(position, half, origin, dem_corner, dem_axes, elevation, clamped, corner, axes, bounds):
    """Find the rectangle along a grid's axes that holds every particle that has a pixel, with `half` of its side.

    The DTM is that of `place`, with `dem_corner` and `dem_axes`. `half` float64[n] or float64[1] [m]; `corner` and
    `axes` are of a grid whose cells have sides of 1 m. `bounds` float64[4] takes
    (first column, first row, last column, last row) [m] from `corner`. Answers how many particles that are.
    """
    bounds[0], bounds[1], bounds[2], bounds[3] = np.inf, np.inf, -np.inf, -np.inf
    count, each = 0, half.shape[0] > 1
    shift_east, shift_north = origin[0] - corner[0], origin[1] - corner[1]
    dem_east, dem_north = origin[0] - dem_corner[0], origin[1] - dem_corner[1]
    for p in range(position.shape[0]):
        x, y = position[p, 0] + dem_east, position[p, 1] + dem_north
        row, column = along(dem_axes, 1, x, y), along(dem_axes, 0, x, y)
        i, j = cell_at(row, column, elevation.shape[0], elevation.shape[1], clamped)
        if i < 0 or not np.isfinite(elevation[i, j]):
            continue
        x, y = position[p, 0] + shift_east, position[p, 1] + shift_north
        u, v, h = along(axes, 0, x, y), along(axes, 1, x, y), half[p if each else 0]
        bounds[0], bounds[1] = min(bounds[0], u - h), min(bounds[1], v - h)
        bounds[2], bounds[3] = max(bounds[2], u + h), max(bounds[3], v + h)
        count += 1
    return count


@jit
def left_out(row, distance, mass):
    """(Particles without a cell, their mass, particles with a cell and no known distance)."""
    outside, mass_outside, unknown = 0, 0.0, 0
    for p in range(row.shape[0]):
        if row[p] < 0:
            outside += 1
            mass_outside += mass[p]
        elif np.isnan(distance[p]):
            unknown += 1
    return outside, mass_outside, unknown


@jit
def below(distance, mass, limit):
    """(Mass of what lies nearer to the bed than `limit` [m], the smallest distance known; inf where there is none)."""
    total, lowest = 0.0, np.inf
    for p in range(distance.shape[0]):
        d = distance[p]
        if d < limit:
            total += mass[p]
        if d < lowest:
            lowest = d
    return total, lowest


@jit
def mark_points(row, column, bounds, mark):
    """Set `mark` int32[window rows, window columns] to 1 in every cell that holds a particle."""
    for p in range(row.shape[0]):
        if row[p] >= 0:
            mark[row[p] - bounds[0], column[p] - bounds[2]] = 1


@jit
def mark_footprints(footprint, bounds, mark):
    """Set `mark` to 1 in every cell that a column's footprint (`footprints`) touches."""
    for p in range(footprint.shape[0]):
        if footprint[p, 0] < footprint[p, 1]:
            for i in range(int(footprint[p, 2]), int(np.ceil(footprint[p, 3]))):
                for j in range(int(footprint[p, 0]), int(np.ceil(footprint[p, 1]))):
                    mark[i - bounds[0], j - bounds[2]] = 1


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
    """Add what moves with (`u`, `v`, `w`), split along and across the bed, to row `k` (Eqs 9, 10; sums of 13, 14)."""
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
    """True where more than a quarter of some points lie over a tile's side away from the one before."""
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
        return  # no slope under it: mass and number are all that is known (X4)
    table[k, TOP] = max(table[k, TOP], d)
    table[k, LOWEST] = min(table[k, LOWEST], d)
    add_motion(table, k, weight, u, v, w, slope_east, slope_north)


@jit
def _sum_points(row, column, bounds, mark, pixel, distance, gradient, velocity, mass, volume, table):
    """Add the points to the rows of their cells as they come."""
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

    Never between two particles (design note X6). `share` in (0, 1]; cells without a particle are left as they are.
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
