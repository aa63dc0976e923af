"""The metric in which lengths along the ground are measured.

`slope` is for mass flows on steep ground: a body constrained to the bed is driven by g sin cos, and speed is the
length along the ground. `swe` is the shallow-water form for water and lakes on gentle beds.
"""

from typing import NamedTuple


class SlopeMetric(NamedTuple):
    """Lengths along the bed: the metric gradient is the bed's."""

    null: float = 0.0  # the compiler requires a field

    def metric_gradient(self, gradient_x: float, gradient_y: float) -> tuple[float, float]:
        """Return the gradient of the bed.

        Parameters
        ----------
        gradient_x, gradient_y : float [1]
            Gradient of the bed.
        """
        return gradient_x, gradient_y


class WaterMetric(NamedTuple):
    """Horizontal lengths, classic shallow water: the metric gradient is zero."""

    null: float = 0.0  # the compiler requires a field

    def metric_gradient(self, gradient_x: float, gradient_y: float) -> tuple[float, float]:
        """Return (0, 0): lengths are horizontal.

        Parameters
        ----------
        gradient_x, gradient_y : float [1]
            Gradient of the bed.
        """
        return 0.0, 0.0


def cosine_squared(metric_x: float, metric_y: float) -> float:
    """Compute c^2 = 1 / (1 + T^2) [1], where T is the length of the metric gradient.

    Parameters
    ----------
    metric_x, metric_y : float [1]
        Metric gradient.
    """
    return 1.0 / (1.0 + metric_x * metric_x + metric_y * metric_y)


FORMS = {"slope": SlopeMetric, "swe": WaterMetric}
