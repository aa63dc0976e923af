"""Predict memory and time of a run: from its size, from a trial before a long run, and from its first steps."""

from collections.abc import Callable
from itertools import pairwise
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..solvers.columns.node_grid import ColumnGrid
from ..system.errors import MpmgisError, SceneError
from ..system.memory import available_memory, memory_lack
from ..system.messages import log, muted
from . import measured_cost
from .mass_sources import read_sources
from .measured_cost import BYTES_PER_COLUMN, BYTES_PER_GRID_NODE, MEMORY_SHARE, require_memory_for_points
from .stage_end import CHECK_SECONDS
from .stepping import PACE_SECONDS, measured_pace
from .warmup import sample_of, switched_sample, warm_up

if TYPE_CHECKING:
    from ..scene import Scene
    from ..terrain.elevation import Terrain
    from .preparation import Prepared
    from .stage_sequence import StageSequence

FEW_NODES = 4_000_000  # of a map grid; up to this number no estimate is needed: 0.4 GB, one second
COARSE_NODES = 250_000  # of the grid for seeding the release in the estimate
TRIAL_FROM = 0.5  # [s] predicted for a typical machine; longer runs get a trial on this one
TRIAL_SHARE = 0.1  # of the predicted time for a trial of each solver, at most two seconds
TRIAL_POINTS = 30_000  # in a trial of a later stage
LOG_FROM = 5.0  # [s] shorter predictions from a run's first steps are not logged
LONGER = 1.1  # the longest time is also given if it exceeds the expected one by this factor


def require_memory(stages: "list[Scene]", windowed: list[bool], terrain: "Terrain") -> None:
    """Raise SceneError if the cells need more memory for grid or particles than this machine has.

    Parameters
    ----------
    stages : list of Scene
        Each of one solver, with its cell size.
    windowed : list of bool
        Whether the stage contains only a part of the flow: its number of particles is not estimated.
    terrain : Terrain

    Raises
    ------
    SceneError
    """
    west, south, east, north = terrain.grid.bounds
    fine = []
    for scene, part in zip(stages, windowed, strict=True):
        size = scene.numerics.cell_size
        across, along = (east - west) / size, (north - south) / size
        if across * along <= FEW_NODES:
            continue
        fine += [] if part else [scene]
        if lack := memory_lack(across * along * BYTES_PER_GRID_NODE, MEMORY_SHARE):
            raise SceneError(
                f"[numerics] cell_size = {size:g} m makes {across:.6g} x {along:.6g} cells on the terrain, which need "
                f"{lack}; take larger cells, or a [terrain] window"
            )
    if not fine or (stages[0].release is not None and stages[0].release.particles is not None):
        return
    coarse = np.sqrt((east - west) * (north - south) / COARSE_NODES)
    try:
        with muted():
            moving = read_sources(stages[0], terrain, ColumnGrid.on(terrain, coarse)).everything
    except MpmgisError:  # only on coarse cells, or raised again later on the scene's cells
        return
    volume, area = float(moving.particles.volume.sum()), float(moving.particles.area.sum())
    for scene in fine:
        _require_particles(scene, volume, area)


def _require_particles(scene: "Scene", volume: float, area: float) -> None:
    """Raise SceneError for too many particles of `volume` [m3] on `area` [m2] in a `scene` of one solver."""
    numerics = scene.numerics
    if scene.solver == "points":
        spacing = numerics.cell_size / numerics.points_per_side
        require_memory_for_points(volume / spacing**3, numerics.cell_size)
        return
    columns = area / numerics.cell_size**2 * scene.columns_per_cell
    if lack := memory_lack(columns * BYTES_PER_COLUMN, MEMORY_SHARE):
        raise SceneError(
            f"[numerics] cell_size = {numerics.cell_size:g} m and particles_per_cell = {scene.columns_per_cell} make "
            f"{columns:.3g} columns, which need {lack}; take larger cells, or fewer particles_per_cell"
        )


