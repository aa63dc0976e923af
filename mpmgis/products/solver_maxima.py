"""Peaks that a solver kept at its own nodes in every step, on the cells of an export (README, "The files").

A solver's thickness is vertical, that of the bands normal to the bed: what a node holds is multiplied by the cosine of
the slope of the DTM pixel, as every column's is. Its speed is |U|, along the ground in form `slope`, which is what
`Ut` means, and horizontal in form `swe`, which is at most `Ut` and differs little on the beds that water runs on.
Speed, pressure and arrival are of flow that is at least `arrival_thickness` deep at the node, and serve only where
`min_depth` is the same number: a band has one threshold. (The solver's is vertical, which matters little at a front.)

Between nodes peaks are bilinear. A cell finer than the nodes takes the value at its centre; a coarser one is sampled
as densely as there are nodes, and each band combines the samples as it is defined: `h` and `t` the largest (Eq 7),
`t_vol` the mean over the whole cell, `Ut` the mean weighted by mass, that is by thickness, `p` from the mean speed,
and the arrival the mean over what was reached.

Where the flow never was as deep as `min_depth`, nor as the solver's arrival thickness, a peak is only the tail of the
solver's splines, and nothing is answered.
"""

from dataclasses import dataclass

import numpy as np

from .maxima import ARRIVAL

BANDS = ("h_max", "t_max", "Ut_max", "p_max", ARRIVAL)  # a solver of columns knows no velocity normal to the bed
WITHOUT_THRESHOLD = BANDS[:2]
ARRIVAL_THICKNESS = 0.05  # [m] of the solver, where its frames do not say another
THINNEST = 1e-3  # [m] no flow, whatever --min-depth says
STRIP_SAMPLES = 1_000_000  # of one strip, so that memory does not grow with the raster


@dataclass(frozen=True)
class SolverPeaks:
    """Peaks up to `time` [s] at nodes with one spacing [m] in both directions, row 0 in the south.

    Parameters
    ----------
    time : float [s]
        Of the frame that holds them.
    thickness : float32[rows, columns] [m]
        Vertical.
    speed, pressure : float32[rows, columns] [m s-1], [Pa]
        Of flow that is at least `arrival_thickness` deep.
    arrival_time : float32[rows, columns] [s]
        First time with that thickness, -1 where there was none.
    west, south : float [m]
        Map position of the first node.
    spacing : float [m]
    arrival_thickness : float [m]
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

    @classmethod
    def of(cls, kept, time):
        """The peaks in the dictionary `kept` (group `maxima` of a frame at `time` [s]); None where nothing was reached.

        Its `transform` maps corners of cells around the nodes: (spacing, 0, west, 0, spacing, south).
        """
        if not kept or not (kept["thickness"] > 0).any():
            return None
        spacing, west, south = (float(kept["transform"][k]) for k in (0, 2, 5))
        return cls(
            float(time),
            *(kept[name] for name in ("thickness", "speed", "pressure", "arrival_time")),
            west + 0.5 * spacing,
            south + 0.5 * spacing,
            spacing,
            float(kept.get("arrival_thickness", ARRIVAL_THICKNESS)),
        )

    def bands(self, min_depth):
        """The maxima bands that these peaks serve: those without a threshold, all where `min_depth` [m] is theirs."""
        same = abs(self.arrival_thickness - min_depth) <= 1e-6 * self.arrival_thickness
        return BANDS if same else WITHOUT_THRESHOLD

    def bounds(self, min_depth):
        """(west, south, east, north) [m] of what the flow reached, to the next dry node; None where that is nothing."""
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
        """Thickness [m] from which a peak is flow."""
        return max(THINNEST, min(min_depth, self.arrival_thickness))

    def on(self, grid, bed, min_depth):
        """Yield the peaks of the cells of `grid` that the flow reached, some rows of it at a time.

        Parameters
        ----------
        grid : Grid
            North-up; its cells may be oblong.
        bed : Bed
            Whose pixels' slopes turn vertical thickness into normal.
        min_depth : float [m]
            Of the bands.

        Yields
        ------
        (int64[k], dict of str to float32[k])
            Flat index of cells, ascending; by product `h`, `t`, `t_vol`, and where `min_depth` is the solver's
            `arrival_thickness` also `Ut`, `p` and `t_arrival`.
        """
        nodes = self._fields(self.bands(min_depth) == BANDS)
        least = self._least(min_depth)
        for first, last, columns in self._strips(grid):
            index, values = self._cells(nodes, grid, bed, first, last, columns)
            reached = values["h"] >= least
            yield index[reached], {name: value[reached].astype(np.float32) for name, value in values.items()}

    def _fields(self, with_motion):
        """What is interpolated, by name, with a ring of dry nodes around: thickness, and sums that become means."""
        thickness, speed, pressure = (
            np.pad(np.asarray(values, float), 1) for values in (self.thickness, self.speed, self.pressure)
        )
        if not with_motion:
            return {"thickness": thickness}
        arrival = np.pad(np.asarray(self.arrival_time, float), 1, constant_values=-1.0)
        arrived = (arrival >= 0).astype(float)
        weight = arrived * thickness
        return {
            "thickness": thickness,
            "arrived": arrived,
            "arrived_at": arrived * arrival,
            "weight": weight,
            "moved": weight * speed,
            "pressed": weight * np.sqrt(pressure),  # the band squares a mean
        }

    def _cells(self, nodes, grid, bed, first, last, columns):
        """(flat index, product -> float64) of all cells in the rows from `first` to `last` and in `columns`."""
        t = grid.transform
        west, south, east, north = self._beyond()
        down = _line(t.f, t.e, first, last, self._samples(-t.e), north, south)
        across = _line(t.c, t.a, columns.start, columns.stop, self._samples(t.a), west, east)
        shape = nodes["thickness"].shape
        place = (
            _beside(down.places, self.south, self.spacing, shape[0]),
            _beside(across.places, self.west, self.spacing, shape[1]),
        )

        def by_cell(reduced, values):
            return reduced.reduceat(reduced.reduceat(values, down.starts, axis=0), across.starts, axis=1).ravel()

        def total(name):
            return by_cell(np.add, _between(nodes[name], *place))

        normal = np.nan_to_num(_between(nodes["thickness"], *place) * _cosine(bed, across.places, down.places))
        depth = by_cell(np.maximum, normal)
        values = {"h": depth, "t": depth, "t_vol": by_cell(np.add, normal) / (down.in_a_cell * across.in_a_cell)}
        if "weight" in nodes:
            weight = total("weight")
            values["Ut"] = _ratio(total("moved"), weight)
            values["p"] = _ratio(total("pressed"), weight) ** 2
            values[ARRIVAL] = _ratio(total("arrived_at"), total("arrived"))
        index = np.arange(first, last)[:, None] * grid.shape[1] + np.arange(columns.start, columns.stop)
        return index.ravel(), values

    def _beyond(self):
        """(west, south, east, north) [m] where bilinear values end: one node beyond the last."""
        rows, columns = self.thickness.shape
        south, west = self.south - self.spacing, self.west - self.spacing
        return west, south, self.west + columns * self.spacing, self.south + rows * self.spacing

    def _strips(self, grid):
        """(first row, last row, slice of columns) of the parts of `grid` that nodes reach, small enough for memory."""
        t = grid.transform
        west, south, east, north = self._beyond()
        j0, j1 = _within((west - t.c) / t.a, (east - t.c) / t.a, grid.shape[1])
        i0, i1 = _within((north - t.f) / t.e, (south - t.f) / t.e, grid.shape[0])
        a_row = (j1 - j0) * self._samples(t.a) * self._samples(-t.e)
        height = max(1, STRIP_SAMPLES // max(a_row, 1))
        return [(i, min(i + height, i1), slice(j0, j1)) for i in range(i0, i1, height)] if j1 > j0 else []

    def _samples(self, cell):
        """How many samples a cell that is `cell` [m] wide takes along that side."""
        return max(1, int(np.ceil(cell / self.spacing - 1e-9)))


@dataclass(frozen=True)
class _Line:
    """Places [m] of samples along a row or column of cells, where each cell's begin, how many a whole cell has."""

    places: np.ndarray
    starts: np.ndarray
    in_a_cell: int


