"""What comes before the first step: a scene read and checked, seeded on the solver's grid, its effects decided."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..conversion.starting import kirchhoff_stress
from ..effects.own_law import load_laws, require_sound
from ..errors import InputError, SceneError
from ..geo.reach import reach_facts, reach_of, release_facts, steepest_profile
from ..geo.release import tell_of_cliffs
from ..io.raster import read_terrain
from ..kernels.own_laws import require_compiled, use_own_laws
from ..scene import TerrainFacts, read_scene, resolve
from ..seeding.plausible import Cures, tell_if_implausible
from ..solvers.columns import ColumnNumerics, ColumnSolver
from ..solvers.events import Events
from ..solvers.grid import ColumnGrid
from ..solvers.identity import start_digest
from ..solvers.places import Places
from ..solvers.placing import levelled
from ..solvers.points import PointNumerics, PointSolver
from .places import read_places, trial_parameters
from .point_start import read_point_start
from .sources import read_sources

CFL = {"columns": ColumnNumerics.cfl, "points": PointNumerics.cfl}


@dataclass(frozen=True)
class Prepared:
    """Everything a run needs, checked, before its first step; `stress`, `walls` and `affine` are of a 3D run."""

    scene: object
    terrain: object
    frame: object
    effects: object
    decisions: tuple
    facts: TerrainFacts
    numerics: object  # ColumnNumerics or PointNumerics
    places: Places
    events: Events
    digest: str
    stress: np.ndarray | None = None  # float64[n, 6] [Pa], Kirchhoff
    walls: tuple = ()
    affine: np.ndarray | None = None  # float64[n, 3, 3] [s-1]
    grid: ColumnGrid | None = None

    @property
    def particles(self):
        """Number of columns or points at the start and of all that may come."""
        return len(self.frame.particles) + self.events.columns_to_come()

    def solver(self):
        """The scene's solver at its start."""
        if self.scene.solver == "points":
            return PointSolver(
                self.frame, self.terrain, self.effects, self.numerics, self.stress, self.places.zone_values, self.walls,
                self.affine,
            )  # fmt: skip
        return ColumnSolver(self.frame, self.terrain, self.effects, self.numerics, self.places, self.grid)


def prepare(scene_path, say=lambda text: None, laws=None):
    """Read a scene with its terrain and release, seed it on the solver's grid, decide its effects.

    `laws` is the path of a Python file with laws of friction of one's own; it is run as a program.
    """
    scene = scene_to_prepare(scene_path, laws)
    try:
        return prepare_scene(scene, say)
    except SceneError:
        raise
    except InputError as error:  # told in the words of `seed`; say whose file they are about
        raise type(error)(f"{Path(scene_path).name}: {error}") from error


def prepare_scene(scene, say=lambda text: None):
    """As `prepare`, of a Scene that is read already."""
    terrain = _terrain(scene, say)
    scene = _completed(scene, scene.numerics.cell_size or terrain.grid.cell_size)
    grid = ColumnGrid.on(terrain, scene.numerics.cell_size)
    return (_points if scene.solver == "points" else _columns)(scene, terrain, grid, say)


def _terrain(scene, say):
    """The terrain, or the window of it that the scene asks for."""
    table = scene.terrain
    terrain = read_terrain(scene.path(table.dem), crs=table.crs, band=table.band, say=say)
    if table.window is None:
        return terrain
    west, south, east, north = terrain.grid.bounds
    window = table.window
    if window[0] >= east or window[2] <= west or window[1] >= north or window[3] <= south:
        raise SceneError(
            f"[terrain] window = {list(window)} does not meet the DTM, E {west:.0f} to {east:.0f}, N {south:.0f} to "
            f"{north:.0f}; correct it"
        )
    return terrain.cropped(window, 0)


