"""Drucker-Prager and mu(I), a point at a time: yield cone, tip, free fall, matches, softening, hard parameters."""

import math

import numpy as np
import pytest
from material_points import FRESH, at_pressure, cauchy_green, pressure, random_states, shear, sheared, step

from mpmgis.laws.material import NO_TENSION, ORDINARY, drucker_prager, elastic, mu_i
from mpmgis.laws.material_choice import stress_step_far
from mpmgis.laws.softening import Softening, softened_cone, softening
from mpmgis.laws.solid_material import returned_mu_i
from mpmgis.system.errors import InputError

BULK, SHEAR = 6.7e6, 4e6
ICE = drucker_prager(BULK, SHEAR, 40.0, 1e3)
SAND = drucker_prager(BULK, SHEAR, 30.0, 0.0)
BEADS = mu_i(BULK, SHEAR, math.tan(math.radians(20.9)), math.tan(math.radians(32.8)), 0.279, 0.01, 2500.0, 1.0)
AT_REST = np.zeros((3, 3))


def laterally_held(law, state, axial, lateral_stress):
    """One step of `axial` strain with the lateral strain that keeps the lateral stress, by secants."""

    def off(lateral):
        result = step(law, state, np.diag([lateral, lateral, axial]))
        return result[1][0, 0] - lateral_stress, result

    a, b = 0.0, 1e-6
    (fa, _), (fb, result) = off(a), off(b)
    for _ in range(30):
        if abs(fb) < 1e-7 * abs(lateral_stress) or fa == fb:
            break
        a, b, fa = b, b - fb * (b - a) / (fb - fa), fb
        fb, result = off(b)
    assert abs(fb) < 1e-5 * abs(lateral_stress)
    return result


@pytest.mark.parametrize("law", [ICE, SAND], ids=["cohesive", "dry"])
def test_triaxial_compression_ends_on_the_cone(law):
    state = at_pressure(law, 5e4)
    for _ in range(200):
        state, stress, code = laterally_held(law, state, -5e-4, -5e4)
        assert code == ORDINARY
    assert stress[0, 0] == pytest.approx(-5e4, rel=1e-5)
    assert shear(stress) == pytest.approx(law.slope * pressure(stress) + law.strength, rel=1e-12)


def test_the_triaxial_match_is_mohr_coulomb_at_triaxial_failure():
    phi, state = math.radians(40.0), at_pressure(ICE, 5e4)
    for _ in range(200):
        state, stress, _ = laterally_held(ICE, state, -5e-4, -5e4)
    most, least = -stress[2, 2], -stress[0, 0]
    failure = least * (1 + math.sin(phi)) / (1 - math.sin(phi)) + 2 * 1e3 * math.cos(phi) / (1 - math.sin(phi))
    assert most == pytest.approx(failure, rel=1e-6)


@pytest.mark.parametrize("match, strength", [("plane_strain", 1.0), ("triaxial", 1.2 / 0.8660254)])
def test_the_plane_strain_match_is_mohr_coulomb_where_nothing_moves_across(match, strength):
    """Sheared in a plane at constant volume the third stress goes to the mean of the others, and q = sqrt(3) radius."""
    law, phi = drucker_prager(BULK, SHEAR, 30.0, 2e3, match=match), math.radians(30.0)
    state = at_pressure(law, 5e4)
    for _ in range(400):
        state, stress, _ = step(law, state, np.diag([1e-3, 0.0, -1e-3 / 1.001]))
    mohr = np.linalg.eigvalsh(stress)
    assert mohr[1] == pytest.approx(0.5 * (mohr[0] + mohr[2]), rel=1e-6)
    radius, middle = 0.5 * (mohr[2] - mohr[0]), -0.5 * (mohr[0] + mohr[2])
    failure = middle * math.sin(phi) + 2e3 * math.cos(phi)
    assert radius == pytest.approx(strength * failure, rel=1e-6)


