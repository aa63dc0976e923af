"""Spatially varying friction: the parameters of the friction law at every node of the solver's grid.

mu(x, y), xi(x, y) and the like. A zone changes the parameters of the law of the scene, not the law
itself.
"""

from typing import NamedTuple


class NoZones(NamedTuple):
    """The null law: the same friction everywhere."""

    null: float = 0.0  # the compiler requires a field

    def local(self, friction, values, j, i):
        """The law at node [j, i]."""
        return friction


class FrictionZones(NamedTuple):
    """The law's parameters come from the node array `values[j, i, :]`, in the order of the law's fields."""

    null: float = 0.0  # the compiler requires a field

    def local(self, friction, values, j, i):
        return friction.at_node(values, j, i)