def _columns(scene, terrain, grid, say):
    """Everything for a depth-averaged run."""
    sources = read_sources(scene, terrain, grid, say)
    frame = sources.frame
    _tell_of_release(frame.particles, frame.header, scene, say)
    tell_of_cliffs(grid.gradients_at(sources.everything), sources.everything, say)
    known = read_places(scene, terrain, grid, frame, sources.everything, say)
    if known.lake_level is not None:
        frame = levelled(frame, known.lake_level, grid, say)
    facts, deciding = _facts(scene, terrain, sources.everything, known)
    facts = facts._replace(**sources.facts)
    effects, decisions = resolve(deciding, facts)
    stop = scene.output.stop_at_rest
    numerics = ColumnNumerics(
        cell_size=grid.cell_size,
        cfl=scene.numerics.cfl,
        edges=scene.numerics.edges,
        clamp=scene.numerics.clamp,
        density=frame.header["density"],
        stop_at_rest=scene.numerics.form == "slope" if stop is None else stop,
        maxima=scene.output.maxima,
        arrival_thickness=scene.output.arrival_thickness or ColumnNumerics.arrival_thickness,
        reference_thickness=sources.reference_thickness,
    )
    places = known.on_grid(effects)
    digest = scene.digest(start_digest(terrain, frame, sources.events, places))
    return Prepared(
        scene, terrain, replace(frame, digest=digest), effects, tuple(decisions), facts, numerics, places,
        sources.events, digest, grid=grid,
    )  # fmt: skip


def _points(scene, terrain, grid, say):
    """Everything for a 3D run."""
    start = read_point_start(scene, terrain, grid, say)
    frame, seen, events = start.frame, start.seen, Events()
    _tell_of_release(seen.particles, frame.header, scene, say)
    known = read_places(scene, terrain, grid, seen, seen, say)
    facts, deciding = _facts(scene, terrain, seen, known)
    effects, decisions = resolve(deciding, facts)
    stop = scene.output.stop_at_rest
    numerics = PointNumerics(
        cell_size=grid.cell_size,
        cfl=scene.numerics.cfl,
        edges=scene.numerics.edges,
        density=frame.header["density"],
        stop_at_rest=scene.material.law != "Fluid" if stop is None else stop,
    )
    places, material, stress = known.in_3d(effects), effects.material, None
    if start.vertical_stress is not None:
        stress = kirchhoff_stress(start.vertical_stress, material.bulk_modulus, getattr(material, "shear_modulus", 0.0))
    digest = scene.digest(start_digest(terrain, frame, events, places))
    return Prepared(
        scene, terrain, replace(frame, digest=digest), effects, tuple(decisions), facts, numerics, places, events,
        digest, stress, known.walls if places.barrier_names else (), start.affine,
    )  # fmt: skip


def _completed(scene, cell_size):
    """The scene with the numbers that stand for keys left out."""
    output = scene.output
    if output.maxima and output.arrival_thickness is None:
        output = replace(output, arrival_thickness=ColumnNumerics.arrival_thickness)
    numerics = replace(scene.numerics, cell_size=cell_size, cfl=scene.numerics.cfl or CFL[scene.solver])
    return replace(scene, numerics=numerics, output=output)


def scene_to_prepare(path, laws=None):
    """The scene, with its own law of friction, if it has one, tried out and fit for the compiler."""
    if laws is None:
        return read_scene(path)
    own = load_laws(laws)
    scene = read_scene(path, own)
    use_own_laws(own)
    law = own.laws[scene.friction.law][0](**trial_parameters(scene))
    require_sound(law, scene.friction.law)
    require_compiled(law, scene.friction.law)
    return scene


def _facts(scene, terrain, frame, known):
    """(the numbers that decide the scene's effects, the scene with what stands for friction by place)."""
    some = slice(None, None, max(1, len(frame.particles) // 10_000))
    xy = np.column_stack(frame.map_xy())[some]
    mass, thickness = frame.particles.mass[some], frame.particles.thickness[some]
    reach = reach_of(terrain, xy, terrain.sample(*xy.T), known.mu_least())
    release = release_facts(terrain, xy, mass, thickness)
    return TerrainFacts(
        **reach_facts(terrain, reach),
        **release,
        **known.facts(terrain, reach, frame, release["release_thickness"]),
        density=frame.header["density"],
        profile=steepest_profile(terrain, np.average(xy, axis=0, weights=mass), reach.mu),
    ), known.completed(reach, terrain)  # fmt: skip


def _tell_of_release(particles, header, scene, say):
    more = "points_per_cell" if scene.solver == "points" else "particles_per_cell"
    cures = Cures("[release] density", "[release] thickness", f"take a smaller [numerics] cell_size or more {more}")
    if len(particles):
        thickness = particles.volume.sum() / particles.area.sum()
        tell_if_implausible(len(particles), header["density"], thickness, cures, say)
