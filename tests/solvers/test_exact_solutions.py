"""The reference solutions themselves, substituted into the equations that they claim to solve."""

import numpy as np
import pytest
from exact_solutions import G, SimilarityCap, ThackerBowl, bead, mangeney, steady_bingham_speed, stoker, stoker_middle

STEP = 1e-4  # of the central differences [m, s]


def residuals(solution, x, y, t, weight=G, drive_x=0.0, drive_y=0.0):
    """Largest residuals of mass and of both momenta, h_t + div(h u) and u_t + u.grad u + weight grad h - drive.

    Each is relative to the largest of its own terms. `drive` is a number or a function of (x, y, t, u, v).
    """
    h, u, v = solution(x, y, t)
    along = [
        [(a - b) / (2 * STEP) for a, b in zip(solution(*up), solution(*down), strict=True)]
        for up, down in (
            ((x + STEP, y, t), (x - STEP, y, t)),
            ((x, y + STEP, t), (x, y - STEP, t)),
            ((x, y, t + STEP), (x, y, t - STEP)),
        )
    ]
    (h_x, u_x, v_x), (h_y, u_y, v_y), (h_t, u_t, v_t) = along
    ax, ay = (d(x, y, t, u, v) if callable(d) else d for d in (drive_x, drive_y))
    equations = [
        (h_t, h * (u_x + v_y), u * h_x + v * h_y),
        (u_t, u * u_x + v * u_y, weight * h_x, -ax),
        (v_t, u * v_x + v * v_y, weight * h_y, -ay),
    ]
    return [
        float(np.max(np.abs(sum(terms))) / max(1e-30, *(np.max(np.abs(term)) for term in terms))) for terms in equations
    ]


@pytest.mark.parametrize("degrees, delta", [(0, 0), (22, 0), (30, 20), (35, 25)])
def test_the_dam_break_solves_the_equations_and_joins_without_a_step(degrees, delta):
    slope, delta, t = np.radians(degrees), np.radians(delta), 2.5
    m, c0 = G * np.cos(slope) * (np.tan(slope) - np.tan(delta)), np.sqrt(G * 5.0 * np.cos(slope))
    back, front = -c0 * t + m * t**2 / 2, 2 * c0 * t + m * t**2 / 2

    def solution(x, y, t):
        h, u = mangeney(x, t, 5.0, slope, delta)
        return h, u, 0 * u

    inside = np.linspace(back + 0.1, front - 0.1, 50)
    mass, momentum, _ = residuals(solution, inside, 0 * inside, t, G * np.cos(slope), m)
    assert max(mass, momentum) < 1e-6
    h, u = mangeney(np.array([back - 1e-9, back + 1e-9, front - 1e-9, front + 1e-9]), t, 5.0, slope, delta)
    np.testing.assert_allclose([h[0], u[0]], [h[1], u[1]], atol=1e-6)
    assert h[2] < 1e-15 and h[3] == 0.0
    np.testing.assert_allclose(u[2], 2 * c0 + m * t, rtol=1e-9)


def test_a_dry_front_carries_all_the_energy_that_there_is():
    """H2's bound with equality: U^2 = 2 g (drop since the dam) + 4 g h cos at the very front, on every slope."""
    for degrees in (0, 22, 35):
        slope, t = np.radians(degrees), 2.5
        c0, m = np.sqrt(G * 5.0 * np.cos(slope)), G * np.sin(slope)
        front = 2 * c0 * t + m * t**2 / 2
        _, u = mangeney(front * (1 - 1e-12), t, 5.0, slope, 0.0)
        np.testing.assert_allclose(u**2, 2 * G * front * np.sin(slope) + 4 * G * 5.0 * np.cos(slope), rtol=1e-9)


def test_the_wet_dam_break_solves_the_equations_and_its_shock_conserves():
    depth, speed, shock = stoker_middle(5.0, 1.0)

    def solution(x, y, t):
        h, u = stoker(x, t, 5.0, 1.0)
        return h, u, 0 * u

    t = 2.5
    fan = np.linspace(-np.sqrt(G * 5) * t + 0.1, (speed - np.sqrt(G * depth)) * t - 0.1, 50)
    assert max(residuals(solution, fan, 0 * fan, t)[:2]) < 1e-6
    np.testing.assert_allclose(depth * (speed - shock), -1.0 * shock, rtol=1e-12)  # mass, Rankine and Hugoniot
    jump = depth * (speed - shock) ** 2 + G * depth**2 / 2 - (1.0 * shock**2 + G * 1.0**2 / 2)
    assert abs(jump) < 1e-9 * G * depth**2


