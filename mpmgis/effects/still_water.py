"""Still water as a reference state: a lake at rest stays at rest to round-off."""

from typing import NamedTuple


class NoStillWater(NamedTuple):
    """The null law: no reference depth."""

    null: float = 0.0  # the compiler requires a field

    def still_water_active(self):
        return False

    def reference_depth(self, bed, level):
        return 0.0


class StillWater(NamedTuple):
    """Lakes at rest; form `swe` only. Each cell of the grid has the still-water level of its lake."""

    null: float = 0.0  # the compiler requires a field

    def still_water_active(self):
        return True

    def reference_depth(self, bed, level):
        """Depth of the still lake [m] over `bed` [m]; `level` [m] is very low where there is no lake."""
        return max(level - bed, 0.0)
