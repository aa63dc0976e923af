"""Friction of the 3D flow on the ground: Coulomb friction on the impulse of the contact, and a traction.

A law of `friction` gives the stress on the bed below a depth-averaged flow. Its Coulomb part with a constant
coefficient acts on the impulse of the contact in 3D. The rest is a traction: a function of the load, the thickness and
the mean speed of the column of flow above the bed.
"""

from math import sqrt
from typing import TYPE_CHECKING

from .flow_layers import relative_roughness
from .friction import (
    COULOMB,
    MANNING,
    NAMES,
    NO_FRICTION,
    POULIQUEN,
    SAMOS_AT,
    VOELLMY,
    VOELLMY_MIN_SHEAR,
    Friction,
    built_in_at_node,
    built_in_parts,
    slowed_speed,
)

if TYPE_CHECKING:
    import numpy as np

STICKING = len(NAMES)  # kind of contact in addition to those of the laws of friction; it has no parameters


def sticking_contact() -> Friction:
    """Make a contact at which the flow neither slides nor separates from the ground."""
    return Friction(STICKING)


def has_traction(contact: Friction) -> bool:
    """Return whether a law has more than Coulomb friction on the impulse.

    Parameters
    ----------
    contact : Friction
    """
    return contact.kind not in (NO_FRICTION, COULOMB, STICKING)


def impulse_friction(contact: Friction) -> float:
    """Return the coefficient of the friction on the impulse of the contact [1].

    Parameters
    ----------
    contact : Friction
    """
    if contact.kind in (COULOMB, VOELLMY, POULIQUEN, SAMOS_AT, VOELLMY_MIN_SHEAR):
        return contact.a
    if contact.kind == MANNING:
        return contact.b
    return 0.0


def dry_slip(mu: float, slip: float, pressed: float) -> float:
    """Compute the share of the tangential speed that Coulomb friction on the impulse leaves.

    Parameters
    ----------
    mu : float [1]
    slip : float [m s-1]
        Tangential speed, above 0.
    pressed : float [m s-1]
        Impulse that the ground exerts along its normal, over the mass that slides: the speed into the ground that it
        removes.

    Returns
    -------
    float [1]
        max(0, 1 - mu pressed / slip): one impulse that resists sliding (semi-implicit), no drag and no reversal.
    """
    return max(0.0, 1.0 - mu * pressed / slip)


def kept_slip(contact: Friction, slip: float, pressed: float) -> float:
    """Compute the share of the tangential speed that friction leaves [1]; none where the flow sticks.

    Parameters
    ----------
    contact : Friction
    slip, pressed : float [m s-1]
        As of `dry_slip`.
    """
    return 0.0 if contact.kind == STICKING else dry_slip(impulse_friction(contact), slip, pressed)


def traction_parts(
    contact: Friction, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
) -> tuple[float, float, float]:
    """Compute the parts of the stress of a law that is not friction on the impulse (see `friction`).

    Parameters
    ----------
    contact : Friction
        A law of friction with traction.
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as of the laws of `friction`.

    Returns
    -------
    float [Pa]
        Dry stress above that of the friction on the impulse.
    float [Pa s m-1]
        Viscous coefficient.
    float [1]
        Drag coefficient.
    """
    dry, viscous, drag = built_in_parts(contact, density, gravity, normal_stress, thickness_normal, speed)
    return max(dry - impulse_friction(contact) * normal_stress, 0.0), viscous, drag


def kept_by_traction(
    parts: tuple[float, float, float], speed: float, time_step: float, density: float, slowed: float
) -> float:
    """Compute the share of the speed that is left after a step of traction [1] (`slowed_speed`).

    Parameters
    ----------
    parts : (float [Pa], float [Pa s m-1], float [1])
        As of `traction_parts`.
    speed : float [m s-1]
        Above 0.
    time_step : float [s]
    density : float [kg m-3]
    slowed : float [kg m-2]
        Mass that the traction slows, per area of bed.
    """
    dry, viscous, drag = parts
    return slowed_speed(speed, time_step, dry / slowed, viscous / slowed, density * drag / slowed) / speed


def drag_roughness(drag: float) -> float:
    """Compute the roughness of the bed whose logarithmic profile of speed has a drag coefficient.

    Parameters
    ----------
    drag : float [1]
        Of the stress rho `drag` u^2; 0 without drag.

    Returns
    -------
    float [1]
        Roughness over the depth of the flow, z0 / h; 1 without drag.
    """
    return relative_roughness(1.0 / sqrt(drag)) if drag > 0.0 else 1.0


def equal_roughness(contact: Friction, zones: bool, gravity: float) -> float:
    """Compute `drag_roughness` of a law whose drag coefficient is the same everywhere.

    Parameters
    ----------
    contact : Friction
    zones : bool
        Whether the parameters of the law are those of each node.
    gravity : float [m s-2]

    Returns
    -------
    float [1]
        0 where it differs from place to place.
    """
    if zones or contact.kind not in (VOELLMY, VOELLMY_MIN_SHEAR):
        return 0.0
    return drag_roughness(gravity / contact.b)


def contact_at(contact: Friction, zones: bool, values: "np.ndarray", j: int, i: int) -> Friction:
    """Return the contact at a node: the parameters of the law at each node are in an array.

    Parameters
    ----------
    contact : Friction
    zones : bool
        Whether the parameters of the law are those of each node.
    values : float[rows, columns, parameters]
        In the order of the law's parameters; where there are no zones, `contact` itself applies.
    j, i : int
        Row and column of the node.
    """
    if not zones or contact.kind == STICKING:
        return contact
    return built_in_at_node(contact, values, j, i)
