"""Basal resistance: the stress with which the bed opposes the flow.

A friction law is a NamedTuple of its parameters with methods that run as plain Python and, unchanged, inside the
compiled solver. The basal stress is split so that the solver can apply it semi-implicitly:

    tau = dry_stress + viscous_coefficient * speed + density * drag_coefficient * speed^2

The first part does not vanish with speed, the second is linear in speed over a step (by its chord). `at_node` gives the
law with the parameters of a node of the solver's grid.

All laws have these arguments: density [kg m-3], gravity [m s-2], normal_stress on the bed [Pa], thickness_normal to the
bed [m], speed along the ground [m s-1]. Stresses are in Pa.

Cohesion of the flow to its bed is a yield stress in addition to the friction law. Zones change the parameters of the
law of a scene from node to node, mu(x, y), xi(x, y) and so on, not the law itself.
"""

from math import asin, sin, sqrt
from typing import TYPE_CHECKING, NamedTuple

from .quantities import GRAVITY

if TYPE_CHECKING:
    import numpy as np

NO_YIELD_STRESS = 1e-6  # [Pa] a smaller yield stress counts as none, because plug_ratio divides by it
LEAST_SPEED = 1e-12  # [m s-1] a divisor in place of the speed at rest
DRY, DRAG = "dry", "drag"  # roles: friction coefficient at rest [1]; xi of a turbulent drag rho g u^2 / xi [m s-2]
ROLES = {"mu": DRY, "mu1": DRY, "xi": DRAG}  # by the parameter's name, the same for built-in and user-defined laws


