"""Earth pressure: granular columns push less where the flow stretches and more where it is compressed."""

from math import cos, radians, sqrt
from typing import NamedTuple


class NoEarthPressure(NamedTuple):
    """The null law: the push is hydrostatic, K = 1."""

    null: float = 0.0  # the compiler wants at least one field

    def earth_pressure_active(self):
        return False

    def pressure_factor(self, rate, time_step):
        return 1.0

    def largest_factor(self):
        return 1.0


class EarthPressure(NamedTuple):
    """K_active where the flow stretches along its direction, K_passive where it is compressed (Savage & Hutter 1989)."""

    active: float
    passive: float

    def earth_pressure_active(self):
        return True

    def pressure_factor(self, rate, time_step):
        """K [1] for a stretching `rate` [s-1] along the flow; smooth over |rate| time_step < 1e-3."""
        share = min(max(0.5 + 500.0 * rate * time_step, 0.0), 1.0)
        return self.passive + share * (self.active - self.passive)

    def largest_factor(self):
        return max(self.active, self.passive)


def earth_pressure(friction_angle, bed_friction_angle):
    """`EarthPressure` of an internal and a bed friction angle [deg] (Hutter et al. 1993; delta <= phi)."""
    cos2_phi, cos2_delta = cos(radians(friction_angle)) ** 2, cos(radians(bed_friction_angle)) ** 2
    root = sqrt(max(1.0 - cos2_phi / cos2_delta, 0.0))
    return EarthPressure(2.0 / cos2_phi * (1.0 - root) - 1.0, 2.0 / cos2_phi * (1.0 + root) - 1.0)
