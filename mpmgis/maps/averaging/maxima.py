"""Compute the largest values over all frames (Eq 16), and the solver's peaks, on the cells of an export.

If the solver recorded peaks of every step, a cell takes the larger of these and of the frames. Solver peaks include
times between frames. Frames include the state before the first step, and edges, where a node has less than the column
thickness. So no frame exceeds the maxima.

The solver's thickness is vertical, that of the bands is normal to the bed: it is multiplied by the cosine of the slope
of the DTM pixel. The solver's speed is |U|: along the ground in form `slope` (as `Ut`), horizontal in form `swe`
(at most `Ut`, nearly equal on the beds of rivers and lakes). Speed, pressure and arrival are of flow that is at least
`arrival_thickness` deep at the node. They are used only if `min_depth` is the same number, because a band has one
threshold.

Peaks are bilinear between nodes, and are integrated over cells like the columns of a frame (`column_field`): `h` and
`t` are the largest mean over parts of the cell not wider than the node spacing, or a crest in the cell; `t_vol` is the
mean over the cell; `Ut` is the mean weighted by thickness; `p` is from the mean speed; arrival is the mean over the
reached part.

Where the depth never reached the smaller of `min_depth` and the arrival thickness, a peak is only the tail of the
solver's splines, and the cell has no value.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy  # submodules are loaded on first use

from ...compiled.jit import jit
from ...frames.peaks import PEAK_NAMES, TRANSFORM, lattices_of
from ...terrain.grid import Grid
from .column_field import Lattice, nodes_to_cells
from .placement import Bed

ARRIVAL = "t_arrival"  # band
RUNNING_BANDS = ("h_max", "t_max", "Un_max", "Ut_max")  # also in every step with `--products maxima`
ARRIVAL_THICKNESS = 0.05  # [m] of the solver, unless its frames give another
THINNEST = 1e-3  # [m] smallest depth of flow where `min_depth` is 0
BANDS = ("h_max", "t_max", "Ut_max", "p_max", ARRIVAL)  # columns have no velocity normal to the bed
WITHOUT_THRESHOLD = BANDS[:2]
STRIP_CELLS = 1_000_000  # [cells] of one strip: limits memory on large rasters

# Sums of a node; each is multiplied by the ground area [m2] of the node.
THICKNESS = 0  # [m]
WEIGHT = 1  # [m] thickness where flow has arrived: the weight of the next two
MOVED = 2  # [m2 s-1] weight times speed
PRESSED = 3  # [m Pa1/2] weight times the square root of pressure
ARRIVED = 4  # [1] 1 where flow has arrived
ARRIVED_AT = 5  # [s] time of arrival


class Peak(NamedTuple):
    """A maxima band.

    Parameters
    ----------
    product : str
    larger : bool
        True: the largest value is kept; False: the smallest one.
    """

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
MAXIMA_BANDS = (*PEAKS, ARRIVAL)
PRODUCTS_NEEDED = tuple(dict.fromkeys(peak.product for peak in PEAKS.values()))


def least_depth(min_depth: float, arrival_thickness: float = ARRIVAL_THICKNESS) -> float:
    """Return the smallest depth [m] of flow in a field of columns; smaller values are the tail of their splines.

    Parameters
    ----------
    min_depth : float [m]
    arrival_thickness : float [m]
        Of the solver.
    """
    return min(min_depth, arrival_thickness) or THINNEST


class RunningMaxima:
    """Largest (or smallest) value of every cell of a grid over the frames so far.

    Stored in float32, as in the file: rounding keeps order, so this is the rounded maximum. Memory pages of cells
    without flow stay untouched, so memory follows the extent of the flow.

    Parameters
    ----------
    cells : int
        Number of cells of the grid.
    min_depth : float [m]
        Depth that defines arrival.
    peaks : dict of str to Peak
        By band.
    """

    def __init__(self, cells: int, min_depth: float, peaks: dict = PEAKS):
        self.peaks, self.min_depth = dict(peaks), np.float32(min_depth)
        names = (*self.peaks, ARRIVAL)
        self.values = {name: np.zeros(cells, np.float32) for name in names}
        self.seen = {name: np.zeros(cells, bool) for name in names}

    def absorb(self, index: np.ndarray, values: dict, time: float, least: float = 0.0) -> None:
        """Add one frame.

        Parameters
        ----------
        index : int64[k]
            Flat numbers of its cells.
        values : dict of str to float[k]
            By product.
        time : float [s]
        least : float [m]
            Cells with a smaller `h` have no flow (`least_depth`); 0 for particles without splines.
        """
        if least > 0.0:
            flow = ~(np.asarray(values["h"]) < least)
            index, values = index[flow], {name: value[flow] for name, value in values.items()}
        for name, peak in self.peaks.items():
            self._keep(name, index, values[peak.product], peak.larger)
        arrived = np.where(np.asarray(values["h"], np.float32) >= self.min_depth, time, np.nan)
        self._keep(ARRIVAL, index, arrived, False)

    def absorb_peaks(self, index: np.ndarray, values: dict) -> None:
        """Add the solver's peaks of every step.

        Parameters
        ----------
        index : int64[k]
        values : dict of str to float32[k]
            Both as yielded by `SolverPeaks.on`.
        """
        for name, peak in self.peaks.items():
            if peak.larger and peak.product in values:
                self._keep(name, index, values[peak.product], True)
        if ARRIVAL in values:
            self._keep(ARRIVAL, index, values[ARRIVAL], False)

    def _keep(self, name, index, new, larger):
        keep_extremes(index, np.asarray(new, np.float32), larger, self.values[name], self.seen[name])

    def rows(self, name: str, first: int, last: int, columns: int) -> np.ndarray:
        """Return rows of the raster of one band.

        Parameters
        ----------
        name : str
        first, last : int
            First row, and row after the last.
        columns : int
            Of the raster.

        Returns
        -------
        float32[last - first, columns]
            NaN without flow.
        """
        part = slice(first * columns, last * columns)
        return np.where(self.seen[name][part], self.values[name][part], np.float32(np.nan)).reshape(-1, columns)

    def at(self, name: str, index: np.ndarray) -> np.ndarray:
        """Return the values of one band in some cells.

        Parameters
        ----------
        name : str
        index : int64[k]
            Flat numbers of the cells.

        Returns
        -------
        float32[k]
            NaN without flow.
        """
        return np.where(self.seen[name][index], self.values[name][index], np.float32(np.nan))

    def largest(self, name: str) -> float:
        """Return the largest absolute value of one band; 0 without flow.

        Parameters
        ----------
        name : str
        """
        return float(np.abs(self.values[name]).max(initial=0.0))


@jit
def keep_extremes(index: np.ndarray, new: np.ndarray, larger: bool, values: np.ndarray, seen: np.ndarray) -> None:
    """Keep the larger or the smaller of the values so far and new ones, in some cells.

    Parameters
    ----------
    index : int64[k]
        Flat numbers of the cells.
    new : float32[k]
        NaN: without a value.
    larger : bool
        True: the largest value is kept; False: the smallest one.
    values : float32[cells], out
        Of all cells, so far.
    seen : bool[cells], out
        Cells with a value.
    """
    for k in range(index.shape[0]):
        cell, value = index[k], new[k]
        if np.isnan(value):
            continue
        if not seen[cell] or (value >= values[cell] if larger else value <= values[cell]):
            values[cell] = value
            seen[cell] = True


@dataclass(frozen=True)
class SolverPeaks:
    """Peaks up to `time` [s] at nodes with one spacing [m] in both directions, row 0 in the south.

    Parameters
    ----------
    time : float [s]
        Of the frame that contains them.
    thickness : float32[rows, columns] [m]
        Vertical.
    speed, pressure : float32[rows, columns] [m s-1], [Pa]
        Of flow that is at least `arrival_thickness` deep.
    arrival_time : float32[rows, columns] [s]
        First time with that thickness, -1 if never.
    west, south : float [m]
        Map position of the first node.
    spacing : float [m]
    arrival_thickness : float [m]
    others : tuple of SolverPeaks
        On other lattices, of stages with another cell size.
    """

    time: float
    thickness: np.ndarray
    speed: np.ndarray
    pressure: np.ndarray
    arrival_time: np.ndarray
    west: float
    south: float
    spacing: float
    arrival_thickness: float = ARRIVAL_THICKNESS
    others: tuple = ()

    @classmethod
    def of(cls, kept: dict, time: float) -> "SolverPeaks | None":
        """Return the peaks in the group `maxima` of a frame.

        Parameters
        ----------
        kept : dict
            The group. Its `transform` maps corners of cells around the nodes: (spacing, 0, west, 0, spacing, south).
        time : float [s]
            Of the frame.

        Returns
        -------
        SolverPeaks or None
            None without flow.
        """
        lattices = [lattice for lattice in lattices_of(kept) if (lattice["thickness"] > 0).any()]
        found = [cls._of_lattice(lattice, float(time)) for lattice in lattices]
        return replace(found[0], others=tuple(found[1:])) if found else None

    @classmethod
    def _of_lattice(cls, kept, time):
        spacing, west, south = (float(kept[TRANSFORM][k]) for k in (0, 2, 5))
        return cls(
            time,
            *(kept[name] for name in PEAK_NAMES),
            west + 0.5 * spacing,
            south + 0.5 * spacing,
            spacing,
            float(kept.get("arrival_thickness", ARRIVAL_THICKNESS)),
        )

    def bands(self, min_depth: float) -> tuple[str, ...]:
        """Return the maxima bands from these peaks.

        Parameters
        ----------
        min_depth : float [m]
            Threshold of the bands. Those that have a threshold are returned only if the peaks have the same one.
        """
        same = abs(self.arrival_thickness - min_depth) <= 1e-6 * self.arrival_thickness
        return BANDS if same else WITHOUT_THRESHOLD

    def bounds(self, min_depth: float) -> tuple | None:
        """Find the bounds of the flow, to the next dry node.

        Parameters
        ----------
        min_depth : float [m]

        Returns
        -------
        (float, float, float, float) or None
            West, south, east, north [m]; None without flow.
        """
        found = [lattice._own_bounds(min_depth) for lattice in (self, *self.others)]
        found = np.array([bounds for bounds in found if bounds is not None])
        if not len(found):
            return None
        return (*found[:, :2].min(axis=0).tolist(), *found[:, 2:].max(axis=0).tolist())

    def _own_bounds(self, min_depth):
        row, column = np.nonzero(self.thickness >= self._least(min_depth))
        if not len(row):
            return None
        return (
            self.west + self.spacing * float(column.min() - 1),
            self.south + self.spacing * float(row.min() - 1),
            self.west + self.spacing * float(column.max() + 1),
            self.south + self.spacing * float(row.max() + 1),
        )

    def _least(self, min_depth):
        """Smallest thickness [m] of a peak that is flow."""
        return least_depth(min_depth, self.arrival_thickness)

    def on(self, grid: Grid, bed: Bed, min_depth: float) -> Iterator[tuple]:
        """Yield the peaks of the cells of `grid` with flow, for strips of rows and one lattice at a time.

        Parameters
        ----------
        grid : Grid
            May be rotated, with rectangular cells.
        bed : Bed
            Its slopes convert vertical to normal thickness.
        min_depth : float [m]
            Threshold of the bands.

        Yields
        ------
        (int64[k], dict of str to float32[k])
            Flat index of cells, ascending; by product `h`, `t`, `t_vol`, and if `min_depth` is the solver's
            `arrival_thickness` also `Ut`, `p` and `t_arrival`.
        """
        for lattice in (self, *self.others):
            yield from lattice._own_on(grid, bed, min_depth)

    def _own_on(self, grid, bed, min_depth):
        row, column = np.nonzero(self.thickness > 0)
        if not len(row):
            return
        # one ring of neighbours, to detect crests at the edge
        part = tuple(slice(max(k.min() - 1, 0), k.max() + 2) for k in (row, column))
        with_motion = self.bands(min_depth) == BANDS
        nodes = self._nodes(part, with_motion)
        north = self.south + self.spacing * (part[0].start + nodes.shape[0] - 1.0)
        lattice = Lattice(self.spacing, (self.west + self.spacing * float(part[1].start), north))
        if grid.is_rotated:
            nodes, lattice = _rotated(nodes, lattice, grid)
        extent = np.array([0, nodes.shape[0], 0, nodes.shape[1]], np.int64)
        cells = lattice.window(grid, extent)
        if cells[0] == cells[1] or cells[2] == cells[3]:
            return
        axes, least = lattice.axes(grid, cells, extent), self._least(min_depth)
        for first, last in _strips(cells):
            strip = cells + np.array([first, last - cells[1] + cells[0], 0, 0])
            window = lattice.cell_window(grid, bed, strip, (axes[0].rows(first, last), axes[1]), sloped=True)
            index, values = _cells(nodes, grid, window, with_motion)
            reached = values["h"] >= least
            yield index[reached], {name: value[reached].astype(np.float32) for name, value in values.items()}

    def _nodes(self, part, with_motion):
        """float64[rows, columns, s]: sums of the nodes of `part`, row 0 in the north; s as THICKNESS, WEIGHT, ..."""
        thickness = np.asarray(self.thickness[part], float)[::-1]
        nodes = np.empty((*thickness.shape, ARRIVED_AT + 1 if with_motion else 1))
        nodes[..., THICKNESS] = thickness
        if with_motion:
            speed, pressure, arrival = (
                np.asarray(values[part], float)[::-1] for values in (self.speed, self.pressure, self.arrival_time)
            )
            arrived = (arrival >= 0).astype(float)
            nodes[..., WEIGHT] = arrived * thickness
            nodes[..., MOVED] = nodes[..., WEIGHT] * speed
            nodes[..., PRESSED] = nodes[..., WEIGHT] * np.sqrt(pressure)  # the band is the square of a mean
            nodes[..., ARRIVED] = arrived
            nodes[..., ARRIVED_AT] = arrived * arrival
        nodes *= self.spacing**2
        return nodes


def _rotated(nodes, lattice, grid):
    """(nodes, Lattice) of the same field on nodes along the axes of a rotated `grid`, at half the spacing."""
    rows, columns, held = nodes.shape
    lattice_along = Lattice(0.5 * lattice.spacing, lattice.anchor)
    west, north = lattice.anchor
    east, south = west + (columns - 1) * lattice.spacing, north - (rows - 1) * lattice.spacing
    places = np.array([lattice_along.place_of(grid, x, y) for x in (west, east) for y in (north, south)])
    low, high = np.floor(places.min(axis=0)), np.ceil(places.max(axis=0))
    across, down = (np.arange(a, b + 1.0) for a, b in zip(low, high, strict=True))
    step = grid.matrix / lattice_along.units(grid)[0]
    x, y = (step[k, 0] * across[None, :] + step[k, 1] * down[:, None] for k in (0, 1))
    place = np.stack([-y, x]) / lattice.spacing
    at_place = partial(scipy.ndimage.map_coordinates, coordinates=place, order=1, mode="grid-constant")
    rotated = np.stack([at_place(nodes[..., k]) for k in range(held)], axis=-1)
    anchor = west + float(x[0, 0]), north + float(y[0, 0])
    rotated *= lattice_along.node_area(grid) / lattice.spacing**2
    return np.ascontiguousarray(rotated), Lattice(lattice_along.spacing, anchor)


def _strips(cells):
    """(first row, row after the last) of strips of the window `cells`."""
    first, last, left, right = cells.tolist()
    height = max(1, STRIP_CELLS // (right - left))
    for row in range(0, last - first, height):
        yield row, min(row + height, last - first)


def _cells(nodes, grid, window, with_motion):
    """(flat index, product -> float64) of the cells of `window` within reach of a node with flow."""
    found = nodes_to_cells(nodes, THICKNESS, THICKNESS, grid, window)
    values = {"h": found.top, "t": found.top, "t_vol": found.sums[:, THICKNESS] / grid.cell_area}
    if with_motion:
        sums = found.sums.T
        values["Ut"] = _ratio(sums[MOVED], sums[WEIGHT])
        values["p"] = _ratio(sums[PRESSED], sums[WEIGHT]) ** 2
        values[ARRIVAL] = _ratio(sums[ARRIVED_AT], sums[ARRIVED])
    return found.index, values


def _ratio(part, whole):
    return np.divide(part, whole, out=np.full(len(part), np.nan), where=whole > 0)
