"""Contact of points with the ground: what each law leaves of a speed, plain and compiled."""

import numpy as np
import pytest
from compiled import compiled

from mpmgis.laws.contact_friction import coulomb_contact, sticking_contact, voellmy_contact

LAWS = {"Coulomb": coulomb_contact(0.4), "Voellmy": voellmy_contact(0.4, 500.0), "Sticking": sticking_contact()}
VALUES = np.array([[[0.1, 50.0], [0.2, 60.0]]])


@pytest.mark.parametrize("name", LAWS)
def test_laws_agree_with_compiled(name):
    law = LAWS[name]
    for method, arguments in (
        ("kept_slip", (3.0, 2.0)),
        ("kept_by_drag", (3.0, 40.0)),
        ("sticks", ()),
        ("drag_active", ()),
    ):
        assert compiled(method, len(arguments))(law, *arguments) == getattr(law, method)(*arguments), method


def test_dry_friction_takes_mu_times_what_is_pressed_and_never_turns_a_speed_round():
    for law in (LAWS["Coulomb"], LAWS["Voellmy"]):
        assert law.kept_slip(3.0, 2.0) == pytest.approx((3.0 - 0.4 * 2.0) / 3.0)
        assert law.kept_slip(1.0, 9.0) == 0.0 and law.kept_slip(1.0, 0.0) == 1.0
    assert LAWS["Sticking"].kept_slip(3.0, 0.0) == 0.0


def test_drag_solves_its_quadratic_exactly():
    """s = S - load s^2 / xi for small and for huge steps; only Voellmy's law has it."""
    law, slip = LAWS["Voellmy"], 7.0
    for load in (1e-3, 1.0, 1e6):
        left = slip * law.kept_by_drag(slip, load)
        assert 0.0 < left < slip
        assert left == pytest.approx(slip - load * left**2 / 500.0, rel=1e-9)
    assert LAWS["Coulomb"].kept_by_drag(slip, 1e6) == 1.0 and not LAWS["Coulomb"].drag_active()
    assert law.drag_active()


def test_parameters_of_a_place():
    assert LAWS["Coulomb"].at_node(VALUES, 0, 1) == coulomb_contact(0.2)
    assert LAWS["Voellmy"].at_node(VALUES, 0, 1) == voellmy_contact(0.2, 60.0)
    assert LAWS["Sticking"].at_node(VALUES, 0, 1) == sticking_contact()
