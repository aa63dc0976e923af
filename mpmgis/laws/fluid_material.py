"""Water and mud in the 3D solver: weakly compressible, without tension."""

from math import log, sqrt
from typing import TYPE_CHECKING, NamedTuple

from .material import FAR, NO_TENSION, ORDINARY, TINY

if TYPE_CHECKING:
    import numpy as np

SMALLEST_VOLUME = 0.6  # [1] smallest J; below it the fluid is far too soft for its speed: limited and counted
LARGEST_GAP = 0.1  # [1] of J; a larger one is closed at the rate of this one
NEWTON_STEPS = 8  # for J at a given pressure by Tait's equation


class Fluid(NamedTuple):
    """sigma = -p I + 2 eta dev D with p = K (1 / J - 1), or Tait's (K / 7) (J^-7 - 1) where `tait` is 1.

    A point has J, its volume over the stress-free volume; J above 1 is reset to 1: a fluid has no tension and no memory
    of gaps. K = rho (10 U)^2 for flows up to U [m s-1] keeps densities within 1 % (Monaghan 1994, whose water
    is Tait's). Viscosity: water 1e-3, muds 0.1 to 100 Pa s.
    """

    bulk_modulus: float  # K [Pa]
    dynamic_viscosity: float  # eta [Pa s]
    tait: float  # 1 or 0

    def strength_at_rest(self) -> tuple[float, float]:
        """Return (0, 0) [1], [Pa]: a fluid at rest bears no shear stress."""
        return 0.0, 0.0

    def pressure(self, volume: float) -> float:
        """Compute the pressure p [Pa].

        Parameters
        ----------
        volume : float [1]
            J.
        """
        inverse = 1.0 / volume
        cube = inverse * inverse * inverse
        stiffened = (cube * cube * inverse - 1.0) * (1.0 / 7.0)
        return self.bulk_modulus * (stiffened if self.tait > 0.5 else inverse - 1.0)

    def stress_step(
        self,
        s0: float,
        s1: float,
        s2: float,
        s3: float,
        s4: float,
        s5: float,
        s6: float,
        s7: float,
        gxx: float,
        gxy: float,
        gxz: float,
        gyx: float,
        gyy: float,
        gyz: float,
        gzx: float,
        gzy: float,
        gzz: float,
        time_step: float,
        softening: tuple,
    ) -> tuple[float, ...]:
        """Compute state and stress of a point after a step, as `material.stress_step`.

        Parameters
        ----------
        s0, s1, s2, s3, s4, s5, s6, s7 : float
            State: J [1]; its correction [s-1] by the density at the nodes (`point_density`); the energy [J m-3, per
            volume free of stress] that the correction has supplied since it was set; the rest is not used.
        gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz : float [1]
            Gradient of the step, dt grad v.
        time_step : float [s]
        softening : law
            Not used.

        Returns
        -------
        s0..s7, txx, tyy, tzz, txy, txz, tyz, code : float
            New state, Kirchhoff stress [Pa], code of the step.
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
        self,
        s0: float,
        s1: float,
        s2: float,
        s3: float,
        s4: float,
        s5: float,
        s6: float,
        s7: float,
        gxx: float,
        gxy: float,
        gxz: float,
        gyx: float,
        gyy: float,
        gyz: float,
        gzx: float,
        gzy: float,
        gzz: float,
        time_step: float,
        softening: tuple,
    ) -> tuple[float, ...]:
        """Compute what `stress_step` does, which limits J itself and returns the code FAR.

        Parameters
        ----------
        s0, s1, s2, s3, s4, s5, s6, s7 : float
            State: J [1]; its correction [s-1] by the density at the nodes (`point_density`); the energy [J m-3, per
            volume free of stress] that the correction has supplied since it was set; the rest is not used.
        gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz : float [1]
            Gradient of the step, dt grad v.
        time_step : float [s]
        softening : law
            Not used.
        """
        return self.stress_step(
            s0, s1, s2, s3, s4, s5, s6, s7, gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz, time_step, softening
        )

    def state_at_stress(
        self,
        txx: "float | np.ndarray",
        tyy: "float | np.ndarray",
        tzz: "float | np.ndarray",
        txy: "float | np.ndarray",
        txz: "float | np.ndarray",
        tyz: "float | np.ndarray",
    ) -> tuple[float, ...]:
        """Compute the state s0..s7 with the mean of this stress, without shear; for numbers or arrays.

        Parameters
        ----------
        txx, tyy, tzz, txy, txz, tyz : float or float64[n] [Pa]
            Kirchhoff stress.
        """
        pull = (txx + tyy + tzz) / (3.0 * self.bulk_modulus)
        volume = _held(1.0 + pull)
        if self.tait > 0.5:
            for _ in range(NEWTON_STEPS):  # Newton on the convex (J^-6 - J) / 7 + pull = 0, from the left
                sixth = 1.0 / (volume * volume * volume * volume * volume * volume)
                volume = volume + (sixth - volume + 7.0 * pull) / (6.0 * sixth / volume + 1.0)
            volume = _held(volume)
        nothing = 0.0 * pull
        return volume, nothing, nothing, nothing, nothing, nothing, nothing, nothing

    def follows_density(self) -> bool:
        """Return True: J is corrected where it differs from the density at the nodes (`point_density`)."""
        return True

    def gap_at_density(self, volume: float, density: float, inside: bool, band: float) -> float:
        """Compute what J lacks at the density of the nodes [1].

        It is 0 where the product of J and the density is within 1 - `band` and 1 + `band`, otherwise the way of J to
        this band, at most LARGEST_GAP. It is positive only inside the flow, where no free surface is near.

        Parameters
        ----------
        volume : float [1]
            J.
        density : float [1]
            Density at the nodes over that of the fluid free of stress.
        inside : bool
            Whether the point is inside the flow.
        band : float [1]
        """
        product = volume * density
        within = min(max(product, 1.0 - band), 1.0 + band)
        if within == product or (product < within and not inside):
            return 0.0 * volume
        gap = volume * within / max(product, TINY) - volume
        return min(max(gap, -LARGEST_GAP), LARGEST_GAP)

    def volume_ratio(
        self, s0: float, s1: float, s2: float, s3: float, s4: float, s5: float, s6: float, s7: float
    ) -> float:
        """Return the volume over the stress-free volume, J [1].

        Parameters
        ----------
        s0, s1, s2, s3, s4, s5, s6, s7 : float
            State: J [1]; its correction [s-1] by the density at the nodes (`point_density`); the energy [J m-3, per
            volume free of stress] that the correction has supplied since it was set; the rest is not used.
        """
        return s0

    def stored_energy(
        self, s0: float, s1: float, s2: float, s3: float, s4: float, s5: float, s6: float, s7: float
    ) -> float:
        """Compute the energy of compression [J m-3], the integral of -p over J from 1.

        Parameters
        ----------
        s0, s1, s2, s3, s4, s5, s6, s7 : float
            State: J [1]; its correction [s-1] by the density at the nodes (`point_density`); the energy [J m-3, per
            volume free of stress] that the correction has supplied since it was set; the rest is not used.
        """
        if self.tait > 0.5:
            return self.bulk_modulus / 7.0 * (1.0 / (6.0 * s0**6) + s0 - 7.0 / 6.0)
        return self.bulk_modulus * (s0 - 1.0 - log(s0))

    def wave_speed(self, density: float) -> float:
        """Compute the speed of pressure waves [m s-1], sqrt(K / rho).

        Parameters
        ----------
        density : float [kg m-3]
        """
        return sqrt(self.bulk_modulus / density)

    def viscosity(self) -> float:
        """Return eta [Pa s], for the limit of the time step."""
        return self.dynamic_viscosity

    def state_count(self) -> int:
        """Return the number of state variables of a point."""
        return 4


def _held(volume):
    """J limited to SMALLEST_VOLUME..1, for a number or an array."""
    small, large = volume < SMALLEST_VOLUME, volume > 1.0
    return small * SMALLEST_VOLUME + large * 1.0 + (1.0 - small - large) * volume
