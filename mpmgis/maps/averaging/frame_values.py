"""Compute the cell values of one frame, the survey of all frames before an export, and values of selected cells."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...frames.flow_end import moving_share
from ...frames.particles import Frame
from ...terrain.grid import Grid
from . import cell_places
from .band_products import PRODUCTS, cell_values, map_speed, volume_thickness
from .cell_averages import bin_frame, column_reach, column_side, column_spacing, grid_spacing
from .export_resolution import FrameFacts, export_axes, export_grid
from .height_layers import HeightLayers, height_layers
from .maxima import least_depth
from .placement import Bed, place

_ROUNDING = 1e-3  # [solver cells] particles that are less than this below the bed are on it
RESTING_BELOW = 0.01  # [1] share of the mass below the bed, above which an offset of the solver is assumed
NOWHERE = -1  # cell number of a point outside the grid


@dataclass(frozen=True)
class Averaging:
    """Settings for averaging frames, the same for all frames.

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
        Second grid to average on; `second_names` are its products.
    layers : tuple of float [m]
        Edges of layers of height over the bed; empty: no layers.
    """

    bed: Bed
    grid: Grid
    density: float
    names: tuple
    percentile: float = 100.0
    min_depth: float = 0.05
    second_grid: Grid | None = None
    second_names: tuple = ()
    layers: tuple = ()


@dataclass(frozen=True)
class FrameValues:
    """Cell values of one frame.

    Parameters
    ----------
    time : float [s]
    count, mass : int, float [kg]
        Particles in the frame.
    index : int64[k]
        Flat index in the export grid of the cells with particles, ascending.
    values : dict of str to float32[k]
        By product.
    second : (int64[m], dict of str to float32[m]) or None
        The same on the second grid.
    outside, mass_outside, without_slope : int, float [kg], int
        Particles outside the DTM, their mass, and particles on DTM pixels without a slope.
    moved : int
        Particles outside the DTM that were moved to the edge of a clamped bed.
    below, lowest : float, float [m]
        Share of the mass below the DTM (points), and the smallest distance from it, without the standoff.
    column_side : float [m]
        Resolution of columns: node spacing of the run, else the side of the mean column; 0 for points.
    least : float [m]
        Depth below which a cell has only the tail of column splines; 0 for particles without splines.
    point_side : float [m]
        Cell size of Eq 15: cube root of the mean current volume of points; 0 for columns.
    fastest : float [m s-1]
        Largest depth-averaged horizontal speed where the flow is at least min_depth deep.
    solver_cell : float [m]
        Node spacing of the solver that made the frame, or the side of the mean column; 0 if it is unknown.
    moving, kinetic : float [1], float [J]
        Share of the mass that is faster than FLOWING_SPEED, and kinetic energy, of all particles.
    layers : HeightLayers or None
        Of `Averaging.layers`.
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
    solver_cell: float
    moving: float
    kinetic: float
    layers: HeightLayers | None = None


def average_frame(frame: Frame, averaging: Averaging) -> FrameValues:
    """Average a frame over the cells of a grid.

    Parameters
    ----------
    frame : Frame
    averaging : Averaging

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
    moving, kinetic = _motion(frame.particles)
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
        solver_cell=column_side(frame) or cells.spacing,
        moving=moving,
        kinetic=kinetic,
        layers=_layers(frame, placed, averaging),
    )


def _motion(particles):
    """Return the share of the mass that is faster than FLOWING_SPEED [1], and the kinetic energy [J]."""
    speed2 = np.einsum("ij,ij->i", particles.velocity, particles.velocity, dtype=float)
    return moving_share(particles.mass, np.sqrt(speed2)), float(0.5 * (particles.mass * speed2).sum())


def _layers(frame, placed, averaging):
    if not averaging.layers:
        return None
    return height_layers(frame, placed, averaging.bed, averaging.grid, averaging.layers)


def _bin(frame, placed, averaging, grid):
    return bin_frame(frame, placed, averaging.bed, grid, averaging.density, averaging.percentile)


def _stored(values):
    return {name: value.astype(np.float32) for name, value in values.items()}


def _fastest(cells, depth, min_depth):
    speed = map_speed(cells)[depth >= min_depth]
    return float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0


def _below_terrain(frame, placed, standoff, spacing, mass):
    """(share of the mass below the DTM, smallest distance [m]) of points; (0, 0) for columns."""
    if frame.dimension == 2:
        return 0.0, 0.0
    below, lowest = cell_places.below(placed.distance, frame.particles.mass, -_ROUNDING * spacing - standoff)
    return (float(below / mass), float(lowest + standoff)) if np.isfinite(lowest) else (0.0, 0.0)


def reached(frame: Frame, bed: Bed, axes: Grid) -> tuple | None:
    """Find the bounds of the flow on the DTM.

    Parameters
    ----------
    frame : Frame
        Only `position` of its particles is used, and `area` of columns (their full ground area counts).
    bed : Bed
    axes : Grid
        `export_axes` of the bounds.

    Returns
    -------
    (float, float, float, float) or None
        First column, first row, last column, last row [m]; None without flow.
    """
    particles, bounds = frame.particles, np.empty(4)
    half = column_reach(frame) if frame.dimension == 2 else np.zeros(1)
    origin = np.asarray(frame.origin, float)
    count = cell_places.reach(
        particles.position,
        half,
        origin,
        bed.grid.corner,
        bed.grid.axes,
        bed.elevation,
        bed.clamped and frame.dimension == 3,
        axes.corner,
        axes.axes,
        bounds,
    )
    return tuple(bounds.tolist()) if count else None


def survey_frame(frame: Frame, bed: Bed, density: float, axes: Grid | None = None) -> FrameFacts:
    """Collect the data of a frame for the choice of the cell size and the standoff.

    Parameters
    ----------
    frame : Frame
    bed : Bed
    density : float [kg m-3]
        Of the release.
    axes : Grid, optional
        `export_axes` of the bounds (default: north-up).

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


