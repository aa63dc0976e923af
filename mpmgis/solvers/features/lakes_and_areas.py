"""Values of polygons or raster cells at any points, and lakes that the release fills to a still level."""

import numpy as np
import shapely
from scipy import ndimage

_RIM = 1e-6  # [cells] that count as on a border
FILLED = 0.9  # share of the volume of a body below the level that released water must fill for a lake at rest


def within(shape, x, y):
    """bool, as `x` and `y` [m]: points in a polygon or on its border."""
    west, south, east, north = shape.bounds
    near = (x >= west) & (x <= east) & (y >= south) & (y <= north)
    inside = np.zeros(np.shape(x), bool)
    shapely.prepare(shape)
    inside[near] = shapely.intersects_xy(shape, x[near], y[near])
    return inside


def cell_values(values, grid, x, y):
    """Value of the raster cell of each point x, y [m]; NaN outside the raster and in cells without value.

    No interpolation, because zones are classes. A point on the border of cells gets the value of one that
    has a value.
    """
    row, column = grid.rowcol(x, y)
    there = (row >= -0.5 - _RIM) & (row <= grid.shape[0] - 0.5 + _RIM)
    there &= (column >= -0.5 - _RIM) & (column <= grid.shape[1] - 0.5 + _RIM)
    found = np.full(np.shape(row), np.nan)
    for aside in ((_RIM, _RIM), (-_RIM, _RIM), (_RIM, -_RIM), (-_RIM, -_RIM)):
        i = np.clip(np.floor(row + 0.5 + aside[0]), 0, grid.shape[0] - 1).astype(int)
        j = np.clip(np.floor(column + 0.5 + aside[1]), 0, grid.shape[1] - 1).astype(int)
        found = np.where(np.isfinite(found) | ~there, found, values[i, j])
    return found


def spread(values, where):
    """(largest - smallest) / mean of `values`, none negative, over the points `where` [1]; 0 for none."""
    chosen = values[where]
    if chosen.size == 0 or not np.isfinite(chosen).any():
        return 0.0
    low, high, mean = np.nanmin(chosen), np.nanmax(chosen), np.nanmean(chosen)
    return float((high - low) / mean) if mean > 0.0 else 0.0


def lake_cells(corner_bed, level, water, touched=None):
    """Cells of all lakes at one still level.

    A lake is a connected body of cells with ground below `level`, of which the released water fills at least FILLED:
    a dry valley at the same level is neither a lake nor a reference state.

    Parameters
    ----------
    corner_bed : float[ny + 1, nx + 1] [m]
    level : float [m]
    water : float[ny, nx] [m]
        Mean depth of the released material in each cell.
    touched : bool[ny, nx], optional
        Only bodies with one of these cells.

    Returns
    -------
    (bool[ny, nx], list of float)
        Cells of lakes; filled share of every other body with released water.
    """
    corners = [corner_bed[:-1, :-1], corner_bed[:-1, 1:], corner_bed[1:, :-1], corner_bed[1:, 1:]]
    depth = np.mean([np.maximum(level - bed, 0.0) for bed in corners], axis=0)
    labels, count = ndimage.label(depth > 0.0)
    index = np.arange(1, count + 1)
    wet = ndimage.maximum((water > 0.0) & (depth > 0.0), labels, index) if count else np.zeros(0)
    filled = ndimage.sum(np.minimum(water, depth), labels, index) / ndimage.sum(depth, labels, index) if count else wet
    if touched is not None and count:
        wet = wet * ndimage.maximum(touched, labels, index)
    lakes = index[(np.asarray(wet) > 0) & (np.asarray(filled) >= FILLED)]
    others = np.asarray(filled)[(np.asarray(wet) > 0) & (np.asarray(filled) < FILLED)]
    return np.isin(labels, lakes), others.tolist()


def water_depth(x, y, volume, shape, cell_size):
    """float64[ny, nx] [m]: mean depth of columns at x, y [m] from the south-west corner, of `volume` [m3] each."""
    rows, columns = shape
    j, i = np.clip((y / cell_size).astype(int), 0, rows - 1), np.clip((x / cell_size).astype(int), 0, columns - 1)
    return np.bincount(j * columns + i, volume, rows * columns).reshape(shape) / cell_size**2
