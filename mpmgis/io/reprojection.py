"""Vector and raster inputs brought to the terrain's CRS."""

import warnings
from pathlib import Path

import numpy as np
import pyproj
import shapely

from ..errors import FormatError, GeoreferenceError, InputError, MpmgisError
from ..messages import log
from ..terrain.georeference import horizontal, name_of, same_place
from ..terrain.release import polygons_only
from .dtm import WithoutCRS
from .gdal_input import require_undisguised
from .libraries import pyogrio
from .raster import open_raster, read_raster
from .vector_table import LAYER, read_table

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
