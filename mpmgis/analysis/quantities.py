"""The quantities of an export: one function for each equation of NHESS 25:3897, and the table of all products.

Each function takes `Cells` and returns float64[k], NaN for unknown values. They are valid for points and for columns:
in `Cells` the largest distance of a column from the bed is its thickness, and the smallest is 0.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..kernels import binning
from .cells import Cells


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


ALWAYS = ("h", "t", "Un", "Ut")
RUNNING = "maxima"


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
