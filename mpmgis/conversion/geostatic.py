"""Stress that a column's weight puts on its points, and the strain to start a 3D material with (design note E7).

A conversion keeps in the frame's `state`, a row a point: `depth` [m], vertical, under the surface, and
`vertical_stress` [Pa], negative in compression. A material makes its own strain of them; started without it every
layer would first drop onto its own elasticity.
"""

from ..errors import InputError


def vertical_stress(density, gravity, depth, cosine):
    """float64[n] [Pa]: -rho g c^2 d, the load of `depth` [m] (vertical) on a slope of `cosine` c."""
    return -density * gravity * cosine**2 * depth


def vertical_strain(stress, bulk_modulus, shear_modulus):
    """float64[n] [1]: Hencky strain e_zz of a point confined sideways, all other components 0; K0 follows.

    `stress` [Pa] vertical, moduli [Pa]. The material's own return mapping then takes what it cannot bear.
    """
    stiffness = bulk_modulus + 4.0 / 3.0 * shear_modulus
    if not stiffness > 0:
        raise InputError(f"confined modulus K + 4 G / 3 is {stiffness:g} Pa, wanted above 0")
    return stress / stiffness


def volume_ratio(density, gravity, depth, bulk_modulus):
    """float64[n] [1]: J of a weakly compressible fluid under `depth` [m] of itself, 1 - rho g d / K."""
    if not bulk_modulus > 0:
        raise InputError(f"bulk modulus is {bulk_modulus:g} Pa, wanted above 0")
    return 1.0 - density * gravity * depth / bulk_modulus
