"""Still water as a reference state: a lake at rest stays at rest to round-off."""

from typing import NamedTuple


class NoStillWater(NamedTuple):
    """The null law: no reference depth."""

    null: float = 0.0  # the compiler requires a field

    def still_water_active(self) -> bool:
        """Return False: there are no lakes."""
        return False

    def reference_depth(self, bed: float, level: float) -> float:
        """Return 0: there is no reference depth.

        Parameters
        ----------
        bed : float [m]
            Elevation of the bed.
        level : float [m]
            Elevation of the still water; very low where there is no lake.
        """
        return 0.0


class StillWater(NamedTuple):
    """Lakes at rest; form `swe` only. Each cell of the grid has the still-water level of its lake."""

    null: float = 0.0  # the compiler requires a field

    def still_water_active(self) -> bool:
        """Return True: there are lakes."""
        return True

    def reference_depth(self, bed: float, level: float) -> float:
        """Compute the depth of the still lake [m].

        Parameters
        ----------
        bed : float [m]
            Elevation of the bed.
        level : float [m]
            Elevation of the still water; very low where there is no lake.
        """
        return max(level - bed, 0.0)
