"""Put features from files on the solver's grid: friction zones and erodible ground, with their checks."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely

from ...laws.friction import DRAG, ROLES, given_instead, turbulent_coefficient
from ...system.errors import InputError, SceneError
from .area_shares import (
    SAME,
    Area,
    covered_nodes,
    covers_domain,
    domain_shares,
    mask_share,
    raster_means,
    square_areas,
    visible_shares,
)
from .feature_notes import Note

if TYPE_CHECKING:
    from pathlib import Path

    from ...scene.scene import Scene
    from ...scene.tables import EntrainmentTable, ZoneTable
    from ..columns.node_grid import ColumnGrid

ROUNDED = float(np.finfo(np.float32).eps)  # [1] relative: a limit that a raster of float32 has is not beyond it


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


class Erodible(NamedTuple):
    """Erodible ground at the nodes."""

    mass: np.ndarray  # float64[ny + 3, nx + 3] [kg m-2] for each square metre on the map
    share: np.ndarray  # float64[ny + 3, nx + 3] [1] of the node's square that is erodible


def painted_zones(
    scene: "Scene", zones: "Iterable[tuple[int, ZoneTable, PlacedFiles]]", grid: "ColumnGrid", notes: list[Note]
) -> dict[str, np.ndarray]:
    """Return the parameters of friction at the nodes: means of [friction] and of the zones by the areas they cover.

    Later zones lie on earlier ones. The mean of xi is that of 1 / xi, to which its drag is in proportion.

    Parameters
    ----------
    scene : Scene
    zones : iterable of (int, ZoneTable, PlacedFiles)
        Number in the scene, table and files of each zone.
    grid : ColumnGrid
    notes : list of Note
        To which lines about how it is computed are added.

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
    instead = given_instead(scene.friction.law)
    areas = {name: ([], []) for name in law}  # of each parameter, and their values
    for number, zone, files in zones:
        covers = False
        for area, name, value in _painting(zone, files, grid):
            own = instead[name][1] if name in instead else law[name]
            _require_in_range(_values_in(value, area, grid), name, own, f"[[zones]] number {number}")
            if name in instead:
                name, value = instead[name][0], turbulent_coefficient(value)
            areas[name][0].append(area)
            areas[name][1].append(value)
            covers = covers or covers_domain(area, grid)
        if not covers:
            raise InputError(f"[[zones]] number {number} covers no part of the terrain; check its CRS and its values")
        notes += area_notes("zones", f"[[zones]] number {number}", files, grid)
    given = scene.friction.parameters
    means = {name: _mean(*areas[name], given.get(name, np.nan), grid, ROLES.get(name) == DRAG) for name in law}
    return {name: np.pad(values, 1, "edge") for name, values in means.items()}


def _painting(zone, files, grid):
    """Yield (Area, parameter, its value or its values at the nodes) for each feature and parameter of a zone."""
    numbers = {name: value for name, value in zone.parameters.items() if not isinstance(value, str)}
    rasters = {
        name: raster_means(*raster, grid, reciprocal=ROLES.get(name) == DRAG) for name, raster in files.values.items()
    }
    columns = [name for name in zone.parameters if name not in numbers and name not in rasters]
    if files.features is None:
        if columns:
            name, given = columns[0], zone.parameters[columns[0]]
            raise SceneError(f"[[zones]]: {name} = {given!r} is not a file, and without polygons there are no columns")
        share = mask_share(files.raster, grid) if files.raster is not None else np.ones(square_areas(grid).shape)
        yield from ((Area(None, share), name, value) for name, value in numbers.items())
        yield from ((Area(None, share * known), name, mean) for name, (mean, known) in rasters.items())
        return
    for feature in files.features:
        yield from ((Area(feature.shape), name, value) for name, value in numbers.items())
        yield from ((Area(feature.shape, known), name, mean) for name, (mean, known) in rasters.items())
        yield from ((Area(feature.shape), name, feature.number(zone.parameters[name])) for name in columns)


def area_notes(effect: str, what: str, files: PlacedFiles, grid: "ColumnGrid", more: str = "") -> list[Note]:
    """Return a Note of the area of polygons or of a raster, and how much of it acts on the domain; none without both.

    Parameters
    ----------
    effect : str
        That they belong to.
    what : str
        Name of the table.
    files : PlacedFiles
    grid : ColumnGrid
    more : str
        At the end of the line.
    """
    if files.features is not None:
        shape = shapely.union_all([feature.shape for feature in files.features])
        drawn, share = shape.area, domain_shares(shape, grid)
    elif files.raster is not None:
        values, placed = files.raster
        drawn, share = np.count_nonzero(np.nan_to_num(values)) * placed.cell_area, mask_share(files.raster, grid)
    else:
        return []
    used = float((share * square_areas(grid)).sum())
    text = f"{what}: {drawn:.6g} m2 are drawn, {used:.6g} m2 of them lie on the terrain and act{more}"
    return [Note(effect, text, np.flatnonzero(share > 0.0))]


