"""Contact of the 3D flow with the ground: Coulomb friction on the impulse, or sticking (design notes 4.7)."""

from typing import NamedTuple


class CoulombContact(NamedTuple):
    """Dry friction of points on the ground: what is pressed into it slows what slides by mu times as much.

    Parameters
    ----------
    mu : float [1]
        Tangent of the bed friction angle; 0 slides freely. Vicari et al. (2025): 0.65 on glacier ice, 0.55 on rock.
    """

    mu: float

    def kept_slip(self, slip, pressed):
        """Share [1] that is left of the tangential speed `slip` [m s-1] when `pressed` [m s-1] goes into the ground."""
        return max(0.0, 1.0 - self.mu * pressed / slip)

    def sticks(self):
        """Is the flow held on the ground when it moves away from it?"""
        return False

    def placed(self, values, j, i):
        """The law with the parameters of a place, from the node array values[j, i, :]."""
        return CoulombContact(values[j, i, 0])


class StickingContact(NamedTuple):
    """The flow does not move on the ground, nor leave it."""

    null: float = 0.0

    def kept_slip(self, slip, pressed):
        """Nothing is left."""
        return 0.0

    def sticks(self):
        """Is the flow held on the ground when it moves away from it?"""
        return True

    def placed(self, values, j, i):
        """Sticks everywhere."""
        return self
