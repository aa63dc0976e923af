"""Stress in the plane of a depth-averaged flow: earth pressure of granular flows, and viscous stress."""

from math import cos, radians, sqrt
from typing import NamedTuple

from .friction import plug_ratio

# Compression in one time step over which K changes from active to passive. With a twentieth of that, and the mean K at
# rest, the push alternates between the two from column to column: 16 % error in a dam break whose exact solution is
# Ritter's with K_active, against 1.7 % (measured 2026-11-21).
SWITCH = 0.02


class NoEarthPressure(NamedTuple):
    """The null law: the push is hydrostatic, K = 1."""

    null: float = 0.0  # the compiler requires a field

    def earth_pressure_active(self):
        return False

    def pressure_factor(self, rate, time_step):
        return 1.0

    def largest_factor(self):
        return 1.0


class EarthPressure(NamedTuple):
    """Push along the slope over push normal to it: less than 1 where the flow stretches, more where it is compressed.

    K_active where the flow stretches along its own direction, K_passive where it is compressed (Savage & Hutter 1989),
    of `earth_pressure`. One factor for all directions: the push across the flow gets it too. Laboratory sands and
    gravels phi 25 to 45, delta 15 to 35 degrees; snow and debris flows are commonly run with K = 1.
    """

    active: float  # [1]
    passive: float  # [1]

    def earth_pressure_active(self):
        return True

    def pressure_factor(self, rate, time_step):
        """K [1] for a stretching `rate` [s-1] along the flow: active from rest on, passive below -SWITCH / dt."""
        compressed = min(max(-rate * time_step / SWITCH, 0.0), 1.0)
        return self.active + compressed * (self.passive - self.active)

    def largest_factor(self):
        """Largest K [1]: the wave speed for the time step is proportional to its root."""
        return max(self.active, self.passive)


def earth_pressure(friction_angle, bed_friction_angle):
    """`EarthPressure` of an internal and a bed friction angle phi and delta <= phi [deg] (Hutter et al. 1993).

    K = 2 / cos^2 phi (1 -+ sqrt(1 - cos^2 phi / cos^2 delta)) - 1, minus where active. delta = 0 is Rankine's
    tan^2(45 -+ phi / 2), delta = phi the 2 / cos^2 phi - 1 of a layer about to fail.
    """
    cos2_phi, cos2_delta = cos(radians(friction_angle)) ** 2, cos(radians(bed_friction_angle)) ** 2
    root = sqrt(max(1.0 - cos2_phi / cos2_delta, 0.0))
    return EarthPressure(2.0 / cos2_phi * (1.0 - root) - 1.0, 2.0 / cos2_phi * (1.0 + root) - 1.0)


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
