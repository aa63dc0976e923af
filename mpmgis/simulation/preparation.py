"""Prepare a run: read and check a scene, seed its release on the solver's grid, decide its effects."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..compiled.law_functions import require_compiled, use_own_laws
from ..laws.friction import BY_VOLUME, LAWS, SIZE, mu_of_size, size_of_release
from ..laws.own_law import NO_OWN_LAWS, load_laws, require_sound
from ..laws.quantities import GRAVITY
from ..scene import TerrainFacts, read_scene, resolve, scene_from_tables
from ..scene.joint_checks import check_together
from ..scene.tables import DENSITY
from ..seeding.implausible_values import Fixes, report_implausible, report_implausible_friction
from ..solvers.columns.column_solver import ColumnNumerics
from ..solvers.columns.node_grid import ColumnGrid, require_ground
from ..solvers.features.lakes import levelled
from ..solvers.points.point_numerics import PointNumerics
from ..system.errors import InputError, SceneError
from ..system.file_references import require_local
from ..system.memory import memory_lack
from ..system.messages import log, logged_once, muted
from ..terrain.dtm import READ_WHOLE, TerrainFile
from ..terrain.flow_reach import reach_facts, reach_of, release_facts, steepest_profile
from ..terrain.nodata_groups import nodata_in_reach
from ..terrain.release_parts import report_cliffs
from ..terrain.spatial_inputs import with_crs_hint
from ..terrain.walled_regions import require_real, walled_in_reach
from .mass_sources import read_point_start, read_sources
from .memory_need import MEMORY_SHARE
from .numerical_parameters import cells_times, default_courant_number, setting
from .release_events import Events
from .required_memory import require_memory
from .run_device import with_device
from .scene_files import read_spatial_features, trial_parameters
from .stage import Stage, read_areas, require_inflow_over
from .start_digest import start_digest

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..scene import Scene
    from ..solvers.columns.column_solver import ColumnSolver
    from ..solvers.points.point_solver import PointSolver
    from ..terrain.elevation import Terrain
    from ..terrain.flow_reach import Reach
    from ..terrain.nodata_fill import NodataFill
    from ..terrain.walled_regions import WalledRegion

MOST_SAMPLED = 10_000  # columns that are starts of energy lines
BYTES_PER_PIXEL = 140  # of a DTM that is read as a whole, for preparing a run; measured 135 with cells of a pixel
# option of `mpmgis seed` in a message -> key of a scene, except in `rio edit-info FILE --crs`
_KEYS_OF_OPTIONS = (
    (r"omit --crs\b", "omit [terrain] crs"),
    (r"--crs got", r"[terrain] crs got"),
    (r"(?<!FILE )--crs (EPSG:\w+|local)", r'[terrain] crs = "\1"'),
    (r"--to-crs (EPSG:\w+|auto)", r'[terrain] to_crs = "\1"'),
    (r"--to-crs got", r"[terrain] to_crs got"),
    (r"--dem-band (\w+)", r"[terrain] band = \1"),
    (r"--thickness-mode (\w+)", r'[release] thickness_mode = "\1"'),
    (r"--(thickness|surface|density)\b", r"[release] \1"),
)


@dataclass(frozen=True)
class Prepared:
    """All checked data of a run before its first step.

    `effects`, `decisions`, `facts`, `numerics`, `places`, `walls` and `grid` are those of the first stage, the only one
    of most scenes.

    Parameters
    ----------
    scene : Scene
        With the defaults of omitted keys.
    terrain : Terrain
    frame : Frame
        Columns or points at the start.
    events : Events
    digest : str
        Of all input of the run.
    stages : tuple of Stage
        The parts of the run, one after the other.
    seen : Frame
        All mass that may ever move, as columns.
    vertical_stress : float64[n] or None [Pa]
        Of points at the start.
    affine : float64[n, 3, 3] or None [s-1]
        Velocity gradient of points at the start.
    fill : NodataFill or None
        Of the terrain, where the scene requests it.
    walled : tuple of WalledRegion
        Probably undeclared nodata of the terrain.
    """

    scene: "Scene"
    terrain: "Terrain"
    frame: "Frame"
    events: Events
    digest: str
    stages: tuple  # of Stage
    seen: "Frame"
    vertical_stress: np.ndarray | None = None  # float64[n] [Pa]
    affine: np.ndarray | None = None  # float64[n, 3, 3] [s-1]
    fill: "NodataFill | None" = None
    walled: "tuple[WalledRegion, ...]" = ()

    effects = property(lambda self: self.stages[0].effects)
    decisions = property(lambda self: self.stages[0].decisions)
    facts = property(lambda self: self.stages[0].facts)
    numerics = property(lambda self: self.stages[0].numerics)
    places = property(lambda self: self.stages[0].places)
    walls = property(lambda self: self.stages[0].walls)
    grid = property(lambda self: self.stages[0].grid)

    @property
    def coarsest_cells(self) -> float:
        """Cell size [m] of the stage with the largest cells."""
        return max(stage.numerics.cell_size for stage in self.stages)

    @property
    def particles(self) -> int:
        """Number of columns or points, at the start and released later."""
        return len(self.frame.particles) + self.events.columns_to_come()

    def particles_of(self, number: int) -> int:
        """Estimate the number of particles of a stage; of later points those of the whole release.

        Parameters
        ----------
        number : int
            Of the stage, from 0.
        """
        stage = self.stages[number]
        if number == 0:
            return self.particles
        if stage.scene.solver == "points":
            return int(stage.point_options().predicted_points(self.seen.particles))
        return int(self.seen.particles.area.sum() / stage.grid.cell_size**2 * stage.scene.columns_per_cell) + 1

    @property
    def stress(self) -> np.ndarray | None:
        """Kirchhoff stress of points at the start, float64[n, 6] [Pa]; None if unknown."""
        return self.stages[0].stress(self.terrain, self.frame, self.vertical_stress)

    def solver(self) -> "ColumnSolver | PointSolver":
        """Return the solver of the first stage at its start."""
        return self.stages[0].solver(self.terrain, self.frame, self.vertical_stress, self.affine)


@dataclass(frozen=True)
class _Start:
    """Moving mass: columns or points at the start (`frame`), and all mass that may ever move as columns (`seen`)."""

    frame: "Frame"
    seen: "Frame"
    events: Events
    facts: dict
    reference_thickness: float | None
    vertical_stress: np.ndarray | None = None
    affine: np.ndarray | None = None


def prepare(
    given: str | Path | Mapping,
    laws: str | Path | None = None,
    device: str | None = None,
    begin: Callable[["Scene"], object] = lambda scene: None,
) -> Prepared:
    """Read a scene with its terrain and release, seed it on the solver's grid, decide its effects.

    Parameters
    ----------
    given : path or Mapping
        Path of a scene.toml, or its tables, with paths relative to the current folder.
    laws : path, optional
        Python file with the user's own friction laws; it is executed.
    device : str, optional
        Replaces [numerics] device.
    begin : callable
        Called with the scene once its tables are checked, before its files are read.

    Raises
    ------
    InputError
        With the name of the scene in the message.
    """
    scene = scene_to_prepare(given, laws)
    if device is not None:
        scene = replace(scene, numerics=replace(scene.numerics, device=device))
        check_together(scene, "scene" if isinstance(given, Mapping) else Path(given).name)
    where = "scene" if isinstance(given, Mapping) else Path(given).name
    begin(scene)
    try:
        return prepare_scene(scene)
    except InputError as error:  # a message without the file name, those of other modules with options of `seed`
        message = str(error) if isinstance(error, SceneError) else in_scene_words(str(error))
        raise type(error)(f"{where}: {message}") from error


def in_scene_words(message: str) -> str:
    """Replace options of `mpmgis seed` in a message by keys of a scene.

    Parameters
    ----------
    message : str
    """
    for option, key in _KEYS_OF_OPTIONS:
        message = re.sub(option, key, message)
    return message


@logged_once()
def prepare_scene(scene: "Scene") -> Prepared:
    """Prepare a run of a Scene that is already read, see `prepare`.

    Parameters
    ----------
    scene : Scene
    """
    terrain, fill, walled = with_crs_hint(_first_area(scene), lambda: _terrain(scene))
    scene = _completed(_with_density(scene), terrain.grid.cell_size)
    alone = [_with_courant_number(one) for one in scene.alone()]
    require_memory(alone, [stage.window is not None for stage in scene.stage] or [False], terrain)
    grids = [ColumnGrid.on(terrain, one.numerics.cell_size) for one in alone]
    start = (_start_of_points if alone[0].solver == "points" else _start_of_columns)(alone[0], terrain, grids[0])
    require_inflow_over(scene.stage, start.events)
    volume = float(start.seen.particles.volume.sum())
    scene, *alone = (_sized(one, volume) for one in (scene, *alone))
    stages, reached = [], lru_cache(partial(_reached, terrain, start.seen))
    for number, (one, grid) in enumerate(zip(alone, grids, strict=True)):
        areas = read_areas(scene, number, terrain)
        stages.append(_stage(one, terrain, grid, start, reached, walled, number > 0, areas))
    _log_no_friction(stages)
    frame, lakes = start.frame, stages[0].places.lake_level
    if lakes is not None:
        frame = levelled(frame, lakes, grids[0])
    shapes = [shape for stage in stages for shape in stage.shapes()]
    digest = scene.digest(start_digest(terrain, frame, start.events, *(s.places for s in stages), shapes=shapes))
    frame = replace(frame, digest=digest)
    prepared = Prepared(
        scene,
        terrain,
        frame,
        start.events,
        digest,
        tuple(stages),
        start.seen,
        start.vertical_stress,
        start.affine,
        fill,
        walled,
    )
    return with_device(prepared)


@muted()
def on_larger_cells(prepared: Prepared, factor: float) -> Prepared:
    """Return the same run on larger cells, with as many columns or points in each and with the same effects.

    Parameters
    ----------
    prepared : Prepared
    factor : float [1]
        Size of the cells over that of the run.

    Raises
    ------
    InputError
        The release has nothing on such cells, or the files have changed.
    """
    terrain = prepared.terrain
    scene = setting(prepared.scene, "cell_size", cells_times(prepared.scene, factor)).scene
    alone = [_with_courant_number(one) for one in scene.alone()]
    grids = [ColumnGrid.on(terrain, one.numerics.cell_size) for one in alone]
    start = (_start_of_points if alone[0].solver == "points" else _start_of_columns)(alone[0], terrain, grids[0])
    if scene.release is not None and scene.release.particles is not None:
        start = _thinned(start, factor)
    at_start = start.frame if start.frame.dimension == 2 else start.seen
    stages = []
    for stage, one, grid in zip(prepared.stages, alone, grids, strict=True):
        known = read_spatial_features(one, terrain, grid, at_start, start.seen)
        places = known.in_3d(stage.effects) if one.solver == "points" else known.on_grid(stage.effects)
        numerics = replace(stage.numerics, cell_size=grid.cell_size)
        larger = {"scene": one, "grid": grid, "known_walls": known.walls}
        stages.append(replace(stage, **larger, numerics=numerics, places=places))
    frame, lakes = start.frame, stages[0].places.lake_level
    frame = frame if lakes is None else levelled(frame, lakes, grids[0])
    start_of = {"vertical_stress": start.vertical_stress, "affine": start.affine, "events": start.events}
    return replace(prepared, scene=scene, frame=frame, seen=start.seen, stages=tuple(stages), **start_of)


def _thinned(start, factor):
    """Return a random part of the particles of a file, with the mass of all; as many are in larger cells."""
    count = len(start.frame.particles)
    kept = np.sort(np.random.default_rng(0).permutation(count)[: max(1, round(count / factor**start.frame.dimension))])
    more, few = count / len(kept), start.frame.particles.take(kept)
    grown = {name: more * getattr(few, name) for name in ("mass", "volume", "area") if getattr(few, name) is not None}
    stress, affine = ((None if of is None else of[kept]) for of in (start.vertical_stress, start.affine))
    frame = replace(start.frame, particles=replace(few, **grown), state={})
    return replace(start, frame=frame, vertical_stress=stress, affine=affine)


def _sized(scene: "Scene", volume: float) -> "Scene":
    """Return a scene whose size of avalanche is that of the released volume [m3], where it asks for that."""
    table = scene.friction
    if table is None or table.written.get(SIZE) != BY_VOLUME:
        return scene
    size = size_of_release(volume)
    parameters = {**table.parameters, "mu": mu_of_size(size)}
    chosen = f" ({size}, for a release of {volume:.6g} m3)"
    return replace(scene, friction=replace(table, parameters=parameters, chosen=chosen))


def _first_area(scene):
    """Return the path of the release area, or else of the inlet; None without."""
    for table in (scene.release, scene.hydrograph):
        if table is not None and table.source is not None:
            return scene.path(table.source)
    return None


def _terrain(scene):
    """Return (the terrain, of which only the window of the scene is read; its NodataFill or None; WalledRegions)."""
    table = scene.terrain
    file = TerrainFile(scene.path(table.dem), table.crs, table.band, table.fill_nodata, table.to_crs)
    window = table.window
    if window is None:
        _check_size(file.path, file.grid.shape)
        return file.whole(), file.fill, file.walled
    west, south, east, north = file.grid.bounds
    if window[0] >= east or window[2] <= west or window[1] >= north or window[3] <= south:
        raise SceneError(
            f"[terrain] window = {list(window)} does not overlap the DTM, E {west:.0f} to {east:.0f}, N {south:.0f} to "
            f"{north:.0f}; correct it"
        )
    rows, columns = file.grid.window(window, 0)
    _check_size(f"[terrain] window of {file.path}", (rows.stop - rows.start, columns.stop - columns.start))
    given = zip(("west", "south", "east", "north"), window, (west, south, east, north), (-1, -1, 1, 1), strict=True)
    beyond = [side for side, value, edge, out in given if out * (value - edge) > file.grid.cell_size]
    if beyond:
        log.info(
            f"[terrain] window = [west, south, east, north] extends beyond the DTM to the {', '.join(beyond)}; it is "
            f"clipped there (W {west:.0f}, S {south:.0f}, E {east:.0f}, N {north:.0f})"
        )
    return file.cropped(window, 0), file.fill, file.walled


def _check_size(name, shape):
    """Log the memory for a very large DTM before it is read; raise SceneError if it is not available."""
    rows, columns = shape
    if rows * columns <= READ_WHOLE:
        return
    needed, cells = rows * columns * BYTES_PER_PIXEL, f"{name} has {rows} x {columns} cells"
    fix = "[terrain] window = [west, south, east, north] reads only a part"
    if lack := memory_lack(needed, MEMORY_SHARE):
        raise SceneError(f"{cells}, which need {lack}; {fix}")
    log.info(f"{cells}, which need up to {needed / 1e9:.2g} GB; {fix}")


def _start_of_columns(scene, terrain, grid):
    """Return the _Start of a run that begins with columns."""
    sources = read_sources(scene, terrain, grid)
    _check_release(sources.frame.particles, sources.frame.header, scene, grid.cell_size)
    report_cliffs(grid.gradients_at(sources.everything), sources.everything)
    return _Start(sources.frame, sources.everything, sources.events, sources.facts, sources.reference_thickness)


def _start_of_points(scene, terrain, grid):
    """Return the _Start of a run that begins with points."""
    start = read_point_start(scene, terrain, grid)
    _check_release(start.seen.particles, start.frame.header, scene, grid.cell_size)
    return _Start(start.frame, start.seen, Events(), {}, None, start.vertical_stress, start.affine)


def _stage(
    scene: "Scene",
    terrain: "Terrain",
    grid: ColumnGrid,
    start: _Start,
    reached: Callable,
    walled: "tuple[WalledRegion, ...]",
    later: bool,
    areas: dict,
) -> Stage:
    """Return the Stage of a `scene` of one solver; its effects are decided by the release, also for later stages.

    `reached(mu)` returns the result of `_reached`, `areas` are those of `read_areas`.
    """
    at_start = start.frame if start.frame.dimension == 2 else start.seen
    known = read_spatial_features(scene, terrain, grid, at_start, start.seen)
    reach, facts, deciding = _facts(terrain, start.seen, reached, known)
    in_reach = nodata_in_reach(terrain, reach, grid.cell_size)
    require_ground(scene.solver, scene.numerics.edges, in_reach)
    real = scene.terrain.real_values or ()
    for line in require_real(walled_in_reach(walled, reach, terrain.grid, grid.cell_size), real, terrain.path):
        log.info(line)
    for line in in_reach.lines():
        log.info(line)
    facts = facts._replace(**start.facts, hole_in_reach=in_reach.hole)
    effects, decisions = resolve(deciding, facts)
    for line in known.lines(effects, terrain, reach, areas.get("window")):
        log.info(line)
    if scene.solver == "points":
        numerics, places = _point_numerics(scene, grid, start), known.in_3d(effects)
    else:
        thickness = start.reference_thickness or (facts.release_thickness if later else None)
        numerics, places = _column_numerics(scene, grid, start, thickness), known.on_grid(effects)
    return Stage(scene, grid, effects, tuple(decisions), facts, numerics, places, known.walls, nodata=in_reach, **areas)


def _column_numerics(
    scene: "Scene", grid: ColumnGrid, start: _Start, reference_thickness: float | None
) -> ColumnNumerics:
    stop = scene.output.stop_at_rest
    return ColumnNumerics(
        cell_size=grid.cell_size,
        cfl=scene.numerics.cfl,
        edges=scene.numerics.edges,
        clamp=scene.numerics.clamp,
        density=start.frame.header["density"],
        stop_at_rest=scene.numerics.form == "slope" if stop is None else stop,
        maxima=scene.output.maxima,
        arrival_thickness=scene.output.arrival_thickness or ColumnNumerics.arrival_thickness,
        reference_thickness=reference_thickness,
    )


def _point_numerics(scene, grid, start):
    stop = scene.output.stop_at_rest
    return PointNumerics(
        cell_size=grid.cell_size,
        cfl=scene.numerics.cfl,
        edges=scene.numerics.edges,
        density=start.frame.header["density"],
        clearance=scene.numerics.clearance,
        precision=scene.numerics.precision,
        maxima=scene.output.maxima,
        arrival_thickness=scene.output.arrival_thickness or PointNumerics.arrival_thickness,
        stop_at_rest=scene.material.law != "Fluid" if stop is None else stop,
    )


def _with_density(scene):
    """Return the scene with a density of its release: if not given, that of the inflow, else an assumed one."""
    release, named = scene.release, scene.densities()
    if release is not None and release.particles is not None:
        return scene
    if not named:
        log.info(f"no density is given: {DENSITY:g} kg m-3 is assumed (masses, forces and pressures follow it)")
    if release is None or release.density is not None:
        return scene
    return replace(scene, release=replace(release, density=named[0][1] if named else DENSITY))


def _log_no_friction(stages):
    """Log stages without friction on the bed, which is rarely intended."""
    for number, stage in enumerate(stages, 1):
        for decision in stage.decisions:
            if decision.effect == "friction" and decision.state == "off":
                where = f"stage {number}: " if len(stages) > 1 else ""
                log.info(f"{where}there is no friction: {decision.reason}")


def _completed(scene, cell_size):
    """Return the scene with defaults of omitted keys; Courant numbers and cell sizes of stages are set separately."""
    output = scene.output
    if output.maxima and output.arrival_thickness is None:
        output = replace(output, arrival_thickness=ColumnNumerics.arrival_thickness)
    if scene.stage:
        given = scene.numerics.cell_size or cell_size
        stages = (replace(stage, cell_size=stage.cell_size or given) for stage in scene.stage)
        return replace(scene, stage=tuple(stages), output=output)
    return replace(_with_courant_number(scene, cell_size), output=output)


def _with_courant_number(scene, cell_size=None):
    """Return a scene of one solver with its Courant number, and with `cell_size` [m] if it has none."""
    numerics = scene.numerics
    cfl = numerics.cfl or default_courant_number(scene, scene.solver)
    return replace(scene, numerics=replace(numerics, cell_size=numerics.cell_size or cell_size, cfl=cfl))


def scene_to_prepare(given: str | Path | Mapping, laws: str | Path | None = None) -> "Scene":
    """Read a scene from a file or from tables; its own friction law, if any, is checked and compiled.

    Parameters
    ----------
    given : path or Mapping
        Path of a scene.toml, or its tables.
    laws : path, optional
        Python file with the user's own friction laws; it is executed.
    """
    own = NO_OWN_LAWS if laws is None else load_laws(laws)
    if isinstance(given, Mapping):
        scene = scene_from_tables(given, own_laws=own)
    else:
        scene = read_scene(given, own)
        for name in scene.files():
            require_local(scene.path(name), given)
    if laws is not None:
        use_own_laws(own)
        law = own.laws[scene.friction.law][0](**trial_parameters(scene))
        require_sound(law, scene.friction.law)
        require_compiled(law, scene.friction.law)
    return scene


def _facts(terrain, frame, reached, known):
    """Return (the Reach, the numbers that decide effects, the scene with representative values of zones)."""
    reach, facts = reached(known.mu_least())
    of_places = known.facts(terrain, reach, frame, facts["release_thickness"])
    facts = TerrainFacts(**facts, **of_places, density=frame.header["density"])
    return reach, facts, known.completed(reach, terrain)


def _reached(terrain: "Terrain", frame: "Frame", mu: float) -> "tuple[Reach, dict]":
    """Return (the Reach of the columns of `frame` with friction `mu`, facts about terrain and release)."""
    some = _some_columns(frame.particles)
    xy = np.column_stack(frame.map_xy())[some]
    mass, thickness = frame.particles.mass[some], frame.particles.thickness[some]
    head = (frame.particles.velocity[some] ** 2).sum(axis=1) / (2.0 * GRAVITY)
    reach = reach_of(terrain, xy, terrain.sample(*xy.T), mu, head)
    facts = reach_facts(terrain, reach) | release_facts(terrain, xy, mass, thickness)
    fastest = float(np.sqrt(2.0 * GRAVITY * head.max()))
    facts |= {"start_speed": fastest, "speed": max(facts["speed"], fastest)}
    profile = steepest_profile(terrain, np.average(xy, axis=0, weights=mass), reach.mu, head=head.max())
    return reach, facts | {"profile": profile}


def _some_columns(particles):
    """Return int[k]: an even sample of the columns, with the fastest."""
    step = max(1, len(particles) // MOST_SAMPLED)
    fastest = int(np.argmax((particles.velocity**2).sum(axis=1)))
    return np.union1d(np.arange(0, len(particles), step), [fastest])


def _check_release(particles, header, scene, cell_size):
    more = "points_per_cell" if scene.solver == "points" else "particles_per_cell"
    finer = "take a smaller [numerics] cell_size"
    fixes = Fixes("[release] density", "[release] thickness", f"{finer} or more {more}", finer)
    if len(particles):
        area = particles.area.sum()
        across = np.sqrt(area) / cell_size
        report_implausible(len(particles), header["density"], particles.volume.sum() / area, across, fixes)
    if scene.friction is not None and scene.friction.law in LAWS:
        report_implausible_friction(scene.friction.parameters)
