"""Exact and near-exact answers of the depth-averaged equations, as small functions of place and time.

Lengths in metres, times in seconds, angles in radians, depths and thicknesses as each function says. None of them knows
the solver; `test_exact_solutions.py` substitutes every one into the equations that it claims to solve.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

G = 9.81


def mangeney(x, t, depth, slope, delta):
    """(slope-normal depth, speed) `x` along the slope from a dam that broke at t = 0 (V7; Mangeney et al. 2000).

    `depth` is the reservoir's, `delta` the angle of Coulomb friction; slope = delta = 0 is Ritter's dam break (1892).
    """
    m = G * np.cos(slope) * (np.tan(slope) - np.tan(delta))
    c0 = np.sqrt(G * depth * np.cos(slope))
    back, front = -c0 * t + m * t**2 / 2, 2 * c0 * t + m * t**2 / 2
    h = np.where(x < back, depth, (2 * c0 - x / t + m * t / 2) ** 2 / (9 * G * np.cos(slope)))
    u = np.where(x < back, m * t, 2 / 3 * (c0 + x / t + m * t))
    return np.where(x > front, 0.0, h), np.where(x > front, 0.0, u)


def stoker_middle(left, right):
    """(depth, speed, speed of the shock) behind the shock of a dam break on a wet bed (V6; Stoker 1957)."""

    def residual(h):
        return 2 * (np.sqrt(G * left) - np.sqrt(G * h)) - (h - right) * np.sqrt(G / 2 * (1 / h + 1 / right))

    depth = brentq(residual, right, left, xtol=1e-14)
    speed = 2 * (np.sqrt(G * left) - np.sqrt(G * depth))
    return depth, speed, depth * speed / (depth - right)


def stoker(x, t, left, right):
    """(depth, speed) of the dam break between depths `left` and `right` on a level bed."""
    depth, speed, shock = stoker_middle(left, right)
    c0, cm = np.sqrt(G * left), np.sqrt(G * depth)
    fan = (2 * c0 - x / t) ** 2 / (9 * G)
    h = np.where(x < -c0 * t, left, np.where(x < (speed - cm) * t, fan, depth))
    u = np.where(x < -c0 * t, 0.0, np.where(x < (speed - cm) * t, 2 / 3 * (c0 + x / t), speed))
    return np.where(x > shock * t, right, h), np.where(x > shock * t, 0.0, u)


class SimilarityCap:
    """A parabolic cap of Coulomb material that slides down a plane and stays a parabola (V8; Hutter et al. 1993).

    Semi-axes `half_length` along and `half_width` across the slope, slope-normal `depth` in the middle, earth pressure
    coefficient 1. Friction acts along the mean motion, so that sideways it is C v / |u|: exact for a cap that slides
    faster than it spreads. The two stretches of the axes follow an ordinary differential equation.
    """

    def __init__(self, slope, delta, half_length, half_width, depth, end, early=0.01):
        self.half_length, self.half_width, self.depth = half_length, half_width, depth
        self.acceleration = G * (np.sin(slope) - np.cos(slope) * np.tan(delta))
        self.friction = G * np.cos(slope) * np.tan(delta)
        push = 2 * G * np.cos(slope) * depth
        self._push_x, self._push_y = push / half_length**2, push / half_width**2
        early = early * np.sqrt(half_length / G)  # from rest the friction's share is 0 / 0: a series starts
        sideways = self._push_y * self.acceleration / (self.acceleration + self.friction)
        start = [1 + self._push_x * early**2 / 2, self._push_x * early, 1 + sideways * early**2 / 2, sideways * early]
        self._axes = solve_ivp(self._rate, (early, end), start, rtol=1e-10, atol=1e-12, dense_output=True).sol

    def _rate(self, t, state):
        stretch_x, rate_x, stretch_y, rate_y = state
        slowed = self.friction * rate_y / (self.acceleration * t)
        along = self._push_x / (stretch_x**2 * stretch_y)
        return [rate_x, along, rate_y, self._push_y / (stretch_x * stretch_y**2) - slowed]

    def __call__(self, x, y, t):
        """(slope-normal depth, u, v) at `x` along and `y` across the slope from where the middle started."""
        stretch_x, rate_x, stretch_y, rate_y = self._axes(t) if t > 0 else (1.0, 0.0, 1.0, 0.0)
        x = x - self.acceleration * t**2 / 2
        shape = 1 - (x / (self.half_length * stretch_x)) ** 2 - (y / (self.half_width * stretch_y)) ** 2
        h = self.depth / (stretch_x * stretch_y) * np.maximum(shape, 0.0)
        return h, self.acceleration * t + x * rate_x / stretch_x, y * rate_y / stretch_y


class ThackerBowl:
    """Water that swings without loss in the bowl b = -depth (1 - r^2 / radius^2) (V9; Thacker 1981)."""

    def __init__(self, depth, radius):
        self.depth, self.radius = depth, radius

    def bed(self, x, y):
        return -self.depth * (1 - (x * x + y * y) / self.radius**2)

    def slosh(self, shift):
        """(period [s], solution(x, y, t) -> depth, u, v) of the plane surface that circles, `shift` from the middle."""
        omega, radius2 = np.sqrt(2 * G * self.depth) / self.radius, self.radius**2

        def solution(x, y, t):
            cos, sin = np.cos(omega * t), np.sin(omega * t)
            surface = shift * self.depth / radius2 * (2 * x * cos + 2 * y * sin - shift)
            h = np.maximum(surface - self.bed(x, y), 0.0)
            return h, -shift * omega * sin + 0 * x, shift * omega * cos + 0 * x

        return 2 * np.pi / omega, solution

    def breathe(self, start_radius):
        """(period [s], solution(x, y, t) -> depth, u, v) of the round pool that starts at `start_radius` at rest."""
        omega = np.sqrt(8 * G * self.depth) / self.radius
        a = (self.radius**4 - start_radius**4) / (self.radius**4 + start_radius**4)

        def solution(x, y, t):
            q = 1 - a * np.cos(omega * t)
            r2 = (x * x + y * y) / self.radius**2
            surface = self.depth * (np.sqrt(1 - a * a) / q - 1 - r2 * ((1 - a * a) / q**2 - 1))
            rate = omega * a * np.sin(omega * t) / (2 * q)
            return np.maximum(surface - self.bed(x, y), 0.0), rate * x, rate * y

        return 2 * np.pi / omega, solution


def steady_voellmy_speed(slope, thickness_normal, mu, xi):
    """Speed [m/s] at which Voellmy friction carries a sheet's weight down a plane (V19)."""
    return np.sqrt(xi * thickness_normal * (np.sin(slope) - mu * np.cos(slope)))


