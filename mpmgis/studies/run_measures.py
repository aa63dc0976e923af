"""Run the settings of a study: wall time, states on common cells, errors between runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..frames.particles import Frame
from ..maps.averaging import binning
from ..maps.averaging.cell_averages import bin_frame
from ..maps.averaging.placement import place

if TYPE_CHECKING:
    from ..maps.averaging.placement import Bed
    from ..simulation.numerical_parameters import Setting
    from ..terrain.grid import Grid

FOOTPRINT_SHARE = 0.01  # [1] of the largest thickness of the reference; thinner cells do not count as flow
UNITS = {"thickness": "1", "momentum": "1", "area": "1", "reach": "m"}
FAR_SHARE = 0.99  # [1] share of the mass within the reach


class Errors(NamedTuple):
    """Errors of a run against a reference; NaN if the reference has no value.

    Parameters
    ----------
    thickness : float [1]
        sum |h - h_ref| / sum h_ref, mean over the times.
    momentum : float [1]
        The same of h u, against its largest sum over the times.
    area : float [1]
        1 - IoU of all cells with flow.
    reach : float [m]
        Mean over the times.
    """

    thickness: float
    momentum: float
    area: float
    reach: float


NAMES = Errors._fields


def errors_of(states: Sequence, reference: Sequence) -> Errors:
    """Return the errors of a run against a reference.

    Parameters
    ----------
    states, reference : sequence of State
        At the same times.
    """
    pairs = list(zip(states, reference, strict=True))
    thickness = [_sum_of_differences(a.thickness, b.thickness) / max(b.thickness.sum(), 1e-300) for a, b in pairs]
    most = max(np.abs(b.momentum).sum() for b in reference)
    momentum = [_sum_of_differences(a.momentum, b.momentum) / max(most, 1e-300) for a, b in pairs]
    least = FOOTPRINT_SHARE * max(b.thickness.max() for b in reference)
    covered = [np.any([s.thickness > least for s in run], axis=0) for run in (states, reference)]
    area = 1.0 - np.count_nonzero(covered[0] & covered[1]) / max(np.count_nonzero(covered[0] | covered[1]), 1)
    reach = [abs(a.reach - b.reach) for a, b in pairs]
    return Errors(float(np.mean(thickness)), float(np.mean(momentum)), float(area), float(np.mean(reach)))


def errors_against_exact(states: Sequence, thickness: np.ndarray) -> Errors:
    """Return the errors of the last state of a run against an exact thickness.

    Parameters
    ----------
    states : sequence of State
    thickness : float64[rows, columns] [m]
        NaN cells are ignored.
    """
    known = np.isfinite(thickness)
    exact = np.where(known, thickness, 0.0)
    error = _sum_of_differences(np.where(known, states[-1].thickness, 0.0), exact) / max(exact.sum(), 1e-300)
    return Errors(float(error), np.nan, np.nan, np.nan)


def _sum_of_differences(first, second):
    return float(np.abs(first - second).sum())


class State(NamedTuple):
    """The flow at one time, on the cells of a study.

    Parameters
    ----------
    time : float [s]
    thickness : float64[rows, columns] [m]
        Vertical, volume over area.
    momentum : float64[rows, columns, 2] [m2 s-1]
        Thickness times horizontal velocity.
    reach : float [m]
        Horizontal distance from the release's centre with 99 % of the mass.
    """

    time: float
    thickness: np.ndarray
    momentum: np.ndarray
    reach: float


@dataclass(frozen=True)
class Outcome:
    """Result of one setting.

    Parameters
    ----------
    setting : Setting
    particles, steps, particle_steps : int
    seconds : tuple of float [s]
        Wall times of the time integration, one per repeat, without compilation.
    compile_seconds : float [s]
    predicted : float [s]
        Predicted run time.
    states : tuple of State
    mass_error : float [1]
    """

    setting: "Setting"
    particles: int
    steps: int
    particle_steps: int
    seconds: tuple
    compile_seconds: float
    predicted: float
    states: tuple
    mass_error: float

    @property
    def typical_seconds(self) -> float:
        """Median of the wall times [s]."""
        return float(np.median(self.seconds))


def outcomes(
    settings: Sequence,
    prepare: Callable,
    compile_kernels: Callable,
    begin: Callable,
    cells: "StudyCells",
    times: Sequence,
    repeats: int,
    predict: Callable,
    begun: Callable = lambda turn, number: None,
) -> list[Outcome]:
    """Run all `settings`, `repeats` times in turns; kernels are compiled before the first turn.

    Turns distribute other load of the machine over all settings. Every second turn is in reverse order, so that a
    slow drift of the machine affects all settings alike.

    Parameters
    ----------
    settings : sequence of Setting
    prepare : callable
        Setting -> a new prepared run at each call.
    compile_kernels : callable
        Compiles the kernels of a prepared run, or loads them from the disk cache.
    begin : callable
        prepared -> an iterator of its frames every `times[0]` to `times[-1]`, with `solver`, `steps`, `particle_steps`
        and `mass_error`.
    cells : StudyCells
    times : float[k] [s]
        Ascending, the last the end.
    predict : callable
        Setting -> seconds.
    begun : callable
        Called with (turn, number of the setting) before each run, both from 0.

    Returns
    -------
    list of Outcome
    """
    found = [_before_first_run(setting, prepare, compile_kernels, predict) for setting in settings]
    for turn in range(repeats):
        order = range(len(found))
        for number in order if turn % 2 == 0 else reversed(order):
            begun(turn, number)
            flow = begin(prepare(settings[number]))
            spent, states = _integrated(flow, cells, times)
            known = found[number]
            found[number] = replace(
                known,
                steps=flow.steps,
                particle_steps=flow.particle_steps,
                seconds=(*known.seconds, spent),
                states=known.states or states,
                mass_error=float(flow.mass_error),
            )
    return found


def _before_first_run(setting, prepare, compile_kernels, predict):
    """Return the Outcome of a setting before its first run."""
    prepared = prepare(setting)
    began = perf_counter()
    compile_kernels(prepared)
    return Outcome(setting, prepared.particles, 0, 0, (), perf_counter() - began, predict(setting), (), 0.0)


def _integrated(flow, cells, times):
    """Return the wall time of the integration [s] and States at `times`; a run that ends early keeps its last state."""
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
    """The common cells of a comparison.

    Parameters
    ----------
    grid : Grid
        North-up.
    bed : Bed
    density : float [kg m-3]
    start : (float, float) [m]
        E, N of the release's centre of mass.
    spread : bool
        True: columns are spread with B-splines, as in maps. False: each fills the square of its area.
    """

    grid: "Grid"
    bed: "Bed"
    density: float
    start: tuple
    spread: bool = False

    def state_of(self, frame: Frame) -> State:
        """Return the flow of a frame on these cells.

        Parameters
        ----------
        frame : Frame
            Of columns or points.
        """
        cells = bin_frame(frame, place(frame, self.bed), self.bed, self.grid, self.density, spread=self.spread)
        per_area = 1.0 / (self.density * cells.cell_area)
        thickness = np.zeros(self.grid.shape[0] * self.grid.shape[1])
        momentum = np.zeros((thickness.size, 2))
        thickness[cells.index] = cells.sums[:, binning.MASS] * per_area
        momentum[cells.index] = cells.sums[:, binning.MOMENTUM : binning.MOMENTUM + 2] * per_area
        shape = self.grid.shape
        return State(frame.time, thickness.reshape(shape), momentum.reshape(*shape, 2), self._reach(frame))

    def _reach(self, frame):
        x, y = frame.map_xy()
        distance = np.hypot(x - self.start[0], y - self.start[1])
        order = np.argsort(distance, kind="stable")
        heap = np.cumsum(frame.particles.mass[order])
        return float(distance[order[min(np.searchsorted(heap, FAR_SHARE * heap[-1]), len(heap) - 1)]])