def test_isotropic_extension_returns_to_the_tip():
    state = FRESH
    for _ in range(20):
        state, stress, code = step(ICE, state, 1e-4 * np.eye(3))
    tension = 1e3 / math.tan(math.radians(40.0))
    assert code == NO_TENSION
    np.testing.assert_allclose(stress, tension * np.eye(3), rtol=1e-9, atol=1e-9)
    state, stress, code = step(SAND, FRESH, 1e-3 * np.eye(3))
    assert code == NO_TENSION and np.all(stress == 0.0) and state[:6] == FRESH[:6]


def test_a_shear_cycle_keeps_the_trace():
    state = at_pressure(SAND, 5e4)
    before = sum(np.log(np.linalg.eigvalsh(cauchy_green(state))))
    for k in range(400):
        state, stress, _ = step(SAND, state, sheared(5e-3 * (1 if (k // 50) % 2 == 0 else -1)))
    after = sum(np.log(np.linalg.eigvalsh(cauchy_green(state))))
    assert abs(after - before) <= 1e-13
    assert pressure(stress) == pytest.approx(5e4, rel=1e-9)
    assert state[6] > 1.0  # it flowed


def test_free_fall_without_cohesion_leaves_nothing():
    """No stress, no strain, exactly; and a spray that widens stays free of stress while it does."""
    state = FRESH
    for _ in range(1000):
        state, stress, code = step(SAND, state, AT_REST)
        assert np.all(stress == 0.0) and state[:6] == FRESH[:6] and code == NO_TENSION
    assert state == FRESH
    rng = np.random.default_rng(1)
    for _ in range(300):
        state, stress, _ = step(SAND, state, 1e-3 * np.eye(3) + 1e-3 * rng.uniform(-0.3, 0.3, (3, 3)))
        assert np.all(stress == 0.0) and state[:6] == FRESH[:6]


def test_what_was_pulled_apart_is_pushed_back_before_it_bears_load():
    for law, remembers in ((SAND, True), (SAND._replace(volume_correction=0.0), False)):
        state = FRESH
        for _ in range(10):
            state, _, _ = step(law, state, 1e-3 * np.eye(3))
        assert state[7] == pytest.approx(10 * 3 * math.log(1.001) if remembers else 0.0, rel=1e-12)
        for k in range(12):
            state, stress, _ = step(law, state, (1 / 1.001 - 1) * np.eye(3))
            if k < 9:
                assert (pressure(stress) == 0.0) == remembers
        assert pressure(stress) == pytest.approx(BULK * 3 * math.log(1.001) * (2 if remembers else 12), rel=0.51)
        assert state[7] == 0.0


def test_returned_states_are_admissible():
    """20 000 random points, some softened: inside the cone, not beyond the tip, and returned again the same."""
    rng = np.random.default_rng(2)
    law, soft, bare = ICE, softening((40.0, 1e3), (20.0, 0.0), 10.0), elastic(BULK, SHEAR)
    torn = slid = 0
    for b, gradient in random_states(rng, 20_000, 0.03):
        start = (*b, rng.uniform(0.0, 0.5), rng.choice([0.0, 5e-3]))
        state, stress, code = step(law, start, gradient, softening=soft)
        slope, strength = softened_cone(soft, law.slope, law.strength, start[6])
        p, q = pressure(stress), shear(stress)
        assert state[6] >= start[6] and state[7] >= 0.0
        if code == NO_TENSION:
            assert p == pytest.approx(-strength / slope, abs=1e-6) and q <= 1e-6
            torn += 1
        else:
            assert q <= slope * (p - BULK * start[7]) + strength + 1e-6
            assert state[7] == 0.0
            slid += state[6] > start[6]
        if (torn + slid) % 10 == 0:
            np.testing.assert_allclose(step(bare, state, AT_REST)[1], stress, rtol=0, atol=1e-6)
    assert torn > 2000 and slid > 2000


def test_flow_keeps_the_direction_of_the_deviator():
    rng = np.random.default_rng(3)
    checked = 0
    for b, gradient in random_states(rng, 300, 0.03):
        _, whole, _ = step(elastic(BULK, SHEAR), (*b, 0.0, 0.0), gradient)
        _, stress, code = step(SAND, (*b, 0.0, 0.0), gradient)
        if code == NO_TENSION:
            continue
        trial, returned = whole + pressure(whole) * np.eye(3), stress + pressure(stress) * np.eye(3)
        np.testing.assert_allclose(
            returned * shear(whole), trial * shear(stress), rtol=0, atol=1e-9 * shear(whole) ** 2
        )
        assert pressure(stress) == pytest.approx(pressure(whole), rel=1e-9)
        checked += 1
    assert checked > 50


def test_plastic_strain_is_the_deviatoric_part_that_is_lost():
    """On the cone at constant pressure all further strain is plastic: gamma / sqrt(3) in simple shear."""
    state = at_pressure(SAND, 5e4)
    for _ in range(400):
        state, _, _ = step(SAND, state, sheared(2e-3))
    before = state[6]
    for _ in range(100):
        state, _, _ = step(SAND, state, sheared(2e-3))
    assert state[6] - before == pytest.approx(100 * 2e-3 / math.sqrt(3.0), rel=0.01)


def test_softened_shear_ends_on_the_residual_cone():
    soft = softening((40.0, 1e3), (20.0, 0.0), 10.0)
    state, peak = at_pressure(ICE, 5e4), 0.0
    for _ in range(3000):
        state, stress, _ = step(ICE, state, sheared(2e-3), softening=soft)
        peak = max(peak, shear(stress))
    p = pressure(stress)
    assert shear(stress) == pytest.approx(0.7722 * p, rel=1e-3)
    assert 0.95 < peak / (ICE.slope * p + ICE.strength) < 1 + 1e-9


def test_softening_of_nothing_and_at_once():
    """xi_s = 0 is no softening at all, xi_s = 1e6 the residual from the first plastic strain on."""
    never, at_once = softening((40.0, 1e3), (20.0, 0.0), 0.0), softening((40.0, 1e3), (20.0, 0.0), 1e6)
    residual = drucker_prager(BULK, SHEAR, 20.0, 0.0)
    states = [at_pressure(ICE, 5e4)] * 4
    for _ in range(50):
        gradient = sheared(2e-3)
        results = [
            step(law, state, gradient, softening=soft)
            for law, state, soft in zip(
                (ICE, ICE, ICE, residual), states, (Softening(), never, at_once, Softening()), strict=True
            )
        ]
        states = [result[0] for result in results]
    np.testing.assert_allclose(results[1][1], results[0][1], rtol=1e-11, atol=1e-6)
    np.testing.assert_allclose(results[2][1], results[3][1], rtol=0, atol=1e-3)  # the first step had its peak


@pytest.mark.parametrize("phi, cohesion", [(0.0, 0.0), (0.0, 2e3), (25.0, 0.0), (1e-9, 2e3)])
def test_without_friction_or_cohesion_or_both(phi, cohesion):
    law = drucker_prager(BULK, SHEAR, phi, cohesion)
    rng = np.random.default_rng(4)
    for b, gradient in random_states(rng, 500, 0.03):
        state, stress, _ = step(law, (*b, 0.0, 0.0), gradient)
        assert np.all(np.isfinite(state)) and np.all(np.isfinite(stress))
        assert shear(stress) <= law.slope * pressure(stress) + law.strength + 1e-6
        assert -pressure(stress) <= 10 * cohesion + 1e-6
    state = FRESH
    for _ in range(50):
        state, stress, code = step(law, state, 1e-3 * np.eye(3))
    tension = 0.0 if cohesion == 0.0 else min(cohesion / math.tan(math.radians(phi)), 10 * cohesion) if phi else 2e4
    assert code == NO_TENSION and pressure(stress) == pytest.approx(-tension, rel=1e-9, abs=1e-9)


def test_a_cone_has_the_slopes_of_the_text_books():
    assert (ICE.slope, ICE.strength) == pytest.approx((1.6365, 1950.0), rel=1e-3)
    assert drucker_prager(BULK, SHEAR, 20.0, 0.0).slope == pytest.approx(0.7722, rel=1e-3)
    plane = drucker_prager(BULK, SHEAR, 30.0, 1e3, match="plane_strain")
    assert (plane.slope, plane.strength) == pytest.approx((math.sqrt(3) / 2, 1.5e3))
    assert drucker_prager(BULK, SHEAR, 30.0, 1e3).slope == pytest.approx(1.2)
    with pytest.raises(InputError, match="'plain_strain', expected one of triaxial, plane_strain"):
        drucker_prager(BULK, SHEAR, 30.0, 1e3, match="plain_strain")


def test_inertial_friction_solves_its_equation():
    """|s| / sqrt(2) = mu(I) p at the shear rate that the return itself has taken out."""
    rng = np.random.default_rng(5)
    both = set()
    for _ in range(5000):
        p, excess, time_step = 10.0 ** rng.uniform(1, 6), 10.0 ** rng.uniform(-3, 2), 10.0 ** rng.uniform(-6, -2)
        trial = BEADS.mu1 * p * (1.0 + excess)
        norm = trial / (math.sqrt(2.0) * SHEAR)
        _, kept, strain, _, code, yields = returned_mu_i(BEADS, (0.0, 0.0), -p / BULK, norm, 0.0, 0.0, time_step)
        shear_stress, rate = kept * trial, (1.0 - kept) * trial / (SHEAR * time_step)
        inertia = rate * 0.01 / math.sqrt(p / 2500.0)
        friction = BEADS.mu1 + (BEADS.mu2 - BEADS.mu1) * inertia / (inertia + 0.279)
        assert abs(shear_stress - friction * p) <= 1e-12 * trial
        assert yields and code == ORDINARY
        assert strain == pytest.approx(rate * time_step / math.sqrt(3.0), rel=1e-9)
        both.add(friction > 0.9 * BEADS.mu2)
    assert both == {True, False}


def test_steady_inertial_shear_has_the_friction_of_its_rate():
    for rate in (0.1, 5.0, 100.0):
        state = at_pressure(BEADS, 1e4)
        for _ in range(400):
            state, stress, _ = step(BEADS, state, sheared(rate * 1e-4), time_step=1e-4)
            if rate < 1.0:
                state, stress, _ = step(BEADS, state, sheared(rate * 1e-3), time_step=1e-3)
        inertia = rate * 0.01 / math.sqrt(pressure(stress) / 2500.0)
        friction = BEADS.mu1 + (BEADS.mu2 - BEADS.mu1) / (1.0 + 0.279 / inertia)
        assert shear(stress) / math.sqrt(3.0) == pytest.approx(friction * pressure(stress), rel=2e-3)


def test_inertial_flow_bears_no_tension_and_little_shear_is_elastic():
    state, stress, code = step(BEADS, FRESH, 1e-3 * np.eye(3))
    assert code == NO_TENSION and np.all(stress == 0.0) and state[:6] == FRESH[:6] and state[7] > 0.0
    start = at_pressure(BEADS, 1e4)
    state, stress, code = step(BEADS, start, sheared(1e-6))
    np.testing.assert_allclose(stress, step(elastic(BULK, SHEAR), start, sheared(1e-6))[1], rtol=0, atol=1e-9)
    assert code == ORDINARY and state[6] == 0.0


def test_far_and_near_flow_alike():
    """A step of shear that leaves the series comes out as many small ones do."""
    state = at_pressure(SAND, 5e4)
    once, stress, _ = step(SAND, state, sheared(0.4), function=stress_step_far)
    for _ in range(400):
        state, small, _ = step(SAND, state, sheared(1e-3))
    assert pressure(stress) == pytest.approx(pressure(small), rel=1e-9)
    assert shear(stress) == pytest.approx(shear(small), rel=1e-9)
    assert once[6] == pytest.approx(state[6], rel=0.05)
