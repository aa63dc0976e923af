"""One frame turned into the values of its cells: the unit of work that is mapped over frames."""

from dataclasses import dataclass

import numpy as np

from ..geo.grid import Grid
from ..kernels import binning
from .bed import Bed, place
from .cells import bin_frame, column_side, column_spacing
from .depth_average import map_speed
from .maxima import least_depth
from .table import cell_values

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
    below, lowest = binning.below(placed.distance, frame.particles.mass, -_ROUNDING * spacing - standoff)
    return (float(below / mass), float(lowest + standoff)) if np.isfinite(lowest) else (0.0, 0.0)
