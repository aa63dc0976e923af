"""Observed outlines, lines, points and values at points, from vector files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyproj
import shapely
from rasterio.features import geometry_mask

from ..system.errors import GeoreferenceError, InputError
from ..system.messages import log
from .datum_shift import transformer_to
from .georeference import horizontal, name_of, same_place
from .grid import Grid
from .release_parts import polygons_only
from .vector_table import KINDS, names_of, read_table

QUANTITIES = ("h_max", "Ut_max", "p_max", "t_arrival")  # columns, as the bands of maxima
DEVIATION = "_sd"  # suffix of the column with standard deviations


def read_outline(path: str | Path, grid: Grid) -> shapely.Geometry:
    """Read polygons as one geometry in the CRS of a grid; report reprojection and repairs.

    Parameters
    ----------
    path : str or Path
    grid : Grid

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        No polygons, or none that can be brought to the grid's CRS.
    """
    shapes = _shapes(path, grid, "Polygon", "")
    broken = int(np.count_nonzero(~shapely.is_valid(shapes)))
    if broken:
        log.info(f"{path}: {broken} of {len(shapes)} polygons intersect themselves and are repaired")
    whole = polygons_only(shapely.union_all(shapely.make_valid(shapes)))
    if whole.is_empty or whole.area <= 0:
        raise InputError(f"{path}: the polygons have no area; draw the outline again")
    return whole


def read_line(path: str | Path, grid: Grid) -> np.ndarray:
    """Read the vertices of a single line, in the CRS of a grid.

    Parameters
    ----------
    path : str or Path
    grid : Grid

    Returns
    -------
    float64[n, 2] [m]

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        No line, or several that do not join to one.
    """
    shapes = _shapes(path, grid, "LineString", "--line ")
    parts = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(shapely.get_parts(shapes))))
    if len(parts) == 0:
        raise InputError(f"{path}: the line has no length; draw it again")
    if len(parts) != 1:
        raise InputError(f"{path} contains {len(parts)} lines that do not join end to end, expected one; keep only one")
    return shapely.get_coordinates(shapely.remove_repeated_points(parts[0]))


def read_points(path: str | Path, grid: Grid) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Read points with their names, in the CRS of a grid.

    Parameters
    ----------
    path : str or Path
    grid : Grid

    Returns
    -------
    names : tuple of str
    x, y : float64[n] [m]

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        No points, or none that can be brought to the grid's CRS.
    """
    shapes, names = _named_shapes(path, grid, "Point", "--points ")
    parts, of = shapely.get_parts(shapes, return_index=True)
    x, y = shapely.get_coordinates(parts).T
    return tuple(names[k] for k in of), x, y


def cells_within(shape: shapely.Geometry, grid: Grid) -> np.ndarray:
    """Return which cells of a grid have their centre within a geometry.

    Parameters
    ----------
    shape : shapely.Geometry
        In the CRS of the grid.
    grid : Grid

    Returns
    -------
    bool[rows, columns]
    """
    return geometry_mask([shape], grid.shape, grid.transform, invert=True)


def _shapes(path: str | Path, grid: Grid, kind: str, flag: str) -> np.ndarray:
    """Return the geometries of one kind at `path`, 2D and in the CRS of `grid`; leave empty ones out."""
    return _named_shapes(path, grid, kind, flag)[0]


