"""Measure cost and accuracy of an export over its cell size and frame interval (Eqs 15-17)."""

import math
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..frames.particles import Frame
from ..maps.averaging.frame_values import Averaging, average_frame
from ..maps.averaging.maxima import PRODUCTS_NEEDED, RunningMaxima
from ..terrain.grid import Grid

if TYPE_CHECKING:
    import pyproj

    from ..maps.averaging.cell_averages import Bed

CELL_FACTORS = (1, 2, 4, 8)  # times the smallest cell size
STEP_FACTORS = (1, 2, 4, 8)  # times the frame interval
LOSSES = ("h_max", "Ut_max")


class ExportSetting(NamedTuple):
    """One pair of cell size and interval of an export, with its cost and accuracy.

    Parameters
    ----------
    cs_e : float [m]
        Cell size, option --cs-e.
    dt_e : float [s]
        Interval, option --dt-e.
    frames : int
        Number of averaged frames.
    seconds : float [s]
        Wall time of averaging, without writing files.
    h_max, Ut_max : float [1]
        Difference of these maxima from those of the finest pair, sum |a - b| / sum b.
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

    def __init__(
        self,
        bed: "Bed",
        bounds: tuple,
        crs: "pyproj.CRS | None",
        finest: float,
        interval: float,
        density: float,
        min_depth: float = 0.05,
    ) -> None:
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
        """Average a frame; frames come in order, `interval` apart.

        Parameters
        ----------
        frame : Frame
        """
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
        """Return the ExportSettings, from the finest pair to the coarsest."""
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
        """Return a maximum on the smallest cells, float64[rows, columns], 0 without flow."""
        found = self.maxima[cell, step]
        values = np.where(found.seen[name], found.values[name], 0.0).reshape(self.averagings[cell].grid.shape)
        return np.kron(values, np.ones((cell, cell)))


def _multiple(count, of):
    """Return `count` rounded up to a multiple of `of`."""
    return math.ceil(math.ceil(round(count, 6)) / of) * of


def _export_difference(values, reference):
    return float(np.abs(values - reference).sum() / max(np.abs(reference).sum(), 1e-300))