def steady_bingham_speed(slope, thickness_normal, density, yield_stress, viscosity):
    """Depth-averaged speed [m/s] of a Bingham sheet on a plane, 0 where the yield stress holds it (V19)."""
    basal = density * G * thickness_normal * np.sin(slope)
    ratio = min(yield_stress / basal, 1.0)
    return basal * thickness_normal / (6 * viscosity) * (1 - ratio) ** 2 * (2 + ratio)


def bead(slope_at, bend_at, start, mu, end, load=True):
    """A mass point on the curve b(x) from rest: solution(t) -> (x, horizontal speed), as `solve_ivp`'s dense output.

    `slope_at(x)` and `bend_at(x)` are b' and b''; with `load` the bend presses it on the bed (V20, V21).
    """

    def rate(t, state):
        x, u = state
        slope, bend = slope_at(x), bend_at(x)
        c2 = 1 / (1 + slope * slope)
        pressing = max(G + u * u * bend, 0.0) if load else G
        friction = mu * pressing * c2 * np.sign(u if u else -slope)
        return [u, -c2 * (G + u * u * bend) * slope - friction]

    return solve_ivp(rate, (0.0, end), [start, 0.0], rtol=1e-10, atol=1e-12, dense_output=True).sol


def steady_speed(stress, drive):
    """Speed [m s-1] of a uniform flow at which `stress` [Pa], a function of the speed, is the `drive` [Pa]."""
    return brentq(lambda speed: stress(speed) - drive, 0.0, 500.0, xtol=1e-10)


def uniform_speed(stress, drive, mass, start, time):
    """Speed [m s-1] after a `time` [s] of a uniform flow of `mass` [kg m-2] that begins with speed `start`."""
    change = solve_ivp(lambda _, speed: (drive - stress(speed[0])) / mass, (0.0, time), [start], rtol=1e-9, atol=1e-9)
    return change.y[0, -1]