def _named_shapes(path: str | Path, grid: Grid, kind: str, flag: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the geometries as `_shapes`, and the name of each."""
    table = read_table(path, kind, flag)
    wanted = KINDS[kind]
    if table.geometry is None:
        raise InputError(f"{path} contains a table without geometry, expected {wanted}")
    there = table.where(~table.without_geometry)
    others = sorted(there.kinds - {kind, f"Multi{kind}"})
    if others:
        raise InputError(f"{path} contains {', '.join(others)}, expected {wanted}")
    if len(there) == 0:
        raise InputError(f"{path} contains no geometry, expected {wanted}")
    flat = shapely.force_2d(there.geometry)
    if not np.isfinite(shapely.get_coordinates(flat)).all():
        raise InputError(f"{path}: some coordinates are NaN or infinite; repair the geometry (QGIS: Fix geometries)")
    return _on_grid(flat, table.crs, grid, path), np.array(names_of(table, path), dtype=object)[~table.without_geometry]


def _on_grid(shapes: np.ndarray, crs: pyproj.CRS | None, grid: Grid, path: str | Path) -> np.ndarray:
    """Return `shapes` in the CRS of `grid`; without a CRS on one side the coordinates must overlap the raster."""
    if crs is None or grid.crs is None:
        _require_near(shapely.total_bounds(shapes), crs, grid, path)
        if crs is not None or grid.crs is not None:
            log.info(f"{path}: the coordinates are assumed to be in the CRS of the rasters, {name_of(grid.crs or crs)}")
        return shapes
    if same_place(crs, grid.crs):
        return shapes
    coordinates = shapely.get_coordinates(shapes)
    transformer, shift = transformer_to(horizontal(pyproj.CRS(crs)), grid.crs, coordinates[0], path)
    moved = np.column_stack(transformer.transform(*coordinates.T))
    if not np.isfinite(moved).all():
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be reprojected to {name_of(grid.crs)}; check its CRS"
        )
    log.info(f"{path}: reprojected from {name_of(crs)} to {name_of(grid.crs)}, the CRS of the rasters{shift}")
    return shapely.set_coordinates(shapes.copy(), moved)


def _require_near(bounds: np.ndarray, crs: pyproj.CRS | None, grid: Grid, path: str | Path) -> None:
    """Refuse coordinates without a common CRS that are outside the raster."""
    west, south, east, north = grid.bounds
    if bounds[0] <= east and bounds[2] >= west and bounds[1] <= north and bounds[3] >= south:
        return
    problem = "has no CRS" if crs is None else f"is in {name_of(crs)}, the rasters in a local frame"
    raise GeoreferenceError(
        f"{path} {problem}, and its coordinates ({bounds[0]:.6g}, {bounds[1]:.6g}) are outside the rasters; assign "
        "its CRS (QGIS: Define projection), or use the CRS of the rasters"
    )


@dataclass(frozen=True)
class ObservedValue:
    """A value of a quantity at a point.

    Parameters
    ----------
    point : str
        Its name.
    quantity : str
        One of QUANTITIES.
    row, column : int
        Cell of the grid.
    value, deviation : float [SI]
        The value and its standard deviation.
    """

    point: str
    quantity: str
    row: int
    column: int
    value: float
    deviation: float


def read_values(path: str | Path, grid: Grid, error: float) -> list[ObservedValue]:
    """Read the values of QUANTITIES that were observed at points on the cells of a grid.

    Parameters
    ----------
    path : str or Path
    grid : Grid
    error : float [1]
        Relative standard deviation of values without one.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        No points, none of the columns, a point outside the grid, or a deviation that is not above 0.
    """
    names, x, y = read_points(path, grid)
    table = read_table(path, "Point", "--points ")
    columns = table.where(~table.without_geometry).columns
    given = [name for name in QUANTITIES if name in columns]
    if not given:
        raise InputError(f"{path} has none of the columns {', '.join(QUANTITIES)}; add the observed ones")
    if len(names) != len(columns[given[0]]):
        raise InputError(f"{path} contains multipoints; expected one point in each feature")
    column, row = (np.floor(v).astype(int) for v in ~grid.transform * (x, y))
    inside = (row >= 0) & (row < grid.shape[0]) & (column >= 0) & (column < grid.shape[1])
    if not inside.all():
        raise InputError(f"{path}: point {names[int(np.argmin(inside))]} is outside the DTM; remove it")
    found = []
    for quantity in given:
        values = np.array(columns[quantity], float)
        own = columns.get(quantity + DEVIATION)
        deviations = error * np.abs(values) if own is None else np.array(own, float)
        for k in np.flatnonzero(np.isfinite(values)):
            if not deviations[k] > 0:
                raise InputError(f"{path}: {quantity}{DEVIATION} of point {names[k]} is not above 0; give it")
            found.append(ObservedValue(str(names[k]), quantity, int(row[k]), int(column[k]), values[k], deviations[k]))
    if not found:
        raise InputError(f"{path}: all values of {', '.join(given)} are missing")
    return found
