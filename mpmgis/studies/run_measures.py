"""Runs of a study: wall time, states on common cells, errors between runs, cost of an export (Eqs 15-17)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from ..frames.particles import Frame
from ..maps.averaging import binning
from ..maps.averaging.cells import bin_frame
from ..maps.averaging.frame_values import Averaging, average_frame
from ..maps.averaging.maxima import PRODUCTS_NEEDED, RunningMaxima
from ..maps.averaging.placement import place
from ..terrain.grid import Grid

FOOTPRINT_SHARE = 0.01  # of the largest thickness of the reference; thinner cells are not flow
UNITS = {"thickness": "1", "momentum": "1", "area": "1", "reach": "m"}
FAR_SHARE = 0.99  # share of the mass within the reach
CELL_FACTORS = (1, 2, 4, 8)  # times the smallest cell size
STEP_FACTORS = (1, 2, 4, 8)  # times the frame interval
LOSSES = ("h_max", "Ut_max")


class Errors(NamedTuple):
    """Errors of a run against a reference; NaN if the reference has no value.

    thickness [1]: sum |h - h_ref| / sum h_ref, mean over the times. momentum [1]: the same of h u, against its largest
    sum over the times. area [1]: 1 - IoU of all cells with flow. reach [m]: mean over the times.
    """

    thickness: float
    momentum: float
    area: float
    reach: float


NAMES = Errors._fields


def errors_of(states: Sequence, reference: Sequence) -> Errors:
    """Errors of `states` against the `reference`, two sequences of State at the same times."""
    pairs = list(zip(states, reference, strict=True))
    thickness = [_apart(a.thickness, b.thickness) / max(b.thickness.sum(), 1e-300) for a, b in pairs]
    most = max(np.abs(b.momentum).sum() for b in reference)
    momentum = [_apart(a.momentum, b.momentum) / max(most, 1e-300) for a, b in pairs]
    least = FOOTPRINT_SHARE * max(b.thickness.max() for b in reference)
    covered = [np.any([s.thickness > least for s in run], axis=0) for run in (states, reference)]
    area = 1.0 - np.count_nonzero(covered[0] & covered[1]) / max(np.count_nonzero(covered[0] | covered[1]), 1)
    reach = [abs(a.reach - b.reach) for a, b in pairs]
    return Errors(float(np.mean(thickness)), float(np.mean(momentum)), float(area), float(np.mean(reach)))


def errors_against_exact(states: Sequence, thickness: np.ndarray) -> Errors:
    """Errors of the last of `states` against an exact `thickness` float64[rows, columns] [m]; NaN cells are ignored."""
    known = np.isfinite(thickness)
    exact = np.where(known, thickness, 0.0)
    error = _apart(np.where(known, states[-1].thickness, 0.0), exact) / max(exact.sum(), 1e-300)
    return Errors(float(error), np.nan, np.nan, np.nan)


def _apart(first, second):
    return float(np.abs(first - second).sum())


class State(NamedTuple):
    """The flow at one time, on the study's cells.

    thickness float64[rows, columns] [m], vertical, volume over area; momentum float64[rows, columns, 2] [m2 s-1],
    thickness times horizontal velocity; reach [m]: horizontal distance from the release's centre with 99 % of the mass.
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
        Wall times of the time integration, one per repeat; compilation is in `compile_seconds` [s].
    predicted : float [s]
        Predicted run time.
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
        prepared -> seconds.
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
    """The Outcome of a setting before its first run."""
    prepared = prepare(setting)
    began = perf_counter()
    compile_kernels(prepared)
    return Outcome(setting, prepared.particles, 0, 0, (), perf_counter() - began, predict(prepared), (), 0.0)


def _integrated(flow, cells, times):
    """(wall time of the time integration [s], States at `times`); a run that ends early keeps its last state."""
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

    grid: object
    bed: object
    density: float
    start: tuple
    spread: bool = False

    def state_of(self, frame: Frame) -> State:
        """The State of a Frame of columns or points."""
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


