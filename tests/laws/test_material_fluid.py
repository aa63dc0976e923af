"""Fluids of the 3D solver: pressure, no tension, viscosity, what they start with."""

import math

import numpy as np
import pytest
from material_points import matrix, pressure, six, step

from mpmgis.laws.fluid_material import SMALLEST_VOLUME, fluid_pressure
from mpmgis.laws.material import FAR, NO_TENSION, ORDINARY, fluid
from mpmgis.laws.material_choice import (
    state_at_stress,
    state_count,
    stored_energy,
    stress_step,
    stress_step_far,
    wave_speed,
)

WATER, TAIT, MUD = fluid(7.1e6, 0.0, 0.0), fluid(7.1e6, 0.0, 1.0), fluid(7.1e6, 50.0, 0.0)
FRESH = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
AT_REST = np.zeros((3, 3))


def test_pressure_is_as_printed():
    for volume in (1.0, 0.99, 0.7):
        assert fluid_pressure(WATER, volume) == pytest.approx(7.1e6 * (1 / volume - 1), rel=1e-12)
        assert fluid_pressure(TAIT, volume) == pytest.approx(7.1e6 / 7 * (volume**-7 - 1), rel=1e-12)
    assert fluid_pressure(TAIT, 0.9999) == pytest.approx(fluid_pressure(WATER, 0.9999), rel=1e-3)


@pytest.mark.parametrize("law", [WATER, TAIT], ids=["linear", "Tait"])
def test_kirchhoff_stress_is_the_volume_times_the_pressure(law):
    state, stress, code = step(law, FRESH, -0.01 * np.eye(3))
    assert code == ORDINARY and state[0] == pytest.approx(0.97)
    np.testing.assert_allclose(stress, -0.97 * fluid_pressure(law, 0.97) * np.eye(3), rtol=1e-12)


def test_volume_follows_the_trace_so_that_rotation_makes_none():
    spin = np.array([[0, -0.1, 0.2], [0.1, 0, -0.3], [-0.2, 0.3, 0]])
    state, stress, code = step(WATER, (0.99, *FRESH[1:]), spin)
    assert state[0] == 0.99 and code == ORDINARY
    np.testing.assert_allclose(stress, -0.99 * fluid_pressure(WATER, 0.99) * np.eye(3), rtol=1e-12)


def test_no_tension_and_no_gap_is_remembered():
    state = FRESH
    for _ in range(10):
        state, stress, code = step(WATER, state, 0.05 * np.eye(3))
        assert code == NO_TENSION and state == FRESH and np.all(stress == 0.0)
    state, stress, code = step(WATER, state, -0.001 * np.eye(3))
    assert code == ORDINARY and pressure(stress) == pytest.approx(7.1e6 * 0.003, rel=1e-9)


@pytest.mark.parametrize("function", [stress_step, stress_step_far])
def test_crushed_fluid_is_held_and_that_is_reported(function):
    state, stress, code = step(TAIT, FRESH, -0.2 * np.eye(3), function=function)
    assert code == FAR and state[0] == SMALLEST_VOLUME
    assert pressure(stress) == pytest.approx(0.6 * fluid_pressure(TAIT, 0.6), rel=1e-12)
    assert step(WATER, FRESH, -1.0 * np.eye(3), function=function)[2] == FAR
    assert step(WATER, FRESH, np.full((3, 3), np.nan), function=function)[2] == FAR


def test_viscous_stress_is_newtons():
    """tau_xy = eta dv_x/dy in shear, 2 eta dev D in compression; none of it from rotation."""
    time_step, rate = 1e-3, 3.0
    shear = np.zeros((3, 3))
    shear[0, 1] = rate * time_step
    _, stress, _ = step(MUD, FRESH, shear, time_step=time_step)
    np.testing.assert_allclose(stress, 50.0 * rate * matrix((0, 0, 0, 1, 0, 0)), rtol=1e-12)
    _, stress, _ = step(MUD, FRESH, np.diag([0.0, 0.0, -rate * time_step]), time_step=time_step)
    deviator = stress + pressure(stress) * np.eye(3)
    expected = 0.997 * 2 * 50.0 * rate * np.diag([1 / 3, 1 / 3, -2 / 3])
    np.testing.assert_allclose(deviator, expected, rtol=0, atol=1e-9 * 7.1e6)
    assert MUD.dynamic_viscosity == 50.0 and WATER.dynamic_viscosity == 0.0


@pytest.mark.parametrize("law", [WATER, TAIT], ids=["linear", "Tait"])
def test_state_at_stress_bears_its_pressure(law):
    loads = np.array([0.0, 1.0, 1e3, 1e5, 5e5])
    nothing = 0.0 * loads
    states = np.array(state_at_stress(law, (-loads, -loads, -loads, nothing, nothing, nothing)))
    for k, load in enumerate(loads):
        _, stress, code = step(law, tuple(states[:, k]), AT_REST)
        assert code == ORDINARY
        np.testing.assert_allclose(stress, -load * np.eye(3), rtol=1e-9, atol=1e-8)
        alone = state_at_stress(law, (-load, -load, -load, 0.0, 0.0, 0.0))
        assert alone == pytest.approx(tuple(states[:, k]), rel=1e-15) and len(alone) == 8
    assert state_at_stress(law, (1e5, 1e5, 1e5, 0.0, 0.0, 0.0)) == FRESH  # no tension to start with
    assert state_at_stress(law, (-1e9, -1e9, -1e9, 0.0, 0.0, 0.0))[0] >= SMALLEST_VOLUME
    assert state_count(law) == 4


@pytest.mark.parametrize("law", [WATER, TAIT], ids=["linear", "Tait"])
def test_stored_energy_is_the_work_of_compression(law):
    volumes = np.linspace(1.0, 0.8, 20001)
    pressures = np.array([fluid_pressure(law, volume) for volume in volumes])
    work = np.sum(0.5 * (pressures[1:] + pressures[:-1]) * -np.diff(volumes))
    assert stored_energy(law, (0.8, *FRESH[1:])) == pytest.approx(work, rel=1e-6)
    assert stored_energy(law, FRESH) == pytest.approx(0.0, abs=1e-8)


def test_waves_go_ten_times_as_fast_as_the_flow_that_it_is_made_for():
    assert wave_speed(fluid(1000.0 * (10 * 8.4) ** 2), 1000.0) == pytest.approx(84.0)
    assert math.isfinite(wave_speed(WATER, 1000.0)) and six(AT_REST) == (0.0,) * 6
