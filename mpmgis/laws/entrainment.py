"""Entrainment: the flow erodes material of its bed.

A law gives the mass that a square metre of bed surface loses in a second. The entrained mass is at rest and shares the
momentum of the flow; it never exceeds the erodible mass, and it lowers the bed if the scene requires it.
"""

from typing import NamedTuple

from .friction import Parameter

NO_EROSION, EROSION_ENERGY, EROSION_SPEED = range(3)  # kinds of law, in the order of `LAWS`


class Entrainment(NamedTuple):
    """A law of erosion by number, with its parameter; by default the bed is rigid."""

    kind: int = NO_EROSION
    coefficient: float = 0.0  # parameter of the law
    lowering: float = 0.0  # bed lowered per eroded mass and area [m3 kg-1], 1 / bed density; 0: the bed stays as it is


def erosion_by_energy(erosion_energy: float, density: float, basal_stress: float, speed: float) -> float:
    """Compute erosion by the work of friction, q = tau_b |U| / e_b (AvaFrame com1DFA).

    e_b is the energy that loosens a kilogram of bed. Snow: 1000 to 50 000 J/kg, 5000 in com1DFA's examples.

    Parameters
    ----------
    erosion_energy : float [J kg-1]
        e_b.
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
    return basal_stress * speed / erosion_energy


def erosion_by_speed(coefficient: float, density: float, basal_stress: float, speed: float) -> float:
    """Compute erosion in proportion to speed, q = k_e rho |U|: the bed recedes at k_e times the flow's speed.

    k_e 1e-5 to 1e-2: debris flows near 1e-3, dry snow up to 1e-2.

    Parameters
    ----------
    coefficient : float [1]
        k_e.
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
    return coefficient * density * speed


def erosion_rate(law: Entrainment, density: float, basal_stress: float, speed: float) -> float:
    """Compute the rate of erosion of a law, by its number; 0 of a rigid bed.

    Parameters
    ----------
    law : Entrainment
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
    if law.kind == EROSION_ENERGY:
        return erosion_by_energy(law.coefficient, density, basal_stress, speed)
    if law.kind == EROSION_SPEED:
        return erosion_by_speed(law.coefficient, density, basal_stress, speed)
    return 0.0


# law name in a scene -> (law, {name: Parameter}); `lowering` comes from the density of the bed
LAWS = {
    "ErosionEnergy": (
        erosion_by_energy,
        {"erosion_energy": Parameter("J kg-1", "energy that loosens a kilogram of bed", 1.0, 1e9)},
    ),
    "ErosionSpeed": (
        erosion_by_speed,
        {"coefficient": Parameter("1", "speed at which the bed recedes over the flow's", 0.0, 0.1)},
    ),
}
NAMES = ("", *LAWS)  # of the laws, by kind


def entrainment_law(name: str, coefficient: float, lowering: float = 0.0) -> Entrainment:
    """Make a law of erosion of its parameter.

    Parameters
    ----------
    name : str
        Of a row of `LAWS`.
    coefficient : float
        In the unit of that row.
    lowering : float [m3 kg-1]
        As in `Entrainment`.
    """
    return Entrainment(NAMES.index(name), float(coefficient), float(lowering))
