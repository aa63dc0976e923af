"""The quantities of an export: one function for each equation of NHESS 25:3897, and the table of all products.

Each takes `Cells` and gives float64[k], NaN where the cell has none. They hold for points and for columns, because
a column's thickness stands in `Cells` as its highest distance from the bed, above a lowest of 0.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..kernels import binning
from . import quantities as average


def flow_depth(cells):
    """h [m]: largest distance from the bed, normal to it, at least 0 (Eq 7)."""
    return np.maximum(cells.top, 0.0)


def flow_thickness(cells):
    """t [m]: largest minus smallest distance from the bed (Eq 8)."""
    return cells.top - cells.lowest


def normal_velocity(cells):
    """Un [m s-1]: mean of U . n, weighted by mass; positive leaves the bed (Eqs 9, 13; X2)."""
    return cells.mean(binning.NORMAL)


def parallel_speed(cells):
    """Ut [m s-1]: length of the mean slope-parallel velocity, weighted by mass (Eqs 10, 14; X2)."""
    return np.linalg.norm(cells.mean_vector(binning.PARALLEL), axis=1)


def parallel_velocity_east(cells):
    """Ut_E [m s-1]: east part of the mean slope-parallel velocity."""
    return cells.mean(binning.PARALLEL)


def parallel_velocity_north(cells):
    """Ut_N [m s-1]: north part of the mean slope-parallel velocity."""
    return cells.mean(binning.PARALLEL + 1)


def volume_thickness(cells):
    """t_vol [m]: sum of m / density times n_H, over the cell's area; conserves mass (design note X5)."""
    thickness = cells.sums[:, binning.UPRIGHT] / (cells.density * cells.cell_area)
    return np.where(cells.sums[:, binning.SLOPED] > 0, thickness, np.nan)


def particle_count(cells):
    """n [1]: particles whose position lies in the cell."""
    return cells.count.astype(float)


def areal_mass(cells):
    """mass [kg m-2]: per plan area; times the cell's area it sums to the particles' mass (design notes 5.3)."""
    return cells.sums[:, binning.MASS] / cells.cell_area


def impact_pressure(cells):
    """p [Pa]: density of the release times the squared mean velocity."""
    return cells.density * np.sum(cells.mean_vector(binning.MOMENTUM) ** 2, axis=1)


def detached(cells):
    """1 where the lowest particle is clear of the bed by more than a solver cell and a fifth of h, else 0 (X10)."""
    if cells.spacing == 0:
        return np.zeros(len(cells.index))
    clear = cells.lowest > np.maximum(cells.spacing, 0.2 * flow_depth(cells))
    return np.where(np.isnan(cells.lowest), np.nan, clear)


def map_speed(cells):
    """Speed of the mean velocity in the map plane [m s-1], the one that Eq 17 means."""
    return np.hypot(cells.mean(binning.MOMENTUM), cells.mean(binning.MOMENTUM + 1))


ALWAYS = ("h", "t", "Un", "Ut")
RUNNING = "maxima"


class Product(NamedTuple):
    """How a band is made: `compute(cells)`, its value in `empty` cells, and whether it needs `min_depth` of flow."""

    compute: Callable
    empty: float
    needs_depth: bool


PRODUCTS = {
    "h": Product(average.flow_depth, 0.0, False),
    "t": Product(average.flow_thickness, 0.0, False),
    "Un": Product(average.normal_velocity, np.nan, True),
    "Ut": Product(average.parallel_speed, np.nan, True),
    "Ut_E": Product(average.parallel_velocity_east, np.nan, True),
    "Ut_N": Product(average.parallel_velocity_north, np.nan, True),
    "t_vol": Product(average.volume_thickness, 0.0, False),
    "n": Product(average.particle_count, 0.0, False),
    "mass": Product(average.areal_mass, 0.0, False),
    "p": Product(average.impact_pressure, np.nan, True),
    "detached": Product(average.detached, np.nan, False),
}


def choose_products(asked):
    """The bands of a step: the four that are always there and those `asked` for, in the table's order.

    Raises
    ------
    InputError
        A name that is neither in the table nor `maxima`.
    """
    for name in asked:
        if name not in PRODUCTS and name != RUNNING:
            known = ", ".join([*PRODUCTS, RUNNING])
            raise InputError(f"--products: there is no product {name!r}; choose from {known}")
    return tuple(name for name in PRODUCTS if name in ALWAYS or name in asked)


def cell_values(cells, names, min_depth):
    """Name -> float64[k] of the products `names`; velocities are NaN where the flow is shallower than `min_depth`."""
    too_shallow = ~(average.flow_depth(cells) >= min_depth)
    values = {}
    for name in names:
        product = PRODUCTS[name]
        values[name] = product.compute(cells)
        if product.needs_depth:
            values[name] = np.where(too_shallow, np.nan, values[name])
    return values
