"""Features from files on the solver's grid: friction zones, walls, erodible ground and lakes, with their checks.

Forest from files on the solver's grid: values of the trees at the nodes, with their checks.
"""

import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...laws.friction import given_instead, turbulent_coefficient
from ...scene.tables import HIGHEST_WALL
from ...system.errors import InputError, SceneError
from ...system.messages import log
from ..columns.feature_arrays import NO_LAKE
from .lakes_and_areas import cell_values, lake_cells, water_depth, within
from .wall_openings import narrow_openings
from .walls import CORE_CELLS, FACE_CELLS, Wall, half_thickness, wall_nodes

DRY = 1e-6  # [m] thinner water at a lake's shore is none
MOST_NAMED = 5  # narrow openings that are reported one by one
REPORTED_CHANGE = 1e-3  # share of a release by which it may change without a word


@dataclass(frozen=True)
class PlacedFiles:
    """Features of the files of one table, in the CRS of the terrain.

    Parameters
    ----------
    features : list, optional
        Polygons: objects with name, shape (shapely, map metres), path, and number(column), a float; None where the
        table names no polygons.
    raster : (float64[rows, columns], Grid), optional
        In place of polygons; NaN where it has no value.
    values : dict
        Parameter -> raster of its values.
    """

    features: list | None = None
    raster: tuple | None = None
    values: dict = field(default_factory=dict)


def painted_zones(scene, zones, grid):
    """Parameter of friction -> float64 at the nodes: [friction] underneath, then every zone in its order.

    `zones` are (number in the scene, ZoneTable, PlacedFiles). NaN where there is no value.

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
    """(bool nodes, parameter, its values at the nodes) of each feature and parameter of a zone, in order."""
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


def standing_walls(barriers, grid, everything):
    """(tuple of Wall, WallNodes) of `barriers`, (BarrierTable, PlacedFiles) each; ((), None) without any.

    Raises
    ------
    InputError
        A wall off the terrain, below it or on the columns of `everything` (Frame); an invalid height.
    """
    walls = walls_of(barriers)
    if not walls:
        return (), None
    nodes = wall_nodes(walls, *grid.node_axes(), grid.bed, grid.cell_size)
    _require_standing(walls, nodes, grid, everything)
    return walls, nodes


def walls_of(barriers):
    """Tuple of Wall of `barriers`, (BarrierTable, PlacedFiles) each."""
    walls = []
    for table, files in barriers:
        for k, feature in enumerate(files.features, 1):
            height, crest = (
                feature.number(value) if isinstance(value, str) else value for value in (table.height, table.crest)
            )
            if height is not None and not 0.0 < height <= HIGHEST_WALL:
                raise InputError(
                    f"{feature.path}: '{feature.name}' has height {height:g}, expected metres above 0, at most "
                    f"{HIGHEST_WALL:g}"
                )
            name = _unlike(_wall_name(table, feature.name, k, len(files.features)), walls)
            walls.append(Wall(name, feature.shape, height, crest, table.mu))
    return tuple(walls)


def _wall_name(table, feature_name, k, count):
    """The name of feature `k` of `count`: the table's, else the feature's own, else the file's; numbered if shared."""
    stem = Path(table.source).stem
    own = stem if feature_name.startswith("feature ") else feature_name
    name = table.name or own
    return f"{name} {k}" if count > 1 and (table.name or own == stem) else name


def _unlike(name, walls):
    """`name`, with a number where a wall has it already."""
    taken = {wall.name for wall in walls}
    numbered = (name if k == 1 else f"{name} ({k})" for k in itertools.count(1))
    return next(candidate for candidate in numbered if candidate not in taken)


def _require_standing(walls, nodes, grid, frame):
    """Refuse walls off the terrain, under the ground or on the release; report thin walls and narrow openings."""
    i, j = (np.rint(place / grid.cell_size).astype(int) + 1 for place in grid.from_corner(frame))
    closed = np.where(nodes.share > 0.0, 0, nodes.number)
    under = closed[np.clip(j, 0, grid.bed.shape[0] - 1), np.clip(i, 0, grid.bed.shape[1] - 1)]
    for number, wall in enumerate(walls, 1):
        own = nodes.number == number
        if not own.any():
            _refuse_without_nodes(wall, walls, nodes, grid)
        above = (nodes.crest - grid.bed)[own]
        if wall.crest is not None and above.max() > HIGHEST_WALL:
            raise InputError(
                f"barrier '{wall.name}': its crest at {wall.crest:g} m is {above.max():.4g} m above the terrain, "
                f"expected at most {HIGHEST_WALL:g} m; give the elevation of the crest [m], or height"
            )
        if wall.crest is not None and above.max() <= 0:
            raise InputError(
                f"barrier '{wall.name}': its crest at {wall.crest:g} m is below the terrain, which is at "
                f"{grid.bed[own].min():.1f} to {grid.bed[own].max():.1f} m there; give a higher crest, or height"
            )
        if wall.crest is not None and (buried := np.mean(above <= 0)) > 0.01:
            log.info(f"barrier '{wall.name}': {100 * buried:.0f} % of it is below the terrain, where it has no effect")
        if (under == number).any():
            raise InputError(
                f"barrier '{wall.name}' is on the release ({int((under == number).sum())} particles start inside it, "
                f"including one cell on each side); move it, or take a smaller [numerics] cell_size"
            )
        thin, least = 2.0 * half_thickness(wall.footprint), 2.0 * (FACE_CELLS + CORE_CELLS) * grid.cell_size
        if thin < least - 2.0 * grid.cell_size:
            log.info(
                f"barrier '{wall.name}' is {thin:.3g} m thick, thinner than a cell; it is computed {least:g} m thick "
                "(3 cells), the least that stops a flow on this grid"
            )
    for east, north, width in narrow_openings([wall.footprint for wall in walls], grid.cell_size)[:MOST_NAMED]:
        log.info(
            f"barriers: the opening at E {east:.1f} N {north:.1f} is {width:.2g} m wide, narrower than a cell; it "
            f"passes the flow by its share of the cells. [numerics] cell_size = {width:.2g} or less resolves it"
        )


