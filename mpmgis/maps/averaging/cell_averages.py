"""Sums of particle quantities over raster cells, for points and columns (NHESS 25:3897, Eqs 7-14)."""

import threading
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...frames.particles import Frame
from ...terrain.grid import Grid
from . import binning, cell_places, column_squares
from .column_field import SPLINE_REACH, Lattice, column_sums
from .placement import Bed, Placed

_buffers = threading.local()


@dataclass(frozen=True)
class Cells:
    """Sums over the particles of one frame in every export cell that has particles.

    Parameters
    ----------
    index : int64[k]
        Flat index of the cell in the export grid, ascending.
    top, lowest : float64[k] [m]
        Largest (or percentile) and smallest distance from the bed; NaN where the bed slope is unknown under all
        particles. For a column: its thickness normal to the bed, and 0.
    count : int64[k]
        Particles whose position lies in the cell.
    sums : float64[k, SUMS]
        Mass-weighted sums; column numbers are constants of `binning`.
    cell_area : float [m2]
    density : float [kg m-3]
        Of the release.
    spacing : float [m]
        Grid spacing of the solver that made the particles; 0 for columns (they never leave the bed).
    outside, mass_outside, without_slope : int, float [kg], int
        Particles outside the DTM, their mass, and particles on DTM pixels without a slope.
    """

    index: np.ndarray
    top: np.ndarray
    lowest: np.ndarray
    count: np.ndarray
    sums: np.ndarray
    cell_area: float
    density: float
    spacing: float
    outside: int
    mass_outside: float
    without_slope: int

    def mean(self, column: int) -> np.ndarray:
        """Compute the mean of a column of `sums`, weighted by mass.

        Parameters
        ----------
        column : int
            Constant of `binning`.

        Returns
        -------
        float64[k]
            NaN where the slope of the bed is unknown under all particles.
        """
        if column not in self._means:
            weight = self.sums[:, binning.SLOPED]
            mean = np.divide(self.sums[:, column], weight, out=np.full(len(weight), np.nan), where=weight > 0)
            self._means[column] = mean
        return self._means[column]

    @cached_property
    def _means(self):
        """Means that are known, by column of `sums`: several products are made of the same ones."""
        return {}

    def mean_square(self, column: int) -> np.ndarray:
        """Compute the squared length of the `mean` of three columns of `sums`.

        Parameters
        ----------
        column : int
            The first of them.

        Returns
        -------
        float64[k]
        """
        east, north, up = (self.mean(column + axis) for axis in range(3))
        return east * east + north * north + up * up


def bin_frame(
    frame: Frame, placed: Placed, bed: Bed, grid: Grid, density: float, percentile: float = 100.0, spread: bool = True
) -> Cells:
    """Sum the particles of `frame` into the cells of the export `grid`.

    Parameters
    ----------
    frame : Frame
    placed : Placed
        Location of its particles on `bed`.
    bed : Bed
    grid : Grid
        May be rotated, with rectangular cells. Columns are squares along its axes.
    density : float [kg m-3]
    percentile : float
        Mass-weighted percentile of the points' distances, in (0, 100]; not used for columns.
    spread : bool
        True: columns of a run are spread with their solver's B-splines. False: each column fills the square of its
        area; sums over cells stay sharper (for comparing runs of different cell sizes), but fine cells have gaps.

    Returns
    -------
    Cells
    """
    row, column, bounds = _cells_of(frame, placed, grid, bed.clamped and frame.dimension == 3)
    outside, mass_outside, without_slope = cell_places.left_out(row, placed.distance, frame.particles.mass)
    totals = {
        "cell_area": grid.cell_area,
        "density": density,
        "outside": int(outside),
        "mass_outside": float(mass_outside),
        "without_slope": int(without_slope),
    }
    if frame.dimension == 3:
        return _bin_points(frame, placed, bed, grid, row, column, bounds, percentile, totals)
    if spread and column_spacing(frame) is not None:
        return _bin_field(frame, placed, bed, grid, row, column, totals)
    return _bin_squares(frame, placed, bed, grid, row, column, totals)


