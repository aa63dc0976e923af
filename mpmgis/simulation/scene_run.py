"""Simulate a scene into a folder of frames (`mpmgis run`)."""

import math
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..compiled.jit import set_threads
from ..frames.flow_end import FlowEnd, recorded_end
from ..frames.load_table import LoadTable
from ..frames.peaks import largest_peaks
from ..frames.run_folder import BARRIER_FILE, STAGE_BARRIER_FILE, TERRAIN_FILE, RunFolder
from ..scene import scene_text
from ..scene.point_effects import MACH_THRESHOLD
from ..scene.scene_reading import read_toml
from ..scene.tables import CPU
from ..solvers.columns.column_state import BARRIER_SUMS as COLUMN_BARRIER_SUMS
from ..solvers.points.point_balances import BARRIER_SUMS as POINT_BARRIER_SUMS
from ..system import source_names
from ..system.errors import InputError, SceneError, UnphysicalError
from ..system.memory import available_memory
from ..system.messages import log
from .companion_run import LARGER, companion_run, has_companion, headline_numbers
from .cost_prediction import Prediction, TimeLeft, most_particle_steps, need_words, predicted
from .kernels_ahead import kernels_ahead
from .memory_need import MEMORY_SHARE
from .numerical_parameters import cost_power
from .preparation import prepare
from .required_memory import predicted_memory
from .run_device import devices_record, require_devices
from .run_extension import can_continue, continue_earlier, differences, earlier_run
from .run_summary import extremes, flight_lines, unusable_lines
from .scene_files import input_files
from .stage_sequence import StageSequence
from .warmup import warm_up

if TYPE_CHECKING:
    from .preparation import Prepared
    from .trial_run import StageWork

ANEW, RESUMED, FINISHED = range(3)  # how a run starts
PARTICLES_PER_THREAD = 10_000  # with fewer, threads cost more time than they save
BARRIER_SUMS = {"columns": COLUMN_BARRIER_SUMS, "points": POINT_BARRIER_SUMS}
ASK_SECONDS = 3600.0  # [s] predicted time of a run above which it must be confirmed
SURELY_SHORT = ASK_SECONDS / 1e-6  # particle-steps; no machine takes more than a microsecond for one


@dataclass(frozen=True)
class RunSummary:
    """Result of a run.

    Parameters
    ----------
    folder : Path
    reason : str
        Of its end.
    frames, steps : int
        Number of frames and of steps.
    time : float [s]
        Simulated time at the end.
    wall_seconds : float [s]
    particle_steps_per_second : float [s-1]
    balances : dict
        Of the last solver.
    predicted_seconds : float or None [s]
        Of the whole run; None for one of less than a second.
    solver : {"columns", "points"}
        The last one.
    mass : dict or None
        Account of a run in several stages.
    result_digest : str or None
        Of all frames.
    extremes : dict or None
        Place and time of the largest thickness and speed.
    warnings : tuple of str
        About mass in flight that became columns, and points that have lost their volume.
    end : FlowEnd or None
        State of the flow at the end; None for a run of a version that did not record it.
    companion : dict or None
        Numerical errors, see `companion_run`; None without a companion run.
    """

    folder: Path
    reason: str
    frames: int
    steps: int
    time: float
    wall_seconds: float
    particle_steps_per_second: float
    balances: dict
    predicted_seconds: float | None
    solver: str = "columns"
    mass: dict | None = None
    result_digest: str | None = None
    extremes: dict | None = None
    warnings: tuple = ()
    end: FlowEnd | None = None
    companion: dict | None = None

    @property
    def came_to_rest(self) -> bool:
        """Whether the flow came to rest: only then its last step is a deposit."""
        return self.end is not None and self.end.came_to_rest


def use_threads(particles: int, number: int | None = None) -> int:
    """Set the number of threads of the solvers, and return it.

    More threads for few particles are slower, especially on a busy machine; the result does not depend on them.

    Parameters
    ----------
    particles : int
    number : int, optional
        Default: one thread for every PARTICLES_PER_THREAD particles.
    """
    return set_threads(number or _useful_threads(particles, set_threads(None)))


