"""Largest values over all frames (Vicari et al. 2025, Eq 16). They do not depend on the order of the frames.

Where the solver kept peaks of every step, a cell takes the larger of those and of the frames': both are values that the
flow had, peaks between frames as well, frames also before the first step and at rims, where a node sees less than a
column is thick. So no step ever shows more than the maxima.
"""

from typing import NamedTuple

import numpy as np


class Peak(NamedTuple):
    """A maxima band: of which product, and whether the `larger` or the smaller value stays."""

    product: str
    larger: bool


PEAKS = {
    "h_max": Peak("h", True),
    "t_max": Peak("t", True),
    "Un_max": Peak("Un", True),
    "Un_min": Peak("Un", False),
    "Ut_max": Peak("Ut", True),
    "p_max": Peak("p", True),
}
ARRIVAL = "t_arrival"
MAXIMA_BANDS = (*PEAKS, ARRIVAL)
RUNNING_BANDS = ("h_max", "t_max", "Un_max", "Ut_max")  # in every step, where `--products maxima` asks for them
PRODUCTS_NEEDED = tuple(dict.fromkeys(peak.product for peak in PEAKS.values()))

ARRIVAL_THICKNESS = 0.05  # [m] of the solver, where its frames do not say another
THINNEST = 1e-3  # [m] no flow, where --min-depth is 0


def least_depth(min_depth, arrival_thickness=ARRIVAL_THICKNESS):
    """Depth [m] from which a field of columns is flow; below it is the tail of their splines."""
    return min(min_depth, arrival_thickness) or THINNEST


class RunningMaxima:
    """The largest (or smallest) value that every cell of a grid has seen.

    Stored in float32, as in the file: rounding keeps order, so this is the rounded maximum. Pages of cells that the
    flow never meets stay untouched, so that memory follows the flow.

    Parameters
    ----------
    cells : int
        Number of cells of the grid.
    min_depth : float [m]
        Depth at which the flow counts as arrived.
    peaks : dict of str to Peak
    """

    def __init__(self, cells, min_depth, peaks=PEAKS):
        self.peaks, self.min_depth = dict(peaks), np.float32(min_depth)
        names = (*self.peaks, ARRIVAL)
        self.values = {name: np.zeros(cells, np.float32) for name in names}
        self.seen = {name: np.zeros(cells, bool) for name in names}

    def absorb(self, index, values, time, least=0.0):
        """Take in one frame.

        Parameters
        ----------
        index : int64[k]
            Its cells.
        values : dict of str to float[k]
            By product.
        time : float [s]
        least : float [m]
            Cells with a smaller `h` hold no flow (`least_depth`); 0 for particles that have no tails.
        """
        if least > 0.0:
            flow = ~(np.asarray(values["h"]) < least)
            index, values = index[flow], {name: value[flow] for name, value in values.items()}
        for name, peak in self.peaks.items():
            self._keep(name, index, values[peak.product], np.maximum if peak.larger else np.minimum)
        arrived = np.where(np.asarray(values["h"], np.float32) >= self.min_depth, time, np.nan)
        self._keep(ARRIVAL, index, arrived, np.minimum)

    def absorb_peaks(self, index, values):
        """Take in what the solver kept of every step: `index` and `values` as `SolverPeaks.on` yields them."""
        for name, peak in self.peaks.items():
            if peak.larger and peak.product in values:
                self._keep(name, index, values[peak.product], np.maximum)
        if ARRIVAL in values:
            self._keep(ARRIVAL, index, values[ARRIVAL], np.minimum)

    def _keep(self, name, index, new, better):
        new = np.asarray(new, np.float32)
        there = ~np.isnan(new)
        index, new = index[there], new[there]
        store, seen = self.values[name], self.seen[name]
        store[index] = np.where(seen[index], better(store[index], new), new)
        seen[index] = True

    def rows(self, name, first, last, columns):
        """float32[last - first, columns]: raster rows of band `name`, NaN where the flow never was."""
        part = slice(first * columns, last * columns)
        return np.where(self.seen[name][part], self.values[name][part], np.float32(np.nan)).reshape(-1, columns)

    def at(self, name, index):
        """float32[k]: band `name` in the cells `index`, NaN where the flow never was."""
        return np.where(self.seen[name][index], self.values[name][index], np.float32(np.nan))

    def largest(self, name):
        """Largest absolute value of band `name`; 0 where the flow never was anywhere."""
        return float(np.abs(self.values[name]).max(initial=0.0))
