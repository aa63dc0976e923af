"""Contact of the 3D flow with the ground: Coulomb friction on the impulse, Voellmy's drag, or sticking."""

from math import sqrt
from typing import NamedTuple

from .flow_layers import chezy_number, relative_roughness


def dry_slip(law, slip, pressed):
    """Share [1] left of the tangential speed `slip` [m s-1] if the ground stops the normal speed `pressed` [m s-1]."""
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

    def sticks(self):
        """Whether the flow stays on the ground when it moves away from it."""
        return False

    def drag_active(self):
        """Whether there is a stress on the bed in addition to Coulomb friction."""
        return False

    def kept_by_drag(self, slip, load):
        """No drag."""
        return 1.0

    def layer_friction(self):
        """No friction between layers in addition to that of the material."""
        return 0.0

    def layer_roughness(self, gravity):
        """No drag, no turbulence."""
        return 1.0

    def at_node(self, values, j, i):
        """The law with the parameters values[j, i, :] of a node."""
        return CoulombContact(values[j, i, 0])


class VoellmyContact(NamedTuple):
    """Dry friction and turbulent drag on the ground, tau = mu sigma + rho g u^2 / xi (Voellmy 1955).

    The same law as `effects/friction.Voellmy` of the depth-averaged solver: u is the mean speed over the flow's depth,
    and its layers transfer mu p and turbulent stress (`effects/layers`). Drag acts on flow that touches the bed, with
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

    def sticks(self):
        """Whether the flow stays on the ground when it moves away from it."""
        return False

    def drag_active(self):
        """Whether there is a stress on the bed in addition to Coulomb friction."""
        return True

    def kept_by_drag(self, slip, load):
        """Share [1] left of the speed `slip` [m s-1] after a step of drag, exact for s = slip - load s^2 / xi.

        `load` [s m s-2 m-1] is rho g dt times the area of bed over the mass that it slows.
        """
        return 2.0 / (1.0 + sqrt(1.0 + 4.0 * load * slip / self.xi))

    def layer_friction(self):
        """mu [1], also between layers of a flow whose material has no strength."""
        return self.mu

    def layer_roughness(self, gravity):
        """Roughness of the bed over the flow's depth, z0 / h [1], whose log law has the drag of xi."""
        return relative_roughness(chezy_number(self.xi, gravity))

    def at_node(self, values, j, i):
        """The law with the parameters values[j, i, :] of a node."""
        return VoellmyContact(values[j, i, 0], values[j, i, 1])


class StickingContact(NamedTuple):
    """The flow neither moves on the ground nor leaves it."""

    null: float = 0.0

    def kept_slip(self, slip, pressed):
        """No slip."""
        return 0.0

    def sticks(self):
        """Whether the flow stays on the ground when it moves away from it."""
        return True

    def drag_active(self):
        """Whether there is a stress on the bed in addition to Coulomb friction."""
        return False

    def kept_by_drag(self, slip, load):
        """No drag."""
        return 1.0

    def layer_friction(self):
        """No friction between layers in addition to that of the material."""
        return 0.0

    def layer_roughness(self, gravity):
        """No drag, no turbulence."""
        return 1.0

    def at_node(self, values, j, i):
        """Sticks everywhere."""
        return self
