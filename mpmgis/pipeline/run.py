"""`mpmgis run`: a scene in, a folder of frames out."""

import os
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError, SceneError, UnphysicalError
from ..geo.reach import reach_facts
from ..io.frames import read_frame
from ..io.raster import file_sha256, read_terrain
from ..io.run_folder import TERRAIN_FILE, RunFolder
from ..io.vector import read_release
from ..kernels.jit import set_threads
from ..scene import TerrainFacts, mu_least, read_scene, resolve, scene_text
from ..seeding.columns import seed_columns
from ..solvers.columns import ColumnNumerics, ColumnSolver
from ..solvers.march import March

BYTES_PER_COLUMN = 2 * 13 * 8 + 2 * 8 + 2 * 4 + 4 + 160  # rows and keys twice, order; frames while they are written
BYTES_PER_NODE = 8 * (1 + 2 + 4) + 2
NANOSECONDS_PER_STEP = 50.0  # of one column on one thread, nominal: enough to ask before an hour, no promise
COLUMNS_PER_THREAD = 10_000
ASK_SECONDS, ASK_MEMORY_SHARE = 3600.0, 0.8


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
    digest: str


@dataclass(frozen=True)
class RunSummary:
    """What came of a run: its folder, why it ended, its balances and its cost."""

    folder: Path
    reason: str
    frames: int
    steps: int
    time: float
    wall_seconds: float
    particle_steps_per_second: float
    balances: dict


