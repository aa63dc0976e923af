"""Curvature of the bed: the flow keeps its speed where the slope changes, and presses harder in hollows.

Two parts under one switch: (T) the velocity turns with the bed at constant speed, (N) the
centrifugal acceleration kappa = u^T Hess(b) u changes the normal load under Coulomb friction. Each alone is there for
tests against exact solutions without the other; on real ground T alone gives too large and N alone too small runouts.
After Hergarten (2024, minVoellmy v2) and Fischer et al. (2012).
"""

from math import sqrt

# parts of the effect, which a number sums up
NO_CURVATURE = 0
TURN = 1  # tangent transport: energy is kept round a bend
LOAD = 2  # centrifugal load: hollows press harder
CURVATURE = TURN + LOAD
# Smallest squared speed that the turned velocity is scaled by: a share of the squared speed before, plus [m2 s-2].
LEAST_SHARE, LEAST_SQUARE = 1e-12, 1e-300


def turned_velocity(u: float, v: float, old_x: float, old_y: float, new_x: float, new_y: float) -> tuple[float, float]:
    """Turn the velocity with the bed; its length on the bed is kept.

    Parameters
    ----------
    u, v : float [m s-1]
        Horizontal velocity.
    old_x, old_y, new_x, new_y : float [1]
        Gradient of the bed before and after the step.

    Returns
    -------
    u, v : float [m s-1]
    """
    w = u * old_x + v * old_y
    out = (w - u * new_x - v * new_y) / (1.0 + new_x * new_x + new_y * new_y)  # along (-b_x, -b_y, 1)
    u_new, v_new, w_new = u + out * new_x, v + out * new_y, w - out
    before = u * u + v * v + w * w
    after = u_new * u_new + v_new * v_new + w_new * w_new
    scale = sqrt(before / max(after, LEAST_SHARE * before + LEAST_SQUARE))
    return u_new * scale, v_new * scale


def centrifugal_acceleration(u: float, v: float, bend_xx: float, bend_xy: float, bend_yy: float) -> float:
    """Compute kappa = u^T Hess(b) u, positive in hollows.

    Parameters
    ----------
    u, v : float [m s-1]
        Horizontal velocity.
    bend_xx, bend_xy, bend_yy : float [m-1]
        Second derivatives (Hessian) of the bed.

    Returns
    -------
    float [m s-2]
    """
    return u * u * bend_xx + 2.0 * u * v * bend_xy + v * v * bend_yy


def effective_gravity(gravity: float, centrifugal: float) -> float:
    """Compute max(0, g + kappa); zero means take-off, and then there is no friction.

    Parameters
    ----------
    gravity : float [m s-2]
    centrifugal : float [m s-2]
        kappa of `centrifugal_acceleration`.

    Returns
    -------
    float [m s-2]
    """
    return max(0.0, gravity + centrifugal)


# one part alone, by the word in a scene instead of "on"
PARTS = {"turn": TURN, "load": LOAD}