def _line(origin, cell, first, last, in_a_cell, begin, end):
    """Samples of the cells from `first` to `last` that lie between `begin` and `end` [m], at least one of each cell.

    Beyond is nothing that would add to a sum: a cell may be any number of times as wide as what the flow reached.
    """
    step = cell / in_a_cell
    low, high = first * in_a_cell, last * in_a_cell
    low = min(max(low, int(np.floor((begin - origin) / step))), low + in_a_cell - 1)
    high = max(min(high, int(np.ceil((end - origin) / step))), high - in_a_cell + 1)
    starts = np.maximum(np.arange(first, last) * in_a_cell, low) - low
    return _Line(origin + step * (np.arange(low, high) + 0.5), starts, in_a_cell)


def _within(low, high, count):
    """First and one past the last of the `count` cells between two places counted in cells."""
    return max(int(np.floor(low)), 0), min(int(np.ceil(high)), count)


def _ratio(part, whole):
    return np.divide(part, whole, out=np.full(len(part), np.nan), where=whole > 0)


def _beside(places, first, spacing, count):
    """The node before each of `places` [m] among `count` padded ones, and the share of the next (0 to 1)."""
    along = (places - first) / spacing + 1.0
    before = np.clip(np.floor(along).astype(np.int64), 0, count - 2)
    return before, np.clip(along - before, 0.0, 1.0)


def _between(values, vertical, horizontal):
    """Bilinear values where rows `vertical` and columns `horizontal` meet (each as `_beside` answers)."""
    (j, up), (i, right) = vertical, horizontal
    low = j.min()
    near = values[low : j.max() + 2]
    lines = near[:, i] * (1.0 - right) + near[:, i + 1] * right
    up = up[:, None]
    return lines[j - low] * (1.0 - up) + lines[j - low + 1] * up


def _cosine(bed, x, y):
    """Cosine of the slope of the DTM pixels under a lattice of places; NaN off the DTM and where it has no slope."""
    row, column = (np.floor(place + 0.5).astype(np.int64) for place in bed.grid.rowcol(x[None, :], y[:, None]))
    rows, columns = bed.grid.shape
    on = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    slope = bed.gradient_by_pixel[np.where(on, row * columns + column, 0)]
    return np.where(on, 1.0 / np.sqrt(1.0 + slope[..., 0] ** 2 + slope[..., 1] ** 2), np.nan)
