"""Spatial inputs of a scene in the terrain's CRS: polygons and lines with their columns, and rasters."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely

from ..system.errors import FormatError, GeoreferenceError, InputError, MpmgisError
from ..system.file_references import require_local
from ..system.messages import log, muted
from ..system.source_names import source_of
from ..system.zip_archives import members
from .datum_shift import transformer_to
from .dtm import WithoutCRS
from .elevation import Terrain
from .georeference import horizontal, name_of, same_place, warp_command
from .grid import Grid
from .raster_input import RASTER_SUFFIXES, grid_of, open_raster, read_raster
from .release_parts import polygons_only
from .terrain_reprojection import reprojected_raster
from .undeclared_nodata import Role
from .vector_table import names_of, open_vector, read_table, require_polygons

_SAME_METRES = 1e-3  # [m] smaller displacements by a reprojection are not reported


def is_raster(path: str | Path) -> bool:
    """Return whether GDAL reads a file as a raster; files that can be both (GeoPackage) count as vector.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        A file that leads to others (`file_references.require_local`).
    """
    source = source_of(path)
    require_local(path)
    if source.options or source.driver:
        return bool(source.driver)
    inside = [] if source.part or source.elsewhere else members(source.file)
    if any(Path(name).suffix.lower() in RASTER_SUFFIXES for name in (source.part or source.file, *inside)):
        return True
    try:
        with warnings.catch_warnings(), open_vector(path) as (library, place):
            warnings.simplefilter("ignore")
            if len(library.list_layers(place)):
                return False
    except Exception:  # not a vector file; it may be a raster
        pass
    try:
        with open_raster(path):
            return True
    except FormatError:
        return False


def repaired(shape: shapely.Geometry, name: str, path: str | Path) -> shapely.Geometry:
    """Return a shape as valid polygons; report a repair with the new area.

    Parameters
    ----------
    shape : shapely.Geometry
    name : str
        Of the feature, for messages.
    path : str or Path
        For messages.

    Raises
    ------
    InputError
        It has no area.
    """
    if not shapely.is_valid(shape):
        reason = shapely.is_valid_reason(shape).split("[")[0].strip().lower()
        fixed = polygons_only(_make_valid(shape))
        log.info(f"{path}: '{name}' was invalid ({reason}) and is repaired; the area is {fixed.area:.6g} m2")
        shape = fixed
    if shape.is_empty or shape.area <= 0:
        raise InputError(f"{path}: '{name}' has no area; draw it again, or remove it")
    return shape


def _make_valid(shape: shapely.Geometry) -> shapely.Geometry:
    """Repair by GEOS with the method that unites overlapping parts (the other one cuts them out as holes)."""
    try:
        return shapely.make_valid(shape, method="structure", keep_collapsed=False)
    except TypeError:  # shapely before 2.1 has only the other method: unite part by part
        parts = [shapely.make_valid(part) for part in shapely.get_parts(shape)]
        return shapely.union_all(parts)


def to_terrain(shapes: np.ndarray, crs: pyproj.CRS | None, grid: Grid, path: str | Path) -> list[shapely.Geometry]:
    """Return 2D shapes in the terrain's CRS; report reprojection and assumptions.

    Parameters
    ----------
    shapes : object[n]
        Of shapely.Geometry.
    crs : pyproj.CRS or None
        Of the shapes.
    grid : Grid
        Of the terrain.
    path : str or Path
        For messages.

    Raises
    ------
    GeoreferenceError
        They cannot be reprojected, or are outside the terrain and one side has no CRS.
    """
    shapes = shapely.force_2d(shapes)
    target = grid.crs
    if crs is None or target is None:
        require_lies_on(shapely.total_bounds(shapes), crs, grid, path)
        return list(shapes)
    if same_place(crs, target):
        return list(shapes)
    before = shapely.get_coordinates(shapes)
    transformer, shift = transformer_to(horizontal(pyproj.CRS(crs)), target, (*before, (0.0, 0.0))[0], path)
    after = np.column_stack(transformer.transform(*before.T))
    if not np.isfinite(after).all():
        unnamed = "; GeoJSON without a CRS is in degrees" if Path(path).suffix in (".json", ".geojson") else ""
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be reprojected to {name_of(target)}; check its CRS{unnamed}"
        )
    if np.abs(after - before).max() > _SAME_METRES:
        log.info(f"{path}: reprojected from {name_of(crs)} to {name_of(target)}, the terrain's CRS{shift}")
    return list(shapely.set_coordinates(shapes, after))


def require_lies_on(bounds: Sequence[float], crs: pyproj.CRS | None, grid: Grid, path: str | Path) -> None:
    """Refuse coordinates outside the terrain where one side has no CRS; report the assumed CRS otherwise.

    Parameters
    ----------
    bounds : (float, float, float, float)
        West, south, east, north of the input.
    crs : pyproj.CRS or None
        Of the input.
    grid : Grid
        Of the terrain.
    path : str or Path
        For messages.

    Raises
    ------
    GeoreferenceError
    """
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


def with_crs_hint(path: str | Path | None, open_terrain: Callable[[], Any]) -> Any:
    """Call `open_terrain`; if the DTM has no CRS, suggest the CRS of another file that overlaps it.

    Parameters
    ----------
    path : str, Path or None
        Of the other file.
    open_terrain : callable () -> object

    Returns
    -------
    object
        The result of `open_terrain`.

    Raises
    ------
    GeoreferenceError
        The DTM has no CRS.
    """
    try:
        return open_terrain()
    except WithoutCRS as error:
        raise GeoreferenceError(f"{error}{_crs_hint(path, error.bounds)}") from error


def _crs_hint(path: str | Path | None, bounds: tuple[float, float, float, float]) -> str:
    """Return the suggestion of the CRS of a file; "" without an EPSG code in metres, or outside `bounds`."""
    crs, lies = (None, None) if path is None else _crs_and_bounds(path)
    number = crs.to_epsg() if crs is not None else None
    if number is None or not all(axis.unit_name == "metre" for axis in crs.axis_info):
        return ""
    if lies[0] > bounds[2] or lies[2] < bounds[0] or lies[1] > bounds[3] or lies[3] < bounds[1]:
        return ""
    return f"; {path} overlaps it and is in {name_of(crs)}: if the DTM is too, give --crs EPSG:{number}"


def _crs_and_bounds(path: str | Path) -> tuple:
    """Return (pyproj.CRS or None, bounds) of a vector file or a raster; (None, None) where it cannot be read."""
    try:
        if is_raster(path):
            with open_raster(path) as source:
                grid = grid_of(source, path)
            return grid.crs, grid.bounds
        table = read_table(path)
    except MpmgisError:  # reported later, once the DTM has a CRS
        return None, None
    return (table.crs, shapely.total_bounds(table.geometry)) if table.geometry is not None else (None, None)


@dataclass(frozen=True)
class Feature:
    """One feature of a vector file.

    Parameters
    ----------
    name : str
    shape : shapely.Geometry [m]
        In the terrain's CRS.
    columns : dict
        Column -> value of its row.
    path : str
    """

    name: str
    shape: shapely.Geometry
    columns: dict
    path: str

    def number(self, column: str) -> float:
        """Return the finite number in a column.

        Parameters
        ----------
        column : str

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


