"""Average points over the cells of a map and layers of height over the bed: density and impact pressure.

The outlook of Vicari et al. (2025, NHESS 25:3897) names these rasters. A point has the height of a cube of its volume
and is shared among the layers that it overlaps, as in the vertical profiles of `profiles`.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...frames.particles import Frame
from ...laws.quantities import MASS, Quantity
from ...terrain.grid import Grid
from .cell_averages import flat_cells
from .placement import Bed, Placed, place

OUTSIDE = Quantity("mass_outside", "kg m-2", "mass outside all height intervals, per plan area", "float32", MASS)


class HeightLayers(NamedTuple):
    """Layers of the cells with particles of one frame.

    The sum of density times thickness is the mass in the layers per area of the bed, which is the plan area over
    `upright`. So cell_area (sum of density thickness / upright + outside) is the mass of the cell.

    Parameters
    ----------
    index : int64[k]
        Flat numbers of the cells, ascending.
    density : float64[k, layers] [kg m-3]
        0 in an empty layer.
    pressure : float64[k, layers] [Pa]
        Density times the squared mean velocity, 0 in an empty layer.
    outside : float64[k] [kg m-2]
        Mass outside all layers per plan area, with points where the slope is not known.
    upright : float64[k] [1]
        Vertical component of the bed's normal, mean by mass.
    """

    index: np.ndarray
    density: np.ndarray
    pressure: np.ndarray
    outside: np.ndarray
    upright: np.ndarray

    def bands(self) -> list[np.ndarray]:
        """Return the values of the bands of `layer_quantities`, float64[k] each."""
        layered = [values[:, k] for k in range(self.density.shape[1]) for values in (self.density, self.pressure)]
        return [*layered, self.outside]


def layer_quantities(edges: Sequence) -> list[Quantity]:
    """Return the quantities of the bands: density and pressure of each layer, then the mass outside.

    Parameters
    ----------
    edges : sequence of float [m]
        Of the layers, ascending.
    """
    found = []
    for low, high in pairwise(edges):
        words = f"from {low:g} to {high:g} m over the bed, along its normal"
        found += [
            Quantity(f"rho_{low:g}_{high:g}", "kg m-3", f"density {words}", "float32"),
            Quantity(f"p_{low:g}_{high:g}", "Pa", f"impact pressure {words}, density times squared speed", "float32"),
        ]
    return [*found, OUTSIDE]


def point_extents(volume: np.ndarray, placed: Placed, bed: Bed) -> tuple[np.ndarray, np.ndarray]:
    """Compute the range of height of points, each as high as the side of a cube, cut at the bed for points above it.

    Parameters
    ----------
    volume : float[n] [m3]
    placed : Placed
    bed : Bed

    Returns
    -------
    (float64[n], float64[n])
        Lower and upper end [m], over the bed along its normal.
    """
    slope = bed.gradient_by_pixel[placed.pixel]
    side = np.cbrt(np.asarray(volume, float)) / np.sqrt(1.0 + (slope**2).sum(axis=-1))
    lower, upper = placed.distance - 0.5 * side, placed.distance + 0.5 * side
    return np.where(placed.distance >= 0, np.maximum(lower, 0.0), lower), upper


def height_layers(frame: Frame, placed: Placed, bed: Bed, grid: Grid, edges: Sequence) -> HeightLayers:
    """Average the points of `frame` over the cells of `grid` and the layers between `edges` [m].

    Parameters
    ----------
    frame : Frame
        Of dimension 3.
    placed : Placed
        Its particles on `bed`.
    bed : Bed
    grid : Grid
    edges : sequence of float [m]
        Ascending heights over the bed. Where the first is 0, material below the bed counts in the first layer.

    Returns
    -------
    HeightLayers
    """
    cell = flat_cells(frame, placed, grid, bed.clamped)
    within = cell >= 0
    mass = np.asarray(frame.particles.mass, float)
    index, number = np.unique(cell[within], return_inverse=True)
    sloped = np.isfinite(placed.distance[within])
    keep = np.flatnonzero(within)[sloped]
    part = Placed(placed.pixel[keep], placed.distance[keep])
    upright = _mean_upright(part, bed, mass[keep], number[sloped], len(index))
    shares = _shares(frame.particles.volume[keep], part, bed, edges)
    momentum = mass[keep, None] * np.asarray(frame.particles.velocity, float)[keep]
    density, pressure = np.zeros((2, len(index), len(shares)))
    for k, (share, thickness) in enumerate(zip(shares, np.diff(edges), strict=True)):
        held = _sum(number[sloped], mass[keep] * share, len(index))
        moving = np.stack([_sum(number[sloped], momentum[:, axis] * share, len(index)) for axis in range(3)])
        density[:, k] = held * upright / (grid.cell_area * thickness)
        speed = np.divide(moving, held, out=np.zeros_like(moving), where=held > 0)
        pressure[:, k] = density[:, k] * (speed**2).sum(axis=0)
    left = mass[within].copy()
    left[sloped] *= np.clip(1.0 - shares.sum(axis=0), 0.0, 1.0)
    return HeightLayers(index, density, pressure, _sum(number, left, len(index)) / grid.cell_area, upright)


def frame_layers(frame: Frame, bed: Bed, grid: Grid, edges: Sequence) -> HeightLayers:
    """Return the `height_layers` of a frame whose particles are not placed yet.

    Parameters
    ----------
    frame : Frame
    bed : Bed
    grid : Grid
    edges : sequence of float [m]
    """
    return height_layers(frame, place(frame, bed), bed, grid, edges)


def _sum(number, values, count):
    return np.bincount(number, values, count)


def _mean_upright(part, bed, mass, number, count):
    """float64[cells]: vertical component of the bed's normal, mean by mass; 1 in cells without slope."""
    upright = 1.0 / np.sqrt(1.0 + (bed.gradient_by_pixel[part.pixel] ** 2).sum(axis=-1))
    held = _sum(number, mass, count)
    return np.divide(_sum(number, mass * upright, count), held, out=np.ones(count), where=held > 0)


def _shares(volume, part, bed, edges):
    """float64[layers, n]: part of each point in each layer."""
    lower, upper = point_extents(volume, part, bed)
    floors = np.array(edges[:-1], float)
    floors[0] = -np.inf if edges[0] <= 0 else floors[0]
    tops = np.array(edges[1:], float)
    overlap = np.minimum(upper, tops[:, None]) - np.maximum(lower, floors[:, None])
    return np.clip(overlap, 0.0, None) / (upper - lower)
