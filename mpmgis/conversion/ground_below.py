"""The bed under columns and points, and the stress of a load on it."""

from dataclasses import dataclass

import numpy as np

from ..system.errors import InputError
from ..terrain.elevation import Terrain, bilinear

_MARGIN = 3  # [pixels] beyond the particles, so that gradients under them are central


@dataclass(frozen=True)
class Ground:
    """Bilinear height of a terrain, and its gradient limited at cliff edges, interpolated likewise."""

    terrain: Terrain

    @classmethod
    def under(cls, terrain, x, y, reach=0.0):
        """The ground below map points `x`, `y` [m] and up to `reach` [m] around them."""
        bounds = (x.min() - reach, y.min() - reach, x.max() + reach, y.max() + reach)
        return cls(terrain.cropped(bounds, _MARGIN))

    def height(self, x, y):
        """float64[n] [m]; NaN off the terrain and next to nodata."""
        return self.terrain.sample(x, y)

    def gradient(self, x, y):
        """(db/dE, db/dN), float64[n] each; NaN where there is no height."""
        row, column = self.terrain.grid.rowcol(x, y)
        slopes = self.terrain.limited_gradient
        return tuple(bilinear(slopes[..., axis], row, column) for axis in (0, 1))


def slope_cosine(gradient_east, gradient_north):
    """Cosine of the slope angle."""
    return 1.0 / np.sqrt(1.0 + gradient_east**2 + gradient_north**2)


def vertical_stress(density, gravity, depth, cosine):
    """float64[n] [Pa]: -rho g c^2 d, the load of `depth` [m] (vertical) on a slope of `cosine` c."""
    return -density * gravity * cosine**2 * depth


def vertical_strain(stress, bulk_modulus, shear_modulus):
    """float64[n] [1]: Hencky strain e_zz of a point confined sideways, all other components 0; K0 follows.

    `stress` [Pa] vertical, moduli [Pa]. The return mapping of the material then removes excess stress.
    """
    stiffness = bulk_modulus + 4.0 / 3.0 * shear_modulus
    if not stiffness > 0:
        raise InputError(f"confined modulus K + 4 G / 3 is {stiffness:g} Pa, expected above 0")
    return stress / stiffness


def volume_ratio(density, gravity, depth, bulk_modulus):
    """float64[n] [1]: J of a weakly compressible fluid under `depth` [m] of itself, 1 - rho g d / K."""
    if not bulk_modulus > 0:
        raise InputError(f"bulk modulus is {bulk_modulus:g} Pa, expected above 0")
    return 1.0 - density * gravity * depth / bulk_modulus
