"""What a scene knows by place: its files read, checked against the release, and put on the solver's grid."""

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from ..effects.zones import FrictionZones
from ..errors import InputError, SceneError
from ..geo.barriers import CORE_CELLS, FACE_CELLS, Wall, half_thickness, wall_nodes
from ..geo.lakes import lake_cells, water_depth
from ..geo.zones import cell_values, spread, within
from ..io.by_place import read_placed_raster, read_polygons, read_walls
from ..io.vector import is_raster
from ..scene import mu_least
from ..solvers.places import NO_LAKE, Places, barrier_entries

LEAST_OF = ("xi",)  # parameters whose least value makes the law's part largest; of others the mean decides


@dataclass(frozen=True)
class KnownByPlace:
    """The places of one scene before its effects are decided; None or empty where it has nothing of the kind.

    Parameters
    ----------
    grid : ColumnGrid
    scene : Scene
    zones : dict
        Parameter of friction -> float64 at the nodes, NaN where nothing says it.
    erodible : float64 at the nodes [kg m-2]
    walls : tuple of Wall
    wall_nodes : WallNodes
    lake_level : float64 in the cells [m]
    """

    grid: object
    scene: object
    zones: dict
    erodible: np.ndarray | None
    walls: tuple
    wall_nodes: object
    lake_level: np.ndarray | None

    def mu_least(self):
        """The least that friction can be anywhere [1]."""
        if not self.zones:
            return mu_least(self.scene)
        ends = {name: {np.nanmin(values), np.nanmax(values)} for name, values in self.zones.items()}
        corners = itertools.product(*([(name, value) for value in sorted(found)] for name, found in ends.items()))
        return min(mu_least(_with_friction(self.scene, dict(corner))) for corner in corners)

    def facts(self, terrain, reach, frame, depth):
        """What `TerrainFacts` tells of places; `depth` [m] is the release's, `frame` its columns.

        Raises
        ------
        SceneError
            Ground in reach of the flow without friction.
        """
        x, y = _node_points(self.grid)
        inside, near = reach.at(terrain.grid, x, y)
        facts = {}
        if self.zones:
            within_domain = _domain(inside)
            self._require_no_gap(inside & within_domain, x, y)
            facts["zone_spread"] = max(spread(values, inside & within_domain) for values in self.zones.values())
        if self.erodible is not None:
            mass = self.erodible[inside].sum() * self.grid.cell_size**2
            facts["erodible_ratio"] = float(mass / frame.particles.mass.sum())
        if self.walls:
            facts |= self._wall_facts(terrain, reach, inside | near, x, y, depth)
        if self.lake_level is not None:
            facts["lake_ratio"] = self._lake_volume() / float(frame.particles.volume.sum())
        return facts

    def completed(self, reach, terrain):
        """The scene with the friction that stands for its zones, to decide effects by."""
        if not self.zones:
            return self.scene
        x, y = _node_points(self.grid)
        inside = reach.at(terrain.grid, x, y)[0] & _domain(x)
        told = {}
        for name, values in self.zones.items():
            chosen = values[inside] if np.isfinite(values[inside]).any() else values
            told[name] = float(np.nanmin(chosen) if name in LEAST_OF else np.nanmean(chosen))
        return _with_friction(self.scene, told)

    def on_grid(self, effects):
        """The Places of a run in which `effects` are on."""
        zones, barriers, names = None, None, ()
        if isinstance(effects.zones, FrictionZones):
            zones = np.stack([_filled(self.zones[name]) for name in effects.friction._fields], axis=-1)
        if effects.barrier.barrier_active():
            barriers, names = barrier_entries(self.wall_nodes), tuple(wall.name for wall in self.walls)
        return Places(
            zone_values=zones,
            erodible=self.erodible if effects.entrainment.entrainment_active() else None,
            barriers=barriers,
            barrier_names=names,
            lake_level=self.lake_level if effects.still_water.still_water_active() else None,
        )

    def _require_no_gap(self, inside, x, y):
        for name, values in self.zones.items():
            gap = inside & ~np.isfinite(values)
            if gap.any():
                at = tuple(np.argwhere(gap)[0])
                area = gap.sum() * self.grid.cell_size**2
                raise SceneError(
                    f"[[zones]]: {name} is not known on {area:.4g} m2 that the flow can reach, for example at "
                    f"E {x[at]:.1f} N {y[at]:.1f}; extend the zones or fill the raster there, or give [friction] {name}"
                )

    def _wall_facts(self, terrain, reach, reached, x, y, depth):
        """How far walls are from reachable ground, and how high the lowest is against flow and energy head there."""
        stands = self.wall_nodes.number > 0
        touched = stands & reached
        if not touched.any():
            apart = ndimage.distance_transform_edt(~reached) if reached.any() else np.full(x.shape, max(x.shape))
            return {"barrier_distance": float(apart[stands].min() * self.grid.cell_size)}
        row, column = terrain.grid.rowcol(x[touched], y[touched])
        i, j = (np.clip(np.rint(v / reach.step).astype(int), 0, n - 1)
                for v, n in zip((row, column), reach.height.shape, strict=True))  # fmt: skip
        head = depth + np.maximum(np.nan_to_num(reach.height[i, j]), 0.0)
        above = self.wall_nodes.crest[touched] - self.grid.bed[touched]
        return {"barrier_distance": 0.0, "barrier_height_ratio": float((above / np.maximum(head, 1e-6)).min())}

    def _lake_volume(self):
        bed = self.grid.bed[1:-1, 1:-1]
        mean = 0.25 * (bed[:-1, :-1] + bed[:-1, 1:] + bed[1:, :-1] + bed[1:, 1:])
        return float(np.maximum(self.lake_level - mean, 0.0).sum() * self.grid.cell_size**2)


