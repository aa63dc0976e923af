"""What comes before the first step: a scene read and checked, seeded on the solver's grid, its effects decided."""

import glob
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..effects.own_law import load_laws, require_sound
from ..errors import InputError, SceneError
from ..geo.reach import reach_facts, reach_of, release_facts, steepest_profile
from ..io.frames import read_frame
from ..io.raster import file_sha256, read_terrain
from ..io.vector import read_release
from ..kernels.own_laws import require_compiled, use_own_laws
from ..scene import TerrainFacts, mu_least, read_scene, resolve
from ..seeding.columns import seed_columns
from ..seeding.plausible import Cures, tell_if_implausible
from ..solvers.columns import ColumnNumerics
from ..solvers.grid import ColumnGrid
from ..solvers.places import Places


@dataclass(frozen=True)
class Prepared:
    """Everything a run needs, checked, before its first step."""

    scene: object
    terrain: object
    frame: object
    effects: object
    decisions: tuple
    facts: TerrainFacts
    numerics: ColumnNumerics
    places: Places
    digest: str


def prepare(scene_path, say=lambda text: None, laws=None):
    """Read a scene with its terrain and release, seed it on the solver's grid, decide its effects.

    `laws` is the path of a Python file with laws of friction of one's own; it is run as a program.
    """
    scene = _read_scene(scene_path, laws)
    try:
        return _prepare(scene, say)
    except SceneError:
        raise
    except InputError as error:  # told in the words of `seed`; say whose file they are about
        raise type(error)(f"{Path(scene_path).name}: {error}") from error


def _prepare(scene, say):
    table = scene.terrain
    terrain = read_terrain(scene.path(table.dem), crs=table.crs, band=table.band, say=say)
    cell_size = scene.numerics.cell_size or terrain.grid.cell_size
    scene = replace(scene, numerics=replace(scene.numerics, cell_size=cell_size))
    frame = _columns(scene, terrain, cell_size, say)
    _tell_of_release(frame.particles, frame.header["density"], say)
    facts = _facts(scene, terrain, frame)
    effects, decisions = resolve(scene, facts)
    stop = scene.output.stop_at_rest
    numerics = ColumnNumerics(
        cell_size=cell_size,
        cfl=scene.numerics.cfl,
        edges=scene.numerics.edges,
        clamp=scene.numerics.clamp,
        density=frame.header["density"],
        stop_at_rest=scene.numerics.form == "slope" if stop is None else stop,
        maxima=scene.output.maxima,
    )
    digest = scene.digest(terrain.sha256, _input_digest(scene))
    places = _places(scene, effects, ColumnGrid.on(terrain, cell_size))
    return Prepared(
        scene, terrain, replace(frame, digest=digest), effects, tuple(decisions), facts, numerics, places, digest
    )


def _read_scene(path, laws):
    """The scene, with its own law of friction, if it has one, tried out and fit for the compiler."""
    if laws is None:
        return read_scene(path)
    own = load_laws(laws)
    scene = read_scene(path, own)
    use_own_laws(own)
    law = own.laws[scene.friction.law][0](**scene.friction.parameters)
    require_sound(law, scene.friction.law)
    require_compiled(law, scene.friction.law)
    return scene


def _facts(scene, terrain, frame):
    """The numbers that decide the scene's effects."""
    some = slice(None, None, max(1, len(frame.particles) // 10_000))
    xy = np.column_stack(frame.map_xy())[some]
    mass, thickness = frame.particles.mass[some], frame.particles.thickness[some]
    reach = reach_of(terrain, xy, terrain.sample(*xy.T), mu_least(scene))
    return TerrainFacts(
        **reach_facts(terrain, reach),
        **release_facts(terrain, xy, mass, thickness),
        density=frame.header["density"],
        profile=steepest_profile(terrain, np.average(xy, axis=0, weights=mass), reach.mu),
    )


def _places(scene, effects, grid):
    """What the effects know by place, on the solver's grid."""
    lake = None
    if effects.still_water.still_water_active():
        lake = np.full(grid.inside.shape, scene.still_water.level)
    return Places(lake_level=lake)


def _columns(scene, terrain, cell_size, say):
    """The columns at the start: seeded on the solver's own lattice of cells, or read from a seed."""
    release = scene.release
    if release.particles is not None:
        return _read_columns(scene.path(release.particles), terrain, release.density, say)
    thickness = release.thickness
    if isinstance(thickness, str) and scene.path(thickness).exists():
        thickness = str(scene.path(thickness))
    surface = None if release.surface is None else scene.path(release.surface)
    area = read_release(
        scene.path(release.source), terrain, thickness=thickness, thickness_mode=release.thickness_mode,
        surface=surface, say=say,
    )  # fmt: skip
    west, _, _, north = terrain.grid.bounds
    return seed_columns(
        terrain, area, cell_size=cell_size, anchor=(west, north), per_cell=scene.numerics.particles_per_cell,
        points=release.points, density=release.density, velocity=release.velocity, seed=release.seed,
    )  # fmt: skip


def _tell_of_release(particles, density, say):
    cures = Cures(
        "[release] density", "[release] thickness", "take a smaller [numerics] cell_size or more particles_per_cell"
    )
    if len(particles):
        tell_if_implausible(len(particles), density, particles.volume.sum() / particles.area.sum(), cures, say)


def _read_columns(path, terrain, density, say):
    """A seed or an earlier frame as the start; refused if it is no columns or in another CRS."""
    frame = read_frame(path, with_state=False)
    if frame.dimension != 2:
        raise InputError(f"{path} holds 3D points, wanted columns; `mpmgis seed` writes them")
    if frame.crs is not None and terrain.grid.crs is not None and not frame.crs.equals(terrain.grid.crs, True):
        raise InputError(f"{path} is in {frame.crs.name}, the terrain in {terrain.grid.crs.name}; seed on this terrain")
    if frame.dem_sha256 and terrain.sha256 and frame.dem_sha256 != terrain.sha256:
        say(f"{path} was seeded on another DTM than {terrain.path} (their sha256 differ); its thickness is kept")
    header = dict(frame.header)
    header.setdefault("density", float(frame.particles.mass.sum() / frame.particles.volume.sum()) or density)
    return replace(frame, crs=terrain.grid.crs, time=0.0, step=0, header=header)


def _input_digest(scene):
    """Digests of all files that the scene names but its DTM; a shapefile's geometry and columns lie in several."""
    named = [scene.path(name.split("|")[0]) for name in scene.files()]
    dem = scene.path(scene.terrain.dem)
    files = {file for path in named for file in (path, *path.parent.glob(f"{glob.escape(path.stem)}.*"))}
    return [file_sha256(file) for file in sorted(files) if file.is_file() and file != dem]