class Machine(NamedTuple):
    """Speed of this machine relative to a typical one.

    Parameters
    ----------
    steps : dict of str to float [1]
        Solver -> time of its steps over that of a typical machine.
    other : float [1]
        The same for all other work.
    words : str
        Where the numbers come from, as the end of a sentence.
    """

    steps: dict  # solver -> ratio [1]
    other: float = 1.0
    words: str = ""


TYPICAL = Machine({})


class Prediction(NamedTuple):
    """Predicted cost of a run.

    Parameters
    ----------
    seconds : float [s]
    longest : float [s]
        Longest possible time: it depends on the end of the stages.
    memory : float [bytes]
    source : str
        Where the prediction comes from, as the end of a sentence.
    compiled : bool
        The kernels of the run were compiled for a trial.
    """

    seconds: float
    longest: float
    memory: float
    source: str
    compiled: bool


def predicted(prepared: "Prepared", threads: int, trial_from: float | None = None) -> Prediction:
    """Predict the cost of a prepared run.

    A run that may take longer than `trial_from` on a typical machine gets a trial on this one.

    Parameters
    ----------
    prepared : Prepared
    threads : int
    trial_from : float, optional [s]
        Default TRIAL_FROM.

    Returns
    -------
    Prediction
    """
    seconds, memory = predicted_cost(prepared, threads), predicted_memory(prepared)
    machine, longest = TYPICAL, predicted_cost(prepared, threads, longest=True)
    trial_from = TRIAL_FROM if trial_from is None else trial_from
    trial = longest > trial_from and memory < measured_cost.MEMORY_SHARE * available_memory()
    if trial:
        warm_up(prepared)
        machine = tried_machine(prepared, threads, seconds)
        seconds = predicted_cost(prepared, threads, machine)
        longest = predicted_cost(prepared, threads, machine, longest=True)
    return Prediction(seconds, longest, memory, machine.words, trial)


def predicted_memory(prepared: "Prepared") -> float:
    """Return the memory of the largest stage of a run, with the conversion between columns and points.

    Parameters
    ----------
    prepared : Prepared

    Returns
    -------
    float [bytes]
    """
    stages = range(len(prepared.stages))
    switched = measured_cost.BYTES_PER_SWITCHED if len(stages) > 1 else 0
    points = [n for n in stages if prepared.stages[n].scene.solver == "points"]
    turned = max((prepared.particles_of(number) for number in points), default=0)
    return max(_steps(prepared, number, 1, 1.0)[1] for number in stages) + turned * switched


def predicted_cost(
    prepared: "Prepared",
    threads: int,
    machine: Machine = TYPICAL,
    *,
    longest: bool = False,
    interval: float | None = None,
) -> float:
    """Predict the wall time of a run from its first frame on.

    Parameters
    ----------
    prepared : Prepared
    threads : int
    machine : Machine
    longest : bool
        Each stage lasts as long as possible.
    interval : float, optional [s]
        Between frames that are evaluated but not written, instead of the interval of the scene.

    Returns
    -------
    float [s]
    """
    stages = range(len(prepared.stages))
    lasting = [prepared.longest(number) for number in stages] if longest else expected_times(prepared)
    steps = sum(
        _steps(prepared, number, threads, lasting[number])[0] * _factor(machine, prepared.stages[number].scene.solver)
        for number in stages
    )
    other = sum(_frames(prepared, number, lasting[number], interval) for number in stages)
    other += sum(_switch(prepared, number) for number in stages[1:])
    if interval is None:
        other += measured_cost.SECONDS_PER_RUN + prepared.terrain.elevation.size * measured_cost.SECONDS_PER_PIXEL
    return steps + machine.other * other


def _factor(machine, solver):
    """Return the time of a step of `solver` over that of a typical machine; if unknown, that of the other solver."""
    return machine.steps.get(solver, next(iter(machine.steps.values()), 1.0))


