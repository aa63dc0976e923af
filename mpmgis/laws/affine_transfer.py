"""Part of a point's velocity gradient that the 3D transfer keeps for the next step (Jiang et al. 2015)."""

from typing import NamedTuple


class WholeGradient(NamedTuple):
    """APIC: the whole gradient. Exact for linear fields."""

    null: float = 0.0  # the compiler requires a field

    def only_turns(self) -> bool:
        """Return False: the whole gradient is kept."""
        return False


class TurningGradient(NamedTuple):
    """RPIC: only the antisymmetric part, its rotation. Angular momentum is conserved, strain rates diffuse.

    Not available in scenes; used in tests of results that must not depend on the transfer.
    """

    null: float = 0.0  # the compiler requires a field

    def only_turns(self) -> bool:
        """Return True: only the rotation is kept."""
        return True
