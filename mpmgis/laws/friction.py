"""Basal resistance: the stress with which the bed opposes the flow.

Each law is one plain function of its parameters and the state of the flow; a `Friction` names it by number. The basal
stress is split so that the solver can apply it semi-implicitly:

    tau = dry_stress + viscous_coefficient * speed + density * drag_coefficient * speed^2

The first part does not vanish with speed, the second is linear in speed over a step (by its chord).

All laws have these arguments after their parameters: density [kg m-3], gravity [m s-2], normal_stress on the bed [Pa],
thickness_normal to the bed [m], speed along the ground [m s-1]. They return dry_stress [Pa], viscous_coefficient
[Pa s m-1] and drag_coefficient [1].

Cohesion of the flow to its bed is a yield stress in addition to the friction law. Zones change the parameters of the
law of a scene from node to node, mu(x, y), xi(x, y) and so on, not the law itself.
"""

from math import asin, exp, log, sqrt
from typing import TYPE_CHECKING, NamedTuple

from .quantities import GRAVITY
from .series import sine_cosine

if TYPE_CHECKING:
    import numpy as np

# kinds of law, in the order of `LAWS`
NO_FRICTION, COULOMB, VOELLMY, MODIFIED_VOELLMY, BINGHAM, POULIQUEN = range(6)
SAMOS_AT, VOELLMY_MIN_SHEAR, OBRIEN, HERSCHEL_BULKLEY, MANNING = range(6, 11)
NO_YIELD_STRESS = 1e-6  # [Pa] a smaller yield stress counts as none, because plug_ratio divides by it
LEAST_SPEED = 1e-12  # [m s-1] a divisor in place of the speed at rest
LEAST_STRESS = 1e-9  # [Pa] a divisor in place of the stress on a bed without load
EXCESS_STEPS = 6  # [1] Newton steps of `excess_stress`: the error is below 1e-9 (tests/laws/test_friction_laws.py)
SIZED_LAW, SIZE, BY_VOLUME = "SamosAT", "size", "auto"  # the law with sizes, its key in place of mu, size by volume
SIZES = {"small": 0.22, "medium": 0.17, "large": 0.155}  # [1] mu by size (AvaFrame 2.1, com1DFA)
SIZE_VOLUMES = {"small": 25_000.0, "medium": 60_000.0}  # [m3] of a release, below which it has this size (the same)
DRY, DRAG = "dry", "drag"  # roles: friction coefficient at rest [1]; xi of a turbulent drag rho g u^2 / xi [m s-2]
ROLES = {"mu": DRY, "mu1": DRY, "xi": DRAG}  # by the parameter's name, the same for built-in and user-defined laws


class Friction(NamedTuple):
    """A built-in law by number, with its parameters in the order of `LAWS`; those that it does not have are 0.

    A user-defined law (`own_law`) is a NamedTuple of its own instead.
    """

    kind: int = NO_FRICTION
    a: float = 0.0
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0
    e: float = 0.0
    f: float = 0.0


FRICTIONLESS = Friction()


def coulomb(
    mu: float, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
) -> tuple[float, float, float]:
    """Compute Coulomb friction, tau = mu sigma.

    Dry granular flows: mu = tan of the bed friction angle, 0.1 to 0.7.

    Parameters
    ----------
    mu : float [1]
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    return mu * normal_stress, 0.0, 0.0


def voellmy(
    mu: float, xi: float, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
) -> tuple[float, float, float]:
    """Compute Coulomb friction plus turbulent drag, tau = mu sigma + rho g u^2 / xi (Voellmy 1955).

    Calibrated ranges: snow avalanches mu 0.15 to 0.4, xi 1000 to 3000 m s-2; debris flows mu 0.05 to 0.2,
    xi 100 to 500; rock and rock-ice avalanches mu 0.1 to 0.3, xi 300 to 1500.

    Parameters
    ----------
    mu : float [1]
    xi : float [m s-2]
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    return mu * normal_stress, 0.0, gravity / xi


