"""Try a run on larger cells: when its stages end, and how its work is distributed over the simulated time.

On cells k times as large a run has k times fewer steps, and k^2 times fewer columns or k^3 times fewer points. With few
particles it takes a moment, and comes to rest, or reaches what ends a stage, at nearly the same time.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..compiled.jit import set_threads, threads_in_use
from ..system.errors import MpmgisError
from ..system.messages import muted
from .preparation import on_larger_cells
from .stage_sequence import StageSequence
from .warmup import middle_of, sample_of, switched_sample

if TYPE_CHECKING:
    from ..solvers.columns.column_solver import ColumnSolver
    from ..solvers.points.point_solver import PointSolver
    from .preparation import Prepared

PARTICLES = {"columns": 1000, "points": 4000}  # of a trial, approximately
POWER = {"columns": 2, "points": 3}  # of the size of cells, to which the number of particles is proportional
SECONDS = 1.0  # [s] wall time after which a trial is broken off; it goes on as in its second half
SAMPLE = 10_000  # particles of the run whose steps are timed
SAMPLE_SECONDS = 0.1  # [s] wall time of these steps
COMPILED_STEPS = 2  # before them
FEWEST_PARTS, MOST_PARTS = 40, 100  # into which the time of a trial is divided


class StageWork(NamedTuple):
    """Work of a stage over its time.

    Parameters
    ----------
    time : float64[m] [s]
        Simulated, since the start of the stage, ascending from 0.
    work : float64[m]
        Particles of the run, summed over its steps until then; ascending from 0.
    pace : float [s]
        Wall time of a step for each particle; NaN where it is unknown.
    """

    time: np.ndarray
    work: np.ndarray
    pace: float = np.nan

    def done(self, since: float) -> float:
        """Return the work until a moment.

        Parameters
        ----------
        since : float [s]
            Simulated time since the start of the stage.
        """
        return float(np.interp(since, self.time, self.work))

    @property
    def seconds(self) -> float:
        """Wall time of all steps [s]."""
        return float(self.pace * self.work[-1])


class _Broken(Exception):
    """A trial has taken SECONDS."""


@muted()
def tried(
    prepared: "Prepared", factor: float | None = None, clock: Callable[[], float] = perf_counter
) -> tuple[StageWork, ...]:
    """Run a scene on larger cells. Its kernels must be compiled; `prepared` is not changed.

    Parameters
    ----------
    prepared : Prepared
    factor : float, optional [1]
        Size of the cells over that of the run. Default: a power of two, so that walls at the edges stay where they are.
    clock : callable
        Returns the wall time [s].

    Returns
    -------
    tuple of StageWork
        Of each stage, with the pace of all but the first; empty where the scene cannot run on such cells.
    """
    numbers, threads = range(len(prepared.stages)), threads_in_use()
    factor = factor or 2.0 ** max(1, round(np.log2(min(_fewer(prepared, number) for number in numbers))))
    try:
        set_threads(1)  # more are slower for so few particles
        larger = on_larger_cells(prepared, factor)
        output = larger.scene.output
        interval = np.clip(factor * output.frame_interval, output.end_time / MOST_PARTS, output.end_time / FEWEST_PARTS)
        output = replace(output, frame_interval=float(interval))
        rows, begins, frames = _recorded(replace(larger, scene=replace(larger.scene, output=output)), clock)
    except MpmgisError:
        return ()
    finally:
        set_threads(threads)
    stages = []
    for number in numbers:
        time, work = np.array([(0.0, 0.0), *(row[1:] for row in rows if row[0] == number)]).T
        time[1:] -= begins[min(number, len(begins) - 1)]
        more = factor ** POWER[prepared.stages[number].scene.solver]
        if not number:
            more = prepared.particles / max(larger.particles, 1)
        pace = _pace_after_switch(prepared, larger, number, frames.get(number - 1), clock)
        stages.append(StageWork(np.maximum.accumulate(time), factor * more * np.maximum.accumulate(work), pace))
    return tuple(stages)


def _fewer(prepared, number):
    """Return the size of cells, over that of a stage, that leaves PARTICLES in it."""
    solver = prepared.stages[number].scene.solver
    return (prepared.particles_of(number) / PARTICLES[solver]) ** (1.0 / POWER[solver])


def _recorded(prepared, clock):
    """Return rows (stage, time [s], particle-steps) of a run, the starts of its stages [s], the last frame of each."""
    rows, frames, began, end = [], {}, clock(), prepared.scene.output.end_time

    def look(solver, end_time):
        rows.append((sequence.number, solver.time, sequence.stepped[1]))
        if clock() - began > SECONDS:
            raise _Broken

    sequence = StageSequence(prepared, look)
    with suppress(_Broken):
        for frame in sequence:
            frames[sequence.number] = frame
    begins = [0.0, *(stage["time"] for stage in sequence.past)]
    if not sequence.reason:
        number, time, work = rows[-1]
        own = [row[1:] for row in rows if row[0] == number]
        half, before = own[len(own) // 2 - 1] if len(own) > 1 else (begins[-1], 0.0)
        rows.append((number, end, work + (work - before) * (end - time) / max(time - half, 1e-300)))
    return rows, begins, frames


def first_pace(prepared: "Prepared", clock: Callable[[], float] = perf_counter) -> float:
    """Measure the wall time of a step of the first stage for each particle, with a part of them.

    Parameters
    ----------
    prepared : Prepared
    clock : callable
        Returns the wall time [s].

    Returns
    -------
    float [s]
        NaN where nothing moves.
    """
    return _pace(prepared.stages[0].solver(prepared.terrain, *sample_of(prepared, SAMPLE)), clock)


def _pace_after_switch(prepared, larger, number, frame, clock):
    """Return the pace of stage `number` of the run, from the last `frame` before it in the trial; NaN if unknown."""
    if not number or frame is None or larger.stages[number - 1].has_columns_outside:
        return np.nan
    stage, before = prepared.stages[number], larger.stages[number - 1]
    if stage.scene.solver == "points":
        each = stage.point_options().predicted_points(frame.particles) / len(frame.particles)
        frame = middle_of(frame, max(1, int(SAMPLE / max(each, 1.0))))
    try:
        switched = switched_sample(stage, before, replace(frame, maxima={}), prepared.terrain)
    except MpmgisError:
        return np.nan
    return _pace(stage.solver(prepared.terrain, switched.frame, switched.vertical_stress, switched.gradient), clock)


def _pace(solver: "ColumnSolver | PointSolver", clock: Callable[[], float]) -> float:
    """Return the wall time [s] of a step of `solver` for each particle; NaN where nothing moves."""
    solver.advance(np.inf, max_steps=COMPILED_STEPS)
    work, began, spent = 0, clock(), 0.0
    while spent < SAMPLE_SECONDS:
        step = solver.step
        solver.advance(np.inf, max_steps=8)
        if solver.step == step:
            break
        work += (solver.step - step) * len(solver.flow())
        spent = clock() - began
    return spent / work if work else np.nan
