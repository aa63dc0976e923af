"""Spatial inputs of a scene in the terrain's CRS: polygons and lines with their columns, and rasters."""

from dataclasses import dataclass

import numpy as np
import shapely

from ..errors import GeoreferenceError, InputError
from ..messages import muted
from ..terrain.georeference import name_of, same_place, warp_command
from ..terrain.grid import Grid
from .raster import read_raster
from .reprojection import repaired, require_lies_on, to_terrain
from .terrain_warp import reprojected_raster
from .vector_table import names_of, read_table, require_polygons


@dataclass(frozen=True)
class Feature:
    """One feature of a vector file: its name, its `shape` (shapely, map metres), column -> value of its row."""

    name: str
    shape: shapely.Geometry
    columns: dict
    path: str

    def number(self, column):
        """The finite number in `column`.

        Raises
        ------
        InputError
            No such column, or another type.
        """
        if column not in self.columns:
            has = ", ".join(map(str, list(self.columns)[:8])) or "no columns"
            raise InputError(f"{self.path} has no column {column!r} (it has {has}); give a number, or another column")
        try:
            value = float(self.columns[column])
        except (TypeError, ValueError):
            value = np.nan
        if not np.isfinite(value):
            raise InputError(
                f"{self.path}: '{self.name}' has {self.columns[column]!r} in column {column!r}, expected a number"
            )
        return value


def read_polygons(path, terrain):
    """The polygons at `path` as Features in the terrain's CRS; repairs and reprojections are reported.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    return _features(path, require_polygons(read_table(path, flag=""), path), terrain)


def read_walls(path, terrain, width):
    """As `read_polygons` for barriers: lines become polygons `width` [m] wide."""
    table = read_table(path, flag="")
    kinds = table.kinds if table.geometry is not None else set()
    if not kinds or not kinds <= {"LineString", "MultiLineString"}:
        if width is not None:
            raise InputError(f"{path} does not contain only lines, and width = {width:g} is for lines; remove width")
        return _features(path, require_polygons(table, path), terrain)
    if width is None:
        raise InputError(f"{path} contains lines; give [[barrier]] width, the thickness of the wall [m]")
    names, rows = names_of(table), table.rows()
    lines = to_terrain(table.geometry, table.crs, terrain, path)
    if shapely.is_empty(lines).any() or shapely.is_missing(lines).any():
        raise InputError(f"{path}: a line has no geometry; draw it again, or remove it")
    return [
        Feature(name, line.buffer(0.5 * width, cap_style="flat", join_style="mitre"), row, str(path))
        for name, line, row in zip(names, lines, rows, strict=True)
    ]


def _features(path, table, terrain):
    names, rows = names_of(table), table.rows()
    shapes = to_terrain(table.geometry, table.crs, terrain, path)
    return [
        Feature(name, repaired(shape, name, path), row, str(path))
        for name, shape, row in zip(names, shapes, rows, strict=True)
    ]


def read_area(path, terrain):
    """The polygons at `path` as one shapely geometry in the terrain's CRS; errors as in `read_polygons`."""
    return shapely.union_all([feature.shape for feature in read_polygons(path, terrain)])


def read_placed_raster(path, terrain):
    """(values float64[rows, columns] with NaN for nodata, Grid) of a raster in the terrain's own CRS.

    Raises
    ------
    GeoreferenceError
        In another CRS, unless the terrain was brought to its CRS by `to_crs`: spatial values are resampled only where
        that is asked for.
    FormatError, InputError
    """
    values, grid = read_raster(path)
    target = terrain.grid.crs
    if grid.crs is not None and target is not None and not same_place(grid.crs, target):
        if terrain.reprojection is not None:
            return reprojected_raster(path, target)
        raise GeoreferenceError(
            f"{path} is in {name_of(grid.crs)}, the DTM in {name_of(target)}; give --to-crs auto, or reproject it: "
            f"{warp_command(path, name_of(target), 'nearest')}"
        )
    if grid.crs is None or target is None:
        with muted():
            require_lies_on(grid.bounds, grid.crs, terrain, path)
    return values, Grid(target, grid.transform, grid.shape)
