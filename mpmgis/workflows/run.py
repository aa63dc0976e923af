"""A scene in, a folder of frames out; and the decisions about its effects with their cost."""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from .. import system
from ..analysis.run_summary import extremes, unusable_lines
from ..errors import InputError, SceneError, UnphysicalError
from ..io.run_folder import BARRIER_FILE, STAGE_BARRIER_FILE, TERRAIN_FILE, RunFolder
from ..io.tables import BarrierTable
from ..kernels.jit import set_threads
from ..machine import available_memory
from ..messages import details, log
from ..peaks import largest_peaks
from ..scene import scene_text
from ..scene.points import MACH_THRESHOLD
from ..scene.reading import read_toml
from ..solvers.column_state import BARRIER_SUMS as COLUMN_BARRIER_SUMS
from ..solvers.cost import MEMORY_SHARE
from ..solvers.effect_costs import effect_costs, under_way
from ..solvers.points import BARRIER_SUMS as POINT_BARRIER_SUMS
from .run_setup.cost_prediction import OwnPace, at_most, foreseen, need, prediction
from .run_setup.later_end import earlier_run, go_on, goes_on
from .run_setup.prepare import prepare
from .run_setup.scene_files import input_files
from .run_setup.sequence import Sequence
from .run_setup.warmup import rehearse

ANEW, RESUMED, FINISHED = range(3)  # where a run starts
PARTICLES_PER_THREAD = 10_000
BARRIER_SUMS = {"columns": COLUMN_BARRIER_SUMS, "points": POINT_BARRIER_SUMS}
ASK_SECONDS = 3600.0
TRIAL_FROM = 0.1 * ASK_SECONDS  # [s] on a typical machine: none is ten times slower, so shorter runs need no question


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
    predicted_seconds: float | None  # of the whole run; None where there is nothing to hold it against
    solver: str = "columns"
    mass: dict | None = None  # where it is, of a run in several stages
    result_digest: str | None = None
    extremes: dict | None = None  # where and when it was thickest and fastest
    unusable: tuple = ()  # lines on points that have lost their volume


