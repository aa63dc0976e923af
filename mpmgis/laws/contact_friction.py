"""Contact of the 3D flow with the ground: Coulomb friction on the impulse, Voellmy's drag, or sticking."""

from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

from .flow_layers import chezy_number, relative_roughness

if TYPE_CHECKING:
    import numpy as np


def dry_slip(law: tuple, slip: float, pressed: float) -> float:
    """Compute the share of the tangential speed that Coulomb friction on the impulse leaves.

    Parameters
    ----------
    law : law
        With the field `mu` [1].
    slip : float [m s-1]
        Tangential speed.
    pressed : float [m s-1]
        Normal speed that the ground stops.

    Returns
    -------
    float [1]
    """
    return max(0.0, 1.0 - law.mu * pressed / slip)


class CoulombContact(NamedTuple):
    """Dry friction of points on the ground: the tangential impulse is at most mu times the normal impulse.

    Parameters
    ----------
    mu : float [1]
        Tangent of the bed friction angle; 0 slides freely. Vicari et al. (2025): 0.65 on glacier ice, 0.55 on rock.
    """

    mu: float

    kept_slip = dry_slip

    def sticks(self) -> bool:
        """Return False: the flow may leave the ground."""
        return False

    def drag_active(self) -> bool:
        """Return False: there is no stress on the bed in addition to Coulomb friction."""
        return False

    def kept_by_drag(self, slip: float, load: float) -> float:
        """Return 1: there is no drag.

        Parameters
        ----------
        slip : float [m s-1]
            Tangential speed.
        load : float [s-1]
            rho g dt times the area of bed, over the mass that it slows.
        """
        return 1.0

    def layer_friction(self) -> float:
        """Return 0: layers have no friction in addition to that of the material."""
        return 0.0

    def layer_roughness(self, gravity: float) -> float:
        """Return 1: there is no drag and no turbulence.

        Parameters
        ----------
        gravity : float [m s-2]
        """
        return 1.0

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "CoulombContact":
        """Return the law with the parameters of node [j, i].

        Parameters
        ----------
        values : float64[rows, columns, parameters]
        j, i : int
        """
        return CoulombContact(values[j, i, 0])


class VoellmyContact(NamedTuple):
    """Dry friction and turbulent drag on the ground, tau = mu sigma + rho g u^2 / xi (Voellmy 1955).

    The same law as `friction.Voellmy` of the depth-averaged solver: u is the mean speed over the flow's depth,
    and its layers transfer mu p and turbulent stress (`flow_layers`). Drag acts on flow that touches the bed, with
    or without pressure in the same step: elastic oscillation of the flow does not reduce it.

    Parameters
    ----------
    mu : float [1]
        Tangent of the bed friction angle.
    xi : float [m s-2]
        Turbulent coefficient; larger is more mobile. Snow 1000 to 3000, debris flows 100 to 500, rock avalanches 300
        to 1500, from depth-averaged models.
    """

    mu: float
    xi: float

    kept_slip = dry_slip

    def sticks(self) -> bool:
        """Return False: the flow may leave the ground."""
        return False

    def drag_active(self) -> bool:
        """Return True: there is drag on the bed in addition to Coulomb friction."""
        return True

    def kept_by_drag(self, slip: float, load: float) -> float:
        """Compute the share of the speed that is left after a step of drag.

        The exact solution s of s = slip - load s^2 / xi, over slip.

        Parameters
        ----------
        slip : float [m s-1]
            Tangential speed.
        load : float [s-1]
            rho g dt times the area of bed, over the mass that it slows.

        Returns
        -------
        float [1]
        """
        return 2.0 / (1.0 + sqrt(1.0 + 4.0 * load * slip / self.xi))

    def layer_friction(self) -> float:
        """Return mu [1], the friction also between layers of a flow whose material has no strength."""
        return self.mu

    def layer_roughness(self, gravity: float) -> float:
        """Compute the roughness of the bed whose logarithmic law has the drag of xi.

        Parameters
        ----------
        gravity : float [m s-2]

        Returns
        -------
        float [1]
            Roughness over the depth of the flow, z0 / h.
        """
        return relative_roughness(chezy_number(self.xi, gravity))

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "VoellmyContact":
        """Return the law with the parameters of node [j, i].

        Parameters
        ----------
        values : float64[rows, columns, parameters]
        j, i : int
        """
        return VoellmyContact(values[j, i, 0], values[j, i, 1])


class StickingContact(NamedTuple):
    """The flow neither moves on the ground nor leaves it."""

    null: float = 0.0

    def kept_slip(self, slip: float, pressed: float) -> float:
        """Return 0: there is no slip.

        Parameters
        ----------
        slip : float [m s-1]
            Tangential speed.
        pressed : float [m s-1]
            Normal speed that the ground stops.
        """
        return 0.0

    def sticks(self) -> bool:
        """Return True: the flow stays on the ground, also where it would move away from it."""
        return True

    def drag_active(self) -> bool:
        """Return False: there is no stress on the bed in addition to Coulomb friction."""
        return False

    def kept_by_drag(self, slip: float, load: float) -> float:
        """Return 1: there is no drag.

        Parameters
        ----------
        slip : float [m s-1]
            Tangential speed.
        load : float [s-1]
            rho g dt times the area of bed, over the mass that it slows.
        """
        return 1.0

    def layer_friction(self) -> float:
        """Return 0: layers have no friction in addition to that of the material."""
        return 0.0

    def layer_roughness(self, gravity: float) -> float:
        """Return 1: there is no drag and no turbulence.

        Parameters
        ----------
        gravity : float [m s-2]
        """
        return 1.0

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "StickingContact":
        """Return this law, which is the same at each node.

        Parameters
        ----------
        values : float64[rows, columns, parameters]
        j, i : int
        """
        return self
