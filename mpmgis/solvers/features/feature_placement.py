"""Put features from files on the solver's grid: friction zones and erodible ground, with their checks."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...laws.friction import given_instead, turbulent_coefficient
from ...system.errors import InputError, SceneError
from .area_values import cell_values, within

if TYPE_CHECKING:
    from pathlib import Path

    from ...scene.scene import Scene
    from ...scene.tables import EntrainmentTable, ZoneTable
    from ..columns.node_grid import ColumnGrid


@dataclass(frozen=True)
class PlacedFiles:
    """Features of the files of one table, in the CRS of the terrain.

    Parameters
    ----------
    features : list, optional
        Polygons: objects with a name, a shape (shapely, map metres), a path, and a method number(column) that returns a
        float. None where the table names no polygons.
    raster : (float64[rows, columns], Grid), optional
        Instead of polygons; NaN where it has no value.
    values : dict
        Parameter -> raster of its values.
    """

    features: list | None = None
    raster: tuple | None = None
    values: dict = field(default_factory=dict)


def painted_zones(
    scene: "Scene", zones: "Iterable[tuple[int, ZoneTable, PlacedFiles]]", grid: "ColumnGrid"
) -> dict[str, np.ndarray]:
    """Return the parameters of friction at the nodes: those of [friction], then those of every zone in its order.

    Parameters
    ----------
    scene : Scene
    zones : iterable of (int, ZoneTable, PlacedFiles)
        Number in the scene, table and files of each zone.
    grid : ColumnGrid

    Returns
    -------
    dict
        Parameter -> float64 at the nodes, NaN where there is no value.

    Raises
    ------
    SceneError, InputError
        A column without polygons or without numbers; values outside their parameter's range; a zone off the terrain.
    """
    law = scene.laws[scene.friction.law][1]
    x, y = grid.node_points()
    instead = given_instead(scene.friction.law)
    painted = {name: np.full(x.shape, scene.friction.parameters.get(name, np.nan)) for name in law}
    for number, zone, files in zones:
        covers = False
        for shape, name, value in _painting(zone, files, x, y):
            known = np.isfinite(value)
            covers = covers or (known & shape).any()
            own = instead[name][1] if name in instead else law[name]
            _require_in_range(value[known & shape], name, own, f"[[zones]] number {number}")
            if name in instead:
                name, value = instead[name][0], turbulent_coefficient(np.where(known & shape, value, np.nan))
            painted[name] = np.where(shape & known, value, painted[name])
        if not covers:
            raise InputError(f"[[zones]] number {number} covers no node of the terrain; check its CRS and its values")
    return painted


def _painting(zone, files, x, y):
    """Yield (bool nodes, parameter, its values at the nodes) for each feature and parameter of a zone, in order."""
    rasters = {name: cell_values(*raster, x, y) for name, raster in files.values.items()}
    constant = {name: np.full(x.shape, value) for name, value in zone.parameters.items() if not isinstance(value, str)}
    columns = {name: value for name, value in zone.parameters.items() if name not in rasters and name not in constant}
    if files.features is None:
        if columns:
            name, column = next(iter(columns.items()))
            raise SceneError(f"[[zones]]: {name} = {column!r} is not a file, and without polygons there are no columns")
        mask = np.ones(x.shape, bool)
        if files.raster is not None:
            mask = np.nan_to_num(cell_values(*files.raster, x, y)) != 0
        yield from ((mask, name, values) for name, values in {**constant, **rasters}.items())
        return
    for feature in files.features:
        mask = within(feature.shape, x, y)
        own = {name: np.full(x.shape, feature.number(column)) for name, column in columns.items()}
        yield from ((mask, name, values) for name, values in {**constant, **rasters, **own}.items())


def _require_in_range(values, name, parameter, where):
    _, _, low, high, _ = parameter
    if values.size and (values.min() < low or values.max() > high):
        worst = values.min() if values.min() < low else values.max()
        raise SceneError(f"{where}: {name} reaches {worst:g}, expected {low:g} to {high:g}")


def erodible_mass(
    table: "EntrainmentTable", files: PlacedFiles, path: "Path", grid: "ColumnGrid", flow_density: float
) -> np.ndarray:
    """Compute the mass that the flow can take up at the nodes.

    Parameters
    ----------
    table : EntrainmentTable
    files : PlacedFiles
    path : Path
        Of the file, for messages.
    grid : ColumnGrid
    flow_density : float [kg m-3]
        Used where the table gives no density.

    Returns
    -------
    float64[ny + 3, nx + 3] [kg m-2]
        For each square metre on the map.

    Raises
    ------
    SceneError, InputError
        The thickness is missing, given twice, negative, or nowhere on the terrain.
    """
    x, y = grid.node_points()
    thickness_from = _raster_thickness if files.features is None else _polygon_thickness
    thickness = thickness_from(table, files, path, x, y)
    inner = grid.domain_nodes()
    if not thickness[inner].any():
        raise InputError(f"{path}: no erodible ground on this terrain; check its CRS and its values")
    if table.thickness_mode == "normal":
        thickness = thickness * np.sqrt(1.0 + (grid.gradient**2).sum(axis=-1))
    density = table.density if table.density is not None else flow_density
    return np.where(inner, density * thickness, 0.0)


def _raster_thickness(table, files, path, x, y):
    if isinstance(table.thickness, str):
        raise SceneError("[entrainment]: thickness names a column, and a raster has none; give a number of metres")
    thickness = np.nan_to_num(cell_values(*files.raster, x, y))
    if thickness.min() < 0:
        raise InputError(f"{path}: thickness reaches {thickness.min():g}, expected metres from 0 up")
    return thickness if table.thickness is None else table.thickness * thickness  # of a mask: 1 inside


def _polygon_thickness(table, files, path, x, y):
    if table.thickness is None:
        raise SceneError("[entrainment]: polygons need thickness: a number of metres, or a column's name")
    thickness = np.zeros(x.shape)
    for feature in files.features:
        given = table.thickness
        metres = feature.number(given) if isinstance(given, str) else given
        if metres < 0:
            raise InputError(f"{path}: '{feature.name}' has thickness {metres:g}, expected metres from 0 up")
        thickness = np.where(within(feature.shape, x, y), metres, thickness)
    return thickness
