"""Hencky elasticity of the 3D solver's solids: series against logarithms of matrices, near against far."""

import math

import numpy as np
import pytest
from material_points import FRESH, carried, cauchy_green, function_of, kirchhoff, matrix, random_states, six, step
from scipy.linalg import logm

from mpmgis.laws.hencky import SERIES_REACH, exponential_less_unit, principal
from mpmgis.laws.material import FAR, ORDINARY, drucker_prager, elastic, mu_i
from mpmgis.laws.material_choice import (
    state_at_stress,
    state_count,
    stored_energy,
    stress_step,
    stress_step_far,
    wave_speed,
)

ICE = elastic(6.7e6, 4e6)
SOLIDS = [ICE, drucker_prager(6.7e6, 4e6, 40.0, 1e3), mu_i(6.7e6, 4e6, 0.38, 0.64, 0.279, 1e-2, 2500.0, 1.0)]
NAMES = ["elastic", "frictional", "inertial"]
AT_REST = np.zeros((3, 3))


def on_the_border(rng, share):
    """A random b with |b - I| at `share` of the reach of the series."""
    off = rng.uniform(-1.0, 1.0, (3, 3))
    off = off + off.T
    return np.eye(3) + share * math.sqrt(SERIES_REACH) * off / np.linalg.norm(off)


def test_stress_is_that_of_the_logarithm_of_the_matrix():
    rng = np.random.default_rng(1)
    for b, gradient in random_states(rng, 100, 0.04):
        state, stress, code = step(ICE, (*b, 0.0, 0.0), gradient)
        trial = (np.eye(3) + gradient) @ cauchy_green(b) @ (np.eye(3) + gradient).T
        strain = 0.5 * logm(trial)
        expected = 2 * 4e6 * strain + (6.7e6 - 2 * 4e6 / 3) * np.trace(strain) * np.eye(3)
        assert code == ORDINARY
        np.testing.assert_allclose(cauchy_green(state), trial, rtol=0, atol=1e-15 * 4)
        np.testing.assert_allclose(stress, expected, rtol=0, atol=1e-13 * 6.7e6)


def test_series_is_exact_to_rounding_up_to_its_border():
    rng = np.random.default_rng(2)
    for _ in range(2000):
        b = on_the_border(rng, rng.uniform(0.9, 1.0 - 1e-12))
        _, stress, code = step(ICE, (*carried(b), 0.0, 0.0), AT_REST)
        assert code == ORDINARY
        np.testing.assert_allclose(stress, kirchhoff(ICE, b), rtol=0, atol=1e-13 * 6.7e6)


@pytest.mark.parametrize("law", SOLIDS, ids=NAMES)
def test_near_and_far_meet_at_the_border(law):
    rng = np.random.default_rng(3)
    for _ in range(200):
        state = (*carried(on_the_border(rng, 1.0 - 1e-9)), 0.1, 1e-3)
        near_state, near_stress, near_code = step(law, state, AT_REST)
        far_state, far_stress, far_code = step(law, state, AT_REST, function=stress_step_far)
        assert near_code == far_code != FAR
        np.testing.assert_allclose(near_state, far_state, rtol=0, atol=1e-13)
        np.testing.assert_allclose(near_stress, far_stress, rtol=0, atol=1e-13 * 6.7e6)


@pytest.mark.parametrize("law", SOLIDS, ids=NAMES)
def test_beyond_the_border_the_kernel_is_sent_to_the_far_path(law):
    rng = np.random.default_rng(4)
    for _ in range(50):
        assert step(law, (*carried(on_the_border(rng, 1.001)), 0.0, 0.0), AT_REST)[2] == FAR
    assert step(law, FRESH, np.full((3, 3), np.nan))[2] == FAR
    assert step(law, FRESH, -2.0 * np.eye(3))[2] == FAR  # b_trial is b, but the point is inside out


def test_far_stress_is_that_of_the_logarithm_at_any_size():
    rng = np.random.default_rng(5)
    for size in (0.3, 0.6, 3.0, 50.0):
        for _ in range(50):
            deformation = np.eye(3) + size * rng.uniform(-1.0, 1.0, (3, 3))
            deformation *= np.sign(np.linalg.det(deformation))
            b = deformation @ deformation.T
            _, stress, code = step(ICE, FRESH, deformation - np.eye(3), function=stress_step_far)
            assert code == ORDINARY
            np.testing.assert_allclose(stress, kirchhoff(ICE, b), rtol=0, atol=1e-9 * np.abs(stress).max())


@pytest.mark.parametrize("law", SOLIDS, ids=NAMES)
@pytest.mark.parametrize("gradient", [1e6 * np.eye(3), -np.eye(3), -2.5 * np.eye(3), np.diag([1e9, -1.0, 0.0])])
def test_stretches_are_held_and_that_is_reported(law, gradient):
    state, stress, code = step(law, FRESH, gradient, function=stress_step_far)
    assert code == FAR
    assert np.all(np.isfinite(state)) and np.all(np.isfinite(stress))
    values = np.linalg.eigvalsh(cauchy_green(state))
    assert values[0] >= 1e-8 * (1 - 1e-6) and values[-1] <= 1e8 * (1 + 1e-6)


