"""Sums over raster cells behind every product, for points and columns, and the bed below (NHESS 25:3897, Eqs 2-7)."""

import threading
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..kernels import binning, cell_places, footprint_binning
from ..terrain.grid import Grid
from .node_fields import SPLINE_REACH, Lattice, column_sums


@dataclass(frozen=True)
class Bed:
    """The DTM as the reference surface of Eqs 3 to 7.

    Parameters
    ----------
    grid : Grid
    elevation : float64[rows, columns] [m], NaN where there is no data
    gradient : float64[rows, columns, 2] [1], (db/dE, db/dN)
    kind : str
        "bilinear": elevation between pixel centres, slopes limited at cliff edges; "plane": tangent plane of the
        pixel, central differences, the paper to the letter (design note X3).
    standoff : float [m]
        Height, along the normal, at which the code that made the particles lets them rest; taken off distances.
    clamped : bool
        Points outside the DTM count in the nearest cell of its rim, as Eq 5 has it; otherwise they are left out.
    """

    grid: Grid
    elevation: np.ndarray
    gradient: np.ndarray
    kind: str = "bilinear"
    standoff: float = 0.0
    clamped: bool = False

    @classmethod
    def of(cls, terrain, kind="bilinear", standoff=0.0, clamped=False):
        """The bed of `terrain`; the rest as of the class."""
        gradient = terrain.gradient if kind == "plane" else terrain.limited_gradient
        return cls(
            terrain.grid,
            np.ascontiguousarray(terrain.elevation),
            np.ascontiguousarray(gradient),
            kind,
            standoff,
            clamped,
        )

    @cached_property
    def gradient_by_pixel(self):
        """float64[pixels, 2]: `gradient` by flat index."""
        return self.gradient.reshape(-1, 2)


@dataclass(frozen=True)
class Placed:
    """Where a frame's particles are: `pixel` int64[n] (flat, -1 outside), `distance` float64[n] [m] (NaN unknown).

    `moved` is the number of those that lie outside and were taken to the rim of a clamped bed.
    """

    pixel: np.ndarray
    distance: np.ndarray
    moved: int = 0

    @cached_property
    def inside(self):
        """bool[n]: particles on the DTM."""
        return self.pixel >= 0


def place(frame, bed):
    """Find the DTM pixel under every particle of `frame` and its distance d_p from the bed (Eqs 2, 5, 6)."""
    n = len(frame.particles)
    pixel, distance = np.empty(n, np.int64), np.empty(n)
    moved = cell_places.place(
        frame.particles.position,
        np.asarray(frame.origin, float),
        bed.grid.corner,
        bed.grid.axes,
        bed.grid.matrix,
        bed.elevation,
        bed.gradient,
        bed.kind == "plane",
        bed.clamped and frame.dimension == 3,
        bed.standoff,
        pixel,
        distance,
    )
    return Placed(pixel, distance, int(moved))


_rooms = threading.local()


@dataclass(frozen=True)
class Cells:
    """What the particles of one frame sum to in every export cell that holds any.

    Parameters
    ----------
    index : int64[k]
        Flat index of the cell in the export grid, ascending.
    top, lowest : float64[k] [m]
        Largest (or percentile) and smallest distance from the bed; NaN where no particle has a slope under it.
        A column's are its thickness normal to the bed, and 0.
    count : int64[k]
        Particles whose position lies in the cell.
    sums : float64[k, SUMS]
        Sums over mass, as `mpmgis.kernels.binning` names its columns.
    cell_area : float [m2]
    density : float [kg m-3]
        Of the release.
    spacing : float [m]
        Grid spacing of the code that made the particles, 0 where the flow is columns (they never leave the bed).
    outside, mass_outside, without_slope : int, float [kg], int
        Particles that are not on the DTM, their mass, and particles on it whose pixel has no slope.
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

    def mean(self, column):
        """Mass-weighted mean of a column of `sums`; NaN where nothing in the cell has a slope under it."""
        weight = self.sums[:, binning.SLOPED]
        return np.divide(self.sums[:, column], weight, out=np.full(len(weight), np.nan), where=weight > 0)

    def mean_vector(self, column):
        """float64[k, 3]: as `mean`, of the three columns from `column`."""
        return np.stack([self.mean(column + axis) for axis in range(3)], axis=1)


def bin_frame(frame, placed, bed, grid, density, percentile=100.0, spread=True):
    """Sum the particles of `frame` into the cells of the export `grid`.

    Parameters
    ----------
    frame : Frame
    placed : Placed
        Where its particles are on `bed`.
    bed : Bed
    grid : Grid
        Rotated or not; its cells may be oblong. Columns are squares along its axes.
    density : float [kg m-3]
    percentile : float
        Of the points' distances, mass-weighted, in (0, 100]; columns have none.
    spread : bool
        Columns of a run are spread as their solver does it. False: each fills the square of its area. That keeps sums
        over cells sharper, to compare runs on cells of different sizes, but gives no depth in fine cells.

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


