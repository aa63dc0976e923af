"""Areas given as polygons or as a raster mask, on the cells of any part of a DTM."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely
from rasterio.features import geometry_mask
from rasterio.windows import Window

from ..system.errors import GeoreferenceError, InputError
from .georeference import name_of, same_place, warp_command
from .grid import Grid
from .raster_input import ONE_BAND, band_number, band_values, grid_of, open_raster
from .spatial_inputs import is_raster, read_area, require_lies_on
from .undeclared_nodata import MASK

if TYPE_CHECKING:
    from .dtm import TerrainFile
    from .elevation import Terrain


@dataclass(frozen=True)
class AreaMask:
    """Cells whose centre is inside areas; a raster is read by part.

    Parameters
    ----------
    path : str or Path
    shapes : object[n]
        Of shapely.Polygon in the CRS of the DTM; empty for a raster.
    raster : Grid or None
        In the CRS of the DTM; None for polygons.
    """

    path: str | Path
    shapes: np.ndarray
    raster: Grid | None

    @cached_property
    def _tree(self):
        return shapely.STRtree(self.shapes)

    def inside(self, grid: Grid) -> np.ndarray:
        """Return which cells of a grid have their centre inside.

        Parameters
        ----------
        grid : Grid
            In the CRS of the DTM.

        Returns
        -------
        bool[rows, columns]
        """
        if self.raster is not None:
            return self._raster_inside(grid)
        there = self._tree.query(shapely.box(*grid.bounds))
        if not len(there):
            return np.zeros(grid.shape, bool)
        return geometry_mask(self.shapes[there], grid.shape, grid.transform, invert=True)

    def _raster_inside(self, grid):
        (i0, j0), (i1, j1) = self.raster.pixel_range(grid.bounds, 1)
        found = np.zeros(grid.shape, bool)
        if i0 >= i1 or j0 >= j1:
            return found
        with open_raster(self.path) as source:
            band = band_number(source, self.path, None, MASK, option=ONE_BAND)
            window = Window.from_slices((i0, i1), (j0, j1))
            values = band_values(source, self.path, band, MASK, may_be_empty=True, window=window)
        row, column = np.meshgrid(*map(np.arange, grid.shape), indexing="ij")
        places = self.raster.rowcol(*grid.xy(row, column))
        i, j = (np.floor(place + 0.5).astype(np.int64) - first for place, first in zip(places, (i0, j0), strict=True))
        on = (i >= 0) & (i < values.shape[0]) & (j >= 0) & (j < values.shape[1])
        pixels = values[i[on], j[on]]
        found[on] = np.isfinite(pixels) & (pixels != 0)
        return found


def read_area_mask(path: str | Path, terrain: "Terrain | TerrainFile", what: str) -> AreaMask:
    """Open areas as a mask on a DTM.

    Parameters
    ----------
    path : str or Path
        Polygons of any vector file, or a raster in the CRS of the DTM: inside where its value is not 0.
    terrain : Terrain or TerrainFile
    what : str
        The areas, for messages: "forest".

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        Not readable, in another CRS, or nowhere on the DTM.
    """
    if not is_raster(path):
        shapes = shapely.get_parts(read_area(path, terrain))
        _require_on_terrain(shapely.total_bounds(shapes), terrain.grid, path, what)
        return AreaMask(path, shapes, None)
    with open_raster(path) as source:
        band_number(source, path, None, MASK, option=ONE_BAND)
        grid = grid_of(source, path)
    target = terrain.grid.crs
    if grid.crs is None or target is None:
        require_lies_on(grid.bounds, grid.crs, terrain.grid, path)
    elif not same_place(grid.crs, target):
        raise GeoreferenceError(
            f"{path}: the {what} is in {name_of(grid.crs)}, the DTM in {name_of(target)}; reproject it: "
            f"{warp_command(path, name_of(target), 'nearest')}"
        )
    _require_on_terrain(grid.bounds, terrain.grid, path, what)
    return AreaMask(path, np.empty(0, object), Grid(target, grid.transform, grid.shape))


def _require_on_terrain(bounds, grid, path, what):
    west, south, east, north = grid.bounds
    if not (bounds[0] < east and bounds[2] > west and bounds[1] < north and bounds[3] > south):
        raise InputError(
            f"{path}: the {what} covers no part of the DTM (it lies between {bounds[0]:.6g}, {bounds[1]:.6g} and "
            f"{bounds[2]:.6g}, {bounds[3]:.6g}); check its CRS"
        )
