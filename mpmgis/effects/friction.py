"""Basal resistance: the stress with which the bed opposes the flow.

A friction law is a NamedTuple of its parameters with methods that run as plain Python and, unchanged, inside the
compiled solver. The basal stress is split so that the solver can apply it semi-implicitly (design notes 3.5):

    tau = dry_stress + viscous_coefficient * speed + density * drag_coefficient * speed^2

and `placed` gives the same law with the parameters of a place (`effects/zones`).
"""

from math import sqrt
from typing import NamedTuple


class Frictionless(NamedTuple):
    """No resistance at all: the null law of the slot."""

    null: float = 0.0  # the compiler wants at least one field

    def dry_stress(self, density, normal_stress, thickness_normal, speed):
        return 0.0

    def viscous_coefficient(self, density, gravity, normal_stress, thickness_normal, speed):
        return 0.0

    def drag_coefficient(self, gravity, thickness_normal, speed):
        return 0.0

    def placed(self, values, j, i):
        return self


class Coulomb(NamedTuple):
    """Coulomb friction, tau = mu sigma.

    Dry granular flows: mu = tan of the bed friction angle, 0.1 to 0.7.
    """

    mu: float

    def dry_stress(self, density, normal_stress, thickness_normal, speed):
        return self.mu * normal_stress

    def viscous_coefficient(self, density, gravity, normal_stress, thickness_normal, speed):
        return 0.0

    def drag_coefficient(self, gravity, thickness_normal, speed):
        return 0.0

    def placed(self, values, j, i):
        return Coulomb(values[j, i, 0])


class Voellmy(NamedTuple):
    """Coulomb friction plus turbulent drag, tau = mu sigma + rho g u^2 / xi (Voellmy 1955).

    Calibrated ranges: snow avalanches mu 0.15 to 0.4, xi 1000 to 3000 m s-2; debris flows mu 0.05 to 0.2,
    xi 100 to 500; rock and rock-ice avalanches mu 0.1 to 0.3, xi 300 to 1500.
    """

    mu: float
    xi: float

    def dry_stress(self, density, normal_stress, thickness_normal, speed):
        return self.mu * normal_stress

    def viscous_coefficient(self, density, gravity, normal_stress, thickness_normal, speed):
        return 0.0

    def drag_coefficient(self, gravity, thickness_normal, speed):
        return gravity / self.xi

    def placed(self, values, j, i):
        return Voellmy(values[j, i, 0], values[j, i, 1])


def basal_stress(law, density, gravity, normal_stress, thickness_normal, speed):
    """Whole basal stress [Pa] of `law` at `speed` [m s-1] under `normal_stress` [Pa], as text-books print it."""
    dry = law.dry_stress(density, normal_stress, thickness_normal, speed)
    viscous = law.viscous_coefficient(density, gravity, normal_stress, thickness_normal, speed)
    drag = law.drag_coefficient(gravity, thickness_normal, speed)
    return dry + viscous * speed + density * drag * speed * speed


def slowed_speed(speed, time_step, dry_deceleration, viscous_rate, drag_per_length):
    """Speed [m s-1] after `time_step` [s] of friction; never reverses (design notes 3.5).

    The exact solution of (1 + dt L) s = S - dt k s^2 with S = max(0, speed - dt F): F is `dry_deceleration` [m s-2], L
    is `viscous_rate` [s-1], k is `drag_per_length` [m-1]. S = 0 is the exact static test tan(theta) <= mu on planes.
    """
    reduced = speed - time_step * dry_deceleration
    if reduced <= 0.0:
        return 0.0
    linear = 1.0 + time_step * viscous_rate
    return 2.0 * reduced / (linear + sqrt(linear * linear + 4.0 * time_step * drag_per_length * reduced))


# law name in a scene -> (law, {parameter: (unit, meaning, smallest, largest)})
LAWS = {
    "Coulomb": (Coulomb, {"mu": ("1", "friction coefficient, tan of the bed friction angle", 0.0, 10.0)}),
    "Voellmy": (
        Voellmy,
        {
            "mu": ("1", "dry friction coefficient", 0.0, 10.0),
            "xi": ("m s-2", "turbulent coefficient; larger is more mobile", 1.0, 1e6),
        },
    ),
}
