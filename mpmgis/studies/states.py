"""One run of a study: how long its steps take, and what the flow is at some times, on cells that all runs share."""

from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from ..kernels import binning
from ..products.bed import place
from ..products.cells import bin_frame

FAR_SHARE = 0.99  # of the mass, which lies nearer to where it started than the reach


class State(NamedTuple):
    """The flow at one time, on the study's cells.

    thickness float64[rows, columns] [m], vertical, volume over area; momentum float64[rows, columns, 2] [m2 s-1],
    thickness times horizontal velocity; reach [m]: 99 % of the mass lie nearer to the release's centre on the map.
    """

    time: float
    thickness: np.ndarray
    momentum: np.ndarray
    reach: float


@dataclass(frozen=True)
class Outcome:
    """What one setting came to.

    Parameters
    ----------
    setting : Setting
    particles, steps, particle_steps : int
    seconds : tuple of float [s]
        Wall time of the loop over steps, each time that it was run; compiling is `compile_seconds` [s].
    predicted : float [s]
        What a run of it was predicted to take.
    states : tuple of State
    mass_error : float [1]
    """

    setting: object
    particles: int
    steps: int
    particle_steps: int
    seconds: tuple
    compile_seconds: float
    predicted: float
    states: tuple
    mass_error: float

    @property
    def typical_seconds(self):
        """Median of the wall times [s]."""
        return float(np.median(self.seconds))


def outcomes(settings, prepare, rehearse, begin, cells, times, repeats, predict, say=lambda turn, number: None):
    """Run all `settings` in turns, `repeats` of them, each rehearsed before so that compiling is apart.

    What the machine does beside slows whole turns and no setting more than another; every second turn goes backwards,
    so that a machine that gets slower and slower does not either.

    Parameters
    ----------
    settings : sequence of Setting
    prepare : callable
        Setting -> a prepared run, anew at each call.
    rehearse : callable
        Compiles, or loads from the disk cache, what a prepared run needs.
    begin : callable
        prepared -> an iterator of its frames every `times[0]` to `times[-1]`, with `solver`, `steps`, `particle_steps`
        and `mass_error`.
    cells : StudyCells
    times : float[k] [s]
        Ascending, the last the end.
    predict : callable
        prepared -> seconds.
    say : callable
        Told (turn, number of the setting) before each run, both from 0.

    Returns
    -------
    list of Outcome
    """
    found = [_rehearsed(setting, prepare, rehearse, predict) for setting in settings]
    for turn in range(repeats):
        order = range(len(found))
        for number in order if turn % 2 == 0 else reversed(order):
            say(turn, number)
            flow = begin(prepare(settings[number]))
            spent, states = _marched(flow, cells, times)
            known = found[number]
            found[number] = replace(
                known, steps=flow.steps, particle_steps=flow.particle_steps, seconds=(*known.seconds, spent),
                states=known.states or states, mass_error=float(flow.mass_error),
            )  # fmt: skip
    return found


def _rehearsed(setting, prepare, rehearse, predict):
    """The Outcome of a setting before its first run."""
    prepared = prepare(setting)
    began = perf_counter()
    rehearse(prepared)
    return Outcome(setting, prepared.particles, 0, 0, (), perf_counter() - began, predict(prepared), (), 0.0)


def _marched(flow, cells, times):
    """(wall time of the march, States at `times`); a flow that stops before stays as it is."""
    frames, taken, spent, last = iter(flow), [], 0.0, None
    while True:
        began = perf_counter()
        frame = next(frames, None)
        spent += perf_counter() - began
        if frame is None:
            break
        last = cells.state_of(frame)
        if len(taken) < len(times) and frame.time >= times[len(taken)] * (1.0 - 1e-9):
            taken.append(last)
    taken += [last._replace(time=time) for time in times[len(taken) :]]
    return spent, tuple(taken)


@dataclass(frozen=True)
class StudyCells:
    """The cells that flows are compared on.

    Parameters
    ----------
    grid : Grid
        North-up.
    bed : Bed
    density : float [kg m-3]
    start : (float, float) [m]
        E, N of the release's centre of mass.
    spread : bool
        Columns are spread as their solver does it, as in maps; else each fills the square of its area.
    """

    grid: object
    bed: object
    density: float
    start: tuple
    spread: bool = False

    def state_of(self, frame):
        """The State of a Frame of columns or points."""
        cells = bin_frame(frame, place(frame, self.bed), self.bed, self.grid, self.density, spread=self.spread)
        per_area = 1.0 / (self.density * cells.cell_area)
        thickness = np.zeros(self.grid.shape[0] * self.grid.shape[1])
        momentum = np.zeros((thickness.size, 2))
        thickness[cells.index] = cells.sums[:, binning.MASS] * per_area
        momentum[cells.index] = cells.sums[:, binning.MOMENTUM : binning.MOMENTUM + 2] * per_area
        return State(frame.time, thickness.reshape(self.grid.shape), momentum.reshape(*self.grid.shape, 2),
                     self._reach(frame))  # fmt: skip

    def _reach(self, frame):
        x, y = frame.map_xy()
        distance = np.hypot(x - self.start[0], y - self.start[1])
        order = np.argsort(distance, kind="stable")
        heap = np.cumsum(frame.particles.mass[order])
        return float(distance[order[min(np.searchsorted(heap, FAR_SHARE * heap[-1]), len(heap) - 1)]])


def centre_of(frame):
    """(E, N) [m] of a frame's centre of mass."""
    x, y = frame.map_xy()
    mass = frame.particles.mass
    return float(np.average(x, weights=mass)), float(np.average(y, weights=mass))
