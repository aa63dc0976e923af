"""Stress in the plane of a depth-averaged flow: earth pressure of granular flows, and viscous stress."""

from math import cos, radians, sqrt
from typing import NamedTuple

from .friction import NO_YIELD_STRESS, plug_ratio

# Compression in one time step over which K changes from active to passive. With a twentieth of that, and the mean K at
# rest, the push alternates between the two from column to column: 16 % error in a dam break whose exact solution is
# Ritter's with K_active, against 1.7 % (measured 2026-11-21).
SWITCH = 0.02  # [1]
LEAST_THICKNESS = 1e-3  # [m] a divisor in place of a smaller thickness
LEAST_SQUARED_RATE = 1e-6  # [s-2] e^2 of the regularised yield stress


class EarthPressure(NamedTuple):
    """Push along the slope over push normal to it: less than 1 where the flow stretches, more where it is compressed.

    K_active where the flow stretches along its own direction, K_passive where it is compressed (Savage & Hutter 1989),
    of `earth_pressure`. One factor for all directions: the push across the flow gets it too. Laboratory sands and
    gravels phi 25 to 45, delta 15 to 35 degrees; snow and debris flows are commonly run with K = 1, as of water.
    """

    active: float = 1.0  # [1]
    passive: float = 1.0  # [1]


def is_hydrostatic(law: EarthPressure) -> bool:
    """Return whether the push is that of water, K = 1.

    Parameters
    ----------
    law : EarthPressure
    """
    return law.active == 1.0 and law.passive == 1.0


def pressure_factor(law: EarthPressure, rate: float, time_step: float) -> float:
    """Compute K [1]: active at rest and where the flow stretches, passive below a rate of -SWITCH / dt.

    Parameters
    ----------
    law : EarthPressure
    rate : float [s-1]
        Rate of stretching along the flow.
    time_step : float [s]
    """
    compressed = min(max(-rate * time_step / SWITCH, 0.0), 1.0)
    return law.active + compressed * (law.passive - law.active)


def largest_factor(law: EarthPressure) -> float:
    """Return the largest K [1]: the wave speed for the time step is proportional to its root.

    Parameters
    ----------
    law : EarthPressure
    """
    return max(law.active, law.passive)


def earth_pressure(friction_angle: float, bed_friction_angle: float) -> EarthPressure:
    """Make the `EarthPressure` of an internal friction angle phi and a bed friction angle delta (Hutter et al. 1993).

    K = 2 / cos^2 phi (1 -+ sqrt(1 - cos^2 phi / cos^2 delta)) - 1, minus where active. delta = 0 is Rankine's tan^2(45
    -+ phi / 2), delta = phi the 2 / cos^2 phi - 1 of a layer about to fail.

    Parameters
    ----------
    friction_angle : float [deg]
        phi.
    bed_friction_angle : float [deg]
        delta, at most phi.
    """
    cos2_phi, cos2_delta = cos(radians(friction_angle)) ** 2, cos(radians(bed_friction_angle)) ** 2
    root = sqrt(max(1.0 - cos2_phi / cos2_delta, 0.0))
    return EarthPressure(2.0 / cos2_phi * (1.0 - root) - 1.0, 2.0 / cos2_phi * (1.0 + root) - 1.0)


class InPlaneViscosity(NamedTuple):
    """Viscosity and yield stress for shear and stretching in the plane of the map (Bingham, regularised); 0: none.

    sigma = (tau_y / sqrt(II + e^2) + 2 eta) D with e = 1e-3 s-1 and II = D:D / 2 over the full symmetric D of a column,
    sheared by 3 u / ((2 + Z) h) at its bed (Z of `plug_ratio`) and thinned by dzz = -div u (Fois et al. 2024).
    Mudflows: eta 1 to 500 Pa s, tau_y 10 to 2000 Pa. It matters where the flow is as thick as wide.
    The solver limits eta_eff to the value that the time step allows, rho dx^2 / (8 dt), and counts these columns.
    """

    viscosity: float = 0.0  # eta [Pa s]
    yield_stress: float = 0.0  # tau_y [Pa]


def is_viscous(law: InPlaneViscosity) -> bool:
    """Return whether there is viscous stress in the plane.

    Parameters
    ----------
    law : InPlaneViscosity
    """
    return law.viscosity > 0.0 or law.yield_stress > 0.0


def apparent_viscosity(
    law: InPlaneViscosity, thickness: float, u: float, v: float, dxx: float, dxy: float, dyy: float
) -> float:
    """Compute eta_eff [Pa s] in sigma = 2 eta_eff D.

    Parameters
    ----------
    law : InPlaneViscosity
    thickness : float [m]
    u, v : float [m s-1]
        Velocity.
    dxx, dxy, dyy : float [s-1]
        Symmetric gradient of the velocity.
    """
    apparent = law.viscosity
    if law.yield_stress > NO_YIELD_STRESS:
        deep = max(thickness, LEAST_THICKNESS)
        speed = sqrt(u * u + v * v)
        bed_shear = 1.5 * speed / ((2.0 + plug_ratio(law.yield_stress, law.viscosity, deep, speed)) * deep)  # D_xz
        dzz = -(dxx + dyy)
        second = 0.5 * (dxx * dxx + dyy * dyy + dzz * dzz) + dxy * dxy + bed_shear * bed_shear
        apparent += 0.5 * law.yield_stress / sqrt(second + LEAST_SQUARED_RATE)
    return apparent