def _numbered(marker, bounds, grid):
    """Number the cells that `marker` (a function of the empty window) marks: (window, flat index of each cell)."""
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
    table, records = _room("table", (k, binning.ROW)), _room("records", (min(n, binning.SLAB), binning.RECORD))
    binning.bin_points(
        row, column, bounds, window, placed.pixel, placed.distance, bed.gradient_by_pixel, particles.velocity,
        particles.mass, particles.volume, table, records, np.empty(tiles[0] * tiles[1] + 1, np.int64),
    )  # fmt: skip
    sums, count = np.empty((binning.SUMS, k)), np.empty(k, np.int64)
    top, lowest = np.empty(k), np.empty(k)
    binning.by_quantity(table, sums, top, lowest, count)
    if percentile < 100:
        slot = np.empty(n, np.int64)
        binning.numbers_of_points(row, column, bounds, window, placed.distance, slot)
        _take_percentile(top, slot, placed.distance, particles.mass, percentile)
    return Cells(cells, top, lowest, count, sums.T, spacing=grid_spacing(frame), **totals)


def _room(name, shape):
    """float64 of `shape` to work in, the same memory for every frame of a thread: fresh pages cost as much as the work.

    Nothing that is handed on may lie there.
    """
    kept, size = vars(_rooms), shape[0] * shape[1]
    if name not in kept or len(kept[name]) < size:
        kept[name] = np.empty(size)
    return kept[name][:size].reshape(shape)


def lower_percentile(distance, mass, percentile):
    """Smallest of the distances float64[n] [m] with `percentile` % of the mass at or below it; 0 without any."""
    top = np.zeros(1)
    _take_percentile(top, np.zeros(len(distance), np.int64), distance, np.asarray(mass, float), percentile)
    return float(top[0])


def _take_percentile(top, slot, distance, mass, percentile):
    start, order = np.empty(len(top) + 1, np.int64), np.empty(int(np.count_nonzero(slot >= 0)), np.int64)
    binning.group_by_cell(slot, start, order)
    binning.cell_quantiles(start, order, distance, mass, percentile / 100.0, top)


def column_spacing(frame):
    """Node spacing [m] of the depth-averaged run that made the columns of `frame`; None for all other particles.

    Columns of a run are samples of the flow, which its solver spreads over nodes. Those of a seed, of a conversion or
    of another code tile the ground: each fills the square of its area.
    """
    said = frame.header.get("cell_size") if frame.dimension == 2 else None
    return None if said is None else float(said)


def column_side(frame):
    """What the columns of `frame` resolve [m]: their run's node spacing, else the side of the mean column's square.

    0 for points.
    """
    if frame.dimension == 3:
        return 0.0
    spacing = column_spacing(frame)
    return float(np.sqrt(frame.particles.area.mean())) if spacing is None else spacing


def column_reach(frame):
    """float64[n] [m]: how far from its position each column of `frame` gives flow to cells."""
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
    footprint_binning.footprints(
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
    window, cells = _numbered(lambda mark: footprint_binning.mark_footprints(footprint, bounds, mark), bounds, grid)
    k = len(cells)
    sums, count = np.zeros((k, binning.SUMS)), np.zeros(k, np.int64)
    footprint_binning.bin_columns(
        footprint, row, column, bounds, window, placed.pixel, bed.gradient_by_pixel,
        particles.velocity, particles.mass, particles.volume, sums, count,
    )  # fmt: skip
    covered = np.minimum(sums[:, binning.COVERED], 1.0)
    volume = sums[:, binning.UPRIGHT] / totals["density"]
    top = np.where(sums[:, binning.SLOPED] > 0, volume / (totals["cell_area"] * covered), np.nan)
    lowest = np.where(np.isnan(top), np.nan, 0.0)
    return Cells(cells, top, lowest, count, sums, spacing=0.0, **totals)


def grid_spacing(frame):
    """Grid spacing [m] of the code that made `frame`: as its header says, else guessed from the particles.

    The guess has the usual 8 points a cell, or columns in 4 rows of 4, and two digits.
    """
    said = frame.header.get("cell_size")
    if said is not None:
        return float(said)
    if frame.dimension == 2:
        return _two_digits(4.0 * float(np.sqrt(frame.particles.area.mean())))
    return _two_digits(2.0 * float(np.cbrt(frame.particles.volume.mean())))


def _two_digits(value):
    return float(f"{value:.2g}")
