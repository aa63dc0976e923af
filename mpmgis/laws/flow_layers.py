"""Layers of a flow with Voellmy's drag: their speeds, and the stress between them (theory page, 3D solver).

Voellmy's law tau_b = mu sigma + rho g U^2 / xi (1955) is one of the whole depth: U is its mean speed, and xi a squared
Chezy coefficient. It is the depth integral of a flow whose layers transfer Coulomb friction and a turbulent stress,

    tau(z) = mu p(z) + rho l^2 |du/dz| du/dz,    l = KAPPA (z + z0) sqrt(1 - z / h),

with Prandtl's mixing length l over a bed of roughness z0 and Nikuradse's factor for a stress that is linear in z: a
steady flow has u(z) = (u* / KAPPA) ln(1 + z / z0) with u*^2 = g U^2 / xi. Its mean over depth is U where r = z0 / h
solves (1 + r) ln(1 + 1 / r) - 1 = KAPPA sqrt(xi / g): xi determines the roughness of the bed.
"""

from math import exp, log, sqrt

KAPPA = 0.4  # von Karman's constant
NEWTON_STEPS = 5  # to round-off for Chezy numbers of 0.01 to 1000
SMOOTHEST = 1e-30  # smallest z0 / h
LEAST_SPREAD = 0.05  # smallest difference of ln(z + z0) between two layers


def relative_roughness(chezy):
    """r = z0 / h [1] of a bed over which a flow of depth h has the mean speed `chezy` [1] times u*, sqrt(xi / g).

    Newton's method for ln r; from the limits of smooth beds, r = exp(-1 - X), and of rough ones, 1 / (2 X).
    """
    asked = KAPPA * chezy
    guess = -1.0 - asked if asked > 1.0 else -log(2.0 * asked)
    if guess < log(SMOOTHEST):
        return SMOOTHEST
    for _ in range(NEWTON_STEPS):
        r = exp(guess)
        steep = log(1.0 + 1.0 / r)
        guess -= ((1.0 + r) * steep - 1.0 - asked) / (r * steep - 1.0)
    return exp(guess)


def layer_speed(above, roughness, chezy):
    """Steady speed over its depth mean [1] at `above` = z / h [1], over a bed of `roughness` z0 / h [1]."""
    return log(1.0 + above / roughness) / (KAPPA * chezy)


def turbulent_link(slip, lower, upper):
    """Turbulent stress over density and slip [m s-1] between layers at `lower` and `upper` [m], both with z0 added.

    The stress is rho `turbulent_link` `slip` where it is as at the bed; `slip` [m s-1] is their difference of speed.
    Between them du/dz is proportional to 1 / (z + z0), so that the steady profile is exact at any two heights.
    """
    spread = max(log(upper / lower), LEAST_SPREAD)
    return KAPPA * KAPPA * slip / (spread * spread)


def chezy_number(xi, gravity):
    """sqrt(xi / g) [1]: the mean speed of a flow over the shear velocity u* of its drag."""
    return sqrt(xi / max(gravity, 1e-300))