def resting_offset(distance: np.ndarray, mass: np.ndarray) -> tuple[float, float]:
    """Find the depth below the DTM at which a grid-based code lets particles rest.

    Parameters
    ----------
    distance : float64[n] [m]
        From the bed, NaN where unknown.
    mass : float[n] [kg]

    Returns
    -------
    (float, float)
        Share of the mass below the bed, and the distance [m] with 1 % of the mass below it.
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


def automatic_standoff(facts: Sequence) -> float:
    """Choose the standoff [m] by the frame with the largest share of its mass below the bed.

    It is the distance with 1 % of that frame's mass below it, and 0 if the share is under 1 %. Grid-based codes apply
    the bed condition at nodes and not at the DTM, so particles rest up to a cell below the DTM, and all distances are
    too small by this offset.

    Parameters
    ----------
    facts : sequence of FrameFacts
    """
    deepest = max(facts, key=lambda fact: fact.below)
    return deepest.offset if deepest.below >= RESTING_BELOW else 0.0


def fastest_mean(frame: Frame, bed: Bed, grid: Grid, density: float) -> float:
    """Compute the largest depth-averaged horizontal speed [m s-1] over the cells of a grid (for Eq 17).

    Parameters
    ----------
    frame : Frame
    bed : Bed
    grid : Grid
    density : float [kg m-3]
    """
    speed = map_speed(bin_frame(frame, place(frame, bed), bed, grid, density))
    return float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0


def cells_of(grid: Grid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Find the cell of a grid that contains each map point.

    Parameters
    ----------
    grid : Grid
    x, y : float64[n] [m]

    Returns
    -------
    int64[n]
        Flat number of the cell; NOWHERE outside the grid.
    """
    row, column = (np.floor(place + 0.5).astype(np.int64) for place in grid.rowcol(x, y))
    rows, columns = grid.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return np.where(inside, row * columns + column, NOWHERE)


def pick(index: np.ndarray, values: np.ndarray, empty: float, cells: np.ndarray) -> np.ndarray:
    """Select the values of some cells.

    Parameters
    ----------
    index : int64[k]
        Flat numbers of the cells with a value, ascending.
    values : float[k]
    empty : float
        Value of the grid's other cells.
    cells : int64[n]
        Flat numbers, or NOWHERE.

    Returns
    -------
    float64[n]
        NaN outside the grid.
    """
    result = np.where(cells == NOWHERE, np.nan, empty)
    if len(index):
        at = np.minimum(np.searchsorted(index, cells), len(index) - 1)
        known = index[at] == cells
        result[known] = values[at[known]]
    return result


def frame_at_cells(frame: Frame, averaging: Averaging, cells: np.ndarray) -> dict:
    """Average a frame as in the export's rasters, and select the values of some cells.

    Parameters
    ----------
    frame : Frame
    averaging : Averaging
    cells : int64[n]
        Flat numbers in `averaging.grid`, or NOWHERE.

    Returns
    -------
    dict of str to float64[n]
        By product.
    """
    found = average_frame(frame, averaging)
    return {name: pick(found.index, found.values[name], PRODUCTS[name].empty, cells) for name in averaging.names}


def nearest_times(times: np.ndarray, wanted: np.ndarray) -> list[int]:
    """Find the frames nearest to given times, without repetition; the earlier of two equally near ones.

    Parameters
    ----------
    times, wanted : float64[n] [s], float64[m] [s]
        Of the frames; given.

    Returns
    -------
    list of int
        Numbers of the frames, ascending.
    """
    gaps = np.abs(np.asarray(times, float)[None, :] - np.asarray(wanted, float)[:, None])
    return sorted({int(k) for k in np.argmin(gaps, axis=1)})