def _useful_threads(particles, most):
    """Return the number of threads, up to `most`, that save time."""
    return max(1, min(most, particles // PARTICLES_PER_THREAD))


def require_affordable(prepared: "Prepared", threads: int, confirm: Callable[[str], bool]) -> "tuple[StageWork, ...]":
    """Ask before a run of more than an hour or of most of the memory; return the trial of one that may be so long.

    Parameters
    ----------
    prepared : Prepared
    threads : int
    confirm : callable
        Question -> whether to run it.

    Raises
    ------
    SceneError
        The answer is no.
    """
    available = available_memory()
    if most_particle_steps(prepared) < SURELY_SHORT:
        ahead = Prediction(math.nan, predicted_memory(prepared))
    else:
        ahead = predicted(prepared, threads)
        log.info(f"predicted before the first step: {need_words(ahead)}")
    if not ahead.seconds > ASK_SECONDS and ahead.memory < MEMORY_SHARE * available:
        return ahead.trial
    question = f"this run is predicted to take {need_words(ahead)} ({available / 1e9:.1f} GB are free)"
    if not confirm(question):
        fewer = "or fewer particles_per_cell"
        if "points" in prepared.scene.solvers:
            fewer = "or [numerics] stiffness = 'scaled' for longer steps"
        raise SceneError(f"{question}; give `yes` to run it, or use larger cells {fewer}")
    return ahead.trial


def run(
    scene: str | Path | Mapping,
    output: str | Path | None = None,
    *,
    overwrite: bool = False,
    resume: bool = False,
    threads: int | None = None,
    law: str | Path | None = None,
    device: str | None = None,
    confirm: Callable[[str], bool] = lambda question: True,
    watch: Callable = lambda solver, end_time, left: None,
) -> RunSummary:
    """Simulate a scene into a folder.

    Parameters
    ----------
    scene : path or Mapping
        Path of a scene.toml, or its tables, with paths relative to the current folder.
    output : path, optional
        Default `results/` beside the scene.
    overwrite : bool
        Replace an earlier run in `output`.
    resume : bool
        Continue after the last complete frame, with the same bits as without a stop. An empty or missing folder starts
        at the beginning. A finished run is not changed, unless [output] end_time is larger than before: then it
        continues to that time, with the same result as one run.
    threads : int, optional
        Default: by the number of particles.
    law : path, optional
        Python file with the user's own friction laws, which the scene can name; it is executed.
    device : str, optional
        Replaces [numerics] device. A run that began on another device continues, and its record names both.
    confirm : callable
        Question -> whether to run a very large scene.
    watch : callable
        Called with (solver, end time [s], wall time left in words) a few times a second.

    Returns
    -------
    RunSummary

    Raises
    ------
    InputError, SceneError, OutputError
        Before the first step; nothing is written.
    UnphysicalError
        The run stopped; all earlier frames are complete.
    """
    if not isinstance(scene, Mapping):
        read_toml(scene)  # a missing scene is reported before an existing folder
    output = output or Path("" if isinstance(scene, Mapping) else scene).parent / "results"
    folder = RunFolder.resumed(output) if resume else RunFolder(output, overwrite)
    if resume and not folder.record():
        log.info(f"{output} contains no run to continue: this one starts from the beginning")
    with ExitStack() as stack:
        prepared = prepare(scene, law, device, lambda checked: stack.enter_context(kernels_ahead(checked)))
        device = require_devices(prepared)
        if prepared.scene.output.rasters:
            _require_rasters(prepared)
        folder.refuse_inputs(input_files(scene, prepared.scene, law))
        used = use_threads(max(prepared.particles_of(number) for number in range(len(prepared.stages))), threads)
        trial = require_affordable(prepared, used, confirm)
        if not trial:
            warm_up(prepared)
    sequence, left, warned = StageSequence(prepared), TimeLeft(prepared, trial), _with_mach_warning(watch)
    sequence.observe = lambda solver, end_time: warned(solver, end_time, left.words(sequence))
    _log_stages(prepared)
    threads_word = "1 thread" if used == 1 else f"{used} threads"
    to_come = prepared.particles - len(prepared.frame.particles)
    particles = f"{len(prepared.frame.particles)} {prepared.scene.solver}" + (f", {to_come} to come" if to_come else "")
    memory = f"{predicted_memory(prepared) / 1e9:.2g} GB"
    log.info(f"{particles}, cells of {prepared.numerics.cell_size:g} m, {threads_word}, {memory}")
    if device != CPU:
        log.info(f"steps: {device}")
    if has_companion(prepared.scene) and "points" in prepared.scene.solvers:
        share = LARGER ** -cost_power(prepared.scene)
        size = LARGER * prepared.numerics.cell_size
        log.info(
            f"a companion run on cells of {size:g} m follows, of about {100 * share:.0f} % of the time of the steps"
        )
    with folder.held():
        start = _restored(folder, sequence) if resume else ANEW
        _warn_of_missing_frames(folder, prepared.scene)
        if start == FINISHED:
            summary = _summary(folder, sequence, folder.record()["reason"], 0.0, recorded_end(folder.record()))
        else:
            folder.open(anew=start == ANEW)
            try:
                summary = integrate_into(folder, sequence, start == RESUMED, left, device)
            except KeyboardInterrupt:
                log.info(
                    f"{folder.path} contains the results until now; `resume` continues after its last complete frame"
                )
                raise
        if has_companion(prepared.scene):
            set_threads(_useful_threads(int(prepared.particles / LARGER**2), used))
            summary = replace(summary, companion=_with_companion(folder, sequence, watch))
        return summary


def _with_companion(folder, sequence, watch):
    """Return the record of the companion run of a finished run; make it, and add it to the folder, if it is missing."""
    record = folder.record()
    made = record.get("companion")
    if made is not None and "failed" not in made:
        return made
    size = LARGER * sequence.prepared.numerics.cell_size
    log.info(f"the run is complete; companion run on cells of {size:g} m, for the numerical error")
    try:
        made = companion_run(sequence, record.get("numbers") or {}, lambda solver, end: watch(solver, end, "companion"))
    except KeyboardInterrupt:
        log.info("the companion run was stopped; the run is complete, and `resume` makes its companion")
        return None
    folder.write_record(**record | {"companion": made})
    return made


def _log_stages(prepared):
    """Log each stage with its end condition, and its effects that the scene has or that a number decides."""
    for number, stage in enumerate(prepared.stages, 1):
        if stage.table is not None:
            log.info(f"stage {number}: {stage.words()}")
        for decision in stage.decisions:
            if decision.called_for:
                log.info(decision.line())


def _restored(folder, sequence):
    """Set the sequence to the last complete frame; return RESUMED, ANEW without a frame, or FINISHED."""
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
    log.info(f"continuing after frame {folder.frames - 1}, t = {frame.time:g} s")
    return RESUMED


def _warn_of_missing_frames(folder, scene):
    """Warn of frames before the one that a run continues from; rasters replace those of a run that writes rasters."""
    missing = [] if scene.output.rasters else folder.missing_frames()
    if not missing:
        return
    first = f"frame {missing[0]} is missing" if len(missing) == 1 else f"{len(missing)} frames are missing"
    which = "" if len(missing) == 1 else f", the first is frame {missing[0]}"
    log.info(
        f"{folder.path}: {first}{which}; maps and results of this run lack this time, `overwrite` computes it again"
    )


def _restored_earlier(folder, sequence, record):
    """Restore a run of this scene with an earlier end_time, see `_restored`; raise InputError for any other run."""
    prepared = sequence.prepared
    earlier = earlier_run(prepared, record)
    if earlier is None:
        raise InputError(
            f"{folder.path} contains a run of another scene or of changed inputs: "
            f"{differences(record, prepared.scene)}; only [output] end_time can be larger than before; give another "
            "`output`, or `overwrite`"
        )
    before, now = earlier.scene.output.end_time, prepared.scene.output.end_time
    if not can_continue(record):
        last = folder.last_frame(earlier.digest)
        if last is not None:
            sequence.restore(last)
        log.info(f"{folder.path} is finished: {record.get('reason')}; the later end_time = {now:g} s has no effect")
        return FINISHED
    frame = continue_earlier(folder, sequence, earlier)
    log.info(
        f"end_time = {before:g} s is now {now:g} s: continuing after frame {folder.frames - 1}, t = {frame.time:g} s"
    )
    return RESUMED


def _with_mach_warning(watch):
    """Return `watch` with one warning when a 3D flow is so fast that its stiffness affects it."""
    warned = []

    def watching(now, end_time, left):
        mach = getattr(now, "mach", 0.0)
        if not warned and mach > MACH_THRESHOLD:
            warned.append(True)
            log.info(
                f"t = {now.time:.1f} s: the flow moves at {mach:.2f} times the speed of pressure waves (more than "
                f"{MACH_THRESHOLD:g}): it is compressed, and impacts are too soft; give a larger [material] "
                "bulk_modulus"
            )
        watch(now, end_time, left)

    return watching


def _summary(folder, sequence, reason, wall, end, expected=None):
    solver, steps = sequence.solver, sequence.particle_steps
    mass = sequence.mass_account() if sequence.prepared.scene.stage else None
    return RunSummary(
        folder.path,
        reason,
        folder.frames,
        sequence.steps,
        solver.time,
        wall,
        steps / wall if wall else 0.0,
        solver.balances(),
        expected,
        sequence.stage.scene.solver,
        mass,
        folder.result,
        extremes(sequence.balances()),
        (*flight_lines(sequence.past), *unusable_lines(_record_of_stages(sequence))),
        end,
    )


def integrate_into(
    folder: RunFolder, sequence: StageSequence, resumed: bool, left: TimeLeft | None = None, device: str = CPU
) -> RunSummary:
    """Integrate in time and write into a locked folder; its record always shows the state of the run.

    Parameters
    ----------
    folder : RunFolder
    sequence : StageSequence
    resumed : bool
        The run continues after a restored frame.
    left : TimeLeft, optional
        Its prediction is recorded.
    device : str
        What computes the steps, in words.

    Returns
    -------
    RunSummary

    Raises
    ------
    InputError, UnphysicalError
        The run stopped; its record contains the reason.
    """
    prepared, began = sequence.prepared, time.perf_counter()
    devices = devices_record(folder.record().get("devices", ()) if resumed else (), sequence.solver.time, device)
    if len(devices) > 1:
        log.info("the run began on another device: its numbers agree with those of one device to rounding only")
    barriers = _BarrierTables(folder, sequence, sequence.solver.time if resumed else None)

    def record(state):
        wall, solver = time.perf_counter() - began, sequence.solver
        folder.write_record(
            state=state,
            reason=sequence.reason,
            end=None if sequence.end is None else asdict(sequence.end),
            digest=prepared.digest,
            time=solver.time,
            steps=sequence.steps,
            frames=folder.frames,
            particles=len(prepared.frame.particles),
            wall_seconds=wall,
            predicted_seconds=None if left is None else left.seconds,
            scene=prepared.scene.as_tables(),
            effects=[decision._asdict() for decision in sequence.prepared.stages[0].decisions],
            terrain_facts=prepared.facts._asdict(),
            balances=solver.balances(),
            extremes=extremes(sequence.balances()),
            maxima=largest_peaks(sequence.maxima()),
            events=prepared.events.record(),
            troubles=sequence.troubles,
            devices=devices,
            release=_record_of_release(prepared.seen.particles),
            terrain=_record_of_terrain(prepared.terrain),
            nodata=_record_of_nodata(prepared),
            unusable=unusable_lines(_record_of_stages(sequence)),
            numbers=headline_numbers(sequence) if state == "finished" and not prepared.scene.stage else None,
            **_record_of_stages(sequence),
        )
        return wall

    record("running")  # the first file: a folder with a record can be resumed
    folder.write_scene(scene_text(_with_paths_from(prepared.scene, folder.path), "resolved by mpmgis run"))
    sha256 = folder.write_terrain(prepared.terrain)
    writer = _frame_writer(folder, prepared, sha256, resumed)
    number = sequence.number
    try:
        for frame in sequence:
            folder.require()
            barriers.add(frame)  # before its frame: a resumed run drops later rows
            writer.add(replace(frame, dem=TERRAIN_FILE, dem_sha256=sha256))
            if sequence.number != number:
                number = sequence.number
                record("running")
        writer.finish(sequence.end)
    except KeyboardInterrupt:
        writer.finish()
        record("interrupted")
        raise
    except UnphysicalError:
        writer.finish()
        record("unphysical")
        raise
    except InputError:  # at a switch
        writer.finish()
        record("refused")
        raise
    expected = None if resumed or left is None else left.seconds
    return _summary(folder, sequence, sequence.reason, record("finished"), sequence.end, expected)


def _require_rasters(prepared):
    """Raise InputError, before the run, for rasters of unknown bands or with too many cells."""
    from ..maps.export.run_rasters import bands_of, raster_grid

    output = prepared.scene.output
    bands_of(output.raster_products)
    raster_grid(prepared.terrain.grid, output.raster_cell_size, prepared.coarsest_cells)


class _Frames:
    """Writer of every frame."""

    def __init__(self, folder):
        self.add = folder.write_frame

    def finish(self, end=None):
        """Nothing is left to write."""


def _frame_writer(folder: RunFolder, prepared: "Prepared", sha256: str, resumed: bool) -> object:
    """Return the writer of a run's frames into its `folder`: of all of them, or of their rasters."""
    if not prepared.scene.output.rasters:
        return _Frames(folder)
    from ..maps.export.run_rasters import RasterWriter

    terrain = replace(prepared.terrain, path=folder.place / TERRAIN_FILE, sha256=sha256)
    return RasterWriter(folder, prepared, terrain, resumed)


def _record_of_release(columns):
    """Return volume [m3], and mean and largest vertical thickness [m], of all mass that may ever move, as columns."""
    volume, area = float(columns.volume.sum()), float(columns.area.sum())
    largest = float(columns.thickness.max(initial=0.0))
    return {"volume": volume, "mean_thickness": volume / area if area else 0.0, "largest_thickness": largest}


def _record_of_terrain(terrain):
    """Return the record of the DTM: its file, its digest, and how it was brought to metres."""
    how = terrain.reprojection
    return {"dem": terrain.path, "sha256": terrain.sha256, "reprojection": None if how is None else how.facts()}


def _record_of_nodata(prepared):
    """Return the record of cells without elevation: filled cells, and the largest number in reach of a stage."""
    in_reach = max((stage.nodata for stage in prepared.stages), key=lambda found: sum(h.cells for h in found.holes))
    return {"filled": None if prepared.fill is None else asdict(prepared.fill), "in_reach": in_reach.as_numbers()}


def _record_of_stages(sequence):
    """Return the record of several stages: effects and checks of each, results of finished ones, the mass account."""
    stages = sequence.prepared.stages
    if stages[0].table is None:
        return sequence.checks
    effects = [[decision._asdict() for decision in stage.decisions] for stage in stages]
    records = [{"solver": stage.scene.solver, "effects": e} for stage, e in zip(stages, effects, strict=True)]
    records[sequence.number].update(sequence.checks)
    for stage, past in zip(records, sequence.past, strict=False):
        stage.update(past)
    return {"stages": records, "mass": sequence.mass_account()}


class _BarrierTables:
    """The tables of forces on barriers: one file, or one for each stage."""

    def __init__(self, folder, sequence, resumed):
        self._folder, self._sequence = folder, sequence
        self._number, self._table = sequence.number, self._opened(resumed)

    def _opened(self, resumed):
        number = self._sequence.number
        stage = self._sequence.prepared.stages[number]
        name = BARRIER_FILE if stage.table is None else STAGE_BARRIER_FILE.format(number + 1)
        names, sums = stage.places.barrier_names, BARRIER_SUMS[stage.scene.solver]
        return LoadTable(self._folder.place / name, names, sums, resumed) if names else None

    def add(self, frame):
        """Add the rows of a `frame` before it is written; a finished stage gets a last row at its end."""
        if self._sequence.number != self._number:
            if self._table is not None:
                self._table.path = self._folder.place / self._table.path.name
                past = self._sequence.past[-1]
                taken = past["balances"]["barriers"].values()
                self._table.add(past["time"], np.array([[one[name] for name in self._table.sums] for one in taken]))
            self._number, self._table = self._sequence.number, self._opened(None)
        if self._table is not None:
            self._table.path = self._folder.place / self._table.path.name  # the folder may have been replaced
            self._table.add(frame.time, frame.state["barriers"])


def _with_paths_from(scene, folder):
    """Return the scene with its paths relative to `folder`, where it is written."""

    def moved(name):
        path = scene.path(name)
        return source_names.moved(path, folder) if source_names.file_of(path).exists() else name

    return scene.with_files(moved)