@pytest.mark.parametrize("kind", ["slosh", "breathe"])
def test_thackers_pools_solve_the_equations_and_come_back(kind):
    bowl = ThackerBowl(1.0, 10.0)
    period, solution = bowl.slosh(2.0) if kind == "slosh" else bowl.breathe(8.0)
    x, y = np.meshgrid(np.linspace(-5, 5, 11), np.linspace(-5, 5, 11))
    for t in (0.1 * period, 0.37 * period, 0.8 * period):
        drive_x, drive_y = (lambda x, y, t, u, v: -2 * G * x / 100, lambda x, y, t, u, v: -2 * G * y / 100)
        assert max(residuals(solution, x, y, t, G, drive_x, drive_y)) < 1e-6
    for first, last in zip(solution(x, y, 0.0), solution(x, y, period), strict=True):
        np.testing.assert_allclose(last, first, atol=1e-12)


def test_the_similarity_cap_solves_its_equations_and_keeps_its_volume():
    slope, delta = np.radians(35), np.radians(25)
    cap = SimilarityCap(slope, delta, 80.0, 80.0, 4.0, 12.0)
    for t in (1.0, 5.0, 10.0):
        middle = cap.acceleration * t**2 / 2
        x, y = np.meshgrid(middle + np.linspace(-30, 30, 9), np.linspace(-30, 30, 9))

        def sideways(x, y, t, u, v):
            return -cap.friction * v / (cap.acceleration * t)

        assert max(residuals(cap, x, y, t, G * np.cos(slope), cap.acceleration, sideways)) < 1e-5
        x, y = np.meshgrid(middle + np.linspace(-400, 400, 1601), np.linspace(-200, 200, 801))
        np.testing.assert_allclose(cap(x, y, t)[0].sum() * 0.25, np.pi * 80 * 80 * 4 / 2, rtol=1e-4)


def test_the_similarity_caps_early_series_is_early_enough():
    """A start ten times later changes the axes at 10 s by less than a thousandth."""
    made = [SimilarityCap(np.radians(35), np.radians(25), 80.0, 80.0, 4.0, 10.0, early=early) for early in (0.01, 0.1)]
    x, y = np.meshgrid(np.linspace(60, 160, 11), np.linspace(-50, 50, 11))
    np.testing.assert_allclose(made[1](x, y, 10.0), made[0](x, y, 10.0), rtol=2e-3, atol=2e-3)


def test_a_bead_keeps_its_energy_and_follows_the_energy_line():
    """Without friction: constant energy. With friction, without centrifugal load: z0 = z + U^2 / 2g + mu x exactly."""

    def energy(x, u):
        return G * 0.005 * x**2 + 0.5 * u * u * (1 + (0.01 * x) ** 2)

    free = bead(lambda x: 0.01 * x, lambda x: 0.01, -50.0, 0.0, 20.0)
    rubbed = bead(lambda x: 0.01 * x, lambda x: 0.01, -50.0, 0.2, 4.0, load=False)
    for t in np.linspace(0.5, 20.0, 20):
        np.testing.assert_allclose(energy(*free(t)), energy(-50.0, 0.0), rtol=1e-8)
    for t in np.linspace(0.5, 4.0, 8):
        x, u = rubbed(t)
        np.testing.assert_allclose(energy(x, u) + 0.2 * G * (x + 50), energy(-50.0, 0.0), rtol=1e-8)


def test_a_bingham_sheet_balances_its_weight():
    """The integral of the profile: shear rate (tau - tau_y) / eta below the plug, integrated twice by quadrature."""
    slope, thickness, density, strength, viscosity = np.radians(10), 2.0, 1500.0, 2000.0, 300.0
    z = np.linspace(0, thickness, 200_001)
    stress = density * G * np.sin(slope) * (thickness - z)
    speed = np.cumsum(np.maximum(stress - strength, 0.0) / viscosity) * (z[1] - z[0])
    expected = steady_bingham_speed(slope, thickness, density, strength, viscosity)
    np.testing.assert_allclose(speed.mean(), expected, rtol=1e-4)
    assert steady_bingham_speed(slope, thickness, density, 1e5, viscosity) == 0.0
