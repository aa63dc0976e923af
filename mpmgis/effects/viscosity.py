"""In-plane viscous stress: the flow resists being sheared and stretched in the plane of the map."""

from math import sqrt
from typing import NamedTuple


class NoViscosity(NamedTuple):
    """The null law: no stress but pressure."""

    null: float = 0.0  # the compiler wants at least one field

    def viscosity_active(self):
        return False

    def apparent_viscosity(self, thickness, u, v, dxx, dxy, dyy):
        return 0.0


class InPlaneViscosity(NamedTuple):
    """sigma = (tau_y / sqrt(II + e^2) + 2 eta) D (Bingham, regularised; Fois et al. 2024; design notes 3.5)."""

    viscosity: float  # eta [Pa s]
    yield_stress: float  # tau_y [Pa]

    def viscosity_active(self):
        return True

    def apparent_viscosity(self, thickness, u, v, dxx, dxy, dyy):
        """eta_eff [Pa s] in sigma = 2 eta_eff D; II = D:D / 2 over the full symmetric D, sheared as by a column."""
        dzz = -(dxx + dyy)
        shear2 = 0.25 * (u * u + v * v) * (1.5 / max(thickness, 1e-3)) ** 2
        second = 0.5 * (dxx * dxx + dyy * dyy + dzz * dzz) + dxy * dxy + shear2
        return self.viscosity + 0.5 * self.yield_stress / sqrt(second + 1e-6)