def read_polygons(path: str | Path, terrain: Terrain) -> list[Feature]:
    """Read polygons as Features in the terrain's CRS; report repairs and reprojections.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    return _features(path, require_polygons(read_table(path, flag=""), path), terrain)


def read_walls(path: str | Path, terrain: Terrain, width: float | None) -> list[Feature]:
    """Read barriers as Features in the terrain's CRS: polygons, or lines that become polygons.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain
    width : float or None [m]
        Of the walls along lines; None for polygons.

    Raises
    ------
    InputError
        Lines without a width, a width for other shapes than lines, or a line without geometry.
    FormatError, GeoreferenceError
    """
    table = read_table(path, flag="")
    kinds = table.kinds if table.geometry is not None else set()
    if not kinds or not kinds <= {"LineString", "MultiLineString"}:
        if width is not None and kinds & {"LineString", "MultiLineString", "Polygon", "MultiPolygon"}:
            raise InputError(f"{path} does not contain only lines, and width = {width:g} is for lines; remove width")
        return _features(path, require_polygons(table, path), terrain)
    if width is None:
        raise InputError(f"{path} contains lines; give [[barrier]] width, the thickness of the wall [m]")
    names, rows = names_of(table, path), table.rows()
    lines = to_terrain(table.geometry, table.crs, terrain.grid, path)
    if shapely.is_empty(lines).any() or shapely.is_missing(lines).any():
        raise InputError(f"{path}: a line has no geometry; draw it again, or remove it")
    return [
        Feature(name, line.buffer(0.5 * width, cap_style="flat", join_style="mitre"), row, str(path))
        for name, line, row in zip(names, lines, rows, strict=True)
    ]


def _features(path, table, terrain):
    names, rows = names_of(table, path), table.rows()
    shapes = to_terrain(table.geometry, table.crs, terrain.grid, path)
    return [
        Feature(name, repaired(shape, name, path), row, str(path))
        for name, shape, row in zip(names, shapes, rows, strict=True)
    ]


def read_area(path: str | Path, terrain: Terrain) -> shapely.Geometry:
    """Read polygons as one geometry in the terrain's CRS.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        As `read_polygons`.
    """
    return shapely.union_all([feature.shape for feature in read_polygons(path, terrain)])


def read_placed_raster(path: str | Path, terrain: Terrain, role: Role) -> tuple[np.ndarray, Grid]:
    """Read a raster that must be in the terrain's own CRS.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain
    role : Role
        What it contains.

    Returns
    -------
    values : float64[rows, columns]
        NaN for nodata.
    grid : Grid

    Raises
    ------
    GeoreferenceError
        In another CRS, unless the terrain was brought to its CRS by `to_crs`: spatial values are resampled only where
        that is asked for.
    FormatError, InputError
    """
    values, grid = read_raster(path, role)
    target = terrain.grid.crs
    if grid.crs is not None and target is not None and not same_place(grid.crs, target):
        if terrain.reprojection is not None:
            return reprojected_raster(path, target, role)
        raise GeoreferenceError(
            f"{path} is in {name_of(grid.crs)}, the DTM in {name_of(target)}; give --to-crs auto, or reproject it: "
            f"{warp_command(path, name_of(target), 'nearest')}"
        )
    if grid.crs is None or target is None:
        with muted():
            require_lies_on(grid.bounds, grid.crs, terrain.grid, path)
    return values, Grid(target, grid.transform, grid.shape)