def _sides_of_cells(grid):
    """float64[2] [m]: width and height of the rectangle with a cell's area and the proportions of its sides."""
    width, height = grid.sides
    return np.array([width, height]) * np.sqrt(grid.cell_area / (width * height))


def _cells_of(frame, placed, grid, clamped):
    n = len(frame.particles)
    row, column, bounds = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(4, np.int64)
    origin = np.asarray(frame.origin, float)
    cell_places.cells_of_points(
        frame.particles.position, placed.pixel, origin, grid.corner, grid.axes, grid.shape, clamped, row, column, bounds
    )
    return row, column, bounds


def flat_cells(frame: Frame, placed: Placed, grid: Grid, clamped: bool = False) -> np.ndarray:
    """Find the cell of a grid that each particle counts in.

    Parameters
    ----------
    frame : Frame
    placed : Placed
    grid : Grid
    clamped : bool
        Points outside the grid count in the nearest cell of its edge (Eq 5).

    Returns
    -------
    int64[n]
        Flat number of the cell; -1 outside.
    """
    row, column, _ = _cells_of(frame, placed, grid, clamped and frame.dimension == 3)
    return np.where(row >= 0, row.astype(np.int64) * grid.shape[1] + column, -1)


def _numbered(marker, bounds, grid):
    """Number the cells that `marker` (a function of the empty window) marks: (window, flat index of each)."""
    window = np.zeros((max(bounds[1] - bounds[0], 0), max(bounds[3] - bounds[2], 0)), np.int32)
    marker(window)
    cells = np.empty(int(np.count_nonzero(window)), np.int64)
    binning.number_cells(window, bounds, grid.shape[1], cells)
    return window, cells