def read_places(scene, terrain, grid, start, everything, say):
    """Read all that `scene` knows by place; a KnownByPlace.

    Parameters
    ----------
    scene : Scene
    terrain : Terrain
    grid : ColumnGrid
        Of the solver.
    start, everything : Frame
        The columns at the start, and all that may ever be released.
    say : callable

    Raises
    ------
    InputError
        Files that cannot be read or do not match terrain, release and scene.
    """
    walls = _walls(scene, terrain, say)
    nodes = None
    if walls:
        x, y = _node_axes(grid)
        nodes = wall_nodes(walls, x, y, grid.bed, grid.cell_size)
        _require_standing(walls, nodes, grid, everything, say)
    return KnownByPlace(
        grid, scene, _zones(scene, terrain, grid, say), _erodible(scene, terrain, grid, everything, say), walls, nodes,
        _lakes(scene, terrain, grid, start, say),
    )  # fmt: skip


def trial_parameters(scene):
    """Parameters to try the scene's law with: what only zones give is their first number, else the least it can be."""
    law = scene.laws[scene.friction.law][1]
    numbers = {}
    for zone in scene.zones:
        numbers = {name: v for name, v in zone.parameters.items() if not isinstance(v, str)} | numbers
    return {name: scene.friction.parameters.get(name, numbers.get(name, allowed[2])) for name, allowed in law.items()}


def _node_axes(grid):
    """Map coordinates [m] of the columns and of the rows of the grid's nodes, ghosts included."""
    rows, columns = grid.bed.shape
    return grid.x0 + (np.arange(columns) - 1) * grid.cell_size, grid.y0 + (np.arange(rows) - 1) * grid.cell_size


def _node_points(grid):
    """Map coordinates [m] of all nodes, each float64[rows, columns]."""
    return np.meshgrid(*_node_axes(grid))


def _with_friction(scene, values):
    """`scene` with these parameters of friction, in the order of its law."""
    table = scene.friction
    known = {**table.parameters, **values}
    ordered = {name: known[name] for name in scene.laws[table.law][1] if name in known}
    return replace(scene, friction=replace(table, parameters=ordered))


def _domain(nodes):
    """True at nodes that are no ghosts."""
    inner = np.zeros(nodes.shape, bool)
    inner[1:-1, 1:-1] = True
    return inner


def _filled(values):
    """`values` with what is not known taken from the nearest node that knows."""
    known = np.isfinite(values)
    return values if known.all() else values[tuple(ndimage.distance_transform_edt(~known, return_distances=False,
                                                                                  return_indices=True))]  # fmt: skip


# ------------------------------------------------------------------------------------------------------------- zones