def modified_voellmy(
    mu: float,
    xi: float,
    crossover_speed: float,
    density: float,
    gravity: float,
    normal_stress: float,
    thickness_normal: float,
    speed: float,
) -> tuple[float, float, float]:
    """Compute Coulomb friction or turbulent drag: mu sigma below the speed v_c h_n^(1/3), rho g u^2 / xi above it.

    Hergarten (2024, minVoellmy v2), with v_c = 4 m/s for a flow of 1 m, justified by the speeds of
    rock avalanches: mu 0.3 to 0.7 (that of dry rock), xi 100 to 1000 m s-2. A slope that starts to move
    keeps mu until it has crossed v_c, and a flow that has slowed to it stops as if dry.

    Parameters
    ----------
    mu : float [1]
    xi : float [m s-2]
    crossover_speed : float [m s-1]
        v_c of a flow of 1 m normal to the bed.
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    if speed < crossover_speed * thickness_normal ** (1.0 / 3.0):
        return mu * normal_stress, 0.0, 0.0
    return 0.0, 0.0, gravity / xi


def plug_ratio(yield_stress: float, viscosity: float, thickness_normal: float, speed: float) -> float:
    """Compute Z = yield stress over basal stress of a Bingham column: 1 at rest, near 0 in fast flow.

    The exact root of Z^3 - (3 + a) Z + 2 = 0 with a = 6 eta |u| / (h_n tau_y): with p = 3 + a and Z = 2 sqrt(p / 3)
    sin(phi), sin(3 phi) = (3 / p)^(3/2). The economised quadratic of Pastor et al. (2004) is 5 % off where the flow
    stops. Z h_n is the thickness of the plug.

    Parameters
    ----------
    yield_stress : float [Pa]
    viscosity : float [Pa s]
    thickness_normal : float [m]
    speed : float [m s-1]

    Returns
    -------
    float [1]
    """
    a = 6.0 * viscosity * speed / (thickness_normal * yield_stress)
    share = 3.0 / (3.0 + a)
    sine, _ = sine_cosine(asin(share * sqrt(share)) / 3.0)
    return 2.0 / sqrt(share) * sine


def bingham(
    yield_stress: float,
    viscosity: float,
    density: float,
    gravity: float,
    normal_stress: float,
    thickness_normal: float,
    speed: float,
) -> tuple[float, float, float]:
    """Compute the stress of a viscous fluid that flows only where it is sheared by more than its yield stress: mud.

    tau = tau_y / Z with Z of `plug_ratio` (Johnson 1970; Pastor et al. 2004; Fois et al. 2024), 3 eta u / h_n without a
    yield stress. The viscous part is what is beyond tau_y. Mudflows: tau_y 10 to 2000 Pa, eta 1 to 500 Pa s; 2000 Pa
    and 50 Pa s in the code of Fois et al.

    Parameters
    ----------
    yield_stress : float [Pa]
        tau_y.
    viscosity : float [Pa s]
        eta.
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    coefficient = 3.0 * viscosity / thickness_normal
    if yield_stress > NO_YIELD_STRESS:
        ratio = plug_ratio(yield_stress, viscosity, thickness_normal, speed)
        coefficient = yield_stress * (1.0 / ratio - 1.0) / max(speed, LEAST_SPEED)
    return yield_stress, coefficient, 0.0


