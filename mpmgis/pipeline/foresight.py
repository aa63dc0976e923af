"""What a run will take, told before it begins: by what it is, and above a moment by a trial on this machine."""

from itertools import pairwise
from time import perf_counter
from typing import NamedTuple

from ..errors import MpmgisError
from ..machine import available_memory
from ..solvers import cost
from ..solvers.pace import PACE_SECONDS, measured_pace
from ..solvers.stage_end import LOOK_SECONDS
from .rehearsal import handed_on, rehearse, some_of

TRIAL_FROM = 0.5  # [s], predicted for a typical machine, above which this one is tried
TRIAL_SHARE = 0.1  # of what is predicted that a trial of each solver takes, two seconds at most
TRIAL_POINTS = 30_000  # that columns are converted to for a trial of a later stage


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


def foreseen(prepared, threads, say=lambda text: None):
    """The Foreseen of a prepared run; tries this machine where the run takes more than a moment."""
    seconds, memory = predicted_cost(prepared, threads), predicted_memory(prepared)
    machine = TYPICAL
    tries = seconds > TRIAL_FROM and memory < cost.MEMORY_SHARE * available_memory()
    if tries:
        rehearse(prepared, say)
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
    how = f", at {' and '.join(words)} and step as measured" if words else ""
    return Machine(steps, beside, how)


def _try(stage, solver, seconds, threads, steps, words):
    """Add to `steps` and `words` what `solver`, which is worth nothing afterwards, shows of its stage's kind."""
    name = stage.scene.solver
    particles = solver.points if name == "points" else solver.columns
    pace = measured_pace(solver, seconds)
    if pace is not None:
        steps[name] = cost.slower_than_nominal(name, pace, particles, threads, stage.scene.numerics.precision)
        words.append(f"{1e9 * pace:.0f} ns a {name.removesuffix('s')}")


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