def prepare(scene_path, say=lambda text: None):
    """Read a scene with its terrain and release, seed it on the solver's grid, decide its effects."""
    scene = read_scene(scene_path)
    table = scene.terrain
    terrain = read_terrain(scene.path(table.dem), crs=table.crs, band=table.band, say=say)
    cell_size = scene.numerics.cell_size or terrain.grid.cell_size
    scene = replace(scene, numerics=replace(scene.numerics, cell_size=cell_size))
    frame = _columns(scene, terrain, cell_size, say)
    x, y = frame.map_xy()
    bed = terrain.sample(x, y)
    some = slice(None, None, max(1, len(x) // 10_000))
    facts = TerrainFacts(**reach_facts(terrain, np.column_stack([x, y])[some], bed[some], mu_least(scene)))
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
    return Prepared(scene, terrain, replace(frame, digest=digest), effects, tuple(decisions), facts, numerics, digest)


def _columns(scene, terrain, cell_size, say):
    """The columns at the start: seeded on the solver's own lattice of cells, or read from a seed."""
    release = scene.release
    if release.particles is not None:
        return _read_columns(scene.path(release.particles), terrain, release.density)
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


def _read_columns(path, terrain, density):
    """A seed or an earlier frame as the start; refused if it is no columns or in another CRS."""
    frame = read_frame(path, with_state=False)
    if frame.dimension != 2:
        raise InputError(f"{path} holds 3D points, wanted columns; `mpmgis seed` writes them")
    if frame.crs is not None and terrain.grid.crs is not None and not frame.crs.equals(terrain.grid.crs, True):
        raise InputError(f"{path} is in {frame.crs.name}, the terrain in {terrain.grid.crs.name}; seed on this terrain")
    header = dict(frame.header)
    header.setdefault("density", float(frame.particles.mass.sum() / frame.particles.volume.sum()) or density)
    return replace(frame, crs=terrain.grid.crs, time=0.0, step=0, header=header)


def _input_digest(scene):
    """Digest of the release's files; a shapefile's geometry and columns lie in two."""
    named = scene.path(scene.release.source or scene.release.particles)
    return [file_sha256(named), file_sha256(named.with_suffix(".dbf"))]


def predicted(prepared, threads):
    """(seconds, bytes) that the run will need, nominally: the energy line's speed sets the number of steps."""
    n, dx = len(prepared.frame.particles), prepared.numerics.cell_size
    thickness = float(prepared.frame.particles.thickness.mean())
    signal = 0.5 * prepared.facts.speed + np.sqrt(9.81 * thickness)
    steps = prepared.scene.output.end_time * signal / (prepared.numerics.cfl * dx)
    west, south, east, north = prepared.terrain.grid.bounds
    nodes = (east - west) * (north - south) / dx**2
    memory = n * BYTES_PER_COLUMN + nodes * BYTES_PER_NODE + 3 * prepared.terrain.elevation.nbytes
    return steps * n * NANOSECONDS_PER_STEP * 1e-9 / threads, memory


def require_affordable(prepared, threads, confirm):
    """Refuse, or ask `confirm(question)`, where a run would take over an hour or most of the memory."""
    seconds, memory = predicted(prepared, threads)
    available = _available_memory()
    if seconds < ASK_SECONDS and memory < ASK_MEMORY_SHARE * available:
        return
    question = (
        f"this run is predicted to take {seconds / 3600:.1f} h and {memory / 1e9:.1f} GB "
        f"({available / 1e9:.1f} GB are free)"
    )
    if not confirm(question):
        raise SceneError(f"{question}; give --yes to run it, or take larger cells or fewer particles_per_cell")


def _available_memory():
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return float("inf")


def run(scene_path, output=None, *, overwrite=False, threads=None, confirm=lambda question: True, say=lambda text: None,
        watch=lambda solver, end_time: None):  # fmt: skip
    """Simulate the scene at `scene_path` into the folder `output` (default `results/` beside the scene).

    `watch(solver, end_time)` is called a few times a second; `say(text)` gets lines for the user; `confirm(question)`
    decides on very large runs.

    Returns
    -------
    RunSummary

    Raises
    ------
    InputError, SceneError, OutputError
        Before the first step; nothing is left behind.
    UnphysicalError
        The run stopped itself; the frames before are whole.
    """
    folder = RunFolder(output or Path(scene_path).parent / "results", overwrite)
    prepared = prepare(scene_path, say)
    # a thread for few columns costs more than it brings, above all on a busy machine; the result is the same
    used = set_threads(threads or max(1, min(set_threads(None), len(prepared.frame.particles) // COLUMNS_PER_THREAD)))
    require_affordable(prepared, used, confirm)
    solver = ColumnSolver(prepared.frame, prepared.terrain, prepared.effects, prepared.numerics)
    for decision in prepared.decisions:
        say(decision.line())
    say(f"{len(prepared.frame.particles)} columns, cells of {prepared.numerics.cell_size:g} m, {used} threads")
    folder.open()
    try:
        return _march(folder, prepared, solver, watch)
    finally:
        folder.remove_if_empty()


def _march(folder, prepared, solver, watch):
    """March and write; the record says at any moment how far the run is."""
    scene = prepared.scene
    folder.write_scene(scene_text(_beside(scene, folder.path), "resolved by mpmgis run"))
    sha256 = folder.write_terrain(prepared.terrain)
    march = March(
        solver, scene.output.end_time, scene.output.frame_interval, lambda s: watch(s, scene.output.end_time)
    )
    began = time.perf_counter()

    def record(state):
        wall = time.perf_counter() - began
        folder.write_record(
            state=state, reason=march.reason, digest=prepared.digest, time=solver.time, steps=solver.step,
            frames=folder.frames, particles=len(prepared.frame.particles), wall_seconds=wall,
            scene=scene.as_tables(), effects=[d._asdict() for d in prepared.decisions],
            terrain_facts=prepared.facts._asdict(), balances=solver.balances(),
        )  # fmt: skip
        return wall

    record("running")
    try:
        for frame in march:
            folder.write_frame(replace(frame, dem=TERRAIN_FILE, dem_sha256=sha256))
    except KeyboardInterrupt:
        record("interrupted")
        raise
    except UnphysicalError:
        record("unphysical")
        raise
    wall = record("finished")
    return RunSummary(
        folder.path, march.reason, folder.frames, solver.step, solver.time, wall,
        len(prepared.frame.particles) * solver.step / max(wall, 1e-9), solver.balances(),
    )  # fmt: skip


def _beside(scene, folder):
    """The scene with its paths relative to `folder`, where it is written: the same scene from its new place."""

    def moved(name):
        if name is None or not scene.path(name).exists():
            return name
        return Path(os.path.relpath(scene.path(name).resolve(), folder.resolve())).as_posix()

    release, terrain = scene.release, scene.terrain
    thickness = moved(release.thickness) if isinstance(release.thickness, str) else release.thickness
    return replace(
        scene,
        terrain=replace(terrain, dem=moved(terrain.dem)),
        release=replace(
            release, source=moved(release.source), particles=moved(release.particles), thickness=thickness,
            surface=moved(release.surface),
        ),
    )  # fmt: skip
