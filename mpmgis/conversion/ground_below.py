"""Bed below columns and points, and the stress of the weight of a column.

A conversion stores in the `state` of the frame, one row per point: `depth` [m], vertical, below the surface, and
`vertical_stress` [Pa], negative in compression. A material computes its strain from them; without it every layer would
first drop until its elasticity carries it.
"""

from dataclasses import dataclass

import numpy as np

from ..system.errors import InputError
from ..terrain.elevation import Terrain, bilinear

_MARGIN = 3  # [pixels] beyond the particles, so that gradients under them are central


@dataclass(frozen=True)
class GroundBelow:
    """Bilinear height of a terrain, and its gradient limited at cliff edges, interpolated likewise."""

    terrain: Terrain

    @classmethod
    def under(cls, terrain: Terrain, x: np.ndarray, y: np.ndarray, reach: float = 0.0) -> "GroundBelow":
        """Return the ground below map points.

        Parameters
        ----------
        terrain : Terrain
        x, y : float64[n] [m]
        reach : float [m]
            Also up to that distance around the points.
        """
        bounds = (x.min() - reach, y.min() - reach, x.max() + reach, y.max() + reach)
        return cls(terrain.cropped(bounds, _MARGIN))

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Interpolate the height of the ground.

        Parameters
        ----------
        x, y : float64[n] [m]

        Returns
        -------
        float64[n] [m]
            NaN off the terrain and next to nodata.
        """
        return self.terrain.sample(x, y)

    def gradient(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Interpolate the gradient of the ground.

        Parameters
        ----------
        x, y : float64[n] [m]

        Returns
        -------
        (float64[n], float64[n])
            db/dE and db/dN [1]; NaN where there is no height.
        """
        row, column = self.terrain.grid.rowcol(x, y)
        slopes = self.terrain.limited_gradient
        return tuple(bilinear(slopes[..., axis], row, column) for axis in (0, 1))


def slope_cosine(gradient_east: np.ndarray, gradient_north: np.ndarray) -> np.ndarray:
    """Compute the cosine of the slope angle.

    Parameters
    ----------
    gradient_east, gradient_north : float64[n] [1]
    """
    return 1.0 / np.sqrt(1.0 + gradient_east**2 + gradient_north**2)


def vertical_stress(
    density: float | np.ndarray, gravity: float, depth: float | np.ndarray, cosine: np.ndarray
) -> np.ndarray:
    """Compute the vertical stress -rho g c^2 d of a load on a slope.

    Parameters
    ----------
    density : float or float64[n] [kg m-3]
    gravity : float [m s-2]
    depth : float or float64[n] [m]
        Vertical, d.
    cosine : float64[n] [1]
        Of the slope, c.

    Returns
    -------
    float64[n] [Pa]
    """
    return -density * gravity * cosine**2 * depth


def vertical_strain(stress: np.ndarray, bulk_modulus: float, shear_modulus: float) -> np.ndarray:
    """Compute the Hencky strain e_zz of points confined sideways, all other components 0; K0 follows.

    The return mapping of the material then removes excess stress.

    Parameters
    ----------
    stress : float64[n] [Pa]
        Vertical.
    bulk_modulus, shear_modulus : float [Pa]

    Returns
    -------
    float64[n] [1]

    Raises
    ------
    InputError
        The confined modulus K + 4 G / 3 is not above 0.
    """
    stiffness = bulk_modulus + 4.0 / 3.0 * shear_modulus
    if not stiffness > 0:
        raise InputError(f"confined modulus K + 4 G / 3 is {stiffness:g} Pa, expected above 0")
    return stress / stiffness


def volume_ratio(density: float, gravity: float, depth: np.ndarray, bulk_modulus: float) -> np.ndarray:
    """Compute J = 1 - rho g d / K of a weakly compressible fluid under its own weight.

    Parameters
    ----------
    density : float [kg m-3]
    gravity : float [m s-2]
    depth : float64[n] [m]
    bulk_modulus : float [Pa]

    Returns
    -------
    float64[n] [1]

    Raises
    ------
    InputError
        The bulk modulus is not above 0.
    """
    if not bulk_modulus > 0:
        raise InputError(f"bulk modulus is {bulk_modulus:g} Pa, expected above 0")
    return 1.0 - density * gravity * depth / bulk_modulus
