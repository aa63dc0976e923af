"""Entrainment: the flow takes up material of its bed."""

from typing import NamedTuple


class NoEntrainment(NamedTuple):
    """The null law: the bed is rigid."""

    null: float = 0.0  # the compiler wants at least one field

    def entrainment_active(self):
        return False

    def erosion_rate(self, density, basal_stress, speed):
        return 0.0

    def bed_lowering(self):
        return 0.0


class ErosionEnergy(NamedTuple):
    """q = tau_b |U| / e_b: the work of the bed's resistance breaks it up (AvaFrame com1DFA).

    e_b is the energy that loosens a kilogram of bed: snow about 1000 to 50 000 J/kg.
    """

    erosion_energy: float  # e_b [J kg-1]
    lowering: float  # bed lowered per eroded mass [m3 kg-1], 1 / bed density; 0: the bed stays as it is

    def entrainment_active(self):
        return True

    def erosion_rate(self, density, basal_stress, speed):
        """q [kg m-2 s-1] per map area."""
        return basal_stress * speed / self.erosion_energy

    def bed_lowering(self):
        return self.lowering


class ErosionSpeed(NamedTuple):
    """q = k_e rho |U|: proportional to speed (k_e 1e-5 to 1e-2 [1])."""

    coefficient: float  # k_e [1]
    lowering: float  # [m3 kg-1]

    def entrainment_active(self):
        return True

    def erosion_rate(self, density, basal_stress, speed):
        """q [kg m-2 s-1] per map area."""
        return self.coefficient * density * speed

    def bed_lowering(self):
        return self.lowering