def _zones(scene, terrain, grid, say):
    """Parameter -> values at the nodes: [friction] underneath, then every zone in its order."""
    used = [(k, zone) for k, zone in enumerate(scene.zones, 1) if zone.use != "off"]
    if not used or scene.friction.use == "off":
        return {}
    law = scene.laws[scene.friction.law][1]
    x, y = _node_points(grid)
    painted = {name: np.full(x.shape, scene.friction.parameters.get(name, np.nan)) for name in law}
    for number, zone in used:
        for shape, name, value in _painting(scene, zone, terrain, x, y, say):
            known = np.isfinite(value)
            _require_in_range(value[known & shape], name, law[name], f"[[zones]] number {number}")
            painted[name] = np.where(shape & known, value, painted[name])
    return painted


def _painting(scene, zone, terrain, x, y, say):
    """(bool nodes, parameter, its values at the nodes) of each feature and parameter of a zone, in order."""
    rasters = {
        name: _raster_at(scene.path(value), terrain, x, y) for name, value in zone.parameters.items()
        if isinstance(value, str) and (Path(value).suffix or scene.path(value).exists())
    }  # fmt: skip
    constant = {name: np.full(x.shape, value) for name, value in zone.parameters.items() if not isinstance(value, str)}
    columns = {name: value for name, value in zone.parameters.items() if name not in rasters and name not in constant}
    if zone.source is None or is_raster(scene.path(zone.source)):
        if columns:
            name, column = next(iter(columns.items()))
            raise SceneError(f"[[zones]]: {name} = {column!r} is no file, and without polygons there are no columns")
        mask = np.ones(x.shape, bool)
        if zone.source is not None:
            mask = np.nan_to_num(_raster_at(scene.path(zone.source), terrain, x, y)) != 0
        yield from ((mask, name, values) for name, values in {**constant, **rasters}.items())
        return
    for feature in read_polygons(scene.path(zone.source), terrain, say):
        mask = within(feature.shape, x, y)
        own = {name: np.full(x.shape, feature.number(column)) for name, column in columns.items()}
        yield from ((mask, name, values) for name, values in {**constant, **rasters, **own}.items())


def _raster_at(path, terrain, x, y):
    return cell_values(*read_placed_raster(path, terrain), x, y)


def _require_in_range(values, name, parameter, where):
    _, _, low, high, _ = parameter
    if values.size and (values.min() < low or values.max() > high):
        worst = values.min() if values.min() < low else values.max()
        raise SceneError(f"{where}: {name} reaches {worst:g}, wanted {low:g} to {high:g}")


# ---------------------------------------------------------------------------------------------------------- barriers


def _walls(scene, terrain, say):
    """The Wall of every feature of every barrier that is not off, with names that differ."""
    walls = []
    for table in scene.barrier:
        if table.use == "off":
            continue
        features = read_walls(scene.path(table.source), terrain, table.width, say)
        for k, feature in enumerate(features, 1):
            plain = feature.name if not feature.name.startswith("feature ") else Path(table.source).stem
            name = table.name or plain
            if len(features) > 1 and (table.name or plain == Path(table.source).stem):
                name = f"{name} {k}"
            height, crest = (
                feature.number(value) if isinstance(value, str) else value for value in (table.height, table.crest)
            )
            if height is not None and height <= 0:
                raise InputError(f"{feature.path}: '{feature.name}' has height {height:g}, wanted metres above 0")
            walls.append(Wall(_unlike(name, walls), feature.shape, height, crest, table.mu))
    return tuple(walls)


def _unlike(name, walls):
    """`name`, with a number where a wall has it already."""
    taken = {wall.name for wall in walls}
    numbered = (name if k == 1 else f"{name} ({k})" for k in itertools.count(1))
    return next(candidate for candidate in numbered if candidate not in taken)


