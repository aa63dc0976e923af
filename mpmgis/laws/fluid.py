"""Water and mud in the 3D solver: weakly compressible, without tension."""

from math import log, sqrt
from typing import NamedTuple

from .material import FAR, NO_TENSION, ORDINARY, TINY

SMALLEST_VOLUME = 0.6  # smallest J; below it the fluid is far too soft for its speed: limited and counted
LARGEST_GAP = 0.1  # of J; a larger one is closed at the rate of this one


class Fluid(NamedTuple):
    """sigma = -p I + 2 eta dev D with p = K (1 / J - 1), or Tait's (K / 7) (J^-7 - 1) where `tait` is 1.

    A point has J, its volume over the stress-free volume; J above 1 is reset to 1: a fluid has no tension and no memory
    of gaps. K = rho (10 U)^2 for flows up to U [m s-1] keeps densities within 1 % (Monaghan 1994, whose water
    is Tait's). Viscosity: water 1e-3, muds 0.1 to 100 Pa s.
    """

    bulk_modulus: float  # K [Pa]
    dynamic_viscosity: float  # eta [Pa s]
    tait: float  # 1 or 0

    def strength_at_rest(self):
        """As in `effects/material`: no shear stress at rest."""
        return 0.0, 0.0

    def pressure(self, volume):
        """p [Pa] of J = `volume` [1]."""
        inverse = 1.0 / volume
        cube = inverse * inverse * inverse
        stiffened = (cube * cube * inverse - 1.0) * (1.0 / 7.0)
        return self.bulk_modulus * (stiffened if self.tait > 0.5 else inverse - 1.0)

    def stress_step(
        self, s0, s1, s2, s3, s4, s5, s6, s7, gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz, time_step, softening
    ):
        """As in `effects/material`.

        s0 is J, s1 its correction [s-1] by the density at the nodes (`point_density`). s2 is the energy that
        the correction has supplied since s1 was set, per volume free of stress [J m-3].
        """
        growth = gxx + gyy + gzz
        corrected = min(max(s0 + time_step * s1, SMALLEST_VOLUME), 1.0)
        supplied = s2 - self.pressure(0.5 * (s0 + corrected)) * (corrected - s0)
        trial = corrected * (1.0 + growth)
        volume = min(max(trial, SMALLEST_VOLUME), 1.0)
        pull = -volume * self.pressure(volume)
        thick = volume * self.dynamic_viscosity / max(time_step, TINY)
        mean = growth * (2.0 / 3.0)
        expanded = NO_TENSION if trial > 1.0 else ORDINARY
        return (
            volume,
            s1,
            supplied,
            s3,
            s4,
            s5,
            s6,
            s7,
            pull + thick * (2.0 * gxx - mean),
            pull + thick * (2.0 * gyy - mean),
            pull + thick * (2.0 * gzz - mean),
            thick * (gxy + gyx),
            thick * (gxz + gzx),
            thick * (gyz + gzy),
            expanded if trial >= SMALLEST_VOLUME else FAR,
        )

    def stress_step_far(
        self, s0, s1, s2, s3, s4, s5, s6, s7, gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz, time_step, softening
    ):
        """The same: `stress_step` limits J itself and returns the code FAR."""
        return self.stress_step(
            s0, s1, s2, s3, s4, s5, s6, s7, gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz, time_step, softening
        )

    def state_at_stress(self, txx, tyy, tzz, txy, txz, tyz):
        """State s0..s7 of the mean of this Kirchhoff stress [Pa], without shear; for numbers or arrays."""
        pull = (txx + tyy + tzz) / (3.0 * self.bulk_modulus)
        volume = _held(1.0 + pull)
        if self.tait > 0.5:
            for _ in range(8):  # Newton on the convex (J^-6 - J) / 7 + pull = 0, from the left
                sixth = 1.0 / (volume * volume * volume * volume * volume * volume)
                volume = volume + (sixth - volume + 7.0 * pull) / (6.0 * sixth / volume + 1.0)
            volume = _held(volume)
        nothing = 0.0 * pull
        return volume, nothing, nothing, nothing, nothing, nothing, nothing, nothing

    def follows_density(self):
        """True: J is corrected where it differs from the density at the nodes (`point_density`)."""
        return True

    def gap_at_density(self, volume, density, inside, band):
        """What J lacks at the `density` [1] of the nodes, over that of the fluid free of stress.

        It is 0 where their product is within 1 - `band` and 1 + `band`, otherwise the way of J to this band, at most
        LARGEST_GAP. It is positive only `inside` the flow, where no free surface is near.
        """
        product = volume * density
        within = min(max(product, 1.0 - band), 1.0 + band)
        if within == product or (product < within and not inside):
            return 0.0 * volume
        gap = volume * within / max(product, TINY) - volume
        return min(max(gap, -LARGEST_GAP), LARGEST_GAP)

    def volume_ratio(self, s0, s1, s2, s3, s4, s5, s6, s7):
        """Volume over stress-free volume [1]."""
        return s0

    def stored_energy(self, s0, s1, s2, s3, s4, s5, s6, s7):
        """Energy [J m-3] of compression, the integral of -p over J from 1."""
        if self.tait > 0.5:
            return self.bulk_modulus / 7.0 * (1.0 / (6.0 * s0**6) + s0 - 7.0 / 6.0)
        return self.bulk_modulus * (s0 - 1.0 - log(s0))

    def wave_speed(self, density):
        """Speed [m s-1] of pressure waves at `density` [kg m-3], sqrt(K / rho)."""
        return sqrt(self.bulk_modulus / density)

    def viscosity(self):
        """eta [Pa s], for the time step's limit."""
        return self.dynamic_viscosity

    def state_count(self):
        """Number of state variables of a point."""
        return 4


def _held(volume):
    """J limited to SMALLEST_VOLUME..1, for a number or an array."""
    small, large = volume < SMALLEST_VOLUME, volume > 1.0
    return small * SMALLEST_VOLUME + large * 1.0 + (1.0 - small - large) * volume
