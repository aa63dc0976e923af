"""Prediction of memory and time of a run: from its size, from a trial before a long run, from its first steps."""

from itertools import pairwise
from time import perf_counter
from typing import NamedTuple

import numpy as np

from ...errors import MpmgisError, SceneError
from ...machine import available_memory, memory_lack
from ...messages import log, muted
from ...solvers import cost
from ...solvers.cost import BYTES_PER_COLUMN, BYTES_PER_GRID_NODE, MEMORY_SHARE, require_memory_for_points
from ...solvers.stage_end import LOOK_SECONDS
from ...solvers.stepping import PACE_SECONDS, measured_pace
from ...spatial.node_grid import ColumnGrid
from .sources import read_sources
from .warmup import handed_on, rehearse, some_of

FEW_NODES = 4_000_000  # of a grid on the map, up to which it is made without an estimate: 0.4 GB, a second
COARSE_NODES = 250_000  # of the grid on which the release is seeded for the estimate


def require_room(stages, windowed, terrain):
    """Refuse cells whose grid or particles this machine cannot hold.

    Parameters
    ----------
    stages : list of Scene
        Each of one solver, with its cell size.
    windowed : list of bool
        Of each, whether it takes only a part of the flow: how many particles that makes is not estimated.
    terrain : Terrain

    Raises
    ------
    SceneError
        It names the key, the number of cells or particles and the memory.
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
                f"[numerics] cell_size = {size:g} m makes {across:.0f} x {along:.0f} cells on the terrain, which need "
                f"{lack}; take larger cells, or a [terrain] window"
            )
    if not fine or (stages[0].release is not None and stages[0].release.particles is not None):
        return
    coarse = np.sqrt((east - west) * (north - south) / COARSE_NODES)
    try:
        with muted():
            moving = read_sources(stages[0], terrain, ColumnGrid.on(terrain, coarse)).everything
    except MpmgisError:  # on such cells alone, or said in full where they are the scene's own
        return
    volume, area = float(moving.particles.volume.sum()), float(moving.particles.area.sum())
    for scene in fine:
        _require_particles(scene, volume, area)


def _require_particles(scene, volume, area):
    """Refuse the particles that `volume` [m3] on `area` [m2] becomes in a `scene` of one solver."""
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


TRIAL_FROM = 0.5  # [s], predicted for a typical machine, above which this one is tried
TRIAL_SHARE = 0.1  # of what is predicted that a trial of each solver takes, two seconds at most
TRIAL_POINTS = 30_000  # that columns are converted to for a trial of a later stage
TELL_FROM = 5.0  # [s], of a prediction from a run's own first steps that is worth a line
LONGER = 1.1  # times what is expected of a run in stages, from which the longest time is given as well


class Machine(NamedTuple):
    """How much longer than on a typical machine this one takes now: a step of each solver, all else; and in words."""

    steps: dict  # solver -> times [1]
    beside: float = 1.0
    words: str = ""


TYPICAL = Machine({})


class Foreseen(NamedTuple):
    """What a run will take [s], what at most by when its stages end [s], its memory [bytes], and how that is known.

    `rehearsed`: to know it, what the run needs was compiled.
    """

    seconds: float
    longest: float
    memory: float
    how: str
    rehearsed: bool


def foreseen(prepared, threads, trial_from=None):
    """The Foreseen of a prepared run.

    A run that may take longer than `trial_from` [s] (default TRIAL_FROM) on a typical machine is tried on this one.
    """
    seconds, memory = predicted_cost(prepared, threads), predicted_memory(prepared)
    machine, longest = TYPICAL, predicted_cost(prepared, threads, longest=True)
    trial_from = TRIAL_FROM if trial_from is None else trial_from
    tries = longest > trial_from and memory < cost.MEMORY_SHARE * available_memory()
    if tries:
        rehearse(prepared)
        machine = tried(prepared, threads, seconds)
        seconds = predicted_cost(prepared, threads, machine)
        longest = predicted_cost(prepared, threads, machine, longest=True)
    return Foreseen(seconds, longest, memory, machine.words, tries)


def predicted_memory(prepared):
    """Bytes that the largest of a run's stages needs, and what becomes points or columns on its way."""
    stages = range(len(prepared.stages))
    switched = cost.BYTES_PER_SWITCHED if len(stages) > 1 else 0
    points = [n for n in stages if prepared.stages[n].scene.solver == "points"]
    turned = max((prepared.particles_of(number) for number in points), default=0)
    return max(_steps(prepared, number, 1, 1.0)[1] for number in stages) + turned * switched


