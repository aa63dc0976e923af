"""`mpmgis run`: a scene in, a folder of frames out."""

import os
import time
from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import InputError, SceneError, UnphysicalError
from ..io.barrier_table import BarrierTable
from ..io.run_folder import BARRIER_FILE, TERRAIN_FILE, RunFolder
from ..kernels.jit import set_threads
from ..scene import scene_text
from ..solvers.columns import BARRIER_SUMS as COLUMN_BARRIER_SUMS
from ..solvers.cost import MEMORY_SHARE, available_memory, predicted, predicted_in_3d
from ..solvers.march import March
from ..solvers.points import BARRIER_SUMS as POINT_BARRIER_SUMS
from ..solvers.points import MACH_WARNING
from .prepare import prepare

ANEW, RESUMED, FINISHED = range(3)  # where a run starts
PARTICLES_PER_THREAD = 10_000
BARRIER_SUMS = {"columns": COLUMN_BARRIER_SUMS, "points": POINT_BARRIER_SUMS}
ASK_SECONDS = 3600.0


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
    solver: str = "columns"


def use_threads(particles, asked=None):
    """Use the number of threads `asked` for, or what `particles` are worth; answers how many that are.

    A thread for few particles costs more than it brings, above all on a busy machine; the result is the same.
    """
    return set_threads(asked or max(1, min(set_threads(None), particles // PARTICLES_PER_THREAD)))


def require_affordable(prepared, threads, confirm):
    """Refuse, or ask `confirm(question)`, where a run would take over an hour or most of the memory."""
    seconds, memory = predicted_cost(prepared, threads)
    available = available_memory()
    if seconds < ASK_SECONDS and memory < MEMORY_SHARE * available:
        return
    need = f"this run is predicted to take {seconds / 3600:.1f} h and {memory / 1e9:.1f} GB"
    question = f"{need} ({available / 1e9:.1f} GB are free)"
    if not confirm(question):
        fewer = "or fewer particles_per_cell"
        if prepared.scene.solver == "points":
            fewer = "or [numerics] stiffness = 'scaled' for longer steps"
        raise SceneError(f"{question}; give --yes to run it, or take larger cells {fewer}")


def predicted_cost(prepared, threads):
    """(seconds, bytes) that the run will need."""
    west, south, east, north = prepared.terrain.grid.bounds
    scene, numerics, facts = prepared.scene, prepared.numerics, prepared.facts
    nodes = (east - west) * (north - south) / numerics.cell_size**2
    elevation_bytes, end_time = prepared.terrain.elevation.nbytes, scene.output.end_time
    if scene.solver == "points":
        return predicted_in_3d(
            prepared.particles, prepared.effects.material, numerics, nodes, elevation_bytes, end_time, facts.speed,
            threads,
        )  # fmt: skip
    return predicted(
        prepared.particles, facts.release_thickness, nodes, elevation_bytes, numerics.cell_size, numerics.cfl, end_time,
        facts.speed, threads,
    )  # fmt: skip


def run(scene_path, output=None, *, overwrite=False, resume=False, threads=None, laws=None,
        confirm=lambda question: True, say=lambda text: None, watch=lambda solver, end_time: None):  # fmt: skip
    """Simulate the scene at `scene_path` into the folder `output` (default `results/` beside the scene).

    `watch(solver, end_time)` is called a few times a second; `say(text)` gets lines for the user; `confirm(question)`
    decides on very large runs. With `resume` the run goes on after its last whole frame, bitwise as if never stopped;
    an empty or missing folder starts at the beginning, a finished run is told and left as it is. `laws` is the path of
    a Python file with laws of friction of one's own, which the scene may name; it is run as a program.

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
    output = output or Path(scene_path).parent / "results"
    folder = RunFolder.resumed(output) if resume else RunFolder(output, overwrite)
    prepared = prepare(scene_path, say, laws)
    used = use_threads(prepared.particles, threads)
    require_affordable(prepared, used, confirm)
    solver = prepared.solver()
    for decision in prepared.decisions:
        if decision.called_for:
            say(decision.line())
    threads_word = "1 thread" if used == 1 else f"{used} threads"
    to_come = prepared.particles - len(prepared.frame.particles)
    particles = f"{len(prepared.frame.particles)} {prepared.scene.solver}" + (f", {to_come} to come" if to_come else "")
    say(f"{particles}, cells of {prepared.numerics.cell_size:g} m, {threads_word}")
    start = _restored(folder, prepared, solver, say) if resume else ANEW
    if start == FINISHED:
        return _summary(folder, prepared, folder.record()["reason"], solver, 0.0, 0)
    folder.open()
    try:
        return _march(folder, prepared, solver, _telling_mach(solver, watch, say), start == RESUMED)
    finally:
        folder.remove_if_empty()


def _restored(folder, prepared, solver, say):
    """Set solver and events to the last whole frame; answers RESUMED, ANEW where there is none, or FINISHED."""
    record = folder.record()
    if not record:
        return ANEW
    if record.get("digest") != prepared.digest:
        raise InputError(
            f"{folder.path} holds the run of another scene, or of inputs that have changed since (its digest is "
            f"{record.get('digest')}, now {prepared.digest}); give another -o, or --overwrite"
        )
    frame = folder.last_frame()
    if frame is None:
        return ANEW
    solver.restore(frame)
    prepared.events.restore(frame)
    if record.get("state") == "finished":
        say(f"{folder.path} is finished: {record.get('reason')}")
        return FINISHED
    say(f"going on after frame {folder.frames - 1}, t = {frame.time:g} s")
    return RESUMED


def _telling_mach(solver, watch, say):
    """`watch` that says once when a 3D flow gets so fast that its stiffness is felt."""
    told = []

    def watching(now, end_time):
        if not told and now.mach > MACH_WARNING:
            told.append(True)
            say(
                f"t = {now.time:.1f} s: the flow moves at {now.mach:.2f} times the speed of pressure waves (more than "
                f"{MACH_WARNING:g}): it is compressed, and impacts are too soft; give a larger [material] bulk_modulus"
            )
        watch(now, end_time)

    return watching if hasattr(solver, "mach") else watch


def _summary(folder, prepared, reason, solver, wall, particle_steps):
    return RunSummary(
        folder.path, reason, folder.frames, solver.step, solver.time, wall, particle_steps / wall if wall else 0.0,
        solver.balances(), prepared.scene.solver,
    )  # fmt: skip


def _march(folder, prepared, solver, watch, resumed):
    """March and write; the record says at any moment how far the run is."""
    scene = prepared.scene
    end = scene.output.end_time
    march = March(solver, end, scene.output.frame_interval, lambda s: watch(s, end), resumed, prepared.events)
    barriers = _barrier_table(folder, prepared, solver.time if resumed else None)
    began = time.perf_counter()

    def record(state):
        wall = time.perf_counter() - began
        folder.write_record(
            state=state, reason=march.reason, digest=prepared.digest, time=solver.time, steps=solver.step,
            frames=folder.frames, particles=len(prepared.frame.particles), wall_seconds=wall,
            scene=scene.as_tables(), effects=[d._asdict() for d in prepared.decisions],
            terrain_facts=prepared.facts._asdict(), balances=solver.balances(),
            events=prepared.events.record(),
        )  # fmt: skip
        return wall

    record("running")  # first of all files: what holds a record is gone on with
    folder.write_scene(scene_text(_beside(scene, folder.path), "resolved by mpmgis run"))
    sha256 = folder.write_terrain(prepared.terrain)
    try:
        for frame in march:
            if barriers is not None:  # before its frame: what is too late for a run that goes on is dropped then
                barriers.add(frame.time, frame.state["barriers"])
            folder.write_frame(replace(frame, dem=TERRAIN_FILE, dem_sha256=sha256))
    except KeyboardInterrupt:
        record("interrupted")
        raise
    except UnphysicalError:
        record("unphysical")
        raise
    return _summary(folder, prepared, march.reason, solver, record("finished"), march.particle_steps)


def _barrier_table(folder, prepared, resumed):
    """The table of what barriers take up, None without barriers; `resumed` is the time that the run goes on from."""
    names, sums = prepared.places.barrier_names, BARRIER_SUMS[prepared.scene.solver]
    return BarrierTable(folder.path / BARRIER_FILE, names, sums, resumed) if names else None


def _beside(scene, folder):
    """The scene with its paths relative to `folder`, where it is written: the same scene from its new place."""

    def moved(name):
        path, bar, layer = name.partition("|")  # file.gpkg|layername=name
        if not scene.path(path).exists():
            return name
        return Path(os.path.relpath(scene.path(path).resolve(), folder.resolve())).as_posix() + bar + layer

    return scene.with_files(moved)
