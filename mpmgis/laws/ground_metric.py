"""The metric in which lengths along the ground are measured.

`slope` is for mass flows on steep ground: a body constrained to the bed is driven by g sin cos, and speed is the
length along the ground. `swe` is the shallow-water form for water and lakes on gentle beds.

Still water as a reference state: a lake at rest stays at rest to round-off.
"""

from typing import NamedTuple


class SlopeMetric(NamedTuple):
    """Lengths along the bed: the metric gradient is the bed's."""

    null: float = 0.0  # the compiler requires a field

    def metric_gradient(self, gradient_x, gradient_y):
        return gradient_x, gradient_y


class WaterMetric(NamedTuple):
    """Horizontal lengths, classic shallow water: the metric gradient is zero."""

    null: float = 0.0  # the compiler requires a field

    def metric_gradient(self, gradient_x, gradient_y):
        return 0.0, 0.0


def cosine_squared(metric_x, metric_y):
    """c^2 = 1 / (1 + T^2) of a metric gradient."""
    return 1.0 / (1.0 + metric_x * metric_x + metric_y * metric_y)


FORMS = {"slope": SlopeMetric, "swe": WaterMetric}


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
