"""Spatial inputs of a scene in the terrain's CRS: polygons and lines with their columns, and rasters.

Vector and raster inputs brought to the terrain's CRS.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyproj
import shapely

from ..system.disguised_files import require_undisguised
from ..system.errors import FormatError, GeoreferenceError, InputError, MpmgisError
from ..system.messages import log, muted
from ..system.optional_libraries import pyogrio
from .dtm import WithoutCRS
from .georeference import horizontal, name_of, same_place, warp_command
from .grid import Grid
from .raster_input import open_raster, read_raster
from .release_parts import polygons_only
from .terrain_warp import reprojected_raster
from .vector_table import LAYER, names_of, read_table, require_polygons

RASTER_SUFFIXES = {".tif", ".tiff", ".vrt", ".asc", ".img", ".nc", ".grd", ".hgt", ".bil", ".dem", ".sdat", ".jp2"}
_SAME_METRES = 1e-3  # [m] smaller displacements by a reprojection are not reported


def is_raster(path):
    """True where GDAL reads `path` as a raster; files that can be both (GeoPackage) count as vector."""
    text = str(path)
    if LAYER in text:
        return False
    path = Path(text)
    if path.suffix.lower() in RASTER_SUFFIXES:
        return True
    require_undisguised(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if len(pyogrio().list_layers(path)):
                return False
    except Exception:  # not a vector file; it may be a raster
        pass
    try:
        with open_raster(path):
            return True
    except FormatError:
        return False


def repaired(shape, name, path):
    """`shape` as valid polygons; a repair is reported with the new area."""
    if not shapely.is_valid(shape):
        reason = shapely.is_valid_reason(shape).split("[")[0].strip().lower()
        fixed = polygons_only(_make_valid(shape))
        log.info(f"{path}: '{name}' was invalid ({reason}) and is repaired; the area is {fixed.area:.6g} m2")
        shape = fixed
    if shape.is_empty or shape.area <= 0:
        raise InputError(f"{path}: '{name}' has no area; draw it again, or remove it")
    return shape


def _make_valid(shape):
    """Repair by GEOS that unites overlapping parts (the other method cuts them out as holes)."""
    try:
        return shapely.make_valid(shape, method="structure", keep_collapsed=False)
    except TypeError:  # shapely before 2.1 has only the other method: unite part by part
        parts = [shapely.make_valid(part) for part in shapely.get_parts(shape)]
        return shapely.union_all(parts)


def to_terrain(shapes, crs, terrain, path):
    """2D shapes in the terrain's CRS; reprojection and assumptions are reported."""
    shapes = shapely.force_2d(shapes)
    target = terrain.grid.crs
    if crs is None or target is None:
        require_lies_on(shapely.total_bounds(shapes), crs, terrain, path)
        return list(shapes)
    if same_place(crs, target):
        return list(shapes)
    transformer = transformer_to(horizontal(pyproj.CRS(crs)), target, path)
    before = shapely.get_coordinates(shapes)
    after = np.column_stack(transformer.transform(*before.T))
    if not np.isfinite(after).all():
        unnamed = "; GeoJSON without a CRS is in degrees" if Path(path).suffix in (".json", ".geojson") else ""
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be reprojected to {name_of(target)}; check its CRS{unnamed}"
        )
    if np.abs(after - before).max() > _SAME_METRES:
        log.info(f"{path}: reprojected from {name_of(crs)} to {name_of(target)}, the terrain's CRS")
    return list(shapely.set_coordinates(shapes, after))


def transformer_to(crs, target, path):
    """pyproj's Transformer from `crs` to `target`, for the file at `path`.

    Raises
    ------
    GeoreferenceError
        There is no transformation, for example from the CRS of another planet.
    """
    try:
        return pyproj.Transformer.from_crs(crs, target, always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be reprojected to {name_of(target)}; check its CRS"
        ) from error


def require_lies_on(bounds, crs, terrain, path):
    """Without a CRS on one side, refuse coordinates outside the terrain; report the assumed CRS otherwise."""
    grid = terrain.grid
    west, south, east, north = bounds
    apart = west > grid.bounds[2] or east < grid.bounds[0] or south > grid.bounds[3] or north < grid.bounds[1]
    if apart:
        small = max(abs(west), abs(east)) <= 360 and max(abs(south), abs(north)) <= 90
        degrees = " and look like degrees" if small else ""
        problem = "has no CRS" if crs is None else f"is in {name_of(crs)}, the DTM in a local frame"
        raise GeoreferenceError(
            f"{path} {problem}, and its coordinates ({west:.6g}, {south:.6g}) are outside the DTM{degrees}; assign "
            f"its CRS (QGIS: Define projection), or use the CRS of the DTM"
        )
    if crs is None and grid.crs is not None:
        log.info(f"{path} has no CRS; its coordinates are on the terrain, so {name_of(grid.crs)} is assumed")
    elif crs is not None:
        log.info(
            f"{path} is in {name_of(crs)}, the DTM in a local frame; its coordinates are on the terrain and are used "
            "unchanged"
        )


def with_crs_hint(path, open_terrain):
    """`open_terrain()`; if the DTM has no CRS, the error suggests the CRS of the file `path` that overlaps it.

    Raises
    ------
    MpmgisError
    """
    try:
        return open_terrain()
    except WithoutCRS as error:
        raise GeoreferenceError(f"{error}{_crs_hint(path, error.bounds)}") from error


def _crs_hint(path, bounds):
    """Suggestion of the CRS of the file `path`; empty without an EPSG code in metres, or outside `bounds`."""
    crs, lies = (None, None) if path is None else _crs_and_bounds(path)
    number = crs.to_epsg() if crs is not None else None
    if number is None or not all(axis.unit_name == "metre" for axis in crs.axis_info):
        return ""
    if lies[0] > bounds[2] or lies[2] < bounds[0] or lies[1] > bounds[3] or lies[3] < bounds[1]:
        return ""
    return f"; {path} overlaps it and is in {name_of(crs)}: if the DTM is too, give --crs EPSG:{number}"


def _crs_and_bounds(path):
    """(pyproj.CRS or None, bounds) of a vector file or a raster; (None, None) where it cannot be read."""
    try:
        if is_raster(path):
            grid = read_raster(path)[1]
            return grid.crs, grid.bounds
        table = read_table(path)
    except MpmgisError:  # reported later, once the DTM has a CRS
        return None, None
    return (table.crs, shapely.total_bounds(table.geometry)) if table.geometry is not None else (None, None)


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
        if width is not None and kinds & {"LineString", "MultiLineString", "Polygon", "MultiPolygon"}:
            raise InputError(f"{path} does not contain only lines, and width = {width:g} is for lines; remove width")
        return _features(path, require_polygons(table, path), terrain)
    if width is None:
        raise InputError(f"{path} contains lines; give [[barrier]] width, the thickness of the wall [m]")
    names, rows = names_of(table, path), table.rows()
    lines = to_terrain(table.geometry, table.crs, terrain, path)
    if shapely.is_empty(lines).any() or shapely.is_missing(lines).any():
        raise InputError(f"{path}: a line has no geometry; draw it again, or remove it")
    return [
        Feature(name, line.buffer(0.5 * width, cap_style="flat", join_style="mitre"), row, str(path))
        for name, line, row in zip(names, lines, rows, strict=True)
    ]


def _features(path, table, terrain):
    names, rows = names_of(table, path), table.rows()
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
