"""Which part of a point's velocity gradient the 3D transfer carries on to the next step (Jiang et al. 2015)."""

from typing import NamedTuple


class WholeGradient(NamedTuple):
    """APIC: all of it. Exact for linear fields."""

    null: float = 0.0  # the compiler wants at least one field

    def only_turns(self):
        return False


class TurningGradient(NamedTuple):
    """RPIC: only the antisymmetric part, its rotation. Angular momentum is kept, strain rates diffuse.

    No scene can ask for it: tests hold what must not depend on the transfer against it.
    """

    null: float = 0.0  # the compiler wants at least one field

    def only_turns(self):
        return True