def use_threads(particles, asked=None):
    """Use the number of threads `asked` for, or what `particles` are worth; answers how many that are.

    A thread for few particles costs more than it brings, above all on a busy machine; the result is the same.
    """
    return set_threads(asked or max(1, min(set_threads(None), particles // PARTICLES_PER_THREAD)))


def require_affordable(prepared, threads, confirm):
    """Tell what a run is predicted to take; refuse, or ask `confirm(question)`, over an hour or most of the memory.

    A run that may come near to the question is predicted from a trial of its steps. Answers the Foreseen.
    """
    ahead, available = foreseen(prepared, threads, TRIAL_FROM), available_memory()
    log.info(prediction(ahead))
    if ahead.longest < ASK_SECONDS and ahead.memory < MEMORY_SHARE * available:
        return ahead
    question = f"this run is predicted to take {need(ahead)}{at_most(ahead)} ({available / 1e9:.1f} GB are free)"
    if not confirm(question):
        fewer = "or fewer particles_per_cell"
        if "points" in prepared.scene.solvers:
            fewer = "or [numerics] stiffness = 'scaled' for longer steps"
        raise SceneError(f"{question}; give --yes to run it, or take larger cells {fewer}")
    return ahead


def run(scene, output=None, *, overwrite=False, resume=False, threads=None, laws=None,
        confirm=lambda question: True, watch=lambda solver, end_time: None):  # fmt: skip
    """Simulate a scene into the folder `output` (default `results/` beside the scene).

    `scene` is the path of a scene.toml, or its tables as a mapping, with paths relative to the current folder.
    `watch(solver, end_time)` is called a few times a second; `confirm(question)`
    decides on very large runs. With `resume` the run goes on after its last whole frame, bitwise as if never stopped;
    an empty or missing folder starts at the beginning, a finished run is left as it is, unless [output] end_time is
    larger than it was: then it goes on to that time, as a run that was to last so long from the start. `laws` is the
    path of a Python file with laws of friction of one's own, which the scene may name; it is run as a program.

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
    if not isinstance(scene, Mapping):
        read_toml(scene)  # a scene that is not there is told before a folder that is
    output = output or Path("" if isinstance(scene, Mapping) else scene).parent / "results"
    folder = RunFolder.resumed(output) if resume else RunFolder(output, overwrite)
    prepared = prepare(scene, laws)
    folder.spare(input_files(scene, prepared.scene, laws))
    used = use_threads(max(prepared.particles_of(number) for number in range(len(prepared.stages))), threads)
    ahead = require_affordable(prepared, used, confirm)
    if not ahead.rehearsed:
        rehearse(prepared)
    sequence, pace = Sequence(prepared, _telling_mach(watch)), OwnPace(prepared, used, ahead)
    if not ahead.rehearsed and not resume:
        sequence.observe = pace.watching(sequence, sequence.observe)
    _tell_of_stages(prepared)
    threads_word = "1 thread" if used == 1 else f"{used} threads"
    to_come = prepared.particles - len(prepared.frame.particles)
    particles = f"{len(prepared.frame.particles)} {prepared.scene.solver}" + (f", {to_come} to come" if to_come else "")
    log.info(f"{particles}, cells of {prepared.numerics.cell_size:g} m, {threads_word}")
    with folder.held():
        start = _restored(folder, sequence) if resume else ANEW
        if start == FINISHED:
            return _summary(folder, sequence, folder.record()["reason"], 0.0)
        folder.open(anew=start == ANEW)
        try:
            return march_into(folder, sequence, start == RESUMED, pace)
        except KeyboardInterrupt:
            log.info(f"{folder.path} holds what was computed until now; --resume goes on after its last whole frame")
            raise


def _tell_of_stages(prepared):
    """Each stage with when it ends and the effects that it is decided to have."""
    for number, stage in enumerate(prepared.stages, 1):
        if stage.table is not None:
            log.info(f"stage {number}: {stage.words()}")
        for decision in stage.decisions:
            if decision.called_for:
                log.info(decision.line())


def _restored(folder, sequence):
    """Set the sequence to the last whole frame; answers RESUMED, ANEW where there is none, or FINISHED."""
    record, digest = folder.record(), sequence.prepared.digest
    if not record:
        return ANEW
    if record.get("digest") != digest:
        return _restored_earlier(folder, sequence, record)
    frame = folder.last_frame(digest)
    if frame is None:
        return ANEW
    sequence.restore(frame)
    if record.get("state") == "finished":
        log.info(f"{folder.path} is finished: {record.get('reason')}")
        return FINISHED
    log.info(f"going on after frame {folder.frames - 1}, t = {frame.time:g} s")
    return RESUMED


def _restored_earlier(folder, sequence, record):
    """As `_restored`, of a folder that holds the run of this scene to an earlier end_time; any other is refused."""
    prepared = sequence.prepared
    earlier = earlier_run(prepared, record)
    if earlier is None:
        raise InputError(
            f"{folder.path} holds the run of another scene, or of inputs that have changed since (its digest is "
            f"{record.get('digest')}, now {prepared.digest}); only [output] end_time may be larger than it was; give "
            "another -o, or --overwrite"
        )
    before, now = earlier.scene.output.end_time, prepared.scene.output.end_time
    if not goes_on(record):
        last = folder.last_frame(earlier.digest)
        if last is not None:
            sequence.restore(last)
        log.info(f"{folder.path} is finished: {record.get('reason')}; the later end_time = {now:g} s changes nothing")
        return FINISHED
    frame = go_on(folder, sequence, earlier)
    log.info(
        f"end_time = {before:g} s is now {now:g} s: going on after frame {folder.frames - 1}, t = {frame.time:g} s"
    )
    return RESUMED


def _telling_mach(watch):
    """`watch` that says once when a 3D flow gets so fast that its stiffness is felt."""
    told = []

    def watching(now, end_time):
        mach = getattr(now, "mach", 0.0)
        if not told and mach > MACH_THRESHOLD:
            told.append(True)
            log.info(
                f"t = {now.time:.1f} s: the flow moves at {mach:.2f} times the speed of pressure waves (more than "
                f"{MACH_THRESHOLD:g}): it is compressed, and impacts are too soft; give a larger [material] "
                "bulk_modulus"
            )
        watch(now, end_time)

    return watching


def _summary(folder, sequence, reason, wall, expected=None):
    solver, steps = sequence.solver, sequence.particle_steps
    mass = sequence.mass_account() if sequence.prepared.scene.stage else None
    return RunSummary(
        folder.path, reason, folder.frames, sequence.steps, solver.time, wall, steps / wall if wall else 0.0,
        solver.balances(), expected, sequence.stage.scene.solver, mass, folder.result, extremes(sequence.balances()),
        tuple(unusable_lines(_record_of_stages(sequence))),
    )  # fmt: skip


def march_into(folder, sequence, resumed, pace=None):
    """March and write into a RunFolder that is held; the record says at any moment how far the run is.

    `pace` is an OwnPace, whose prediction is recorded; None where there is none.
    """
    prepared, began = sequence.prepared, time.perf_counter()
    barriers = _BarrierTables(folder, sequence, sequence.solver.time if resumed else None)

    def record(state):
        wall, solver = time.perf_counter() - began, sequence.solver
        folder.write_record(
            state=state, reason=sequence.reason, digest=prepared.digest, time=solver.time, steps=sequence.steps,
            frames=folder.frames, particles=len(prepared.frame.particles), wall_seconds=wall,
            predicted_seconds=None if pace is None else pace.seconds, scene=prepared.scene.as_tables(),
            effects=[decision._asdict() for decision in sequence.stage_now(0).decisions],
            terrain_facts=prepared.facts._asdict(), balances=solver.balances(),
            extremes=extremes(sequence.balances()), maxima=largest_peaks(sequence.maxima()),
            events=prepared.events.record(), troubles=sequence.troubles, taken_in=sequence.taken_in,
            nodata=_record_of_nodata(prepared), unusable=unusable_lines(_record_of_stages(sequence)),
            **_record_of_stages(sequence),
        )  # fmt: skip
        return wall

    record("running")  # first of all files: what holds a record is gone on with
    folder.write_scene(scene_text(_beside(prepared.scene, folder.path), "resolved by mpmgis run"))
    sha256 = folder.write_terrain(prepared.terrain)
    number = sequence.number
    try:
        for frame in sequence:
            folder.require()
            barriers.add(frame)  # before its frame: what is too late for a run that goes on is dropped then
            folder.write_frame(replace(frame, dem=TERRAIN_FILE, dem_sha256=sha256))
            if sequence.number != number:
                number = sequence.number
                record("running")
    except KeyboardInterrupt:
        record("interrupted")
        raise
    except UnphysicalError:
        record("unphysical")
        raise
    except InputError:  # at a switch
        record("refused")
        raise
    expected = None if resumed or pace is None else pace.seconds
    return _summary(folder, sequence, sequence.reason, record("finished"), expected)


def _record_of_nodata(prepared):
    """What a record holds of cells without elevation: what was filled, and the most that a stage can reach."""
    in_reach = max((stage.nodata for stage in prepared.stages), key=lambda found: sum(h.cells for h in found.holes))
    return {"filled": None if prepared.fill is None else asdict(prepared.fill), "in_reach": in_reach.as_numbers()}


def _record_of_stages(sequence):
    """What a record holds of several stages: effects and checks of each, how those that are over ended, the mass."""
    stages = sequence.prepared.stages
    if stages[0].table is None:
        return sequence.checks
    effects = [[decision._asdict() for decision in sequence.stage_now(n).decisions] for n in range(len(stages))]
    told = [{"solver": stage.scene.solver, "effects": e} for stage, e in zip(stages, effects, strict=True)]
    told[sequence.number].update(sequence.checks)
    for stage, over in zip(told, sequence.past, strict=False):
        stage.update(over)
    return {"stages": told, "mass": sequence.mass_account()}


class _BarrierTables:
    """The tables of what barriers take up: one file, or where there are stages one for each."""

    def __init__(self, folder, sequence, resumed):
        self._folder, self._sequence = folder, sequence
        self._number, self._table = sequence.number, self._opened(resumed)

    def _opened(self, resumed):
        number = self._sequence.number
        stage = self._sequence.stage_now(number)
        name = BARRIER_FILE if stage.table is None else STAGE_BARRIER_FILE.format(number + 1)
        names, sums = stage.places.barrier_names, BARRIER_SUMS[stage.scene.solver]
        return BarrierTable(self._folder.place / name, names, sums, resumed) if names else None

    def add(self, frame):
        """The rows of a `frame` that is about to be written; a stage that is over has a last one of its end."""
        if self._sequence.number != self._number:
            if self._table is not None:
                self._table.path = self._folder.place / self._table.path.name
                over = self._sequence.past[-1]
                taken = over["balances"]["barriers"].values()
                self._table.add(over["time"], np.array([[one[name] for name in self._table.sums] for one in taken]))
            self._number, self._table = self._sequence.number, self._opened(None)
        if self._table is None and "barriers" in frame.state:  # barriers that the flow has come to since
            self._table = self._opened(None)
        if self._table is not None:
            self._table.path = self._folder.place / self._table.path.name  # the earlier run may have gone
            self._table.add(frame.time, frame.state["barriers"])


def _beside(scene, folder):
    """The scene with its paths relative to `folder`, where it is written: the same scene from its new place."""

    def moved(name):
        path, bar, layer = name.partition("|")  # file.gpkg|layername=name
        if not scene.path(path).exists():
            return name
        return system.slashed(scene.path(path).resolve(), folder.resolve()) + bar + layer

    return scene.with_files(moved)


def decided(scene_path, laws=None):
    """((stage in words, decisions), ...) of the scene at `scene_path`, with the user's own `laws`; nothing is run.

    A scene without [[stage]] is one stage, without words.
    """
    with details():
        stages = prepare(scene_path, laws).stages
    return tuple(("" if stage.table is None else stage.words(), stage.decisions) for stage in stages)


def measured(scene_path, laws=None):
    """(decisions, EffectCosts): the scene's first steps are run, with each of its effects and without it."""
    with details():
        prepared = prepare(scene_path, laws)
    if prepared.scene.solvers != {"columns"}:
        raise SceneError("--measure times the effects of solver = 'columns' only; leave it out")
    use_threads(prepared.particles)
    solver = prepared.solver()
    start = under_way(solver, prepared.events, prepared.scene.output.end_time)
    return prepared.decisions, effect_costs(solver, start)
