"""Quantities of an export: one function for each equation of NHESS 25:3897, and the table of all products.

Each function takes `Cells` and returns float64[k], NaN for unknown values. They are valid for points and for columns:
in `Cells` the largest distance of a column from the bed is its thickness, and the smallest is 0.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from ...system.errors import InputError
from . import binning
from .cell_averages import Cells

ALWAYS = ("h", "t", "Un", "Ut", "t_vol")  # bands of every step
RUNNING = "maxima"  # stands for the maxima up to each step


def flow_depth(cells: Cells) -> np.ndarray:
    """Compute h [m], the largest distance from the bed, normal to it, at least 0 (Eq 7).

    Parameters
    ----------
    cells : Cells
    """
    return np.maximum(cells.top, 0.0)


def flow_thickness(cells: Cells) -> np.ndarray:
    """Compute t [m], the largest minus the smallest distance from the bed (Eq 8).

    Parameters
    ----------
    cells : Cells
    """
    return cells.top - cells.lowest


def normal_velocity(cells: Cells) -> np.ndarray:
    """Compute Un [m s-1], the mean of U . n, weighted by mass; positive away from the bed (Eqs 9, 13).

    Parameters
    ----------
    cells : Cells
    """
    return cells.mean(binning.NORMAL)


def parallel_speed(cells: Cells) -> np.ndarray:
    """Compute Ut [m s-1], the length of the mean slope-parallel velocity, weighted by mass (Eqs 10, 14).

    Parameters
    ----------
    cells : Cells
    """
    return np.sqrt(cells.mean_square(binning.PARALLEL))


def parallel_velocity_east(cells: Cells) -> np.ndarray:
    """Compute Ut_E [m s-1], the east component of the mean slope-parallel velocity.

    Parameters
    ----------
    cells : Cells
    """
    return cells.mean(binning.PARALLEL)


def parallel_velocity_north(cells: Cells) -> np.ndarray:
    """Compute Ut_N [m s-1], the north component of the mean slope-parallel velocity.

    Parameters
    ----------
    cells : Cells
    """
    return cells.mean(binning.PARALLEL + 1)


def volume_thickness(cells: Cells) -> np.ndarray:
    """Compute t_vol [m], the sum of m / density times n_H, divided by the cell area; conserves mass.

    Parameters
    ----------
    cells : Cells
    """
    thickness = cells.sums[:, binning.UPRIGHT] / (cells.density * cells.cell_area)
    return np.where(cells.sums[:, binning.SLOPED] > 0, thickness, np.nan)


def particle_count(cells: Cells) -> np.ndarray:
    """Return n [1], the number of particles in each cell.

    Parameters
    ----------
    cells : Cells
    """
    return cells.count.astype(float)


def areal_mass(cells: Cells) -> np.ndarray:
    """Compute the mass per plan area [kg m-2]; its sum times the cell area is the particles' mass.

    Parameters
    ----------
    cells : Cells
    """
    return cells.sums[:, binning.MASS] / cells.cell_area


def impact_pressure(cells: Cells) -> np.ndarray:
    """Compute p [Pa], the density of the release times the squared mean velocity.

    Parameters
    ----------
    cells : Cells
    """
    return cells.density * cells.mean_square(binning.MOMENTUM)


def detached(cells: Cells) -> np.ndarray:
    """Return 1 where the lowest particle is above the bed by more than a solver cell and a fifth of h, else 0.

    Parameters
    ----------
    cells : Cells
    """
    if cells.spacing == 0:
        return np.zeros(len(cells.index))
    clear = cells.lowest > np.maximum(cells.spacing, 0.2 * flow_depth(cells))
    return np.where(np.isnan(cells.lowest), np.nan, clear)


def map_speed(cells: Cells) -> np.ndarray:
    """Compute the horizontal speed of the mean velocity [m s-1], as in Eq 17.

    Parameters
    ----------
    cells : Cells
    """
    return np.hypot(cells.mean(binning.MOMENTUM), cells.mean(binning.MOMENTUM + 1))


class Product(NamedTuple):
    """Definition of a band.

    Parameters
    ----------
    compute : callable
        Of `Cells`.
    empty : float
        Value in cells without particles.
    needs_depth : bool
        The band is nodata where the flow is shallower than the smallest depth.
    """

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


def more_products() -> tuple[str, ...]:
    """Return the names of what can be asked for in addition to the bands of every step."""
    return (*(name for name in PRODUCTS if name not in ALWAYS), RUNNING)


def choose_products(asked: Iterable[str]) -> tuple[str, ...]:
    """Return the bands of a step: the default bands and those asked for, in the order of the table.

    Parameters
    ----------
    asked : iterable of str

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
    """Compute products of cells; velocities are NaN where the flow is shallower than `min_depth`.

    Parameters
    ----------
    cells : Cells
    names : iterable of str
        Of PRODUCTS.
    min_depth : float [m]

    Returns
    -------
    dict of str to float64[k]
    """
    too_shallow = ~(flow_depth(cells) >= min_depth)
    values = {}
    for name in names:
        product = PRODUCTS[name]
        values[name] = product.compute(cells)
        if product.needs_depth:
            values[name] = np.where(too_shallow, np.nan, values[name])
    return values