def pouliquen(
    mu1: float,
    mu2: float,
    beta: float,
    length: float,
    density: float,
    gravity: float,
    normal_stress: float,
    thickness_normal: float,
    speed: float,
) -> tuple[float, float, float]:
    """Compute granular friction that grows with speed: mu1 at rest, towards mu2 where the flow is fast and thin.

    tau = sigma (mu1 + (mu2 - mu1) / (1 + beta h_n sqrt(g c h_n) / (L u))), where g c h_n is sigma / rho
    (Pouliquen 1999; Pouliquen & Forterre 2002). Measured on rough planes: glass beads mu1 = tan 21, mu2 = tan 31
    degrees, beta 0.136; sand about tan 27 and tan 43 degrees; L is one to two grain diameters.

    Parameters
    ----------
    mu1, mu2 : float [1]
        At rest, and of fast flow.
    beta : float [1]
    length : float [m]
        L.
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    scale = beta * thickness_normal * sqrt(normal_stress / density) / length  # [m s-1]
    return mu1 * normal_stress, (mu2 - mu1) * normal_stress / max(speed + scale, LEAST_SPEED), 0.0


def samos_at(
    mu: float,
    tau0: float,
    Rs0: float,
    kappa: float,
    R: float,
    B: float,
    density: float,
    gravity: float,
    normal_stress: float,
    thickness_normal: float,
    speed: float,
) -> tuple[float, float, float]:
    """Compute the resistance of SamosAT, the usual law for dense snow avalanches in Austria and South Tyrol.

    tau = tau0 + mu sigma (1 + Rs0 / (Rs0 + Rs)) + rho u^2 / (ln(h_n / R) / kappa + B)^2 with the fluidisation number
    Rs = rho u^2 / sigma and the drag of a logarithmic profile over a bed of roughness R; ln(1) where h_n < R (Sampl &
    Zwinger 2004; Sampl & Granig 2009). At rest the dry part is 2 mu sigma. Calibrated for snow of 200 kg m-3 in
    AvaFrame (com1DFA 2.1): `SIZES` by the volume of the release, the other parameters in common.

    Parameters
    ----------
    mu : float [1]
    tau0 : float [Pa]
        Least shear stress.
    Rs0 : float [1]
    kappa : float [1]
    R : float [m]
    B : float [1]
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    fluidised = density * speed * speed / max(normal_stress, LEAST_STRESS)
    profile = log(max(thickness_normal / R, 1.0)) / kappa + B
    return tau0 + mu * normal_stress * (1.0 + Rs0 / (Rs0 + fluidised)), 0.0, 1.0 / (profile * profile)


def voellmy_min_shear(
    mu: float,
    xi: float,
    tau0: float,
    density: float,
    gravity: float,
    normal_stress: float,
    thickness_normal: float,
    speed: float,
) -> tuple[float, float, float]:
    """Compute Voellmy's resistance and a constant shear stress, tau = tau0 + mu sigma + rho g u^2 / xi.

    The law of that name in AvaFrame (com1DFA 2.1), with mu 0.155, xi 4000 m s-2 and tau0 70 Pa there. The constant
    stress stops thin flow.

    Parameters
    ----------
    mu : float [1]
    xi : float [m s-2]
    tau0 : float [Pa]
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    return tau0 + mu * normal_stress, 0.0, gravity / xi


def obrien(
    yield_stress: float,
    viscosity: float,
    resistance: float,
    manning_n: float,
    density: float,
    gravity: float,
    normal_stress: float,
    thickness_normal: float,
    speed: float,
) -> tuple[float, float, float]:
    """Compute the quadratic law of hyperconcentrated flows and mud, as in FLO-2D.

    tau = tau_y + K eta u / (8 h_n) + rho g n^2 u^2 / h_n^(1/3) (O'Brien & Julien 1985; O'Brien, Julien & Fullerton
    1993). K is 24 on smooth wide ground and 2285 in FLO-2D's manual for most mudflows; n 0.02 to 0.2.

    Parameters
    ----------
    yield_stress : float [Pa]
        tau_y.
    viscosity : float [Pa s]
        eta.
    resistance : float [1]
        K, of laminar flow.
    manning_n : float [s m-1/3]
        n.
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    viscous = resistance * viscosity / (8.0 * thickness_normal)
    return yield_stress, viscous, gravity * manning_n * manning_n / thickness_normal ** (1.0 / 3.0)


