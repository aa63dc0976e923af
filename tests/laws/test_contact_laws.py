"""Contact of points with the ground: what each law leaves of a speed, plain and compiled."""

import numpy as np
import pytest
from compiled import compiled_function

from mpmgis.laws.contact_friction import (
    COULOMB,
    PARAMETERS,
    STICKING,
    VOELLMY,
    Contact,
    contact_at,
    coulomb_contact,
    dry_slip,
    kept_by_drag,
    kept_slip,
    sticking_contact,
    voellmy_contact,
    voellmy_drag,
)
from mpmgis.scene.material_table import CONTACTS

LAWS = {"Coulomb": coulomb_contact(0.4), "Voellmy": voellmy_contact(0.4, 500.0), "Sticking": sticking_contact()}
VALUES = np.array([[[0.1, 50.0], [0.2, 60.0]]])


@pytest.mark.parametrize("name", LAWS)
def test_laws_agree_with_compiled(name):
    law = LAWS[name]
    for function, *arguments in ((kept_slip, law, 3.0, 2.0), (kept_by_drag, law, 3.0, 40.0)):
        assert compiled_function(function)(*arguments) == function(*arguments), function.__name__
    for zones in (False, True):
        arguments = law, zones, VALUES, 0, 1
        assert compiled_function(contact_at)(*arguments) == contact_at(*arguments)


def test_each_contact_of_a_scene_reaches_its_own_law():
    for name, (make, parameters) in CONTACTS.items():
        contact = make(*(0.5 * (k + 1) for k in range(len(parameters))))
        assert PARAMETERS[contact.kind] == tuple(parameters) and LAWS[name].kind == contact.kind
    friction = {COULOMB: dry_slip(0.4, 3.0, 2.0), VOELLMY: dry_slip(0.4, 3.0, 2.0), STICKING: 0.0}
    drag = {COULOMB: 1.0, VOELLMY: voellmy_drag(500.0, 3.0, 40.0), STICKING: 1.0}
    for law in LAWS.values():
        assert (kept_slip(law, 3.0, 2.0), kept_by_drag(law, 3.0, 40.0)) == (friction[law.kind], drag[law.kind])
    assert set(friction) == set(PARAMETERS)


def test_dry_friction_takes_mu_times_what_is_pressed_and_never_turns_a_speed_round():
    for law in (LAWS["Coulomb"], LAWS["Voellmy"]):
        assert kept_slip(law, 3.0, 2.0) == pytest.approx((3.0 - 0.4 * 2.0) / 3.0)
        assert kept_slip(law, 1.0, 9.0) == 0.0 and kept_slip(law, 1.0, 0.0) == 1.0
    assert kept_slip(LAWS["Sticking"], 3.0, 0.0) == 0.0
    assert kept_slip(Contact(), 1.0, 9.0) == 1.0  # slides freely


def test_drag_solves_its_quadratic_exactly():
    """s = S - load s^2 / xi for small and for huge steps; only Voellmy's law has it."""
    law, slip = LAWS["Voellmy"], 7.0
    for load in (1e-3, 1.0, 1e6):
        left = slip * kept_by_drag(law, slip, load)
        assert 0.0 < left < slip
        assert left == pytest.approx(slip - load * left**2 / 500.0, rel=1e-9)
    assert kept_by_drag(LAWS["Coulomb"], slip, 1e6) == 1.0


def test_parameters_of_a_place():
    assert contact_at(LAWS["Coulomb"], True, VALUES, 0, 1) == coulomb_contact(0.2)
    assert contact_at(LAWS["Voellmy"], True, VALUES, 0, 1) == voellmy_contact(0.2, 60.0)
    assert contact_at(LAWS["Sticking"], True, VALUES, 0, 1) == sticking_contact()
    assert contact_at(LAWS["Voellmy"], False, VALUES, 0, 1) == LAWS["Voellmy"]
