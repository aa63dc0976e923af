"""Contact of the 3D flow with the ground: Coulomb friction on the impulse, Voellmy's drag, or sticking."""

from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

from .flow_layers import chezy_number, relative_roughness

if TYPE_CHECKING:
    import numpy as np

# kinds of contact
COULOMB = 1
VOELLMY = 2
STICKING = 3
# kind -> its parameters, fields of `Contact`
PARAMETERS = {COULOMB: ("mu",), VOELLMY: ("mu", "xi"), STICKING: ()}


class Contact(NamedTuple):
    """Contact of any kind; parameters that its kind does not have are 0. By default the flow slides freely.

    Made by `coulomb_contact`, `voellmy_contact` or `sticking_contact`.
    """

    kind: int = COULOMB
    mu: float = 0.0  # [1] tangent of the bed friction angle
    xi: float = 0.0  # [m s-2] turbulent coefficient


def coulomb_contact(mu: float) -> Contact:
    """Make the contact of `dry_slip`: points on the ground have dry friction, the flow may leave the ground.

    Parameters
    ----------
    mu : float [1]
        Tangent of the bed friction angle; 0 slides freely. Vicari et al. (2025): 0.65 on glacier ice, 0.55 on rock.
    """
    return Contact(COULOMB, float(mu))


def voellmy_contact(mu: float, xi: float) -> Contact:
    """Make a contact with dry friction and turbulent drag: tau = mu sigma + rho g u^2 / xi (Voellmy 1955).

    The same law as `friction.voellmy` of the depth-averaged solver: u is the mean speed over the flow's depth, and its
    layers transfer mu p and turbulent stress (`flow_layers`). Drag acts on flow that touches the bed, with or without
    pressure in the same step: elastic oscillation of the flow does not reduce it.

    Parameters
    ----------
    mu : float [1]
        Tangent of the bed friction angle.
    xi : float [m s-2]
        Turbulent coefficient; larger is more mobile. Snow 1000 to 3000, debris flows 100 to 500, rock avalanches 300
        to 1500, from depth-averaged models.
    """
    return Contact(VOELLMY, float(mu), float(xi))


def sticking_contact() -> Contact:
    """Make the contact of a flow that neither moves on the ground nor leaves it."""
    return Contact(STICKING)


def dry_slip(mu: float, slip: float, pressed: float) -> float:
    """Compute the share of the tangential speed that Coulomb friction on the impulse leaves.

    The tangential impulse is at most mu times the normal impulse.

    Parameters
    ----------
    mu : float [1]
    slip : float [m s-1]
        Tangential speed.
    pressed : float [m s-1]
        Normal speed that the ground stops.

    Returns
    -------
    float [1]
    """
    return max(0.0, 1.0 - mu * pressed / slip)


def voellmy_drag(xi: float, slip: float, load: float) -> float:
    """Compute the share of the speed that is left after a step of drag.

    The exact solution s of s = slip - load s^2 / xi, over slip.

    Parameters
    ----------
    xi : float [m s-2]
    slip : float [m s-1]
        Tangential speed.
    load : float [s-1]
        rho g dt times the area of bed, over the mass that it slows.

    Returns
    -------
    float [1]
    """
    return 2.0 / (1.0 + sqrt(1.0 + 4.0 * load * slip / xi))


def kept_slip(contact: Contact, slip: float, pressed: float) -> float:
    """Compute the share of the tangential speed that friction leaves [1]; none where the flow sticks.

    Parameters
    ----------
    contact : Contact
    slip : float [m s-1]
        Tangential speed.
    pressed : float [m s-1]
        Normal speed that the ground stops.
    """
    return 0.0 if contact.kind == STICKING else dry_slip(contact.mu, slip, pressed)


def kept_by_drag(contact: Contact, slip: float, load: float) -> float:
    """Compute the share of the speed that is left after a step of drag [1]; all without drag.

    Parameters
    ----------
    contact : Contact
    slip, load : float
        As of `voellmy_drag`.
    """
    return voellmy_drag(contact.xi, slip, load) if contact.kind == VOELLMY else 1.0


def layer_friction(contact: Contact) -> float:
    """Return the friction between layers of a flow whose material has no strength [1]: mu of a contact with drag.

    Parameters
    ----------
    contact : Contact
    """
    return contact.mu if contact.kind == VOELLMY else 0.0


def layer_roughness(contact: Contact, gravity: float) -> float:
    """Compute the roughness of the bed whose logarithmic law has the drag of xi; 1 without drag and turbulence.

    Parameters
    ----------
    contact : Contact
    gravity : float [m s-2]

    Returns
    -------
    float [1]
        Roughness over the depth of the flow, z0 / h.
    """
    return relative_roughness(chezy_number(contact.xi, gravity)) if contact.kind == VOELLMY else 1.0


def contact_at(contact: Contact, zones: bool, values: "np.ndarray", j: int, i: int) -> Contact:
    """Return the contact at node [j, i], with the parameters of its zone where there are zones.

    Parameters
    ----------
    contact : Contact
    zones : bool
        Whether parameters differ from place to place.
    values : float64[rows, columns, parameters]
        PARAMETERS of this kind.
    j, i : int
    """
    if not zones or contact.kind == STICKING:
        return contact
    xi = values[j, i, 1] if contact.kind == VOELLMY else contact.xi
    return Contact(contact.kind, values[j, i, 0], xi)
