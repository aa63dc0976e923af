"""Entrainment: the flow erodes material of its bed.

A law gives the mass that a square metre of bed surface loses in a second. The entrained mass is at rest and shares the
momentum of the flow; it never exceeds the erodible mass, and it lowers the bed if the scene requires it.
"""

from typing import NamedTuple

from .friction import Parameter


class NoEntrainment(NamedTuple):
    """The null law: the bed is rigid."""

    null: float = 0.0  # the compiler requires a field

    def entrainment_active(self):
        return False

    def erosion_rate(self, density, basal_stress, speed):
        return 0.0

    def bed_lowering(self):
        return 0.0


class ErosionEnergy(NamedTuple):
    """Erosion by the work of friction, q = tau_b |U| / e_b (AvaFrame com1DFA).

    e_b is the energy that loosens a kilogram of bed. Snow: 1000 to 50 000 J/kg, 5000 in com1DFA's examples.
    """

    erosion_energy: float  # e_b [J kg-1]
    lowering: float = 0.0  # bed lowered per eroded mass and area [m3 kg-1], 1 / bed density; 0: the bed stays as it is

    def entrainment_active(self):
        return True

    def erosion_rate(self, density, basal_stress, speed):
        """Erosion rate q [kg m-2 s-1] per area of the bed's surface; `basal_stress` tau_b [Pa], `speed` |U| [m s-1]."""
        return basal_stress * speed / self.erosion_energy

    def bed_lowering(self):
        return self.lowering


class ErosionSpeed(NamedTuple):
    """Erosion in proportion to speed, q = k_e rho |U|: the bed recedes at k_e times the flow's speed.

    k_e 1e-5 to 1e-2: debris flows near 1e-3, dry snow up to 1e-2.
    """

    coefficient: float  # k_e [1]
    lowering: float = 0.0  # [m3 kg-1]

    def entrainment_active(self):
        return True

    def erosion_rate(self, density, basal_stress, speed):
        """Erosion rate q [kg m-2 s-1] per area of the bed's surface; `density` rho [kg m-3], `speed` |U| [m s-1]."""
        return self.coefficient * density * speed

    def bed_lowering(self):
        return self.lowering


# law name in a scene -> (law, {name: Parameter}); `lowering` comes from the density of the bed
LAWS = {
    "ErosionEnergy": (
        ErosionEnergy,
        {"erosion_energy": Parameter("J kg-1", "energy that loosens a kilogram of bed", 1.0, 1e9)},
    ),
    "ErosionSpeed": (
        ErosionSpeed,
        {"coefficient": Parameter("1", "speed at which the bed recedes over the flow's", 0.0, 0.1)},
    ),
}