def predicted_cost(prepared, threads, machine=TYPICAL, *, longest=False, interval=None):
    """Wall time [s] that a run will take from its first frame on.

    Parameters
    ----------
    machine : Machine
    longest : bool
        As if each stage lasted as long as it may.
    interval : float, optional [s]
        Between frames that somebody looks at and nobody writes, instead of the scene's own.
    """
    stages = range(len(prepared.stages))
    lasting = [prepared.longest(number) for number in stages] if longest else expected_times(prepared)
    steps = sum(
        _steps(prepared, number, threads, lasting[number])[0] * _factor(machine, prepared.stages[number].scene.solver)
        for number in stages
    )
    beside = sum(_frames(prepared, number, lasting[number], interval) for number in stages)
    beside += sum(_switch(prepared, number) for number in stages[1:])
    if interval is None:
        beside += cost.SECONDS_PER_RUN + prepared.terrain.elevation.size * cost.SECONDS_PER_PIXEL
    return steps + machine.beside * beside


def _factor(machine, solver):
    """How much longer this machine takes for a step of `solver`, by the other's where that alone was tried."""
    return machine.steps.get(solver, next(iter(machine.steps.values()), 1.0))


def expected_times(prepared):
    """How long [s] each stage is expected to last.

    When a stage is over by what the flow does nobody knows: the time to the next end that is known is shared out
    evenly among the stages up to it, and where there is but one, half of it is left to what follows.
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
    """The latest time [s] at which stage `number` ends, None where none is known."""
    return end if number == len(tables) - 1 else tables[number].until.get("time")


def _steps(prepared, number, threads, seconds):
    """(wall time [s], bytes) of the steps of stage `number` over `seconds`."""
    west, south, east, north = prepared.terrain.grid.bounds
    stage, particles = prepared.stages[number], prepared.particles_of(number)
    numerics, facts = stage.numerics, stage.facts
    nodes = (east - west) * (north - south) / numerics.cell_size**2
    elevation_bytes = prepared.terrain.elevation.nbytes
    if stage.scene.solver == "points":
        return cost.predicted_in_3d(
            particles, stage.effects.material, numerics, nodes, elevation_bytes, seconds, facts.speed, threads
        )
    return cost.predicted(
        particles, facts.release_thickness, nodes, elevation_bytes, numerics.cell_size, numerics.cfl, seconds,
        facts.speed, threads,
    )  # fmt: skip


def _frames(prepared, number, seconds, interval):
    """Wall time [s] of what is shown of stage `number` over `seconds`, and of the looks whether it is over."""
    stage, particles = prepared.stages[number], prepared.particles_of(number)
    frames = seconds / (interval or prepared.scene.output.frame_interval) + 1
    shown = cost.seconds_of_frames(stage.scene.solver, particles, frames, interval is None)
    conditions = () if stage.table is None else stage.table.until or ()
    return shown + cost.seconds_of_looks(particles, seconds / LOOK_SECONDS, conditions)


def _switch(prepared, number):
    """Wall time [s] in which stage `number` takes over from the one before."""
    nodes = prepared.stages[number].grid.bed.size
    if prepared.stages[number].scene.solver == "points":
        return cost.seconds_to_points(prepared.particles_of(number), nodes)
    return cost.seconds_to_columns(prepared.particles_of(number - 1), nodes)


def tried(prepared, threads, seconds, clock=perf_counter):
    """The Machine as a trial finds it, of each solver for a tenth of `seconds`, of the columns or points of the scene.

    What was compiled before is left apart. Nothing of the run is touched.
    """
    short, first = min(PACE_SECONDS, max(TRIAL_SHARE * seconds, 0.1)), prepared.stages[0]
    steps, words, beside = {}, [], None
    _try(first, prepared.solver(), short, threads, steps, words)
    later = next((n for n, stage in enumerate(prepared.stages) if stage.scene.solver == "points"), 0)
    if later:
        began = clock()
        made = _points_for(prepared, later)
        if made is not None:
            solver, points = made
            nodes = prepared.stages[later].grid.bed.size
            beside = (clock() - began) / cost.seconds_to_points(points, nodes)
            _try(prepared.stages[later], solver, short, threads, steps, words)
    if beside is None:
        beside = next(iter(steps.values()), 1.0)
    return Machine(steps, beside, _measured(words))


def _measured(words):
    """How a prediction is known, from `words` about the pace of each solver."""
    return f", at {' and '.join(words)} and step as measured" if words else ""


def _pace_words(solver, pace):
    return f"{1e9 * pace:.0f} ns a {solver.removesuffix('s')}"


def _try(stage, solver, seconds, threads, steps, words):
    """Add to `steps` and `words` what `solver`, which is worth nothing afterwards, shows of its stage's kind."""
    name = stage.scene.solver
    particles = solver.points if name == "points" else solver.columns
    pace = measured_pace(solver, seconds)
    if pace is not None:
        steps[name] = cost.slower_than_nominal(name, pace, particles, threads, stage.scene.numerics.precision)
        words.append(_pace_words(name, pace))


