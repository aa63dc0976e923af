"""The table of products: what a step's raster can hold. To add one, add a row here and its name to `fields.BAND`."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from . import depth_average as average

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
