"""One frame as cell values, the survey of all frames before an export, and values of chosen cells over time."""

from dataclasses import dataclass

import numpy as np

from ..kernels import cell_places
from ..terrain.grid import Grid
from .cells import Bed, bin_frame, column_reach, column_side, column_spacing, grid_spacing, place
from .maxima import least_depth
from .quantities import PRODUCTS, cell_values, map_speed, volume_thickness
from .sampling import FrameFacts, export_axes, export_grid

_ROUNDING = 1e-3  # particles closer than this share of the code's cell to the bed are on it, not below


@dataclass(frozen=True)
class Averaging:
    """How frames are averaged: the same for all of them.

    Parameters
    ----------
    bed : Bed
    grid : Grid
        Export grid.
    density : float [kg m-3]
        Of the release.
    names : tuple of str
        Products to compute.
    percentile : float
        In (0, 100].
    min_depth : float [m]
    second_grid : Grid or None
        Another grid to average on besides, and `second_names`, the products there.
    """

    bed: Bed
    grid: Grid
    density: float
    names: tuple
    percentile: float = 100.0
    min_depth: float = 0.05
    second_grid: Grid | None = None
    second_names: tuple = ()


@dataclass(frozen=True)
class FrameValues:
    """The values of one frame's cells.

    Parameters
    ----------
    time : float [s]
    count, mass : int, float [kg]
        Particles in the frame.
    index : int64[k]
        Flat index in the export grid of the cells that hold any, ascending.
    values : dict of str to float32[k]
        By product.
    second : (int64[m], dict of str to float32[m]) or None
        The same on the second grid.
    outside, mass_outside, without_slope : int, float [kg], int
        Particles off the DTM, their mass, and particles on it where it has no slope.
    moved : int
        Particles that lie outside the DTM and were taken to its rim (a clamped bed's).
    below, lowest : float, float [m]
        Share of the mass below the DTM (points), and the smallest distance from it, whatever the bed's standoff.
    column_side : float [m]
        What columns resolve: the node spacing of their run, else the side of the mean column; 0 for points.
    least : float [m]
        Depth below which a cell holds only the tail of columns' splines; 0 where particles have none.
    point_side : float [m]
        Eq 15's cell size: the cube root of the mean point's present volume, 0 for columns.
    fastest : float [m s-1]
        Largest depth-averaged speed in the map plane where the flow is at least min_depth deep.
    """

    time: float
    count: int
    mass: float
    index: np.ndarray
    values: dict
    second: tuple | None
    outside: int
    mass_outside: float
    without_slope: int
    moved: int
    below: float
    lowest: float
    column_side: float
    least: float
    point_side: float
    fastest: float


def average_frame(frame, averaging):
    """Average `frame` as `averaging` says.

    Returns
    -------
    FrameValues
    """
    placed = place(frame, averaging.bed)
    cells = _bin(frame, placed, averaging, averaging.grid)
    second = None
    if averaging.second_grid is not None:
        there = _bin(frame, placed, averaging, averaging.second_grid)
        second = there.index, _stored(cell_values(there, averaging.second_names, averaging.min_depth))
    values = cell_values(cells, averaging.names, averaging.min_depth)
    mass = float(frame.particles.mass.sum())
    below, lowest = _below_terrain(frame, placed, averaging.bed.standoff, cells.spacing, mass)
    return FrameValues(
        time=frame.time,
        count=len(frame.particles),
        mass=mass,
        index=cells.index,
        values=_stored(values),
        second=second,
        outside=cells.outside,
        mass_outside=cells.mass_outside,
        without_slope=cells.without_slope,
        moved=placed.moved,
        below=below,
        lowest=lowest,
        column_side=column_side(frame),
        least=0.0 if column_spacing(frame) is None else least_depth(averaging.min_depth),
        point_side=float(np.cbrt(frame.particles.volume.mean())) if frame.dimension == 3 else 0.0,
        fastest=_fastest(cells, values["h"], averaging.min_depth),
    )


def _bin(frame, placed, averaging, grid):
    return bin_frame(frame, placed, averaging.bed, grid, averaging.density, averaging.percentile)


def _stored(values):
    return {name: value.astype(np.float32) for name, value in values.items()}


def _fastest(cells, depth, min_depth):
    speed = map_speed(cells)[depth >= min_depth]
    return float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0


def _below_terrain(frame, placed, standoff, spacing, mass):
    """(share of the mass below the DTM, smallest distance [m]) of points; (0, 0) for columns, which stand on it."""
    if frame.dimension == 2:
        return 0.0, 0.0
    below, lowest = cell_places.below(placed.distance, frame.particles.mass, -_ROUNDING * spacing - standoff)
    return (float(below / mass), float(lowest + standoff)) if np.isfinite(lowest) else (0.0, 0.0)


RESTING_BELOW = 0.01  # share of the mass below the bed from which a code's own offset is assumed


