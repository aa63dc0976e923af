"""Barriers as a screening tool: walls that the flow does not pass until it is higher than their crest."""

from math import sqrt
from typing import NamedTuple


class NoBarrier(NamedTuple):
    """The null law: nothing stands in the way."""

    null: float = 0.0  # the compiler wants at least one field

    def barrier_active(self):
        return False

    def deflected(self, u, v, normal_x, normal_y):
        return u, v


class Barrier(NamedTuple):
    """No flow into the wall, and Coulomb friction along it (design notes 3.9)."""

    mu: float  # along the wall [1]

    def barrier_active(self):
        return True

    def deflected(self, u, v, normal_x, normal_y):
        """Velocity after a wall with outward unit normal took what runs into it, and mu times that along it."""
        into = u * normal_x + v * normal_y
        along_x, along_y = u - into * normal_x, v - into * normal_y
        along = sqrt(along_x * along_x + along_y * along_y)
        kept = max(along + self.mu * into, 0.0) / along if along > 0.0 else 0.0
        if into >= 0.0:
            along_x, along_y, kept = u, v, 1.0
        return along_x * kept, along_y * kept
