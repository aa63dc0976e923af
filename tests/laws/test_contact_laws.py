"""Contact of points with the ground: what each law leaves of a speed, plain and compiled."""

import numpy as np
import pytest
from compiled import compiled_function
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.laws.contact_friction import (
    contact_at,
    drag_roughness,
    dry_slip,
    equal_roughness,
    has_traction,
    impulse_friction,
    kept_by_traction,
    kept_slip,
    sticking_contact,
    traction_parts,
)
from mpmgis.laws.friction import (
    FRICTIONLESS,
    LAWS,
    Friction,
    basal_stress,
    friction_law,
    parameters_of,
    strength_of_bed,
)

G = 9.81
VALUES = {
    "Coulomb": (0.4,),
    "Voellmy": (0.4, 500.0),
    "ModifiedVoellmy": (0.4, 500.0, 4.0),
    "Bingham": (300.0, 40.0),
    "Pouliquen": (0.38, 0.6, 0.136, 1e-3),
    "SamosAT": (0.155, 20.0),
    "VoellmyMinShear": (0.155, 4000.0, 70.0),
    "OBrien": (300.0, 20.0, 500.0, 0.05),
    "HerschelBulkley": (200.0, 200.0, 0.5),
    "Manning": (0.05, 0.1),
}
CONTACTS = {name: friction_law(name, *values) for name, values in VALUES.items()}
CONTACTS |= {"Sticking": sticking_contact(), "none": FRICTIONLESS}
SLIDING = [law for name, law in CONTACTS.items() if name != "Sticking"]
STATE = 1500.0, G, 1.2e4, 0.9, 3.0  # density, gravity, load, thickness, speed


def test_every_law_of_friction_is_here():
    assert set(VALUES) == set(LAWS)


@pytest.mark.parametrize("name", CONTACTS)
def test_contacts_agree_with_compiled(name):
    law = CONTACTS[name]
    parts = traction_parts(law, *STATE)
    zones = np.array([[[0.0] * 6, [0.5 * value for value in law[1:]]]])
    for function, *arguments in (
        (has_traction, law),
        (impulse_friction, law),
        (kept_slip, law, 3.0, 2.0),
        (traction_parts, law, *STATE),
        (kept_by_traction, parts, 3.0, 0.01, 1500.0, 900.0),
        (drag_roughness, parts[2]),
        (equal_roughness, law, False, G),
        (equal_roughness, law, True, G),
        (contact_at, law, False, zones, 0, 1),
        (contact_at, law, True, zones, 0, 1),
    ):
        assert compiled_function(function)(*arguments) == pytest.approx(function(*arguments), rel=1e-12), function


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(SLIDING), st.floats(0.0, 1e6), st.floats(1e-3, 50.0), st.floats(0.0, 100.0))
def test_impulse_and_traction_are_the_whole_law(law, load, thickness, speed):
    state = 1500.0, G, load, thickness, speed
    dry, viscous, drag = traction_parts(law, *state)
    stress = impulse_friction(law) * load + dry + viscous * speed + 1500.0 * drag * speed**2
    assert stress == pytest.approx(basal_stress(law, *state), rel=1e-9, abs=1e-6)
    assert has_traction(law) or (dry, viscous, drag) == (0.0, 0.0, 0.0)
    assert dry >= 0.0


def test_dry_friction_takes_mu_times_what_is_pressed_and_never_turns_a_speed_round():
    for law in (CONTACTS["Coulomb"], CONTACTS["Voellmy"]):
        assert kept_slip(law, 3.0, 2.0) == pytest.approx((3.0 - 0.4 * 2.0) / 3.0) == dry_slip(0.4, 3.0, 2.0)
        assert kept_slip(law, 1.0, 9.0) == 0.0 and kept_slip(law, 1.0, 0.0) == 1.0
    assert kept_slip(CONTACTS["Manning"], 3.0, 2.0) == dry_slip(0.1, 3.0, 2.0)
    assert kept_slip(CONTACTS["Sticking"], 3.0, 0.0) == 0.0
    for law in (FRICTIONLESS, CONTACTS["Bingham"]):  # slides freely, but for a traction
        assert kept_slip(law, 1.0, 9.0) == 1.0


@pytest.mark.parametrize("name", [name for name, law in CONTACTS.items() if has_traction(law)])
def test_a_step_of_traction_solves_its_equation(name):
    """(1 + dt L) s = S - dt F - dt k s^2 for small steps and for huge ones."""
    parts, slowed = traction_parts(CONTACTS[name], *STATE), 900.0
    for dt in (1e-4, 1e-2, 1.0, 1e4):
        left = 3.0 * kept_by_traction(parts, 3.0, dt, 1500.0, slowed)
        dry, viscous, drag = (part / slowed for part in parts)
        if dt * dry >= 3.0:
            assert left == 0.0
            continue
        assert 0.0 < left < 3.0
        assert (1.0 + dt * viscous) * left + dt * 1500.0 * drag * left**2 == pytest.approx(3.0 - dt * dry, rel=1e-9)


def test_parameters_of_a_place():
    values = np.array([[[0.1, 50.0], [0.2, 60.0]]])
    assert contact_at(CONTACTS["Coulomb"], True, values[..., :1], 0, 1) == friction_law("Coulomb", 0.2)
    assert contact_at(CONTACTS["Voellmy"], True, values, 0, 1) == friction_law("Voellmy", 0.2, 60.0)
    assert contact_at(CONTACTS["Sticking"], True, values, 0, 1) == sticking_contact()
    assert contact_at(CONTACTS["Voellmy"], False, values, 0, 1) == CONTACTS["Voellmy"]
    assert parameters_of(CONTACTS["Sticking"]) == parameters_of(FRICTIONLESS) == {}


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(SLIDING), st.floats(0.0, 1e6))
def test_strength_of_the_bed_is_the_stress_at_rest(law: Friction, load):
    coefficient, yield_stress = strength_of_bed(law)
    assert coefficient * load + yield_stress == pytest.approx(
        basal_stress(law, 200.0, G, load, 3.0, 0.0), rel=1e-9, abs=1e-9
    )