def _require_standing(walls, nodes, grid, frame, say):
    """Refuse walls off the terrain, under the ground or on the release; say which are thickened (design note H28)."""
    x, y = frame.map_xy()
    i = np.rint((x - grid.x0) / grid.cell_size).astype(int) + 1
    j = np.rint((y - grid.y0) / grid.cell_size).astype(int) + 1
    under = nodes.number[np.clip(j, 0, grid.bed.shape[0] - 1), np.clip(i, 0, grid.bed.shape[1] - 1)]
    for number, wall in enumerate(walls, 1):
        mine = nodes.number == number
        if not mine.any():
            raise InputError(f"barrier '{wall.name}' lies outside the terrain; check its CRS, or use a larger DTM")
        above = (nodes.crest - grid.bed)[mine]
        if wall.crest is not None and above.max() <= 0:
            raise InputError(
                f"barrier '{wall.name}': its crest at {wall.crest:g} m is below the terrain, which is at "
                f"{grid.bed[mine].min():.1f} to {grid.bed[mine].max():.1f} m there; give a higher crest, or height"
            )
        if wall.crest is not None and (buried := np.mean(above <= 0)) > 0.01:
            say(f"barrier '{wall.name}': {100 * buried:.0f} % of it is below the terrain, where it holds nothing")
        if (under == number).any():
            raise InputError(
                f"barrier '{wall.name}' stands on the release ({int((under == number).sum())} columns start inside it, "
                f"with the cell on each side that it takes); move it, or take a smaller [numerics] cell_size"
            )
        thin, least = 2.0 * half_thickness(wall.footprint), 2.0 * (FACE_CELLS + CORE_CELLS) * grid.cell_size
        if thin < least - 2.0 * grid.cell_size:
            say(
                f"barrier '{wall.name}' is {thin:.3g} m thick, thinner than a cell; it is computed {least:g} m thick "
                "(3 cells), which is what holds a flow on this grid"
            )


# ----------------------------------------------------------------------------------------------------- erodible ground


def _erodible(scene, terrain, grid, frame, say):
    """Mass that the flow can take up at the nodes [kg m-2 on the map]; None without [entrainment]."""
    table = scene.entrainment
    if table is None or table.use == "off":
        return None
    x, y = _node_points(grid)
    path = scene.path(table.source)
    if is_raster(path):
        if table.thickness is not None:
            raise SceneError("[entrainment]: a raster brings its own thickness; take thickness out, or give polygons")
        thickness = np.nan_to_num(_raster_at(path, terrain, x, y))
        if thickness.min() < 0:
            raise InputError(f"{path}: thickness reaches {thickness.min():g}, wanted metres from 0 up")
    else:
        if table.thickness is None:
            raise SceneError("[entrainment]: polygons need thickness: a number of metres, or a column's name")
        thickness = np.zeros(x.shape)
        for feature in read_polygons(path, terrain, say):
            given = table.thickness
            metres = feature.number(given) if isinstance(given, str) else given
            if metres < 0:
                raise InputError(f"{path}: '{feature.name}' has thickness {metres:g}, wanted metres from 0 up")
            thickness = np.where(within(feature.shape, x, y), metres, thickness)
    if not thickness[_domain(thickness)].any():
        raise InputError(f"{path}: no erodible ground on this terrain; check its CRS and its values")
    if table.thickness_mode == "normal":
        thickness = thickness * np.sqrt(1.0 + (grid.gradient**2).sum(axis=-1))
    density = table.density if table.density is not None else frame.header["density"]
    return np.where(_domain(thickness), density * thickness, 0.0)


# --------------------------------------------------------------------------------------------------------------- lakes


def _lakes(scene, terrain, grid, frame, say):
    """Still level in the cells of every lake [m], NO_LAKE elsewhere; None without [still_water].

    Raises
    ------
    SceneError
        No water body is filled to its level, or one body has two levels.
    """
    table = scene.still_water
    if table is None or table.use == "off":
        return None
    x, y = frame.map_xy()
    water = water_depth(x - grid.x0, y - grid.y0, frame.particles.volume, grid.inside.shape, grid.cell_size)
    levels = np.full(grid.inside.shape, NO_LAKE)
    for level, touched in _still_levels(scene, terrain, grid, say):
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


def _still_levels(scene, terrain, grid, say):
    """(level [m], bool cells that its lake touches or None for any) of each lake that the scene names."""
    table = scene.still_water
    if table.source is None:
        yield table.level, None
        return
    rows, columns = np.indices(grid.inside.shape) + 0.5
    x, y = grid.x0 + columns * grid.cell_size, grid.y0 + rows * grid.cell_size
    for feature in read_polygons(scene.path(table.source), terrain, say):
        level = feature.number(table.level) if isinstance(table.level, str) else table.level
        touched = within(feature.shape, x, y)
        if not touched.any():
            raise InputError(f"{feature.path}: '{feature.name}' covers no cell of the terrain; check its CRS")
        yield level, touched