class Frictionless(NamedTuple):
    """No resistance at all: the null law of the slot."""

    null: float = 0.0  # the compiler requires a field

    def dry_stress(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Return 0: there is no resistance.

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return 0.0

    def viscous_coefficient(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Return 0: no part of the stress is linear in speed.

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return 0.0

    def drag_coefficient(self, gravity: float, thickness_normal: float, speed: float) -> float:
        """Return 0: no part of the stress is quadratic in speed.

        Parameters
        ----------
        gravity, thickness_normal, speed : float
            [m s-2], [m], [m s-1].
        """
        return 0.0

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "Frictionless":
        """Return this law, which is the same at each node.

        Parameters
        ----------
        values : float64[rows, columns, parameters]
            In the order of the law's fields.
        j, i : int
            Row and column of the node.
        """
        return self


class Coulomb(NamedTuple):
    """Coulomb friction, tau = mu sigma.

    Dry granular flows: mu = tan of the bed friction angle, 0.1 to 0.7.
    """

    mu: float  # [1]

    def dry_stress(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Compute mu sigma [Pa].

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return self.mu * normal_stress

    def viscous_coefficient(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Return 0: no part of the stress is linear in speed.

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return 0.0

    def drag_coefficient(self, gravity: float, thickness_normal: float, speed: float) -> float:
        """Return 0: no part of the stress is quadratic in speed.

        Parameters
        ----------
        gravity, thickness_normal, speed : float
            [m s-2], [m], [m s-1].
        """
        return 0.0

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "Coulomb":
        """Return the law with the parameters of node [j, i].

        Parameters
        ----------
        values : float64[rows, columns, parameters]
            In the order of the law's fields.
        j, i : int
            Row and column of the node.
        """
        return Coulomb(values[j, i, 0])


class Voellmy(NamedTuple):
    """Coulomb friction plus turbulent drag, tau = mu sigma + rho g u^2 / xi (Voellmy 1955).

    Calibrated ranges: snow avalanches mu 0.15 to 0.4, xi 1000 to 3000 m s-2; debris flows mu 0.05 to 0.2,
    xi 100 to 500; rock and rock-ice avalanches mu 0.1 to 0.3, xi 300 to 1500.
    """

    mu: float  # [1]
    xi: float  # [m s-2]

    def dry_stress(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Compute mu sigma [Pa].

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return self.mu * normal_stress

    def viscous_coefficient(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Return 0: no part of the stress is linear in speed.

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return 0.0

    def drag_coefficient(self, gravity: float, thickness_normal: float, speed: float) -> float:
        """Compute g / xi [1].

        Parameters
        ----------
        gravity, thickness_normal, speed : float
            [m s-2], [m], [m s-1].
        """
        return gravity / self.xi

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "Voellmy":
        """Return the law with the parameters of node [j, i].

        Parameters
        ----------
        values : float64[rows, columns, parameters]
            In the order of the law's fields.
        j, i : int
            Row and column of the node.
        """
        return Voellmy(values[j, i, 0], values[j, i, 1])


class ModifiedVoellmy(NamedTuple):
    """Either Coulomb friction or turbulent drag: mu sigma below the speed v_c h_n^(1/3), rho g u^2 / xi above it.

    Hergarten (2024, minVoellmy v2), with v_c = 4 m/s for a flow of 1 m, justified by the speeds of
    rock avalanches: mu 0.3 to 0.7 (that of dry rock), xi 100 to 1000 m s-2. A slope that starts to move
    keeps mu until it has crossed v_c, and a flow that has slowed to it stops as if dry.
    """

    mu: float  # [1]
    xi: float  # [m s-2]
    crossover_speed: float  # v_c [m s-1], of a flow of 1 m normal to the bed

    def dry_stress(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Compute mu sigma [Pa] of slow flow, 0 of fast flow.

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        slow = speed < self.crossover_speed * thickness_normal ** (1.0 / 3.0)
        return self.mu * normal_stress if slow else 0.0

    def viscous_coefficient(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Return 0: no part of the stress is linear in speed.

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return 0.0

    def drag_coefficient(self, gravity: float, thickness_normal: float, speed: float) -> float:
        """Compute g / xi [1] of fast flow, 0 of slow flow.

        Parameters
        ----------
        gravity, thickness_normal, speed : float
            [m s-2], [m], [m s-1].
        """
        slow = speed < self.crossover_speed * thickness_normal ** (1.0 / 3.0)
        return 0.0 if slow else gravity / self.xi

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "ModifiedVoellmy":
        """Return the law with the parameters of node [j, i].

        Parameters
        ----------
        values : float64[rows, columns, parameters]
            In the order of the law's fields.
        j, i : int
            Row and column of the node.
        """
        return ModifiedVoellmy(values[j, i, 0], values[j, i, 1], values[j, i, 2])


def plug_ratio(law: tuple, thickness_normal: float, speed: float) -> float:
    """Compute Z = yield stress over basal stress of a Bingham column: 1 at rest, near 0 in fast flow.

    The exact root of Z^3 - (3 + a) Z + 2 = 0 with a = 6 eta |u| / (h_n tau_y): with p = 3 + a and Z = 2 sqrt(p / 3)
    sin(phi), sin(3 phi) = (3 / p)^(3/2). The economised quadratic of Pastor et al. (2004) is 5 % off where the flow
    stops. Z h_n is the thickness of the plug.

    Parameters
    ----------
    law : law
        With the fields `viscosity` [Pa s] and `yield_stress` [Pa].
    thickness_normal : float [m]
    speed : float [m s-1]

    Returns
    -------
    float [1]
    """
    a = 6.0 * law.viscosity * speed / (thickness_normal * law.yield_stress)
    share = 3.0 / (3.0 + a)
    return 2.0 / sqrt(share) * sin(asin(share * sqrt(share)) / 3.0)


class Bingham(NamedTuple):
    """A viscous fluid that flows only where it is sheared by more than its yield stress: mud, fine debris.

    tau = tau_y / Z with Z of `plug_ratio` (Johnson 1970; Pastor et al. 2004; Fois et al. 2024), 3 eta u / h_n without a
    yield stress. Mudflows: tau_y 10 to 2000 Pa, eta 1 to 500 Pa s; 2000 Pa and 50 Pa s in the code of Fois et al.
    """

    yield_stress: float  # tau_y [Pa]
    viscosity: float  # eta [Pa s]

    plug_ratio = plug_ratio

    def dry_stress(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Return the yield stress tau_y [Pa].

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return self.yield_stress

    def viscous_coefficient(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Compute the part of tau_y / Z beyond tau_y, over the speed [Pa s m-1]; 3 eta / h_n without tau_y.

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        coefficient = 3.0 * self.viscosity / thickness_normal
        if self.yield_stress > NO_YIELD_STRESS:
            ratio = self.plug_ratio(thickness_normal, speed)
            coefficient = self.yield_stress * (1.0 / ratio - 1.0) / max(speed, LEAST_SPEED)
        return coefficient

    def drag_coefficient(self, gravity: float, thickness_normal: float, speed: float) -> float:
        """Return 0: no part of the stress is quadratic in speed.

        Parameters
        ----------
        gravity, thickness_normal, speed : float
            [m s-2], [m], [m s-1].
        """
        return 0.0

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "Bingham":
        """Return the law with the parameters of node [j, i].

        Parameters
        ----------
        values : float64[rows, columns, parameters]
            In the order of the law's fields.
        j, i : int
            Row and column of the node.
        """
        return Bingham(values[j, i, 0], values[j, i, 1])


class Pouliquen(NamedTuple):
    """Granular friction that grows with speed: mu1 at rest, towards mu2 where the flow is fast and thin.

    tau = sigma (mu1 + (mu2 - mu1) / (1 + beta h_n sqrt(g c h_n) / (L u))), where g c h_n is sigma / rho
    (Pouliquen 1999; Pouliquen & Forterre 2002). Measured on rough planes: glass beads mu1 = tan 21, mu2 = tan 31
    degrees, beta 0.136; sand about tan 27 and tan 43 degrees; L is one to two grain diameters.
    """

    mu1: float  # [1] at rest
    mu2: float  # [1] fast
    beta: float  # [1]
    length: float  # L [m]

    def dry_stress(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Compute mu1 sigma [Pa].

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        return self.mu1 * normal_stress

    def viscous_coefficient(
        self, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
    ) -> float:
        """Compute the part of the stress beyond mu1 sigma, over the speed [Pa s m-1].

        Parameters
        ----------
        density, gravity, normal_stress, thickness_normal, speed : float
            [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
        """
        scale = self.beta * thickness_normal * sqrt(normal_stress / density) / self.length  # [m s-1]
        return (self.mu2 - self.mu1) * normal_stress / max(speed + scale, LEAST_SPEED)

    def drag_coefficient(self, gravity: float, thickness_normal: float, speed: float) -> float:
        """Return 0: no part of the stress is quadratic in speed.

        Parameters
        ----------
        gravity, thickness_normal, speed : float
            [m s-2], [m], [m s-1].
        """
        return 0.0

    def at_node(self, values: "np.ndarray", j: int, i: int) -> "Pouliquen":
        """Return the law with the parameters of node [j, i].

        Parameters
        ----------
        values : float64[rows, columns, parameters]
            In the order of the law's fields.
        j, i : int
            Row and column of the node.
        """
        return Pouliquen(values[j, i, 0], values[j, i, 1], values[j, i, 2], values[j, i, 3])


def basal_stress(
    law: tuple, density: float, gravity: float, normal_stress: float, thickness_normal: float, speed: float
) -> float:
    """Compute the total basal stress [Pa] of a law from its three parts.

    Parameters
    ----------
    law : law
        Friction law.
    density, gravity, normal_stress, thickness_normal, speed : float
        [kg m-3], [m s-2], [Pa], [m], [m s-1], as in the docstring of the module.
    """
    dry = law.dry_stress(density, gravity, normal_stress, thickness_normal, speed)
    viscous = law.viscous_coefficient(density, gravity, normal_stress, thickness_normal, speed)
    drag = law.drag_coefficient(gravity, thickness_normal, speed)
    return dry + viscous * speed + density * drag * speed * speed


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

# law name in a scene -> (law, {parameter: Parameter}), parameters in the order of the law's fields
LAWS = {
    "Coulomb": (Coulomb, {"mu": _MU}),
    "Voellmy": (Voellmy, {"mu": _MU, "xi": _XI}),
    "ModifiedVoellmy": (
        ModifiedVoellmy,
        {
            "mu": _MU._replace(meaning="friction coefficient of slow flow"),
            "xi": _XI._replace(meaning="turbulent coefficient of fast flow"),
            "crossover_speed": Parameter("m s-1", "speed between the two, of a flow of 1 m", 0.0, 100.0, 4.0),
        },
    ),
    "Bingham": (
        Bingham,
        {
            "yield_stress": Parameter("Pa", "stress below which it does not flow", 0.0, 1e6),
            "viscosity": Parameter("Pa s", "plastic viscosity", 0.0, 1e6),
        },
    ),
    "Pouliquen": (
        Pouliquen,
        {
            "mu1": Parameter("1", "friction coefficient at rest", 0.0, 10.0),
            "mu2": Parameter("1", "friction coefficient of fast thin flow, at least mu1", 0.0, 10.0),
            "beta": Parameter("1", "of the flow rule u / sqrt(g h) = beta h / h_stop", 1e-6, 100.0, 0.136),
            "length": Parameter("m", "about two grain diameters", 1e-6, 100.0),
        },
    ),
}


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


class NoCohesion(NamedTuple):
    """The null law: nothing is added."""

    null: float = 0.0  # the compiler requires a field

    def cohesive_stress(self) -> float:
        """Return 0: there is no cohesion."""
        return 0.0


class Cohesion(NamedTuple):
    """A basal stress tau_0 that does not depend on load or speed, added to the friction law's.

    tau_0 of VoellmyMinShear (AvaFrame com1DFA). Dry snow 0 to 100 Pa, wet snow 50 to 1000 Pa, debris
    flows 100 to 5000 Pa.
    """

    stress: float  # tau_0 [Pa]

    def cohesive_stress(self) -> float:
        """Return tau_0 [Pa]."""
        return self.stress


class NoZones(NamedTuple):
    """The null law: the same friction everywhere."""

    null: float = 0.0  # the compiler requires a field

    def local(self, friction: tuple, values: "np.ndarray", j: int, i: int) -> tuple:
        """Return the law unchanged, at each node [j, i].

        Parameters
        ----------
        friction : law
            Friction law.
        values : float64[rows, columns, parameters]
            Not used.
        j, i : int
            Row and column of the node.
        """
        return friction


class FrictionZones(NamedTuple):
    """Spatially varying friction: the parameters of the friction law at every node, from the array `values`."""

    null: float = 0.0  # the compiler requires a field

    def local(self, friction: tuple, values: "np.ndarray", j: int, i: int) -> tuple:
        """Return the law with the parameters of node [j, i].

        Parameters
        ----------
        friction : law
            Friction law.
        values : float64[rows, columns, parameters]
            In the order of the law's fields.
        j, i : int
            Row and column of the node.
        """
        return friction.at_node(values, j, i)
