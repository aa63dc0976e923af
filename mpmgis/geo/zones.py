"""Values by place on any points: polygons painted one over the other, rasters read cell by cell."""

import numpy as np
import shapely

_RIM = 1e-6  # [cells] that count as on a border


def within(shape, x, y):
    """bool, as `x` and `y` [m]: points in a polygon or on its border."""
    west, south, east, north = shape.bounds
    near = (x >= west) & (x <= east) & (y >= south) & (y <= north)
    inside = np.zeros(np.shape(x), bool)
    shapely.prepare(shape)
    inside[near] = shapely.intersects_xy(shape, x[near], y[near])
    return inside


def cell_values(values, grid, x, y):
    """Value of the raster cell that each point x, y [m] lies in; NaN outside the raster and in cells without value.

    No interpolation: zones are classes, and a mean of two classes is none. A point on the border of
    cells takes one that has a value.
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
