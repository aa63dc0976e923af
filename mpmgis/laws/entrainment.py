"""Entrainment: the flow erodes material of its bed.

A law gives the mass that a square metre of bed surface loses in a second. The entrained mass is at rest and shares the
momentum of the flow; it never exceeds the erodible mass, and it lowers the bed if the scene requires it.
"""

from typing import NamedTuple

from .friction import Parameter


class NoEntrainment(NamedTuple):
    """The null law: the bed is rigid."""

    null: float = 0.0  # the compiler requires a field

    def entrainment_active(self) -> bool:
        """Return False: the bed is rigid."""
        return False

    def erosion_rate(self, density: float, basal_stress: float, speed: float) -> float:
        """Return 0: nothing is eroded.

        Parameters
        ----------
        density : float [kg m-3]
            rho of the flow.
        basal_stress : float [Pa]
            tau_b.
        speed : float [m s-1]
            Length of the velocity along the ground.
        """
        return 0.0

    def bed_lowering(self) -> float:
        """Return 0: the bed stays where it is."""
        return 0.0


class ErosionEnergy(NamedTuple):
    """Erosion by the work of friction, q = tau_b |U| / e_b (AvaFrame com1DFA).

    e_b is the energy that loosens a kilogram of bed. Snow: 1000 to 50 000 J/kg, 5000 in com1DFA's examples.
    """

    erosion_energy: float  # e_b [J kg-1]
    lowering: float = 0.0  # bed lowered per eroded mass and area [m3 kg-1], 1 / bed density; 0: the bed stays as it is

    def entrainment_active(self) -> bool:
        """Return True: the bed erodes."""
        return True

    def erosion_rate(self, density: float, basal_stress: float, speed: float) -> float:
        """Compute q = tau_b |U| / e_b.

        Parameters
        ----------
        density : float [kg m-3]
            rho of the flow.
        basal_stress : float [Pa]
            tau_b.
        speed : float [m s-1]
            Length of the velocity along the ground.

        Returns
        -------
        float [kg m-2 s-1]
            Per area of the bed's surface.
        """
        return basal_stress * speed / self.erosion_energy

    def bed_lowering(self) -> float:
        """Return the depth by which the bed is lowered per eroded mass and area [m3 kg-1]."""
        return self.lowering


class ErosionSpeed(NamedTuple):
    """Erosion in proportion to speed, q = k_e rho |U|: the bed recedes at k_e times the flow's speed.

    k_e 1e-5 to 1e-2: debris flows near 1e-3, dry snow up to 1e-2.
    """

    coefficient: float  # k_e [1]
    lowering: float = 0.0  # [m3 kg-1]

    def entrainment_active(self) -> bool:
        """Return True: the bed erodes."""
        return True

    def erosion_rate(self, density: float, basal_stress: float, speed: float) -> float:
        """Compute q = k_e rho |U|.

        Parameters
        ----------
        density : float [kg m-3]
            rho of the flow.
        basal_stress : float [Pa]
            tau_b.
        speed : float [m s-1]
            Length of the velocity along the ground.

        Returns
        -------
        float [kg m-2 s-1]
            Per area of the bed's surface.
        """
        return self.coefficient * density * speed

    def bed_lowering(self) -> float:
        """Return the depth by which the bed is lowered per eroded mass and area [m3 kg-1]."""
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
