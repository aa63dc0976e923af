"""Find the cells of a raster that particles lie in, their height above the bed, and the extent of all particles."""

import numpy as np

from ...compiled.jit import jit, jit_inline

ROUNDING = 1e-5  # [cells] by which an edge may miss a border: map coordinates of 1e7 m, cells of 1 mm


@jit_inline
def along(axes: np.ndarray, k: int, east: float, north: float) -> float:
    """Compute the column or the row of a place, in cells from the corner of a grid.

    Parameters
    ----------
    axes : float64[2, 3]
        `Grid.axes`.
    k : int
        0: column; 1: row.
    east, north : float [m]
        From the corner of the grid.
    """
    return (axes[k, 0] * east + axes[k, 1] * north) / axes[k, 2]


@jit_inline
def cell_at(row: float, column: float, rows: int, columns: int, clamped: bool) -> tuple[int, int]:
    """Find the cell at a fractional place: that with the nearest centre, ties upward.

    Parameters
    ----------
    row, column : float
        Place, in cells from the corner of the grid.
    rows, columns : int
        Number of cells.
    clamped : bool
        Particles outside belong to the nearest cell of the edge (the index range of Eq 5).

    Returns
    -------
    (int, int)
        Row and column; (-1, -1) outside.
    """
    if row >= 0.0 and row < rows and column >= 0.0 and column < columns:
        return int(row), int(column)
    if clamped and np.isfinite(row) and np.isfinite(column):
        return int(min(max(row, 0.0), rows - 1.0)), int(min(max(column, 0.0), columns - 1.0))
    return -1, -1


@jit_inline
def bed_on_plane(centre: float, slope_east: float, slope_north: float, east: float, north: float) -> float:
    """Compute the bed [m] on the tangent plane of a pixel (Eq 6).

    Parameters
    ----------
    centre : float [m]
        Elevation of the centre of the pixel.
    slope_east, slope_north : float [1]
    east, north : float [m]
        From the centre of the pixel.
    """
    return centre + slope_east * east + slope_north * north


@jit_inline
def bed_bilinear(elevation: np.ndarray, row: float, column: float) -> float:
    """Interpolate the bed [m] between the four pixel centres around a place.

    Over the outermost half pixel the outer two pixels are extended, so that a plane stays a plane.

    Parameters
    ----------
    elevation : float64[rows, columns] [m]
    row, column : float
        Fractional; whole numbers are centres of pixels.

    Returns
    -------
    float
        NaN next to nodata.
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
def upward_part_of_normal(slope_east: float, slope_north: float) -> float:
    """Compute n_H, the vertical part of the bed's unit normal (Eq 3).

    Parameters
    ----------
    slope_east, slope_north : float [1]
    """
    return 1.0 / np.sqrt(1.0 + slope_east * slope_east + slope_north * slope_north)


@jit
def place(
    position: np.ndarray,
    origin: np.ndarray,
    corner: np.ndarray,
    axes: np.ndarray,
    matrix: np.ndarray,
    elevation: np.ndarray,
    gradient: np.ndarray,
    on_plane: bool,
    clamped: bool,
    standoff: float,
    pixel: np.ndarray,
    distance: np.ndarray,
) -> int:
    """Find the DTM pixel under every particle and its distance from the bed (Eqs 2, 3, 5 to 7, any affine).

    Parameters
    ----------
    position : float[n, 3] [m]
        Relative to `origin`.
    origin : float64[3] [m]
        East, north, elevation.
    corner : float64[2] [m]
        Map position of the raster's corner (row 0, column 0).
    axes : float64[2, 3]
        `Grid.axes` of the raster.
    matrix : float64[2, 2] [m]
        Map vectors of one step in column and one step in row.
    elevation : float64[rows, columns] [m]
    gradient : float64[rows, columns, 2] [1]
    on_plane : bool
        True: Eq 6 to the letter. False: bilinear bed, and Eq 6 only next to nodata.
    clamped : bool
        True: exactly Eq 5, which moves particles outside to the nearest pixel on the edge.
    standoff : float [m]
        Height of the resting surface of the code over the bed, along the normal.
    pixel : int64[n], out
        Flat number of the pixel; -1 on nodata and, unless `clamped`, outside the raster.
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
def cells_of_points(
    position: np.ndarray,
    pixel: np.ndarray,
    origin: np.ndarray,
    corner: np.ndarray,
    axes: np.ndarray,
    shape: tuple,
    clamped: bool,
    row: np.ndarray,
    column: np.ndarray,
    bounds: np.ndarray,
) -> None:
    """Find the export cell of every particle that has a pixel.

    Parameters
    ----------
    position : float[n, 3] [m]
    pixel : int64[n]
    origin : float64[3] [m]
        These three as in `place`.
    corner : float64[2] [m]
        Map position of the corner of the export grid.
    axes : float64[2, 3]
        `Grid.axes` of the export grid.
    shape : tuple
        Its rows and columns.
    clamped : bool
        As in `place`.
    row, column : int32[n], out
        Cell of each particle; -1 without one.
    bounds : int64[4], out
        First row, row after the last, first column, column after the last of the cells found.
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
def reach(
    position: np.ndarray,
    half: np.ndarray,
    origin: np.ndarray,
    dem_corner: np.ndarray,
    dem_axes: np.ndarray,
    elevation: np.ndarray,
    clamped: bool,
    corner: np.ndarray,
    axes: np.ndarray,
    bounds: np.ndarray,
) -> int:
    """Find the rectangle along the axes of a grid around all particles on the DTM.

    Parameters
    ----------
    position : float[n, 3] [m]
    half : float64[n] or float64[1] [m]
        Half the side of each particle, which lies in the rectangle as well.
    origin : float64[3] [m]
    dem_corner : float64[2] [m]
    dem_axes : float64[2, 3]
    elevation : float64[rows, columns] [m]
    clamped : bool
        These five describe the DTM as in `place`.
    corner : float64[2] [m]
    axes : float64[2, 3]
        Corner and `Grid.axes` of a grid with cells of 1 m.
    bounds : float64[4], out [m]
        First column, first row, last column, last row, from `corner`.

    Returns
    -------
    int
        Number of particles on the DTM.
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
def left_out(row: np.ndarray, distance: np.ndarray, mass: np.ndarray) -> tuple[int, float, int]:
    """Count the particles that have no cell, and those that have no distance from the bed.

    Parameters
    ----------
    row : int32[n]
        Of the cell of each particle; -1 without one.
    distance : float64[n] [m]
    mass : float[n] [kg]

    Returns
    -------
    (int, float, int)
        Particles without a cell, their mass [kg], particles with a cell but without a distance.
    """
    outside, mass_outside, unknown = 0, 0.0, 0
    for p in range(row.shape[0]):
        if row[p] < 0:
            outside += 1
            mass_outside += mass[p]
        elif np.isnan(distance[p]):
            unknown += 1
    return outside, mass_outside, unknown


@jit
def below(distance: np.ndarray, mass: np.ndarray, limit: float) -> tuple[float, float]:
    """Sum the mass below a distance from the bed, and find the smallest distance.

    Parameters
    ----------
    distance : float64[n] [m]
        NaN where it is unknown.
    mass : float[n] [kg]
    limit : float [m]

    Returns
    -------
    (float, float)
        Mass below `limit` [kg], smallest distance [m] (inf if none is known).
    """
    total, lowest = 0.0, np.inf
    for p in range(distance.shape[0]):
        d = distance[p]
        if d < limit:
            total += mass[p]
        if d < lowest:
            lowest = d
    return total, lowest
