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
def place(position, origin, corner, matrix, elevation, gradient, on_plane, standoff, pixel, distance):
    """Find the DTM pixel under every particle and its distance from the bed (Eqs 2, 3, 5 to 7, any affine).

    Parameters
    ----------
    position : float[n, 3] [m]
        Relative to `origin` float64[3] (E, N, H) [m].
    corner : float64[2] [m]
        Map position of the raster's corner (row 0, column 0).
    matrix : float64[2, 2] [m]
        Map vectors of one step in column and one step in row.
    elevation, gradient : float64[rows, columns] [m], float64[rows, columns, 2] [1]
    on_plane : bool
        True: Eq 6 to the letter. False: bilinear bed, and Eq 6 only beside nodata.
    standoff : float [m]
        Height of the code's own resting surface over the bed, along the normal.
    pixel : int64[n], out
        Flat index of the pixel; -1 outside the raster or on nodata. Never moved in (X1).
    distance : float64[n], out [m]
        Along the normal; NaN outside and where the pixel has no slope (X4).
    """
    rows, columns = elevation.shape
    a, b, d, e = matrix[0, 0], matrix[0, 1], matrix[1, 0], matrix[1, 1]
    determinant = a * e - b * d
    shift_east, shift_north = origin[0] - corner[0], origin[1] - corner[1]
    for p in range(position.shape[0]):
        pixel[p] = -1
        distance[p] = np.nan
        x, y = position[p, 0] + shift_east, position[p, 1] + shift_north
        column = (e * x - b * y) / determinant
        row = (a * y - d * x) / determinant
        if not (row >= 0.0 and row < rows and column >= 0.0 and column < columns):
            continue
        i, j = int(row), int(column)  # the nearest centre, ties upward
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


@jit
def cells_of_points(position, pixel, origin, corner, cell, shape, row, column, bounds):
    """Find the export cell of every particle that has a pixel; -1 for the others.

    `corner` [m] is the export grid's upper left corner, `cell` float64[2] [m] its cells' width and height, `shape`
    its rows and columns. `bounds` int64[4] takes (first row, end row, first column, end column) of the cells met.
    """
    rows, columns = shape
    shift_east, shift_south = origin[0] - corner[0], corner[1] - origin[1]
    width, height = cell[0], cell[1]
    bounds[0], bounds[1], bounds[2], bounds[3] = rows, 0, columns, 0
    for p in range(position.shape[0]):
        row[p] = -1
        column[p] = -1
        if pixel[p] < 0:
            continue
        u, v = (position[p, 0] + shift_east) / width, (shift_south - position[p, 1]) / height
        if not (u >= 0.0 and u < columns and v >= 0.0 and v < rows):
            continue
        i, j = int(v), int(u)
        row[p] = i
        column[p] = j
        bounds[0], bounds[1] = min(bounds[0], i), max(bounds[1], i + 1)
        bounds[2], bounds[3] = min(bounds[2], j), max(bounds[3], j + 1)


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
def add_motion(sums, k, weight, velocity, p, slope_east, slope_north):
    """Add particle `p`, split along and across the bed, to cell `k` (Eqs 9, 10 and the sums of 13, 14)."""
    up = upward_part_of_normal(slope_east, slope_north)
    n_east, n_north = -slope_east * up, -slope_north * up
    u, v, w = velocity[p, 0], velocity[p, 1], velocity[p, 2]
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
def bin_points(
    row, column, bounds, mark, pixel, distance, gradient, velocity, mass, volume, sums, count, top, lowest, slot
):
    """Sum the points of a frame into their cells, with the largest and smallest distance of each (Eqs 7 to 14).

    `gradient` float64[pixels, 2]; `sums` float64[cells, SUMS] and `count` int64[cells] start at zero, `top` and
    `lowest` float64[cells] at -inf and inf; `slot` int64[n] takes the number of each particle's cell, -1 outside.
    """
    for p in range(row.shape[0]):
        slot[p] = -1
        if row[p] < 0:
            continue
        k = mark[row[p] - bounds[0], column[p] - bounds[2]]
        count[k] += 1
        sums[k, MASS] += mass[p]
        sums[k, VOLUME] += volume[p]
        d = distance[p]
        if np.isnan(d):
            continue  # no slope under it: mass and number are all that is known (X4)
        slot[p] = k
        top[k] = max(top[k], d)
        lowest[k] = min(lowest[k], d)
        q = pixel[p]
        add_motion(sums, k, mass[p], velocity, p, gradient[q, 0], gradient[q, 1])


@jit_inline
def snapped(edge):
    """`edge`, or the whole number that it misses by rounding alone: no slivers where a lattice meets the cells.

    A northing in float64 is good to 1e-9 m, which in small cells is more than one would think.
    """
    whole = np.rint(edge)
    return whole if abs(edge - whole) < 1e-6 else edge


@jit
def footprints(position, area, row, origin, corner, cell, shape, footprint, bounds):
    """Find the square that every column fills, in cells of the export grid and clipped to it.

    `row` int32[n] is below 0 for the columns left out, as `cells_of_points` answers. `footprint` float64[n, 4] takes
    (west, east, north, south) counted in cells from the upper left corner; west = east where a column is left out.
    `bounds` as in `cells_of_points`.
    """
    rows, columns = shape
    shift_east, shift_south = origin[0] - corner[0], corner[1] - origin[1]
    width, height = cell[0], cell[1]
    bounds[0], bounds[1], bounds[2], bounds[3] = rows, 0, columns, 0
    for p in range(position.shape[0]):
        footprint[p, :] = 0.0
        if row[p] < 0:
            continue
        half = max(0.5 * np.sqrt(area[p]), 1e-6 * width, 1e-6 * height)
        x, y = position[p, 0] + shift_east, shift_south - position[p, 1]
        west, east = max(snapped((x - half) / width), 0.0), min(snapped((x + half) / width), float(columns))
        north, south = max(snapped((y - half) / height), 0.0), min(snapped((y + half) / height), float(rows))
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
                    add_motion(sums, k, mass[p] * share, velocity, p, slope_east, slope_north)


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