def reached(frame, bed, axes):
    """(First column, first row, last column, last row) [m] of what lies on the DTM; None where nothing does.

    Parameters
    ----------
    frame : Frame
        Of its particles only `position` is used, and `area` of columns, which count with the ground they stand for.
    bed : Bed
    axes : Grid
        `export_axes`, along which the answer is.
    """
    particles, bounds = frame.particles, np.empty(4)
    half = column_reach(frame) if frame.dimension == 2 else np.zeros(1)
    origin = np.asarray(frame.origin, float)
    count = cell_places.reach(
        particles.position, half, origin, bed.grid.corner, bed.grid.axes, bed.elevation,
        bed.clamped and frame.dimension == 3, axes.corner, axes.axes, bounds,
    )  # fmt: skip
    return tuple(bounds.tolist()) if count else None


def survey_frame(frame, bed, density, axes=None):
    """What `frame` contributes to the choice of cells and of the standoff.

    Parameters
    ----------
    frame : Frame
    bed : Bed
    density : float [kg m-3]
        Of the release.
    axes : Grid, optional
        `export_axes` that the bounds are along (default: north-up).

    Returns
    -------
    FrameFacts
    """
    placed, particles = place(frame, bed), frame.particles
    inside = placed.inside
    if not inside.any():
        return FrameFacts(None, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    released = particles.mass / density
    volume = float(released.mean())
    below, offset = 0.0, 0.0
    if frame.dimension == 3:
        below, offset = resting_offset(placed.distance[inside], particles.mass[inside])
    return FrameFacts(
        bounds=reached(frame, bed, export_axes(bed.grid) if axes is None else axes),
        particle_volume=volume,
        dilation=min(1.0, float(np.quantile(released / particles.volume, 0.1))),
        thickness=_median_thickness(frame, placed, bed, density),
        spacing=grid_spacing(frame),
        below=below,
        offset=offset,
        column_side=float(np.sqrt(particles.area.mean())) if frame.dimension == 2 else 0.0,
    )


def _median_thickness(frame, placed, bed, density):
    cells = bin_frame(frame, placed, bed, export_grid(bed.grid), density)
    thickness = volume_thickness(cells)
    thickness = thickness[thickness > 0]
    return float(np.median(thickness)) if len(thickness) else 0.0


def resting_offset(distance, mass):
    """How far below the DTM a grid-based code lets its particles rest.

    Parameters
    ----------
    distance : float[n] [m]
        From the bed, NaN where unknown.
    mass : float[n] [kg]

    Returns
    -------
    (float, float)
        Share of the mass below the bed, and the distance [m] that only 1 % of the mass lies under.
    """
    known = np.isfinite(distance)
    distance, mass = distance[known], mass[known]
    below = distance < 0
    share = float(mass[below].sum() / mass.sum()) if len(mass) else 0.0
    if share < RESTING_BELOW:
        return share, 0.0
    order = np.flatnonzero(below)[np.argsort(distance[below], kind="stable")]
    rank = np.searchsorted(np.cumsum(mass[order]), RESTING_BELOW * mass.sum())
    return share, float(distance[order[min(rank, len(order) - 1)]])


def automatic_standoff(facts):
    """The standoff [m] of the frame with the largest share of its mass below the bed; 0 where that is under 1 %.

    It is the distance that only 1 % of that frame's mass lies under: grid-based codes hold particles off nodes and
    not off the DTM, so that they come to rest up to a cell below it, and all distances are short by that much.
    """
    deepest = max(facts, key=lambda fact: fact.below)
    return deepest.offset if deepest.below >= RESTING_BELOW else 0.0


def fastest_mean(frame, bed, grid, density):
    """Largest depth-averaged speed [m s-1] in the map plane over the cells of `grid` (for Eq 17)."""
    speed = map_speed(bin_frame(frame, place(frame, bed), bed, grid, density))
    return float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0


NOWHERE = -1  # the number of a cell that a grid does not have


def cells_of(grid, x, y):
    """int64[n]: flat number of the cell of `grid` that holds each map point [m], NOWHERE off the grid."""
    row, column = (np.floor(place + 0.5).astype(np.int64) for place in grid.rowcol(x, y))
    rows, columns = grid.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return np.where(inside, row * columns + column, NOWHERE)


def pick(index, values, empty, cells):
    """Values of `cells` out of those that are known.

    Parameters
    ----------
    index : int64[k]
        Flat numbers of the cells with a value, ascending.
    values : float[k]
    empty : float
        Value of the grid's other cells.
    cells : int64[n]
        NOWHERE has no value.

    Returns
    -------
    float64[n]
        NaN off the grid.
    """
    result = np.where(cells == NOWHERE, np.nan, empty)
    if len(index):
        at = np.minimum(np.searchsorted(index, cells), len(index) - 1)
        known = index[at] == cells
        result[known] = values[at[known]]
    return result


def frame_at_cells(frame, averaging, cells):
    """Product -> float64[n] of `cells` of `averaging.grid`, one frame averaged as for the export's rasters."""
    found = average_frame(frame, averaging)
    return {name: pick(found.index, found.values[name], PRODUCTS[name].empty, cells) for name in averaging.names}


def nearest_times(times, wanted):
    """Numbers of the frames nearest to the `wanted` times [s], each once, in their order; of two equally near the
    earlier."""
    gaps = np.abs(np.asarray(times, float)[None, :] - np.asarray(wanted, float)[:, None])
    return sorted({int(k) for k in np.argmin(gaps, axis=1)})