def _refuse_without_nodes(wall, walls, nodes, grid):
    """Refuse a wall that has no node: other walls have them, or it is not on the terrain."""
    x, y = grid.node_points()
    owners = nodes.number[within(wall.footprint.buffer(grid.cell_size), x, y) & grid.domain_nodes()]
    others = ", ".join(f"'{walls[number - 1].name}'" for number in np.unique(owners[owners > 0])[:MOST_NAMED])
    if others:
        raise InputError(
            f"barrier '{wall.name}' is completely inside barrier {others}; remove one of them, or change their outlines"
        )
    raise InputError(f"barrier '{wall.name}' is outside the terrain; check its CRS, or use a larger DTM")


def erodible_mass(table, files, path, grid, flow_density):
    """Mass that the flow can take up at the nodes [kg m-2 on the map] by the EntrainmentTable and its file at `path`.

    Raises
    ------
    SceneError, InputError
        Thickness missing, given twice, negative, or nowhere on the terrain.
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
    if table.thickness is not None:
        raise SceneError("[entrainment]: a raster contains its own thickness; remove thickness, or give polygons")
    thickness = np.nan_to_num(cell_values(*files.raster, x, y))
    if thickness.min() < 0:
        raise InputError(f"{path}: thickness reaches {thickness.min():g}, expected metres from 0 up")
    return thickness


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


def lake_levels(table, files, grid, frame):
    """Still-water level in the cells of every lake [m], NO_LAKE elsewhere; `frame` has the initial columns.

    Without files every water body below the StillWaterTable's level that is filled counts.

    Raises
    ------
    SceneError
        No water body is filled to its level, or one body has two levels.
    """
    water = water_depth(*grid.from_corner(frame), frame.particles.volume, grid.inside.shape, grid.cell_size)
    levels = np.full(grid.inside.shape, NO_LAKE)
    for level, touched in _still_levels(table, files, grid):
        cells, others = lake_cells(grid.bed[1:-1, 1:-1], level, water, touched)
        if not cells.any():
            best = f"; the fullest holds {100 * max(others):.0f} % of it" if others else ""
            raise SceneError(
                f"[still_water]: no water body below {level:g} m is filled by the release at the start{best}; a lake "
                "at rest is filled to its level: correct level or release, or take the table out"
            )
        clash = cells & (levels != NO_LAKE) & (levels != level)
        if clash.any():
            raise SceneError(
                f"[still_water]: levels {levels[clash][0]:g} and {level:g} m are given for one water body; keep one"
            )
        levels[cells] = level
    return levels


def _still_levels(table, files, grid):
    """(level [m], bool cells that its lake touches or None for any) of each lake that the scene names."""
    if files.features is None:
        yield table.level, None
        return
    rows, columns = np.indices(grid.inside.shape) + 0.5
    x, y = grid.x0 + columns * grid.cell_size, grid.y0 + rows * grid.cell_size
    for feature in files.features:
        level = feature.number(table.level) if isinstance(table.level, str) else table.level
        touched = within(feature.shape, x, y)
        if not touched.any():
            raise InputError(f"{feature.path}: '{feature.name}' covers no cell of the terrain; check its CRS")
        yield level, touched


def levelled(frame, levels, grid):
    """`frame` with its columns in lakes filled to their still level over the solver's own bed.

    That bed is smoother than the DTM that the release was measured on; water laid on the one and standing on the other
    would rise and sink by the difference. Columns on ground above the level are left out.

    Parameters
    ----------
    frame : Frame
        The columns at the start.
    levels : float64[ny, nx] [m]
        As of `lake_levels`.
    """
    p, density = frame.particles, frame.header["density"]
    x, y = grid.from_corner(frame)
    ny, nx = levels.shape
    j = np.clip((y / grid.cell_size).astype(int), 0, ny - 1)
    i = np.clip((x / grid.cell_size).astype(int), 0, nx - 1)
    level = levels[j, i]
    thickness = np.where(level != NO_LAKE, level - grid.beds_at(frame), p.thickness)
    kept = thickness > DRY
    volume = (thickness * p.area)[kept]
    change = volume.sum() / p.volume.sum() - 1.0
    if abs(change) > REPORTED_CHANGE:
        log.info(f"[still_water]: the release is filled to the still level, its volume by {100 * change:+.2g} %")
    particles = replace(p, thickness=thickness, id=None).take(kept)
    return replace(frame, particles=replace(particles, volume=volume, mass=density * volume))
