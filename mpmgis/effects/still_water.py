"""Still water as a reference state: a lake at rest stays at rest to round-off (design notes 3.6)."""

from typing import NamedTuple


class NoStillWater(NamedTuple):
    """The null law: no reference depth."""

    null: float = 0.0  # the compiler wants at least one field

    def still_water_active(self):
        return False

    def reference_depth(self, bed):
        return 0.0


class StillWater(NamedTuple):
    """A lake whose surface at rest lies at `level` [m, same datum as the DTM]; form `swe` only."""

    level: float

    def still_water_active(self):
        return True

    def reference_depth(self, bed):
        """Depth of the still lake [m] over `bed` [m]."""
        return max(self.level - bed, 0.0)
