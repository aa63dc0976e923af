"""Values of polygons or raster cells at any points of the map."""

from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    from ...terrain.grid import Grid

AT_RIM = 1e-6  # [cells] distance from a border within which a point is on it


def within(shape: shapely.Geometry, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return which points are in a polygon or on its border, as bool of the shape of `x`.

    Parameters
    ----------
    shape : Polygon or MultiPolygon
    x, y : float64[...] [m]
    """
    west, south, east, north = shape.bounds
    near = (x >= west) & (x <= east) & (y >= south) & (y <= north)
    inside = np.zeros(np.shape(x), bool)
    shapely.prepare(shape)
    inside[near] = shapely.intersects_xy(shape, x[near], y[near])
    return inside


def cell_values(values: np.ndarray, grid: "Grid", x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the value of the raster cell of each point.

    It is NaN outside the raster and in cells without value. Values are not interpolated, because zones are classes. A
    point on the border of cells gets the value of one that has a value.

    Parameters
    ----------
    values : float64[rows, columns]
    grid : Grid
        Of the raster.
    x, y : float64[...] [m]
    """
    row, column = grid.rowcol(x, y)
    there = (row >= -0.5 - AT_RIM) & (row <= grid.shape[0] - 0.5 + AT_RIM)
    there &= (column >= -0.5 - AT_RIM) & (column <= grid.shape[1] - 0.5 + AT_RIM)
    found = np.full(np.shape(row), np.nan)
    for aside in ((AT_RIM, AT_RIM), (-AT_RIM, AT_RIM), (AT_RIM, -AT_RIM), (-AT_RIM, -AT_RIM)):
        i = np.clip(np.floor(row + 0.5 + aside[0]), 0, grid.shape[0] - 1).astype(int)
        j = np.clip(np.floor(column + 0.5 + aside[1]), 0, grid.shape[1] - 1).astype(int)
        found = np.where(np.isfinite(found) | ~there, found, values[i, j])
    return found


def spread(values: np.ndarray, where: np.ndarray) -> float:
    """Compute (largest - smallest) / mean of some values [1]; 0 where there is no value, or none above 0.

    Parameters
    ----------
    values : float64[...]
        None of them negative.
    where : bool[...]
        The points that count.
    """
    chosen = values[where]
    if chosen.size == 0 or not np.isfinite(chosen).any():
        return 0.0
    low, high, mean = np.nanmin(chosen), np.nanmax(chosen), np.nanmean(chosen)
    return float((high - low) / mean) if mean > 0.0 else 0.0
