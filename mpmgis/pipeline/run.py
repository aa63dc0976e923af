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
from ..solvers.columns import ColumnSolver
from ..solvers.cost import available_memory, predicted
from ..solvers.march import March
from .prepare import prepare

ANEW, RESUMED, FINISHED = range(3)  # where a run starts
COLUMNS_PER_THREAD = 10_000
ASK_SECONDS, ASK_MEMORY_SHARE = 3600.0, 0.8


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


def use_threads(columns, asked=None):
    """Use the number of threads `asked` for, or what `columns` are worth; answers how many that are.

    A thread for few columns costs more than it brings, above all on a busy machine; the result is the same.
    """
    return set_threads(asked or max(1, min(set_threads(None), columns // COLUMNS_PER_THREAD)))


def require_affordable(prepared, threads, confirm):
    """Refuse, or ask `confirm(question)`, where a run would take over an hour or most of the memory."""
    west, south, east, north = prepared.terrain.grid.bounds
    numerics, facts = prepared.numerics, prepared.facts
    seconds, memory = predicted(
        prepared.columns, facts.release_thickness, (east - west) * (north - south) / numerics.cell_size**2,
        prepared.terrain.elevation.nbytes, numerics.cell_size, numerics.cfl, prepared.scene.output.end_time,
        facts.speed, threads,
    )  # fmt: skip
    available = available_memory()
    if seconds < ASK_SECONDS and memory < ASK_MEMORY_SHARE * available:
        return
    need = f"this run is predicted to take {seconds / 3600:.1f} h and {memory / 1e9:.1f} GB"
    question = f"{need} ({available / 1e9:.1f} GB are free)"
    if not confirm(question):
        raise SceneError(f"{question}; give --yes to run it, or take larger cells or fewer particles_per_cell")


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
    used = use_threads(prepared.columns, threads)
    require_affordable(prepared, used, confirm)
    solver = ColumnSolver(prepared.frame, prepared.terrain, prepared.effects, prepared.numerics, prepared.places)
    for decision in prepared.decisions:
        if decision.called_for:
            say(decision.line())
    threads_word = "1 thread" if used == 1 else f"{used} threads"
    to_come = prepared.columns - len(prepared.frame.particles)
    columns = f"{len(prepared.frame.particles)} columns" + (f", {to_come} to come" if to_come else "")
    say(f"{columns}, cells of {prepared.numerics.cell_size:g} m, {threads_word}")
    start = _restored(folder, prepared, solver, say) if resume else ANEW
    if start == FINISHED:
        return _summary(folder, folder.record()["reason"], solver, 0.0, 0)
    folder.open()
    try:
        return _march(folder, prepared, solver, watch, start == RESUMED)
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


def _summary(folder, reason, solver, wall, column_steps):
    return RunSummary(
        folder.path, reason, folder.frames, solver.step, solver.time, wall, column_steps / wall if wall else 0.0,
        solver.balances(),
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
    return _summary(folder, march.reason, solver, record("finished"), march.column_steps)


def _barrier_table(folder, prepared, resumed):
    """The table of what barriers take up, None without barriers; `resumed` is the time that the run goes on from."""
    names = prepared.places.barrier_names
    return BarrierTable(folder.path / BARRIER_FILE, names, resumed) if names else None


def _beside(scene, folder):
    """The scene with its paths relative to `folder`, where it is written: the same scene from its new place."""

    def moved(name):
        path, bar, layer = name.partition("|")  # file.gpkg|layername=name
        if not scene.path(path).exists():
            return name
        return Path(os.path.relpath(scene.path(path).resolve(), folder.resolve())).as_posix() + bar + layer

    return scene.with_files(moved)
