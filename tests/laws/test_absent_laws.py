"""Laws of points by number: all of them have the same types, for which kernels are compiled once."""

import itertools

import numba
import numpy as np
import pytest

from mpmgis.laws.contact_friction import sticking_contact
from mpmgis.laws.effect_slots import PointEffects, in_precision, with_fixed_types
from mpmgis.laws.friction import FRICTIONLESS, friction_law
from mpmgis.laws.material import cohesive_mu_i, drucker_prager, elastic, fluid, mu_i
from mpmgis.laws.softening import Softening, softening

ICE = drucker_prager(7e6, 4e6, 40, 1000)
MATERIALS = (
    ICE,
    elastic(7, 4),
    mu_i(7e6, 4e6, 0, 1, 0.3, 1, 2500, True),
    cohesive_mu_i(40, 1000, 0, 1, 1, 900, bulk_modulus=7e6, shear_modulus=4e6),
    fluid(7, 0, True),
)
SOFTENINGS = (Softening(), *(softening((40, 1000), (20, 0), 10, form) for form in ("exponential", "tangent", "linear")))
CONTACTS = friction_law("Coulomb", 0), friction_law("Voellmy", 1, 500), sticking_contact()


@pytest.mark.parametrize("real", [np.float64, np.float32])
def test_laws_of_a_slot_have_one_type_whole_numbers_of_users_or_not(real):
    for laws in (MATERIALS, SOFTENINGS, CONTACTS):
        assert len({numba.typeof(in_precision(law, real)) for law in laws}) == 1


def test_effects_have_one_type():
    found = set()
    for laws in itertools.product(MATERIALS, SOFTENINGS, CONTACTS, (False, 1), (0, True), (0, np.int32(1))):
        effects = with_fixed_types(PointEffects(*laws))
        assert effects == PointEffects(*laws)
        found.add(numba.typeof(effects))
    assert len(found) == 1


def test_by_default_nothing_acts_but_the_material():
    effects = PointEffects(ICE)
    assert effects == PointEffects(ICE, Softening(), FRICTIONLESS, False, False, 0)