def excess_stress(
    yield_stress: float, consistency: float, exponent: float, thickness_normal: float, speed: float
) -> float:
    """Compute the basal stress above the yield stress [Pa] of a Herschel-Bulkley column of a mean speed.

    The root x of u = n / (n + 1) h_n (x / k)^(1/n) z (1 - n z / (2 n + 1)) with z = x / (tau_y + x), by Newton's method
    in ln(x), ln(u). The function is concave there, so that the steps from the solution without yield stress, which is
    smaller, approach the root from one side.

    Parameters
    ----------
    yield_stress : float [Pa]
    consistency : float [Pa s^n]
        k.
    exponent : float [1]
        n.
    thickness_normal : float [m]
    speed : float [m s-1]
        Above 0.
    """
    inverse, share = 1.0 / exponent, exponent / (2.0 * exponent + 1.0)
    level = log(speed / (share * thickness_normal))  # ln of the mean rate of shear without yield stress
    excess = consistency * exp(exponent * level)
    for _ in range(EXCESS_STEPS):
        z = excess / (yield_stress + excess)
        rate = inverse * log(excess / consistency) + log(z * (1.0 - share * z) / (1.0 - share))
        steepness = inverse + (1.0 - z) * (1.0 - share * z / (1.0 - share * z))
        excess *= exp((level - rate) / steepness)
    return excess


def herschel_bulkley(
    yield_stress: float,
    consistency: float,
    exponent: float,
    density: float,
    gravity: float,
    normal_stress: float,
    thickness_normal: float,
    speed: float,
) -> tuple[float, float, float]:
    """Compute the stress of a fluid with a yield stress whose viscosity depends on the rate of shear.

    In the layer tau = tau_y + k (du/dz)^n; the basal stress is that of the steady profile of the mean speed (Coussot
    1994, `excess_stress`). n = 1 is Bingham's law with viscosity k. Debris flows and mud: n 0.3 to 0.5, tau_y 100 to
    2000 Pa, k / tau_y about 0.1 to 0.5 s^n.

    Parameters
    ----------
    yield_stress : float [Pa]
        tau_y.
    consistency : float [Pa s^n]
        k.
    exponent : float [1]
        n.
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    moving = max(speed, LEAST_SPEED)
    return yield_stress, excess_stress(yield_stress, consistency, exponent, thickness_normal, moving) / moving, 0.0


def manning(
    manning_n: float,
    mu: float,
    density: float,
    gravity: float,
    normal_stress: float,
    thickness_normal: float,
    speed: float,
) -> tuple[float, float, float]:
    """Compute the resistance of turbulent water, and dry friction if given: mu sigma + rho g n^2 u^2 / h_n^(1/3).

    Manning (1891), n 0.02 to 0.2 s m-1/3. With mu also debris floods.

    Parameters
    ----------
    manning_n : float [s m-1/3]
        n.
    mu : float [1]
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    return mu * normal_stress, 0.0, gravity * manning_n * manning_n / thickness_normal ** (1.0 / 3.0)


