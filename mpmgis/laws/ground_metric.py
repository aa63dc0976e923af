"""The metric in which lengths along the ground are measured.

`slope` is for mass flows on steep ground: a body constrained to the bed is driven by g sin cos, and speed is the
length along the ground. `swe` is the shallow-water form for water and lakes on gentle beds.
"""

SLOPE, WATER = range(2)  # kinds of metric, in the order of `FORMS`


def slope_gradient(gradient_x: float, gradient_y: float) -> tuple[float, float]:
    """Return lengths along the bed: the metric gradient is the bed's.

    Parameters
    ----------
    gradient_x, gradient_y : float [1]
        Gradient of the bed.
    """
    return gradient_x, gradient_y


def water_gradient(gradient_x: float, gradient_y: float) -> tuple[float, float]:
    """Return horizontal lengths, classic shallow water: the metric gradient is zero.

    Parameters
    ----------
    gradient_x, gradient_y : float [1]
        Gradient of the bed.
    """
    return 0.0, 0.0


def metric_gradient(metric: int, gradient_x: float, gradient_y: float) -> tuple[float, float]:
    """Compute the gradient [1] by which lengths on the map become lengths of a metric.

    Parameters
    ----------
    metric : int
        SLOPE or WATER.
    gradient_x, gradient_y : float [1]
        Gradient of the bed.
    """
    if metric == WATER:
        return water_gradient(gradient_x, gradient_y)
    return slope_gradient(gradient_x, gradient_y)


def cosine_squared(metric_x: float, metric_y: float) -> float:
    """Compute c^2 = 1 / (1 + T^2) [1], where T is the length of the metric gradient.

    Parameters
    ----------
    metric_x, metric_y : float [1]
        Metric gradient.
    """
    return 1.0 / (1.0 + metric_x * metric_x + metric_y * metric_y)


# word in a scene -> law; its kind is its place
FORMS = {"slope": slope_gradient, "swe": water_gradient}
