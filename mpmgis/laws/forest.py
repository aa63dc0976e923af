"""Forest: standing trees slow the flow and stop part of its mass; they break above a pressure.

Added friction mu_f and added drag c: tau = rho h (mu_f g_n + c U^2), along the ground, h normal to it (com1DFA's
resistance; added friction as in RAMMS: Christen et al. 2010, Teich et al. 2014). Detrainment: mass stops behind trees
at the rate K / U per area of ground (Feistl et al. 2014), with its momentum, so that the rest keeps its speed and is
braked by the stress K. From the first time that rho U^2 reaches the strength the trees do neither.

Where limits of speed or thickness are given, as in com1DFA of AvaFrame, slow or thin flow loses mass and is not braked,
and other flow is braked and loses no mass. Flow that is too thick breaks the trees.
"""

# entries of a node with forest
DETRAINMENT = 0  # [Pa] K
DRAG = 1  # [m-1] added drag c
FRICTION = 2  # [1] added friction mu_f
STRENGTH = 3  # [Pa] pressure from which on trees break
SLOW = 4  # [m s-1] largest speed of flow that only loses mass; 0: no limit
THIN = 5  # [m] largest thickness, normal to the ground, of flow that only loses mass; 0: no limit
TOO_THICK = 6  # [m] thickness above which the flow breaks trees; 0: no limit
SHARE = 7  # [1] share of the node's square with trees; K, c and mu_f above are those of the trees times this share
FOREST_ENTRIES = 8  # number of entries


def forest_breaks(strength: float, too_thick: float, density: float, thickness_normal: float, speed: float) -> bool:
    """Return whether the flow breaks trees: by its pressure rho U^2, or by its thickness.

    Parameters
    ----------
    strength : float [Pa]
        Pressure from which on trees break.
    too_thick : float [m]
        Thickness above which the flow breaks them at any speed; 0: at none.
    density : float [kg m-3]
    thickness_normal : float [m]
        Normal to the ground.
    speed : float [m s-1]
    """
    return density * speed * speed >= strength or (too_thick > 0.0 and thickness_normal > too_thick)


def forest_only_detrains(slow: float, thin: float, thickness_normal: float, speed: float) -> bool:
    """Return whether the flow is slow or thin: it then loses mass and is not braked (com1DFA).

    Parameters
    ----------
    slow : float [m s-1]
        Largest speed of slow flow.
    thin : float [m]
        Largest thickness of thin flow.
    thickness_normal : float [m]
        Normal to the ground.
    speed : float [m s-1]
    """
    return speed <= slow or thickness_normal <= thin


def forest_detrained(detrainment: float, speed: float, time_step: float) -> float:
    """Compute the mass per area of the ground that stops in a step; none of a flow at rest.

    It stops at the rate K / |U|, with its momentum (Feistl et al. 2014).

    Parameters
    ----------
    detrainment : float [Pa]
        K.
    speed : float [m s-1]
    time_step : float [s]

    Returns
    -------
    float [kg m-2]
    """
    if speed <= 0.0:
        return 0.0
    return detrainment * time_step / speed