def test_principal_values_and_directions_are_those_of_the_tensor():
    rng = np.random.default_rng(6)
    for scale in (1.0, 1e-9, 1e9):
        for _ in range(50):
            a = rng.normal(size=(3, 3)) * scale
            a = a + a.T
            parts = principal(*six(a))
            directions = np.reshape(parts[3:], (3, 3))
            np.testing.assert_allclose(directions @ directions.T, np.eye(3), atol=1e-14)
            np.testing.assert_allclose(directions.T @ np.diag(parts[:3]) @ directions, a, atol=1e-14 * scale * 10)
    assert principal(1.0, 1.0, 1.0, 0.0, 0.0, 0.0)[:3] == (1.0, 1.0, 1.0)


def test_exponential_undoes_the_logarithm():
    rng = np.random.default_rng(7)
    for _ in range(500):
        b = on_the_border(rng, rng.uniform(0.0, 1.0))
        twice = function_of(b, np.log)
        trace = np.trace(twice)
        again = np.eye(3) + matrix(exponential_less_unit(trace, *six(twice - trace / 3.0 * np.eye(3))))
        np.testing.assert_allclose(again, b, rtol=0, atol=3e-15)


def test_turning_a_point_turns_its_stress():
    rng = np.random.default_rng(8)
    state = (*carried(on_the_border(rng, 0.5)), 0.0, 0.0)
    _, before, _ = step(ICE, state, AT_REST)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    _, after, _ = step(ICE, state, turn - np.eye(3))
    np.testing.assert_allclose(after, turn @ before @ turn.T, rtol=0, atol=1e-8)


def test_simple_shear_has_hencky_s_closed_form():
    """F = I + gamma e_x e_y: principal stretches e^(+-a) with sinh a = gamma / 2, tau_xy = 2 G a / cosh a."""
    for gamma in (1e-6, 0.05, 0.2):
        gradient = np.zeros((3, 3))
        gradient[0, 1] = gamma
        _, stress, code = step(ICE, FRESH, gradient, function=stress_step if gamma < 0.15 else stress_step_far)
        a = math.asinh(gamma / 2)
        assert code == ORDINARY
        assert stress[0, 1] == pytest.approx(2 * 4e6 * a / math.cosh(a), rel=1e-9)
        assert stress[0, 0] == pytest.approx(2 * 4e6 * a * math.tanh(a), rel=1e-9, abs=1e-8)
        assert abs(np.trace(stress)) <= 1e-8


@pytest.mark.parametrize("law", SOLIDS, ids=NAMES)
def test_state_at_stress_bears_that_stress(law):
    load = -1e5 * np.diag([0.95, 1.0, 1.05])
    load[0, 2] = load[2, 0] = 5e3
    state = state_at_stress(law, six(load))
    assert len(state) == state_count(law) == 8
    _, stress, code = step(law, state, AT_REST)
    assert code == ORDINARY
    np.testing.assert_allclose(stress, load, rtol=0, atol=1e-7)


def test_state_at_stress_takes_arrays_and_large_stresses():
    loads = np.array(
        [[-1e5, -2e6, 0.0], [-1e5, -5e6, 0.0], [-3e5, -8e6, 0.0], [1e4, 1e6, 0.0], [0, 2e6, 0], [0, 3e6, 0]]
    )
    states = np.array(state_at_stress(ICE, tuple(loads)))
    for k in range(3):
        expected = np.array(state_at_stress(ICE, tuple(loads[:, k])))
        np.testing.assert_allclose(states[:, k], expected, rtol=1e-15)
        _, stress, _ = step(ICE, tuple(states[:, k]), AT_REST, function=stress_step_far)
        np.testing.assert_allclose(six(stress), loads[:, k], rtol=0, atol=1e-6)
    assert tuple(states[:, 2]) == FRESH


def test_stored_energy_is_the_work_done():
    """Along a path of small steps the sum of tau : de is the energy, which is gone where the path ends at its start."""
    state, work = FRESH, 0.0
    old = np.zeros((3, 3))
    for k in range(1000):
        angle = 2 * math.pi * k / 1000
        rate = 1e-4 * np.array([[math.cos(angle), math.sin(2 * angle), 0], [0, math.sin(angle), 0], [0.0, 0.0, 0.5]])
        state, stress, _ = step(ICE, state, rate)
        work += np.sum(0.5 * (old + stress) * 0.5 * (rate + rate.T))
        old = stress
    energy = stored_energy(ICE, state)
    assert energy == pytest.approx(work, rel=2e-4)
    strain = function_of(cauchy_green(state), lambda values: 0.5 * np.log(values))
    deviator = strain - np.trace(strain) / 3 * np.eye(3)
    assert energy == pytest.approx(0.5 * 6.7e6 * np.trace(strain) ** 2 + 4e6 * np.sum(deviator**2), rel=1e-11)
    assert stored_energy(ICE, FRESH) == 0.0


def test_wave_speed_is_that_of_glacier_ice_in_the_paper():
    assert wave_speed(ICE, 850.0) == pytest.approx(119.0, abs=0.1)
    assert ICE.dynamic_viscosity == 0.0
