"""The quantities of an export: one function for each equation of NHESS 25:3897, and the table of all products.

Each function takes `Cells` and returns float64[k], NaN for unknown values. They are valid for points and for columns:
in `Cells` the largest distance of a column from the bed is its thickness, and the smallest is 0.

Density and impact pressure of frames of points in layers of height over the bed, by map cell.

The outlook of Vicari et al. (2025, NHESS 25:3897) names these rasters. A point has the height of a cube of its volume
and is shared among the layers that it overlaps, as in the vertical profiles of `profiles`.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...frames.particles import Frame
from ...laws.quantities import Quantity
from ...system.errors import InputError
from ...terrain.grid import Grid
from . import binning
from .cells import Bed, Cells, Placed, flat_cells, place

ALWAYS = ("h", "t", "Un", "Ut")
RUNNING = "maxima"
OUTSIDE = Quantity("mass_outside", "kg m-2", "mass outside all height intervals, per plan area", "float32")


def flow_depth(cells: Cells) -> np.ndarray:
    """h [m]: largest distance from the bed, normal to it, at least 0 (Eq 7)."""
    return np.maximum(cells.top, 0.0)


def flow_thickness(cells: Cells) -> np.ndarray:
    """t [m]: largest minus smallest distance from the bed (Eq 8)."""
    return cells.top - cells.lowest


def normal_velocity(cells: Cells) -> np.ndarray:
    """Un [m s-1]: mean of U . n, weighted by mass; positive away from the bed (Eqs 9, 13)."""
    return cells.mean(binning.NORMAL)


def parallel_speed(cells: Cells) -> np.ndarray:
    """Ut [m s-1]: length of the mean slope-parallel velocity, weighted by mass (Eqs 10, 14)."""
    return np.linalg.norm(cells.mean_vector(binning.PARALLEL), axis=1)


def parallel_velocity_east(cells: Cells) -> np.ndarray:
    """Ut_E [m s-1]: east component of the mean slope-parallel velocity."""
    return cells.mean(binning.PARALLEL)


def parallel_velocity_north(cells: Cells) -> np.ndarray:
    """Ut_N [m s-1]: north component of the mean slope-parallel velocity."""
    return cells.mean(binning.PARALLEL + 1)


def volume_thickness(cells: Cells) -> np.ndarray:
    """t_vol [m]: sum of m / density times n_H, divided by the cell area; conserves mass."""
    thickness = cells.sums[:, binning.UPRIGHT] / (cells.density * cells.cell_area)
    return np.where(cells.sums[:, binning.SLOPED] > 0, thickness, np.nan)


def particle_count(cells: Cells) -> np.ndarray:
    """n [1]: particles in the cell."""
    return cells.count.astype(float)


def areal_mass(cells: Cells) -> np.ndarray:
    """mass [kg m-2]: per plan area; its sum times the cell area is the particles' mass."""
    return cells.sums[:, binning.MASS] / cells.cell_area


def impact_pressure(cells: Cells) -> np.ndarray:
    """p [Pa]: density of the release times the squared mean velocity."""
    return cells.density * np.sum(cells.mean_vector(binning.MOMENTUM) ** 2, axis=1)


def detached(cells: Cells) -> np.ndarray:
    """1 where the lowest particle is above the bed by more than a solver cell and a fifth of h, else 0."""
    if cells.spacing == 0:
        return np.zeros(len(cells.index))
    clear = cells.lowest > np.maximum(cells.spacing, 0.2 * flow_depth(cells))
    return np.where(np.isnan(cells.lowest), np.nan, clear)


def map_speed(cells: Cells) -> np.ndarray:
    """Horizontal speed of the mean velocity [m s-1], as in Eq 17."""
    return np.hypot(cells.mean(binning.MOMENTUM), cells.mean(binning.MOMENTUM + 1))


class Product(NamedTuple):
    """Definition of a band: `compute(cells)`, its value in `empty` cells, and whether it needs `min_depth` of flow."""

    compute: Callable
    empty: float
    needs_depth: bool


PRODUCTS = {
    "h": Product(flow_depth, 0.0, False),
    "t": Product(flow_thickness, 0.0, False),
    "Un": Product(normal_velocity, np.nan, True),
    "Ut": Product(parallel_speed, np.nan, True),
    "Ut_E": Product(parallel_velocity_east, np.nan, True),
    "Ut_N": Product(parallel_velocity_north, np.nan, True),
    "t_vol": Product(volume_thickness, 0.0, False),
    "n": Product(particle_count, 0.0, False),
    "mass": Product(areal_mass, 0.0, False),
    "p": Product(impact_pressure, np.nan, True),
    "detached": Product(detached, np.nan, False),
}


def choose_products(asked: Iterable[str]) -> tuple[str, ...]:
    """The bands of a step: the four default bands and those `asked` for, in the order of the table.

    Raises
    ------
    InputError
        A name neither in the table nor `maxima`.
    """
    for name in asked:
        if name not in PRODUCTS and name != RUNNING:
            known = ", ".join([*PRODUCTS, RUNNING])
            raise InputError(f"--products: unknown product {name!r}; choose from {known}")
    return tuple(name for name in PRODUCTS if name in ALWAYS or name in asked)


def cell_values(cells: Cells, names: Iterable[str], min_depth: float) -> dict[str, np.ndarray]:
    """Name -> float64[k] of the products `names`; velocities are NaN where the flow is shallower than `min_depth`."""
    too_shallow = ~(flow_depth(cells) >= min_depth)
    values = {}
    for name in names:
        product = PRODUCTS[name]
        values[name] = product.compute(cells)
        if product.needs_depth:
            values[name] = np.where(too_shallow, np.nan, values[name])
    return values


class HeightLayers(NamedTuple):
    """Layers of the cells with particles of one frame.

    `index` int64[k]: flat numbers of the cells, ascending. `density` float64[k, layers] [kg m-3], 0 in an empty layer;
    `pressure` float64[k, layers] [Pa]: density times the squared mean velocity, 0 in an empty layer. `outside`
    float64[k] [kg m-2]: mass outside all layers per plan area, with points where the slope is not known. `upright`
    float64[k] [1]: vertical component of the bed's normal, mean by mass.

    The sum of density times thickness is the mass in the layers per area of the bed, which is the plan area over
    `upright`. So cell_area (sum of density thickness / upright + outside) is the mass of the cell.
    """

    index: np.ndarray
    density: np.ndarray
    pressure: np.ndarray
    outside: np.ndarray
    upright: np.ndarray

    def bands(self) -> list[np.ndarray]:
        """Values of the bands of `layer_quantities`, float64[k] each."""
        layered = [values[:, k] for k in range(self.density.shape[1]) for values in (self.density, self.pressure)]
        return [*layered, self.outside]


def layer_quantities(edges: Sequence) -> list[Quantity]:
    """A Quantity for each band: density and pressure of each layer between `edges` [m], mass outside."""
    found = []
    for low, high in pairwise(edges):
        words = f"from {low:g} to {high:g} m over the bed, along its normal"
        found += [
            Quantity(f"rho_{low:g}_{high:g}", "kg m-3", f"density {words}", "float32"),
            Quantity(f"p_{low:g}_{high:g}", "Pa", f"impact pressure {words}, density times squared speed", "float32"),
        ]
    return [*found, OUTSIDE]


def point_extents(volume: np.ndarray, placed: Placed, bed: Bed) -> tuple[np.ndarray, np.ndarray]:
    """(lower, upper) float64[n] [m]: height range of a point (side of a cube), cut at the bed for points above it."""
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
    """`height_layers` of a frame whose particles are not placed yet."""
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