def expected_times(prepared: "Prepared") -> list[float]:
    """Return the expected duration of each stage.

    The end of a stage that depends on the flow is unknown: the time to the next known end is divided equally among the
    stages up to it; for a single stage half of it is left for what follows.

    Parameters
    ----------
    prepared : Prepared

    Returns
    -------
    list of float [s]
    """
    tables, end = [stage.table for stage in prepared.stages], prepared.scene.output.end_time
    ends, begun = [], 0.0
    for number, table in enumerate(tables):
        known = [(k, _known_end(tables, k, end)) for k in range(number, len(tables))]
        last, latest = next((k, time) for k, time in known if time is not None)
        certain = table is None or number == len(tables) - 1 or set(table.until) == {"time"}
        shared = 1 if certain else max(2, last - number + 1)
        begun += max(latest - begun, 0.0) / shared
        ends.append(begun)
    return [after - before for before, after in pairwise([0.0, *ends])]


def _known_end(tables, number, end):
    """Return the latest time [s] at which stage `number` ends, None if unknown."""
    return end if number == len(tables) - 1 else tables[number].until.get("time")


def _steps(prepared: "Prepared", number: int, threads: int, seconds: float) -> tuple[float, float]:
    """Return (wall time [s], bytes) of the steps of stage `number` over `seconds`."""
    west, south, east, north = prepared.terrain.grid.bounds
    stage, particles = prepared.stages[number], prepared.particles_of(number)
    numerics, facts = stage.numerics, stage.facts
    nodes = (east - west) * (north - south) / numerics.cell_size**2
    elevation_bytes = prepared.terrain.elevation.nbytes
    if stage.scene.solver == "points":
        return measured_cost.predicted_in_3d(
            particles, stage.effects.material, numerics, nodes, elevation_bytes, seconds, facts.speed, threads
        )
    return measured_cost.predicted_in_2d(
        particles,
        facts.release_thickness,
        nodes,
        elevation_bytes,
        numerics.cell_size,
        numerics.cfl,
        seconds,
        facts.speed,
        threads,
    )


def _frames(prepared: "Prepared", number: int, seconds: float, interval: float | None) -> float:
    """Return the wall time [s] of frames of stage `number` over `seconds`, and of checks of its end conditions."""
    stage, particles = prepared.stages[number], prepared.particles_of(number)
    frames = seconds / (interval or prepared.scene.output.frame_interval) + 1
    shown = measured_cost.seconds_of_frames(stage.scene.solver, particles, frames, interval is None)
    conditions = () if stage.table is None else stage.table.until or ()
    return shown + measured_cost.seconds_of_checks(particles, seconds / CHECK_SECONDS, conditions)


def _switch(prepared, number):
    """Return the wall time [s] of the switch to stage `number`."""
    nodes = prepared.stages[number].grid.bed.size
    if prepared.stages[number].scene.solver == "points":
        return measured_cost.seconds_to_points(prepared.particles_of(number), nodes)
    return measured_cost.seconds_to_columns(prepared.particles_of(number - 1), nodes)


def tried_machine(
    prepared: "Prepared", threads: int, seconds: float, clock: Callable[[], float] = perf_counter
) -> Machine:
    """Measure this machine by a trial of each solver, with the columns or points of the scene.

    A trial takes a tenth of `seconds`. Kernels must be compiled before. The run is not changed.

    Parameters
    ----------
    prepared : Prepared
    threads : int
    seconds : float [s]
        Predicted time of the run.
    clock : callable
        Returns the wall time [s].

    Returns
    -------
    Machine
    """
    short, first = min(PACE_SECONDS, max(TRIAL_SHARE * seconds, 0.1)), prepared.stages[0]
    steps, words, other = {}, [], None
    _try(first, prepared.solver(), short, threads, steps, words)
    later = next((n for n, stage in enumerate(prepared.stages) if stage.scene.solver == "points"), 0)
    if later:
        began = clock()
        made = _points_for(prepared, later)
        if made is not None:
            solver, points = made
            nodes = prepared.stages[later].grid.bed.size
            other = (clock() - began) / measured_cost.seconds_to_points(points, nodes)
            _try(prepared.stages[later], solver, short, threads, steps, words)
    if other is None:
        other = next(iter(steps.values()), 1.0)
    return Machine(steps, other, _measured(words))


def _measured(words):
    """Return the source of a prediction, from `words` about the pace of each solver."""
    return f", at {' and '.join(words)} and step as measured" if words else ""


def _pace_words(solver, pace):
    return f"{1e9 * pace:.0f} ns a {solver.removesuffix('s')}"


