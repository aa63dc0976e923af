"""Cells of a raster with particles, their height above the bed, and the extent of all particles."""

import numpy as np

from ...compiled.jit import jit, jit_inline

ROUNDING = 1e-5  # [cells] by which an edge may miss a border: map coordinates of 1e7 m, cells of 1 mm


@jit_inline
def along(axes, k, east, north):
    """Column (`k` = 0) or row (1) of a place [m] from a grid's corner; `axes` as `Grid.axes` has them."""
    return (axes[k, 0] * east + axes[k, 1] * north) / axes[k, 2]


@jit_inline
def cell_at(row, column, rows, columns, clamped):
    """(i, j) of the cell at a fractional place, which is the nearest centre, ties upward; (-1, -1) outside.

    `clamped` moves particles outside to the nearest cell on the edge (the index range of Eq 5).
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
    """Bed [m] between the four pixel centres around fractional (`row`, `column`); NaN next to nodata.

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
        True: Eq 6 to the letter. False: bilinear bed, and Eq 6 only next to nodata.
    clamped : bool
        True: exactly Eq 5, which moves particles outside to the nearest pixel on the edge.
    standoff : float [m]
        Height of the resting surface of the code over the bed, along the normal.
    pixel : int64[n], out
        Flat index of the pixel; -1 on nodata and, unless `clamped`, outside the raster.
    distance : float64[n], out [m]
        Along the normal; NaN outside and where the pixel has no slope.

    Returns
    -------
    int
        Number of particles outside, which were moved to the edge.
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
    """Find the rectangle along the axes of a grid around every particle that has a pixel, with `half` of its side.

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
    """(Mass nearer to the bed than `limit` [m], the smallest known distance; inf for none)."""
    total, lowest = 0.0, np.inf
    for p in range(distance.shape[0]):
        d = distance[p]
        if d < limit:
            total += mass[p]
        if d < lowest:
            lowest = d
    return total, lowest