def _points_for(prepared, number):
    """(a PointSolver of stage `number` with some of the scene's mass, its points); None where there is none of it."""
    stage, seen = prepared.stages[number], prepared.seen.particles
    each = stage.point_options().predicted_points(seen) / max(len(seen), 1)
    few = some_of(prepared, max(1, int(TRIAL_POINTS / max(each, 1.0))))
    try:
        switched = handed_on(stage, prepared.stages[0], few[0], prepared.terrain)
    except MpmgisError:
        return None
    solver = stage.solver(prepared.terrain, switched.frame, switched.vertical_stress, switched.gradient)
    return solver, solver.points


class OwnPace:
    """Predicts a run anew from two seconds of its own steps, once for each solver: no step is taken for that alone.

    Parameters
    ----------
    prepared : Prepared
    threads : int
    ahead : Foreseen
        What was predicted before the first step.

    Attributes
    ----------
    seconds : float [s]
        What the run is predicted to take, by what is known now.
    """

    def __init__(self, prepared, threads, ahead):
        self.seconds, self._ahead, self._say = ahead.seconds, ahead, say
        self._prepared, self._threads, self._steps, self._words = prepared, threads, {}, []

    def look(self, sequence):
        """Take the pace of the `sequence`'s stage, if it is not known and enough of its steps are done."""
        name = sequence.stage.scene.solver
        seconds, particle_steps, steps = sequence.stepped
        if name in self._steps or not steps or seconds < PACE_SECONDS:
            return
        pace, precision = seconds / max(particle_steps, 1), sequence.stage.scene.numerics.precision
        particles = particle_steps / steps
        self._steps[name] = cost.slower_than_nominal(name, pace, particles, self._threads, precision)
        self._words.append(_pace_words(name, pace))
        machine = Machine(dict(self._steps), words=_measured(self._words))
        self.seconds = predicted_cost(self._prepared, self._threads, machine)
        if self.seconds >= TELL_FROM:
            longest = predicted_cost(self._prepared, self._threads, machine, longest=True)
            log.info(prediction(Foreseen(self.seconds, longest, self._ahead.memory, machine.words, True)))

    def watching(self, sequence, watch):
        """`watch` that looks at the pace of the `sequence`, too."""

        def watching(now, end_time):
            self.look(sequence)
            watch(now, end_time)

        return watching


def prediction(ahead):
    """A line about a Foreseen."""
    return f"predicted: {need(ahead)}{ahead.how}{at_most(ahead)}"


def need(ahead):
    """Time and memory of a Foreseen in words."""
    return f"{duration(ahead.seconds)} and {ahead.memory / 1e9:.2g} GB"


def at_most(ahead):
    """How long a run takes if each stage lasts as long as it may, where that is longer."""
    longer = ahead.longest > LONGER * ahead.seconds
    return f"; up to {duration(ahead.longest)}, by when its stages end" if longer else ""


def duration(seconds):
    """A wall time in words."""
    if seconds < 100.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000.0 else f"{seconds / 3600:.1f} h"