def centre_of(frame: Frame) -> tuple[float, float]:
    """(E, N) [m] of a frame's centre of mass."""
    x, y = frame.map_xy()
    mass = frame.particles.mass
    return float(np.average(x, weights=mass)), float(np.average(y, weights=mass))


class ExportSetting(NamedTuple):
    """One pair of --cs-e [m] and --dt-e [s]: number of averaged frames, averaging time [s] without writing files.

    h_max, Ut_max: difference of these maxima from those of the finest pair, sum |a - b| / sum b [1].
    """

    cs_e: float
    dt_e: float
    frames: int
    seconds: float
    h_max: float
    Ut_max: float


class ExportSweep:
    """Averages the frames of one run on grids of several cell sizes.

    Parameters
    ----------
    bed : Bed
    bounds : (west, south, east, north) [m]
    crs : pyproj.CRS or None
    finest : float [m]
        Smallest cell size.
    interval : float [s]
        Frame interval.
    density : float [kg m-3]
    min_depth : float [m]
        Velocities of shallower flow are ignored.
    """

    def __init__(self, bed, bounds, crs, finest, interval, density, min_depth=0.05):
        west, south, east, north = bounds
        self.interval, self.count = interval, 0
        rows, columns = (_multiple(span / finest, CELL_FACTORS[-1]) for span in (north - south, east - west))
        self.averagings = {
            factor: Averaging(
                bed,
                Grid.north_up(crs, west, north, factor * finest, (rows // factor, columns // factor)),
                density,
                PRODUCTS_NEEDED,
                min_depth=min_depth,
            )
            for factor in CELL_FACTORS
        }
        self.seconds = {(cell, step): 0.0 for cell in CELL_FACTORS for step in STEP_FACTORS}
        self.frames = dict.fromkeys(self.seconds, 0)
        self.maxima = {
            (cell, step): RunningMaxima(math.prod(self.averagings[cell].grid.shape), min_depth)
            for cell, step in self.seconds
        }

    def take(self, frame: Frame) -> None:
        """Average a frame; frames are in order, `interval` apart."""
        for cell, averaging in self.averagings.items():
            steps = [step for step in STEP_FACTORS if self.count % step == 0]
            began = perf_counter()
            values = average_frame(frame, averaging)
            spent = perf_counter() - began
            for step in steps:
                began = perf_counter()
                self.maxima[cell, step].absorb(values.index, values.values, frame.time, values.least)
                self.seconds[cell, step] += spent + perf_counter() - began
                self.frames[cell, step] += 1
        self.count += 1

    def settings(self) -> list[ExportSetting]:
        """ExportSettings, from the finest pair to the coarsest."""
        finest = {name: self._on_finest(name, CELL_FACTORS[0], STEP_FACTORS[0]) for name in LOSSES}
        return [
            ExportSetting(
                self.averagings[cell].grid.cell_size,
                step * self.interval,
                self.frames[cell, step],
                self.seconds[cell, step],
                *(_export_difference(self._on_finest(name, cell, step), finest[name]) for name in LOSSES),
            )
            for cell in CELL_FACTORS
            for step in STEP_FACTORS
        ]

    def _on_finest(self, name, cell, step):
        """float64[rows, columns] of a maximum on the smallest cells, 0 without flow."""
        found = self.maxima[cell, step]
        values = np.where(found.seen[name], found.values[name], 0.0).reshape(self.averagings[cell].grid.shape)
        return np.kron(values, np.ones((cell, cell)))


def _multiple(count, of):
    """`count` rounded up to a multiple of `of`."""
    return math.ceil(math.ceil(round(count, 6)) / of) * of


def _export_difference(values, reference):
    return float(np.abs(values - reference).sum() / max(np.abs(reference).sum(), 1e-300))