def _bin_points(frame, placed, bed, grid, row, column, bounds, percentile, totals):
    particles = frame.particles
    window, cells = _numbered(lambda mark: binning.mark_points(row, column, bounds, mark), bounds, grid)
    k, n = len(cells), len(particles)
    tiles = [-(-length // binning.TILE) for length in window.shape]
    table = _work_array("table", (k, binning.ROW))
    records = _work_array("records", (min(n, binning.SLAB), binning.RECORD))
    points = binning.PointsInCells(
        row, column, placed.pixel, placed.distance, particles.velocity, particles.mass, particles.volume
    )
    start = np.empty(tiles[0] * tiles[1] + 1, np.int64)
    binning.bin_points(points, bounds, window, bed.gradient_by_pixel, table, records, start)
    sums, count = np.empty((binning.SUMS, k)), np.empty(k, np.int64)
    top, lowest = np.empty(k), np.empty(k)
    binning.by_quantity(table, sums, top, lowest, count)
    if percentile < 100:
        slot = np.empty(n, np.int64)
        binning.numbers_of_points(row, column, bounds, window, placed.distance, slot)
        _take_percentile(top, slot, placed.distance, particles.mass, percentile)
    return Cells(cells, top, lowest, count, sums.T, spacing=grid_spacing(frame), **totals)


def _work_array(name, shape):
    """float64 work array of `shape`, reused for every frame of a thread, because new pages cost as much as the work.

    Returned values must not refer to it.
    """
    kept, size = vars(_buffers), shape[0] * shape[1]
    if name not in kept or len(kept[name]) < size:
        kept[name] = np.empty(size)
    return kept[name][:size].reshape(shape)


def lower_percentile(distance: np.ndarray, mass: np.ndarray, percentile: float) -> float:
    """Find the smallest distance with a percentage of the mass at or below it.

    Parameters
    ----------
    distance : float64[n] [m]
    mass : float[n] [kg]
    percentile : float
        In (0, 100].

    Returns
    -------
    float
        [m]; 0 without particles.
    """
    top = np.zeros(1)
    _take_percentile(top, np.zeros(len(distance), np.int64), distance, np.asarray(mass, float), percentile)
    return float(top[0])


def _take_percentile(top, slot, distance, mass, percentile):
    start, order = np.empty(len(top) + 1, np.int64), np.empty(int(np.count_nonzero(slot >= 0)), np.int64)
    binning.group_by_cell(slot, start, order)
    binning.cell_quantiles(start, order, distance, mass, percentile / 100.0, top)


def column_spacing(frame: Frame) -> float | None:
    """Return the node spacing [m] of the depth-averaged run that made the columns of a frame.

    Columns of a run sample the flow, and its solver spreads them over nodes. Columns of a seed, of a conversion or
    of another code cover the ground without gaps: each fills the square of its area.

    Parameters
    ----------
    frame : Frame

    Returns
    -------
    float or None
        None for points, and for columns that no run made.
    """
    spacing = frame.header.get("cell_size") if frame.dimension == 2 else None
    return None if spacing is None else float(spacing)


def column_side(frame: Frame) -> float:
    """Return the resolution [m] of the columns of a frame.

    Parameters
    ----------
    frame : Frame

    Returns
    -------
    float
        Node spacing of the run, else the side of the mean column's square; 0 for points.
    """
    if frame.dimension == 3:
        return 0.0
    spacing = column_spacing(frame)
    return float(np.sqrt(frame.particles.area.mean())) if spacing is None else spacing


def column_reach(frame: Frame) -> np.ndarray:
    """Return the distance from its position up to which each column contributes to cells.

    Parameters
    ----------
    frame : Frame
        Of columns.

    Returns
    -------
    float64[n] [m]
    """
    spacing = column_spacing(frame)
    if spacing is None:
        return 0.5 * np.sqrt(frame.particles.area)
    return np.full(len(frame.particles), SPLINE_REACH * spacing)


def _bin_field(frame, placed, bed, grid, row, column, totals):
    lattice = Lattice.of_solver(column_spacing(frame), bed.grid, grid)
    found, count = column_sums(frame, placed, bed, grid, row, column, lattice)
    sloped = found.sums[:, binning.SLOPED] > 0
    top = np.where(sloped, found.top / totals["density"], np.nan)
    return Cells(found.index, top, np.where(sloped, 0.0, np.nan), count, found.sums, spacing=0.0, **totals)


def _bin_squares(frame, placed, bed, grid, row, column, totals):
    particles = frame.particles
    footprint, bounds = np.empty((len(particles), 4)), np.empty(4, np.int64)
    origin = np.asarray(frame.origin, float)
    column_squares.footprints(
        particles.position,
        particles.area,
        row,
        origin,
        grid.corner,
        grid.axes,
        _sides_of_cells(grid),
        grid.shape,
        footprint,
        bounds,
    )
    window, cells = _numbered(lambda mark: column_squares.mark_footprints(footprint, bounds, mark), bounds, grid)
    k = len(cells)
    sums, count = np.zeros((k, binning.SUMS)), np.zeros(k, np.int64)
    column_squares.bin_columns(
        footprint,
        row,
        column,
        bounds,
        window,
        placed.pixel,
        bed.gradient_by_pixel,
        particles.velocity,
        particles.mass,
        particles.volume,
        sums,
        count,
    )
    covered = np.minimum(sums[:, binning.COVERED], 1.0)
    volume = sums[:, binning.UPRIGHT] / totals["density"]
    top = np.where(sums[:, binning.SLOPED] > 0, volume / (totals["cell_area"] * covered), np.nan)
    lowest = np.where(np.isnan(top), np.nan, 0.0)
    return Cells(cells, top, lowest, count, sums, spacing=0.0, **totals)


def grid_spacing(frame: Frame) -> float:
    """Return the grid spacing [m] of the solver that made a frame.

    It is that of the frame's header, else an estimate that assumes 8 points or 4 x 4 columns per cell, rounded to two
    digits.

    Parameters
    ----------
    frame : Frame
    """
    spacing = frame.header.get("cell_size")
    if spacing is not None:
        return float(spacing)
    if frame.dimension == 2:
        return _two_digits(4.0 * float(np.sqrt(frame.particles.area.mean())))
    return _two_digits(2.0 * float(np.cbrt(frame.particles.volume.mean())))


def _two_digits(value):
    return float(f"{value:.2g}")
