"""In-plane viscous stress: the flow resists being sheared and stretched in the plane of the map."""

from math import sqrt
from typing import NamedTuple

from .friction import plug_ratio


class NoViscosity(NamedTuple):
    """The null law: pressure only."""

    null: float = 0.0  # the compiler requires a field

    def viscosity_active(self):
        return False

    def apparent_viscosity(self, thickness, u, v, dxx, dxy, dyy):
        return 0.0


class InPlaneViscosity(NamedTuple):
    """Viscosity and yield stress for shear and stretching in the plane of the map (Bingham, regularised).

    sigma = (tau_y / sqrt(II + e^2) + 2 eta) D with e = 1e-3 s-1 and II = D:D / 2 over the full symmetric D of a column,
    sheared by 3 u / ((2 + Z) h) at its bed (Z of `plug_ratio`) and thinned by dzz = -div u (Fois et al. 2024).
    Mudflows: eta 1 to 500 Pa s, tau_y 10 to 2000 Pa. It matters where the flow is as thick as wide.
    The solver limits eta_eff to the value that the time step allows, rho dx^2 / (8 dt), and counts these columns.
    """

    viscosity: float  # eta [Pa s]
    yield_stress: float  # tau_y [Pa]

    plug_ratio = plug_ratio

    def viscosity_active(self):
        return True

    def apparent_viscosity(self, thickness, u, v, dxx, dxy, dyy):
        """eta_eff [Pa s] in sigma = 2 eta_eff D; thickness [m], velocity [m s-1], its symmetric gradient [s-1]."""
        apparent = self.viscosity
        if self.yield_stress > 1e-6:  # less than that is none
            deep = max(thickness, 1e-3)
            speed = sqrt(u * u + v * v)
            bed_shear = 1.5 * speed / ((2.0 + self.plug_ratio(deep, speed)) * deep)  # D_xz
            dzz = -(dxx + dyy)
            second = 0.5 * (dxx * dxx + dyy * dyy + dzz * dzz) + dxy * dxy + bed_shear * bed_shear
            apparent += 0.5 * self.yield_stress / sqrt(second + 1e-6)
        return apparent
