"""Try a run on larger cells: when its stages end, and how its work is distributed over the simulated time.

On cells k times as large a run has k times fewer steps, and k^2 times fewer columns or k^3 times fewer points. With a
thousand particles it takes a moment, and comes to rest, or reaches what ends a stage, at nearly the same time.
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

if TYPE_CHECKING:
    from .preparation import Prepared

PARTICLES = 1000  # of a trial, approximately
SECONDS = 1.0  # [s] wall time after which a trial is broken off; what is missing goes on at its mean pace
FEWEST_PARTS, MOST_PARTS = 40, 200  # into which the time of a trial is divided


class StageWork(NamedTuple):
    """Work of a stage over its time; both ascend from 0.

    Parameters
    ----------
    time : float64[m] [s]
        Simulated, since the start of the stage.
    work : float64[m] [s]
        Wall time of the steps until then, on one thread.
    """

    time: np.ndarray
    work: np.ndarray


class Trial(NamedTuple):
    """Work of all stages of a run.

    Parameters
    ----------
    stages : tuple of StageWork
    """

    stages: tuple

    @property
    def work(self) -> float:
        """Work of the whole run [s]."""
        return float(sum(stage.work[-1] for stage in self.stages))

    def done(self, number: int, since: float) -> float:
        """Return the work until a moment of a stage.

        Parameters
        ----------
        number : int
            Of the stage, from 0.
        since : float [s]
            Simulated time since its start.

        Returns
        -------
        float [s]
        """
        before = sum(stage.work[-1] for stage in self.stages[:number])
        return float(before + np.interp(since, *self.stages[number]))

    def time_left(self, number: int, since: float) -> float:
        """Return the simulated time from a moment of a stage to the end of the run.

        Parameters
        ----------
        number : int
            Of the stage, from 0.
        since : float [s]
            Simulated time since its start.

        Returns
        -------
        float [s]
        """
        later = sum(stage.time[-1] for stage in self.stages[number + 1 :])
        return float(self.stages[number].time[-1] - since + later)


class _Broken(Exception):
    """A trial has taken SECONDS."""


@muted()
def tried(prepared: "Prepared", factor: float | None = None, clock: Callable[[], float] = perf_counter) -> Trial | None:
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
    Trial or None
        None where the scene cannot run on such cells.
    """
    numbers, threads = range(len(prepared.stages)), threads_in_use()
    factor = factor or 2.0 ** max(1, round(np.log2(max(_fewer(prepared, number) for number in numbers))))
    try:
        set_threads(1)  # more are slower for so few particles
        larger = on_larger_cells(prepared, factor)
        output = larger.scene.output
        interval = np.clip(output.frame_interval, output.end_time / MOST_PARTS, output.end_time / FEWEST_PARTS)
        output = replace(output, frame_interval=float(interval))
        rows, begins = _recorded(replace(larger, scene=replace(larger.scene, output=output)), clock)
    except MpmgisError:
        return None
    finally:
        set_threads(threads)
    stages = []
    for number in numbers:
        time, steps, seconds = np.array([(0.0, 0.0, 0.0), *(row[1:] for row in rows if row[0] == number)]).T
        time[1:] -= begins[min(number, len(begins) - 1)]
        more = factor * prepared.particles_of(number) / max(larger.particles_of(number), 1)
        work = more * seconds[-1] * steps / max(steps[-1], 1.0)
        stages.append(StageWork(np.maximum.accumulate(time), np.maximum.accumulate(work)))
    return Trial(tuple(stages))


def _fewer(prepared, number):
    """Return the size of cells, over that of a stage, that leaves PARTICLES in it."""
    power = 3 if prepared.stages[number].scene.solver == "points" else 2
    return (prepared.particles_of(number) / PARTICLES) ** (1.0 / power)


def _recorded(prepared, clock):
    """Return rows (stage, time [s], steps, wall time of the steps [s]) of a run, and the starts of its stages [s]."""
    rows, began, end = [], clock(), prepared.scene.output.end_time

    def look(solver, end_time):
        rows.append((sequence.number, solver.time, solver.step, sequence.stepped[0]))
        if clock() - began > SECONDS:
            raise _Broken

    sequence = StageSequence(prepared, look)
    with suppress(_Broken):
        for _ in sequence:
            pass
    begins = [0.0, *(stage["time"] for stage in sequence.past)]
    if not sequence.reason:
        number, time, steps, seconds = rows[-1]
        longer = (end - begins[-1]) / max(time - begins[-1], 1e-300)
        rows.append((number, end, steps * longer, seconds * longer))
    return rows, begins
