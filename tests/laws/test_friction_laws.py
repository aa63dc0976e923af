"""Laws of friction one by one: what their formulas say, plain and compiled alike."""

import numpy as np
import pytest
from compiled import compiled_function
from exact_solutions import steady_speed
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.laws.friction import (
    FRICTIONLESS,
    LAWS,
    at_node,
    basal_stress,
    contradiction,
    excess_stress,
    friction_law,
    parameters_of,
    plug_ratio,
    slowed_speed,
    stress_parts,
)

G = 9.81
EVERY = [
    FRICTIONLESS,
    friction_law("Coulomb", 0.4),
    friction_law("Voellmy", 0.2, 1500.0),
    friction_law("ModifiedVoellmy", 0.5, 400.0, 4.0),
    friction_law("Bingham", 500.0, 50.0),
    friction_law("Bingham", 0.0, 50.0),
    friction_law("Bingham", 500.0, 0.0),
    friction_law("Pouliquen", 0.38, 0.6, 0.136, 1e-3),
    friction_law("SamosAT", 0.155),
    friction_law("SamosAT", 0.22, 50.0, 0.1, 0.4, 2.0, 3.0),
    friction_law("VoellmyMinShear", 0.155, 4000.0),
    friction_law("OBrien", 300.0, 20.0, 500.0, 0.05),
    friction_law("HerschelBulkley", 200.0, 200.0, 0.5),
    friction_law("HerschelBulkley", 0.0, 20.0, 1.5),
    friction_law("Manning", 0.05),
    friction_law("Manning", 0.05, 0.1),
]
INPUTS = [
    (density, G, density * G * depth * 0.9, depth, speed)
    for density in (300.0, 2000.0)
    for depth in (1e-3, 0.5, 20.0)
    for speed in (0.0, 1e-9, 0.3, 4.0, 60.0)
]


@pytest.mark.parametrize("law", EVERY, ids=str)
def test_plain_and_compiled_agree(law):
    for state in INPUTS:
        plain = stress_parts(law, *state)
        assert compiled_function(stress_parts)(law, *state) == pytest.approx(plain, rel=1e-12)
        assert np.isfinite(plain).all() and min(plain) >= 0.0


@pytest.mark.parametrize("name", LAWS)
def test_a_place_gives_parameters_in_the_order_of_the_scene(name):
    parameters = LAWS[name][1]
    values = np.zeros((2, 3, len(parameters)))
    values[1, 2] = 0.1 + np.arange(len(parameters))
    law, there = friction_law(name, *np.ones(len(parameters))), friction_law(name, *values[1, 2])
    assert parameters_of(there) == dict(zip(parameters, values[1, 2], strict=True))
    assert at_node(law, values, 1, 2) == there
    assert compiled_function(at_node)(law, values, 1, 2) == there


def test_a_law_is_made_of_its_parameters_each_of_them_once():
    assert friction_law("Voellmy", 0.2, xi=500) == friction_law("Voellmy", xi=500.0, mu=0.2)
    assert friction_law("ModifiedVoellmy", 0.2, 500.0) == friction_law("ModifiedVoellmy", 0.2, 500.0, 4.0)
    assert parameters_of(FRICTIONLESS) == {}
    for values, named in (((0.2,), {}), ((0.2, 500.0, 1.0), {}), ((0.2,), {"mu": 0.2, "xi": 500.0}), ((), {"nu": 1.0})):
        with pytest.raises(TypeError, match=r"expected \(mu, xi\)"):
            friction_law("Voellmy", *values, **named)


def test_voellmy_is_as_printed():
    assert basal_stress(friction_law("Voellmy", 0.2, 1500.0), 300.0, G, 2000.0, 1.0, 30.0) == pytest.approx(
        0.2 * 2000.0 + 300.0 * G * 30.0**2 / 1500.0
    )


def test_hergartens_law_is_dry_below_its_crossover_and_turbulent_above():
    law, load = friction_law("ModifiedVoellmy", 0.5, 400.0, 4.0), 8e3
    crossover = 4.0 * 8.0 ** (1 / 3)  # of 8 m
    assert basal_stress(law, 2000.0, G, load, 8.0, 0.999 * crossover) == 0.5 * load
    fast = 1.001 * crossover
    assert basal_stress(law, 2000.0, G, load, 8.0, fast) == pytest.approx(2000.0 * G * fast**2 / 400.0)


@settings(max_examples=200, deadline=None)
@given(st.floats(1e-3, 1e5), st.floats(1e-3, 1e5), st.floats(1e-3, 50.0), st.floats(0.0, 150.0))
def test_binghams_ratio_is_the_root_of_its_cubic(yield_stress, viscosity, depth, speed):
    a = 6.0 * viscosity * speed / (depth * yield_stress)
    z = plug_ratio(yield_stress, viscosity, depth, speed)
    assert 0.0 < z <= 1.0 + 1e-12
    assert abs(z**3 - (3.0 + a) * z + 2.0) <= 1e-12 * (3.0 + a)


def test_bingham_ends_are_plastic_and_newtonian():
    law = friction_law("Bingham", 500.0, 50.0)
    assert basal_stress(law, 1500.0, G, 1e4, 1.0, 0.0) == pytest.approx(500.0, rel=1e-12)
    newtonian = 3.0 * 50.0 * 2.0 / 0.7
    assert basal_stress(friction_law("Bingham", 0.0, 50.0), 1500.0, G, 1e4, 0.7, 2.0) == pytest.approx(newtonian)
    assert basal_stress(friction_law("Bingham", 1e-3, 50.0), 1500.0, G, 1e4, 0.7, 2.0) == pytest.approx(
        newtonian, rel=1e-4
    )