def built_in_parts(
    law: Friction, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
) -> tuple[float, float, float]:
    """Compute the parts of the stress of a built-in law, by its number; all 0 without friction.

    Parameters
    ----------
    law : Friction
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    if law.kind == COULOMB:
        return coulomb(law.a, density, gravity, normal_stress, thickness_normal, speed)
    if law.kind == VOELLMY:
        return voellmy(law.a, law.b, density, gravity, normal_stress, thickness_normal, speed)
    if law.kind == MODIFIED_VOELLMY:
        return modified_voellmy(law.a, law.b, law.c, density, gravity, normal_stress, thickness_normal, speed)
    if law.kind == BINGHAM:
        return bingham(law.a, law.b, density, gravity, normal_stress, thickness_normal, speed)
    if law.kind == POULIQUEN:
        return pouliquen(law.a, law.b, law.c, law.d, density, gravity, normal_stress, thickness_normal, speed)
    if law.kind == SAMOS_AT:
        return samos_at(
            law.a, law.b, law.c, law.d, law.e, law.f, density, gravity, normal_stress, thickness_normal, speed
        )
    if law.kind == VOELLMY_MIN_SHEAR:
        return voellmy_min_shear(law.a, law.b, law.c, density, gravity, normal_stress, thickness_normal, speed)
    if law.kind == OBRIEN:
        return obrien(law.a, law.b, law.c, law.d, density, gravity, normal_stress, thickness_normal, speed)
    if law.kind == HERSCHEL_BULKLEY:
        return herschel_bulkley(law.a, law.b, law.c, density, gravity, normal_stress, thickness_normal, speed)
    if law.kind == MANNING:
        return manning(law.a, law.b, density, gravity, normal_stress, thickness_normal, speed)
    return 0.0, 0.0, 0.0


def stress_parts(
    law: tuple, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
) -> tuple[float, float, float]:
    """Compute the parts of the stress of a law, built in or user-defined.

    Parameters
    ----------
    law : Friction, or a user-defined law
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.

    Returns
    -------
    float [Pa]
        Dry stress.
    float [Pa s m-1]
        Viscous coefficient.
    float [1]
        Drag coefficient.
    """
    if isinstance(law, Friction):
        return built_in_parts(law, density, gravity, normal_stress, thickness_normal, speed)
    return law.stress_parts(density, gravity, normal_stress, thickness_normal, speed)


def built_in_at_node(law: Friction, values: "np.ndarray", j: int, i: int) -> Friction:
    """Return a built-in law with the parameters of node [j, i].

    Parameters
    ----------
    law : Friction
    values : float64[rows, columns, parameters]
        In the order of the law's parameters.
    j, i : int
        Row and column of the node.
    """
    count = values.shape[2]
    b = values[j, i, 1] if count > 1 else 0.0
    c = values[j, i, 2] if count > 2 else 0.0
    d = values[j, i, 3] if count > 3 else 0.0
    e = values[j, i, 4] if count > 4 else 0.0
    f = values[j, i, 5] if count > 5 else 0.0
    return Friction(law.kind, values[j, i, 0], b, c, d, e, f)


def at_node(law: tuple, values: "np.ndarray", j: int, i: int) -> tuple:
    """Return a law of spatially varying friction: the parameters of the friction law at every node are in an array.

    Parameters
    ----------
    law : Friction, or a user-defined law
    values : float64[rows, columns, parameters]
        In the order of the law's parameters.
    j, i : int
        Row and column of the node.
    """
    if isinstance(law, Friction):
        return built_in_at_node(law, values, j, i)
    return law.at_node(values, j, i)


def basal_stress(
    law: tuple, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
) -> float:
    """Compute the total basal stress [Pa] of a law from its three parts.

    Parameters
    ----------
    law : Friction, or a user-defined law
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    dry, viscous, drag = stress_parts(law, density, gravity, normal_stress, thickness_normal, speed)
    return dry + viscous * speed + density * drag * speed * speed


def strength_of_bed(law: Friction) -> tuple[float, float]:
    """Return what a built-in law resists at rest: a friction coefficient [1] and, in addition, a yield stress [Pa].

    Parameters
    ----------
    law : Friction
    """
    without, _, _ = built_in_parts(law, 1000.0, GRAVITY, 0.0, 1.0, 0.0)
    loaded, _, _ = built_in_parts(law, 1000.0, GRAVITY, 1000.0, 1.0, 0.0)  # [Pa]: at rest it is linear in the load
    return (loaded - without) / 1000.0, without


def slowed_speed(
    speed: float, time_step: float, dry_deceleration: float, viscous_rate: float, drag_per_length: float
) -> float:
    """Compute the speed [m s-1] after a step of friction; it never reverses.

    The exact solution of (1 + dt L) s = S - dt k s^2 with S = max(0, speed - dt F). S = 0 is the exact static test
    tan(theta) <= mu on planes.

    Parameters
    ----------
    speed : float [m s-1]
    time_step : float [s]
    dry_deceleration : float [m s-2]
        F.
    viscous_rate : float [s-1]
        L.
    drag_per_length : float [m-1]
        k.
    """
    reduced = speed - time_step * dry_deceleration
    if reduced <= 0.0:
        return 0.0
    linear = 1.0 + time_step * viscous_rate
    return 2.0 * reduced / (linear + sqrt(linear * linear + 4.0 * time_step * drag_per_length * reduced))


class Parameter(NamedTuple):
    """Parameter of a law in a scene: unit, description, range and default."""

    unit: str
    meaning: str
    smallest: float  # smallest and largest value that a scene may give
    largest: float
    default: float | None = None  # None: required


def value_of_role(role: str, values: dict) -> float | None:
    """Return the value of the first parameter with a role; None where there is none.

    Parameters
    ----------
    role : str
        DRY or DRAG.
    values : dict of str to float
        Parameters of a law by name.
    """
    return next((values[name] for name, known in ROLES.items() if known == role and name in values), None)


