"""Vector and raster inputs brought to the terrain's CRS."""

import warnings
from pathlib import Path

import numpy as np
import pyproj
import shapely

from ..errors import FormatError, GeoreferenceError, InputError, MpmgisError
from ..terrain.georeference import horizontal, name_of, same_place
from ..terrain.release import polygons_only
from .dtm import WithoutCRS
from .gdal_input import require_undisguised
from .libraries import pyogrio
from .raster import open_raster, read_raster
from .vector_table import LAYER, read_table

RASTER_SUFFIXES = {".tif", ".tiff", ".vrt", ".asc", ".img", ".nc", ".grd", ".hgt", ".bil", ".dem", ".sdat", ".jp2"}
_SAME_METRES = 1e-3  # [m] reprojection that moves nothing further than this is none


def is_raster(path):
    """True where GDAL reads `path` as a raster; files that may be both (GeoPackage) count as vector if they can."""
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
    except Exception:  # not a vector file: the raster door says whether it is one
        pass
    try:
        with open_raster(path):
            return True
    except FormatError:
        return False


def repaired(shape, name, path, say):
    """`shape` as valid areas; a repair is said with the areas before and after."""
    if not shapely.is_valid(shape):
        reason = shapely.is_valid_reason(shape).split("[")[0].strip().lower()
        fixed = polygons_only(_make_valid(shape))
        say(f"{path}: '{name}' was invalid ({reason}) and is repaired; its area is {fixed.area:.6g} m2")
        shape = fixed
    if shape.is_empty or shape.area <= 0:
        raise InputError(f"{path}: '{name}' has no area; draw it anew, or remove it")
    return shape


def _make_valid(shape):
    """GEOS's repair that unites overlapping parts (the other method would cut them out as holes)."""
    try:
        return shapely.make_valid(shape, method="structure", keep_collapsed=False)
    except TypeError:  # shapely before 2.1 knows only the other method: unite part by part
        parts = [shapely.make_valid(part) for part in shapely.get_parts(shape)]
        return shapely.union_all(parts)


def to_terrain(shapes, crs, terrain, path, say):
    """2D shapes in the terrain's CRS; reprojection and assumptions are said."""
    shapes = shapely.force_2d(shapes)
    target = terrain.grid.crs
    if crs is None or target is None:
        require_lies_on(shapely.total_bounds(shapes), crs, terrain, path, say)
        return list(shapes)
    if same_place(crs, target):
        return list(shapes)
    transformer = transformer_to(horizontal(pyproj.CRS(crs)), target, path)
    before = shapely.get_coordinates(shapes)
    after = np.column_stack(transformer.transform(*before.T))
    if not np.isfinite(after).all():
        unnamed = "; without a CRS inside, GeoJSON is in degrees" if Path(path).suffix in (".json", ".geojson") else ""
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be brought to {name_of(target)}; check its CRS{unnamed}"
        )
    if np.abs(after - before).max() > _SAME_METRES:
        say(f"{path}: reprojected from {name_of(crs)} to {name_of(target)}, the terrain's CRS")
    return list(shapely.set_coordinates(shapes, after))


def transformer_to(crs, target, path):
    """pyproj's Transformer from `crs` to `target`, of what lies at `path`.

    Raises
    ------
    GeoreferenceError
        There is no way, as from another planet's.
    """
    try:
        return pyproj.Transformer.from_crs(crs, target, always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be brought to {name_of(target)}; check its CRS"
        ) from error


def require_lies_on(bounds, crs, terrain, path, say):
    """Without a CRS on one side the coordinates must lie on the terrain (that is said; else refused)."""
    grid = terrain.grid
    west, south, east, north = bounds
    apart = west > grid.bounds[2] or east < grid.bounds[0] or south > grid.bounds[3] or north < grid.bounds[1]
    if apart:
        small = max(abs(west), abs(east)) <= 360 and max(abs(south), abs(north)) <= 90
        degrees = " and look like degrees" if small else ""
        problem = "carries no CRS" if crs is None else f"is in {name_of(crs)}, the DTM in a local frame"
        raise GeoreferenceError(
            f"{path} {problem}, and its coordinates ({west:.6g}, {south:.6g}) do not lie on the DTM{degrees}; assign "
            f"its CRS (QGIS: Define projection), or use the frame of the DTM"
        )
    if crs is None and grid.crs is not None:
        say(f"{path} carries no CRS; its coordinates lie on the terrain, so {name_of(grid.crs)} is assumed")
    elif crs is not None:
        say(
            f"{path} is in {name_of(crs)}, the DTM in a local frame; its coordinates lie on the terrain and are used "
            "as they are"
        )


def with_crs_beside(path, open_terrain):
    """`open_terrain()`. Where its DTM carries no CRS, the refusal names that of the file `path` that lies on it.

    Raises
    ------
    MpmgisError
    """
    try:
        return open_terrain()
    except WithoutCRS as error:
        raise GeoreferenceError(f"{error}{_crs_that_may_do(path, error.bounds)}") from error


def _crs_that_may_do(path, bounds):
    """Words about the CRS of the file `path`; empty without an EPSG code in metres, or where it lies off `bounds`."""
    crs, lies = (None, None) if path is None else _crs_and_bounds(path)
    number = crs.to_epsg() if crs is not None else None
    if number is None or not all(axis.unit_name == "metre" for axis in crs.axis_info):
        return ""
    if lies[0] > bounds[2] or lies[2] < bounds[0] or lies[1] > bounds[3] or lies[3] < bounds[1]:
        return ""
    return f"; {path} lies on it in {name_of(crs)}: if the DTM is in that, too, --crs EPSG:{number}"


def _crs_and_bounds(path):
    """(pyproj.CRS or None, bounds) of a vector file or a raster; (None, None) of what cannot be read."""
    try:
        if is_raster(path):
            grid = read_raster(path)[1]
            return grid.crs, grid.bounds
        table = read_table(path)
    except MpmgisError:  # its own refusal comes once the DTM has a CRS
        return None, None
    return (table.crs, shapely.total_bounds(table.geometry)) if table.geometry is not None else (None, None)