def _values_in(value, area, grid):
    """The value of an area; of a raster those where the area is."""
    return value[covered_nodes(area, grid)] if isinstance(value, np.ndarray) else np.array([value])


def _mean(areas, values, base, grid, reciprocal):
    """float64[ny + 1, nx + 1]: mean of the visible values over the nodes' squares, with `base` outside the areas.

    NaN where there is none.
    """
    shape = square_areas(grid).shape
    total, share, found = np.zeros(shape), np.zeros(shape), np.full(shape, np.nan)
    for number, window, part in visible_shares(areas, grid):
        value = values[number][window] if isinstance(values[number], np.ndarray) else values[number]
        total[window] += np.where(part > 0.0, part / value if reciprocal else part * value, 0.0)
        share[window] += part
        found[window] = np.where(part == 1.0, value, found[window])
    if np.isfinite(base):
        rest = np.maximum(1.0 - share, 0.0)
        total, share = total + (rest / base if reciprocal else rest * base), share + rest
    mean = np.divide(total, share, out=np.full(shape, np.nan), where=share > 0.0)
    mean = 1.0 / mean if reciprocal else mean
    mean = np.where(np.abs(mean - base) <= SAME * np.abs(base), base, mean)
    return np.where(np.isfinite(found), found, mean)


def _require_in_range(values, name, parameter, where):
    _, _, low, high, _ = parameter
    beyond = values[(values < low - ROUNDED * low) | (values > high + ROUNDED * high)]
    if beyond.size:
        worst = beyond.min() if beyond.min() < low else beyond.max()
        raise SceneError(f"{where}: {name} reaches {worst:g}, expected {low:g} to {high:g}")


def erodible_ground(
    table: "EntrainmentTable",
    files: PlacedFiles,
    path: "Path",
    grid: "ColumnGrid",
    flow_density: float,
    notes: list[Note],
) -> Erodible:
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
    notes : list of Note
        To which lines about how it is computed are added.

    Returns
    -------
    Erodible

    Raises
    ------
    SceneError, InputError
        The thickness is missing, given twice, negative, or nowhere on the terrain.
    """
    thickness, share = (_raster_ground if files.features is None else _polygon_ground)(table, files, path, grid)
    if not thickness.any():
        raise InputError(f"{path}: no erodible ground on this terrain; check its CRS and its values")
    if table.thickness_mode == "normal":
        thickness = thickness * np.sqrt(1.0 + (grid.gradient[1:-1, 1:-1] ** 2).sum(axis=-1))
    mass = (table.density if table.density is not None else flow_density) * thickness
    more = f"; {float((mass * square_areas(grid)).sum()):.6g} kg can be taken up"
    notes += area_notes("entrainment", "[entrainment]", files, grid, more)
    return Erodible(np.pad(mass, 1), np.pad(share, 1))


def _raster_ground(table, files, path, grid):
    """(mean thickness [m], share with a thickness [1]) at the nodes of the domain, from a raster."""
    if isinstance(table.thickness, str):
        raise SceneError("[entrainment]: thickness names a column, and a raster has none; give a number of metres")
    values, placed = files.raster
    values = np.nan_to_num(values)
    if values.min() < 0:
        raise InputError(f"{path}: thickness reaches {values.min():g}, expected metres from 0 up")
    if table.thickness is not None:
        values = table.thickness * values  # of a mask: 1 inside
    mean, share = raster_means(np.where(values > 0.0, values, np.nan), placed, grid)
    return np.nan_to_num(mean) * share, share


def _polygon_ground(table, files, path, grid):
    """(mean thickness [m], share with a thickness [1]) at the nodes of the domain, from polygons."""
    if table.thickness is None:
        raise SceneError("[entrainment]: polygons need thickness: a number of metres, or a column's name")
    given, depths = table.thickness, []
    for feature in files.features:
        depths.append(feature.number(given) if isinstance(given, str) else given)
        if depths[-1] < 0:
            raise InputError(f"{path}: '{feature.name}' has thickness {depths[-1]:g}, expected metres from 0 up")
    thickness, share = np.zeros((2, *square_areas(grid).shape))
    for number, window, part in visible_shares([Area(feature.shape) for feature in files.features], grid):
        if depths[number] > 0.0:
            thickness[window] += part * depths[number]
            share[window] += part
    return thickness, np.minimum(share, 1.0)