def test_pouliquen_goes_from_mu1_to_mu2():
    law, load = friction_law("Pouliquen", 0.38, 0.6, 0.136, 1e-3), 1e4
    assert basal_stress(law, 1500.0, G, load, 1.0, 0.0) == pytest.approx(0.38 * load)
    assert basal_stress(law, 1500.0, G, load, 1.0, 1e9) == pytest.approx(0.6 * load, rel=1e-5)
    speed, depth = 2.0, 0.02
    mu = 0.38 + 0.22 / (1 + 0.136 * depth * np.sqrt(load / 1500.0) / (1e-3 * speed))
    assert basal_stress(law, 1500.0, G, load, depth, speed) == pytest.approx(mu * load)


@pytest.mark.parametrize(
    "law, density, degrees, depth, speed",
    [
        *(
            (friction_law("SamosAT", 0.155), 200.0, degrees, depth, speed)
            for degrees, speeds in (
                (25, (11.136, 18.435, 29.868)),
                (30, (12.691, 21.004, 34.025)),
                (35, (14.029, 23.216, 37.606)),
            )
            for depth, speed in zip((0.5, 1.0, 2.0), speeds, strict=True)
        ),
        (friction_law("OBrien", 300.0, 20.0, 500.0, 0.05), 1900.0, 10, 1.0, 2.173),
        (friction_law("OBrien", 300.0, 20.0, 500.0, 0.05), 1900.0, 10, 2.0, 6.988),
        (friction_law("HerschelBulkley", 200.0, 200.0, 0.5), 1900.0, 5, 0.5, 0.955),
        (friction_law("HerschelBulkley", 200.0, 200.0, 0.5), 1900.0, 10, 0.5, 5.736),
    ],
)
def test_steady_speeds_on_a_plane(law, density, degrees, depth, speed):
    """Of laws of other programs, computed apart from this package by their equations."""
    angle, weight = np.radians(degrees), density * G * depth
    found = steady_speed(
        lambda u: basal_stress(law, density, G, weight * np.cos(angle), depth, u), weight * np.sin(angle)
    )
    assert found == pytest.approx(speed, abs=6e-4)


@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 1e4), st.floats(1e-2, 1e4), st.floats(0.1, 3.0), st.floats(1e-2, 50.0), st.floats(1e-9, 100.0))
def test_herschel_bulkley_has_the_mean_speed_of_its_profile(yield_stress, consistency, exponent, depth, speed):
    stress = yield_stress + excess_stress(yield_stress, consistency, exponent, depth, speed)
    z = 1.0 - yield_stress / stress  # height of the sheared layer over the depth
    if z > 1e-4:  # else the difference of the stresses has no digits left
        mean = exponent / (exponent + 1) * (stress / consistency) ** (1 / exponent) * depth
        mean *= z ** ((exponent + 1) / exponent) * (1.0 - exponent * z / (2 * exponent + 1))
        assert mean == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize("speed", [1e-6, 0.1, 3.0, 40.0])
def test_laws_that_contain_others(speed):
    state = 1500.0, G, 1.2e4, 0.9, speed
    bingham = basal_stress(friction_law("Bingham", 300.0, 40.0), *state)
    assert basal_stress(friction_law("HerschelBulkley", 300.0, 40.0, 1.0), *state) == pytest.approx(bingham, rel=1e-9)
    voellmy = basal_stress(friction_law("Voellmy", 0.2, 900.0), *state)
    assert basal_stress(friction_law("VoellmyMinShear", 0.2, 900.0, 70.0), *state) == pytest.approx(voellmy + 70.0)
    water = basal_stress(friction_law("OBrien", 0.0, 0.0, 24.0, 0.04), *state)
    assert basal_stress(friction_law("Manning", 0.04), *state) == pytest.approx(water)
    assert basal_stress(friction_law("Manning", 0.04, 0.1), *state) == pytest.approx(water + 0.1 * 1.2e4)


def test_samosat_is_dry_at_rest_and_fluidised_in_fast_flow():
    law = friction_law("SamosAT", 0.2)
    assert basal_stress(law, 200.0, G, 1e3, 1.0, 0.0) == pytest.approx(2 * 0.2 * 1e3)
    dry, _, drag = stress_parts(law, 200.0, G, 1e3, 1.0, 1e4)
    assert dry == pytest.approx(0.2 * 1e3, rel=1e-4)
    assert drag == pytest.approx((np.log(1.0 / 0.05) / 0.43 + 4.13) ** -2)
    assert stress_parts(law, 200.0, G, 1e3, 0.01, 1e4)[2] == pytest.approx(4.13**-2)  # thinner than its bed is rough


def test_parameters_that_contradict_are_reported():
    assert "below mu1" in contradiction("Pouliquen", {"mu1": 0.5, "mu2": 0.4, "beta": 0.1, "length": 1e-3})
    assert contradiction("Pouliquen", {"mu1": 0.4, "mu2": 0.5, "beta": 0.1, "length": 1e-3}) == ""
    assert contradiction("Coulomb", {"mu": 0.4}) == ""


@settings(max_examples=200, deadline=None)
@given(*[st.floats(0.0, 100.0)] * 4)
def test_friction_never_reverses_and_solves_its_equation(speed, dry, viscous, drag):
    dt = 0.05
    after = slowed_speed(speed, dt, dry, viscous, drag)
    assert 0.0 <= after <= speed * (1 + 1e-15)
    if after > 0.0:
        left = (1.0 + dt * viscous) * after + dt * drag * after**2
        assert left == pytest.approx(speed - dt * dry, rel=1e-9, abs=1e-12)
