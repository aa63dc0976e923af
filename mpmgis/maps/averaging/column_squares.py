"""Squares of columns on the cells of a raster: their extent and the sums over each cell."""

import numpy as np

from ...compiled.jit import jit, jit_inline
from .binning import COVERED, MASS, VOLUME, add_motion
from .cell_places import ROUNDING, along


@jit
def mark_footprints(footprint: np.ndarray, bounds: np.ndarray, mark: np.ndarray) -> None:
    """Set `mark` to 1 in every cell that a column's square touches.

    Parameters
    ----------
    footprint : float64[n, 4]
        As `footprints` fills it.
    bounds : int64[4]
        As in `binning.mark_points`.
    mark : int32[window rows, window columns], out
    """
    for p in range(footprint.shape[0]):
        if footprint[p, 0] < footprint[p, 1]:
            for i in range(int(footprint[p, 2]), int(np.ceil(footprint[p, 3]))):
                for j in range(int(footprint[p, 0]), int(np.ceil(footprint[p, 1]))):
                    mark[i - bounds[0], j - bounds[2]] = 1


@jit_inline
def snapped(edge: float) -> float:
    """Return the whole number that an edge misses by rounding alone, else the edge: no slivers where grids meet.

    A northing in float64 is good to 1e-9 m, which is a millionth of a cell of a millimetre.

    Parameters
    ----------
    edge : float
        In cells.
    """
    whole = np.rint(edge)
    return whole if abs(edge - whole) < ROUNDING else edge


@jit
def footprints(
    position: np.ndarray,
    area: np.ndarray,
    row: np.ndarray,
    origin: np.ndarray,
    corner: np.ndarray,
    axes: np.ndarray,
    cell: np.ndarray,
    shape: tuple,
    footprint: np.ndarray,
    bounds: np.ndarray,
) -> None:
    """Find the square that every column fills, in cells of the export grid and clipped to it.

    In a rotated grid the square is aligned with the cells.

    Parameters
    ----------
    position : float[n, 3] [m]
    area : float[n] [m2]
    row : int32[n]
        Below 0 for columns that are left out (`cell_places.cells_of_points`).
    origin, corner, axes : float64[3] [m], float64[2] [m], float64[2, 3]
        As in `cell_places.cells_of_points`.
    cell : float64[2] [m]
        Sides of a cell.
    shape : tuple
        Rows and columns of the grid.
    footprint : float64[n, 4], out
        West, east, north and south edge, in cells from the corner of the grid; the first two are equal where a column
        is left out.
    bounds : int64[4], out
        First row, row after the last, first column, column after the last of the cells touched.
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
def bin_columns(
    footprint: np.ndarray,
    row: np.ndarray,
    column: np.ndarray,
    bounds: np.ndarray,
    mark: np.ndarray,
    pixel: np.ndarray,
    gradient: np.ndarray,
    velocity: np.ndarray,
    mass: np.ndarray,
    volume: np.ndarray,
    sums: np.ndarray,
    count: np.ndarray,
) -> None:
    """Share every column over the cells that its square overlaps (the columns' convention in README).

    A square cut by the edge of the grid fills what is left of it, so that no mass is lost.

    Parameters
    ----------
    footprint : float64[n, 4]
        As `footprints` fills it.
    row, column : int32[n]
        Cell of the column's position, for `count` alone.
    bounds : int64[4]
    mark : int32[window rows, window columns]
        Number of each cell.
    pixel : int64[n]
        Flat number of the DTM pixel under each column.
    gradient : float64[pixels, 2] [1]
    velocity : float[n, 3] [m s-1]
    mass : float[n] [kg]
    volume : float[n] [m3]
    sums : float64[cells, SUMS], out
        Starts at zero; columns of `binning`.
    count : int64[cells], out
        Starts at zero.
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