_MU = Parameter("1", "dry friction coefficient, tan of the bed friction angle", 0.0, 10.0)
_XI = Parameter("m s-2", "turbulent coefficient; larger is more mobile", 1.0, 1e6)
_YIELD_STRESS = Parameter("Pa", "stress below which it does not flow", 0.0, 1e6)
_MANNING = Parameter("s m-1/3", "roughness n of the bed", 1e-4, 1.0)

# law name in a scene -> (law, {parameter: Parameter}), parameters in the order of the law's arguments
LAWS = {
    "Coulomb": (coulomb, {"mu": _MU}),
    "Voellmy": (voellmy, {"mu": _MU, "xi": _XI}),
    "ModifiedVoellmy": (
        modified_voellmy,
        {
            "mu": _MU._replace(meaning="friction coefficient of slow flow"),
            "xi": _XI._replace(meaning="turbulent coefficient of fast flow"),
            "crossover_speed": Parameter("m s-1", "speed between the two, of a flow of 1 m", 0.0, 100.0, 4.0),
        },
    ),
    "Bingham": (
        bingham,
        {"yield_stress": _YIELD_STRESS, "viscosity": Parameter("Pa s", "plastic viscosity", 0.0, 1e6)},
    ),
    "Pouliquen": (
        pouliquen,
        {
            "mu1": Parameter("1", "friction coefficient at rest", 0.0, 10.0),
            "mu2": Parameter("1", "friction coefficient of fast thin flow, at least mu1", 0.0, 10.0),
            "beta": Parameter("1", "of the flow rule u / sqrt(g h) = beta h / h_stop", 1e-6, 100.0, 0.136),
            "length": Parameter("m", "about two grain diameters", 1e-6, 100.0),
        },
    ),
    "SamosAT": (
        samos_at,
        {
            "mu": _MU._replace(meaning="friction coefficient of fast flow; at rest it is twice as large"),
            "tau0": Parameter("Pa", "least shear stress", 0.0, 1e6, 0.0),
            "Rs0": Parameter("1", "fluidisation number at which friction is 1.5 mu", 1e-6, 1e3, 0.222),
            "kappa": Parameter("1", "constant of the logarithmic profile", 0.01, 10.0, 0.43),
            "R": Parameter("m", "roughness of the bed", 1e-6, 100.0, 0.05),
            "B": Parameter("1", "constant of the logarithmic profile", 0.1, 100.0, 4.13),
        },
    ),
    "VoellmyMinShear": (
        voellmy_min_shear,
        {"mu": _MU, "xi": _XI, "tau0": Parameter("Pa", "constant shear stress", 0.0, 1e6, 70.0)},
    ),
    "OBrien": (
        obrien,
        {
            "yield_stress": _YIELD_STRESS,
            "viscosity": Parameter("Pa s", "dynamic viscosity", 0.0, 1e6),
            "resistance": Parameter("1", "resistance K of laminar flow", 0.0, 1e5, 2285.0),
            "manning_n": _MANNING,
        },
    ),
    "HerschelBulkley": (
        herschel_bulkley,
        {
            "yield_stress": _YIELD_STRESS,
            "consistency": Parameter("Pa s^n", "consistency k", 1e-6, 1e6),
            "exponent": Parameter("1", "flow exponent n", 0.1, 3.0),
        },
    ),
    "Manning": (manning, {"manning_n": _MANNING, "mu": _MU._replace(default=0.0)}),
}

NAMES = ("", *LAWS)  # of the laws, by kind


def friction_law(name: str, *values: float, **named: float) -> Friction:
    """Make a built-in law of its parameters, in their order or by name; those with a default may be left out.

    Parameters
    ----------
    name : str
        Of a row of `LAWS`.
    values, named : float
        Parameters, in the units of that row.

    Raises
    ------
    TypeError
        A parameter is missing, or is none of this law.
    """
    parameters = LAWS[name][1]
    given = {key: parameter.default for key, parameter in parameters.items() if parameter.default is not None}
    in_order = dict(zip(parameters, values, strict=False))
    given |= in_order | named
    if len(values) > len(parameters) or set(given) != set(parameters) or set(in_order) & set(named):
        got = ", ".join((*map(str, values), *named))
        raise TypeError(f"friction law {name}: got ({got}), expected ({', '.join(parameters)}); give each of them once")
    return Friction(NAMES.index(name), *(float(given[key]) for key in parameters))


