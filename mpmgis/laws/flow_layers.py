"""Layers of a flow with Voellmy's drag: their speeds, and the stress between them (theory page, 3D solver).

Voellmy's law tau_b = mu sigma + rho g U^2 / xi (1955) is one of the whole depth: U is its mean speed, and xi a squared
Chezy coefficient. It is the depth integral of a flow whose layers transfer Coulomb friction and a turbulent stress,

    tau(z) = mu p(z) + rho l^2 |du/dz| du/dz,    l = KAPPA (z + z0) sqrt(1 - z / h),

with Prandtl's mixing length l over a bed of roughness z0 and Nikuradse's factor for a stress that is linear in z: a
steady flow has u(z) = (u* / KAPPA) ln(1 + z / z0) with u*^2 = g U^2 / xi. Its mean over depth is U where r = z0 / h
solves (1 + r) ln(1 + 1 / r) - 1 = KAPPA sqrt(xi / g): xi determines the roughness of the bed.
"""

from math import exp, log

KAPPA = 0.4  # [1] von Karman's constant
NEWTON_STEPS = 5  # to round-off for Chezy numbers of 0.01 to 1000
SMOOTHEST = 1e-30  # [1] smallest z0 / h
LEAST_SPREAD = 0.05  # [1] smallest difference of ln(z + z0) between two layers


def relative_roughness(chezy: float) -> float:
    """Compute r = z0 / h [1] of a bed over which the mean speed of a flow is `chezy` times u*.

    Newton's method for ln r; from the limits of smooth beds, r = exp(-1 - X), and of rough ones, 1 / (2 X), with X =
    KAPPA `chezy`.

    Parameters
    ----------
    chezy : float [1]
        sqrt(xi / g), the mean speed over the shear velocity u*.
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


def layer_speed(above: float, roughness: float, chezy: float) -> float:
    """Compute the steady speed at a height over its mean over the depth [1].

    Parameters
    ----------
    above : float [1]
        Height z / h.
    roughness : float [1]
        z0 / h of the bed.
    chezy : float [1]
        sqrt(xi / g), the mean speed over the shear velocity u*.
    """
    return log(1.0 + above / roughness) / (KAPPA * chezy)


def turbulent_link(slip: float, lower: float, upper: float) -> float:
    """Compute the turbulent stress between two layers, over density and slip.

    The stress is rho `turbulent_link` `slip` where it is as at the bed. Between the layers du/dz is proportional to 1 /
    (z + z0), so that the steady profile is exact at any two heights.

    Parameters
    ----------
    slip : float [m s-1]
        Difference of speed of the layers.
    lower, upper : float [m]
        Heights of the layers, both with z0 added.

    Returns
    -------
    float [m s-1]
    """
    spread = max(log(upper / lower), LEAST_SPREAD)
    return KAPPA * KAPPA * slip / (spread * spread)