def _try(stage, solver, seconds, threads, steps, words):
    """Add the measured pace of `solver`, which is discarded afterwards, to `steps` and `words`."""
    name = stage.scene.solver
    particles = solver.points if name == "points" else solver.columns
    pace = measured_pace(solver, seconds)
    if pace is not None:
        steps[name] = measured_cost.slower_than_nominal(name, pace, particles, threads, stage.scene.numerics.precision)
        words.append(_pace_words(name, pace))


def _points_for(prepared, number):
    """Return (a PointSolver of stage `number` with a part of the scene's mass, its points); None without mass."""
    stage, seen = prepared.stages[number], prepared.seen.particles
    each = stage.point_options().predicted_points(seen) / max(len(seen), 1)
    few = sample_of(prepared, max(1, int(TRIAL_POINTS / max(each, 1.0))))
    try:
        switched = switched_sample(stage, prepared.stages[0], few[0], prepared.terrain)
    except MpmgisError:
        return None
    solver = stage.solver(prepared.terrain, switched.frame, switched.vertical_stress, switched.gradient)
    return solver, solver.points


class OwnPace:
    """Prediction of a run that is updated from two seconds of its own steps, once for each solver.

    Parameters
    ----------
    prepared : Prepared
    threads : int
    ahead : Prediction
        Before the first step.

    Attributes
    ----------
    seconds : float [s]
        Current prediction.
    """

    def __init__(self, prepared: "Prepared", threads: int, ahead: Prediction) -> None:
        self.seconds, self._ahead = ahead.seconds, ahead
        self._prepared, self._threads, self._steps, self._words = prepared, threads, {}, []

    def update(self, sequence: "StageSequence") -> None:
        """Measure the pace of the current stage of `sequence`, if it is unknown and enough steps are done.

        Parameters
        ----------
        sequence : StageSequence
        """
        name = sequence.stage.scene.solver
        seconds, particle_steps, steps = sequence.stepped
        if name in self._steps or not steps or seconds < PACE_SECONDS:
            return
        pace, precision = seconds / max(particle_steps, 1), sequence.stage.scene.numerics.precision
        particles = particle_steps / steps
        self._steps[name] = measured_cost.slower_than_nominal(name, pace, particles, self._threads, precision)
        self._words.append(_pace_words(name, pace))
        machine = Machine(dict(self._steps), words=_measured(self._words))
        self.seconds = predicted_cost(self._prepared, self._threads, machine)
        if self.seconds >= LOG_FROM:
            longest = predicted_cost(self._prepared, self._threads, machine, longest=True)
            log.info(prediction_line(Prediction(self.seconds, longest, self._ahead.memory, machine.words, True)))

    def watching(self, sequence: "StageSequence", watch: Callable) -> Callable:
        """Return `watch` extended by a measurement of the pace of the `sequence`.

        Parameters
        ----------
        sequence : StageSequence
        watch : callable
            Called with (solver, end time [s]) a few times a second.
        """

        def watching(now, end_time):
            self.update(sequence)
            watch(now, end_time)

        return watching


def prediction_line(ahead: Prediction) -> str:
    """Return a line about a Prediction.

    Parameters
    ----------
    ahead : Prediction
    """
    return f"predicted: {need_words(ahead)}{ahead.source}{longest_words(ahead)}"


def need_words(ahead: Prediction) -> str:
    """Return time and memory of a Prediction in words.

    Parameters
    ----------
    ahead : Prediction
    """
    return f"{duration_words(ahead.seconds)} and {ahead.memory / 1e9:.2g} GB"


def longest_words(ahead: Prediction) -> str:
    """Return the longest time of a run in words; '' unless it is longer than the expected one.

    Parameters
    ----------
    ahead : Prediction
    """
    longer = ahead.longest > LONGER * ahead.seconds
    return f"; up to {duration_words(ahead.longest)}, depending on the end of its stages" if longer else ""


def duration_words(seconds: float) -> str:
    """Return a wall time in words.

    Parameters
    ----------
    seconds : float [s]
    """
    if seconds < 100.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000.0 else f"{seconds / 3600:.1f} h"