def parameters_of(law: tuple) -> dict[str, float]:
    """Return the parameters of a law by name; none without friction, and none where the flow sticks to the bed.

    Parameters
    ----------
    law : Friction, or a user-defined law
    """
    if not isinstance(law, Friction):
        return law._asdict()
    if not NO_FRICTION < law.kind < len(NAMES):
        return {}
    return dict(zip(LAWS[NAMES[law.kind]][1], law[1:], strict=False))


# alternatives to a parameter in a scene: name -> (the parameter, Parameter of the alternative)
IN_PLACE_OF = {
    "k": ("xi", Parameter("1", "turbulent friction, k = g / xi", GRAVITY / _XI.largest, GRAVITY / _XI.smallest))
}


def given_instead(law: str) -> "dict[str, tuple[str, Parameter]]":
    """Return the parameters that a scene may give in place of those of a built-in law.

    Parameters
    ----------
    law : str
        Name of the law in a scene.

    Returns
    -------
    dict
        Name -> (parameter in whose place it is, its Parameter).
    """
    known = LAWS.get(law, (None, {}))[1]
    return {name: pair for name, pair in IN_PLACE_OF.items() if pair[0] in known}


def parameter_words(law: str, name: str, value: object) -> str:
    """Return a parameter's value with its unit, as text; without a unit where the law is not built in.

    Parameters
    ----------
    law : str
        Name of the law in a scene.
    name : str
        Of a parameter, or of what is given in its place.
    value : float or str
        In SI units.
    """
    text = f"{value:g}" if isinstance(value, float) else str(value)
    known = parameters_to_give(law) if law in LAWS else {}
    unit = known[name].unit if name in known else "1"
    return text if unit == "1" else f"{text} {unit}"


def replaced_by(name: str) -> str:
    """Return the parameter in whose place a scene may give a key.

    Parameters
    ----------
    name : str
        Of IN_PLACE_OF, or SIZE.
    """
    return "mu" if name == SIZE else IN_PLACE_OF[name][0]


def size_of_release(volume: float) -> str:
    """Return the size of an avalanche by the volume of its release, as AvaFrame's com1DFA.

    Parameters
    ----------
    volume : float [m3]
    """
    return next((size for size, limit in SIZE_VOLUMES.items() if volume < limit), "large")


def mu_of_size(size: str) -> float:
    """Return the friction coefficient [1] of a size; of BY_VOLUME the least of all.

    Parameters
    ----------
    size : str
        Of SIZES, or BY_VOLUME while the volume is not known.
    """
    return SIZES.get(size, min(SIZES.values()))


def parameters_to_give(law: str) -> "dict[str, Parameter]":
    """Return what a table or scene may give for a built-in law: its parameters and those in their place, by name.

    Parameters
    ----------
    law : str
    """
    return LAWS[law][1] | {name: parameter for name, (_, parameter) in given_instead(law).items()}


def turbulent_coefficient(k: "float | np.ndarray") -> "float | np.ndarray":
    """Compute the xi with which Voellmy's drag rho g u^2 / xi is rho k u^2.

    Parameters
    ----------
    k : float or float64[...] [1]
        Turbulent friction coefficient, k = g / xi.

    Returns
    -------
    float or float64[...] [m s-2]
    """
    return GRAVITY / k


def contradiction(name: str, parameters: dict) -> str:
    """Return a message for parameters that are valid separately but not together; '' for none.

    Parameters
    ----------
    name : str
        Name of the law in a scene.
    parameters : dict of str to float
    """
    if name == "Pouliquen" and parameters["mu2"] < parameters["mu1"]:
        return f"mu2 = {parameters['mu2']:g} is below mu1 = {parameters['mu1']:g}; friction grows with speed"
    return ""
