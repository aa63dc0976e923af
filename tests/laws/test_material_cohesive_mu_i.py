"""CohesiveMuI, a point at a time: its equation, steady shear, its limits, and the laws that it contains."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from material_points import FRESH, at_pressure, pressure, random_states, shear, sheared, step

from mpmgis.laws.material import NO_TENSION, ORDINARY, cohesive_mu_i, drucker_prager, mu_i
from mpmgis.laws.material_choice import stress_step, stress_step_far
from mpmgis.laws.softening import Softening, softening
from mpmgis.laws.solid_material import returned_cohesive_mu_i

BULK, SHEAR = 6.7e6, 4e6
MODULI = {"bulk_modulus": BULK, "shear_modulus": SHEAR}
GRAINS = {"rate_friction": 0.26, "inertial_number": 0.279, "grain_diameter": 0.1, "grain_density": 900.0}
ICE = cohesive_mu_i(40.0, 1e3, **GRAINS, **MODULI)
SOFT = softening((40.0, 1e3), (20.0, 0.0), 10.0)


def growth(law, rate, p):
    """What friction gains at a shear rate [s-1] and a pressure [Pa]: mu_r / (1 + I0 / I)."""
    inertia = rate * law.grain_diameter / math.sqrt(p / law.grain_density)
    return law.rate_friction * inertia / (inertia + law.inertial_number)


def steady_shear(law, rate, p, soft, strain=3.0, time_step=None):
    """Stress [Pa] after `strain` of simple shear at `rate` [s-1], begun under pressure p [Pa]."""
    time_step = time_step or 2e-3 / rate
    state = at_pressure(law, p)
    for _ in range(round(strain / (rate * time_step))):
        state, stress, _ = step(law, state, sheared(rate * time_step), time_step=time_step, softening=soft)
    return stress


@pytest.mark.parametrize("rate", [0.01, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("p", [1e3, 5e4])
def test_steady_simple_shear_has_the_strength_of_its_rate(rate, p):
    """q = gamma p + q_c + sqrt(3) mu_r p / (1 + I0 / I), exact in simple shear, which keeps p."""
    stress = steady_shear(ICE, rate, p, Softening(), strain=1.0)
    assert pressure(stress) == pytest.approx(p, rel=1e-6)
    wanted = ICE.slope * p + ICE.strength + math.sqrt(3.0) * growth(ICE, rate, p) * p
    assert shear(stress) == pytest.approx(wanted, rel=2e-5)


@pytest.mark.parametrize("rate", [0.1, 10.0])
def test_softened_steady_shear_keeps_its_rate_term(rate):
    """20 degrees and no cohesion are left, and the growth with the rate is whole."""
    p = 5e4
    wanted = drucker_prager(BULK, SHEAR, 20.0, 0.0).slope * p + math.sqrt(3.0) * growth(ICE, rate, p) * p
    assert shear(steady_shear(ICE, rate, p, SOFT)) == pytest.approx(wanted, rel=2e-5)


@pytest.mark.parametrize("rate", [0.1, 1e3])
def test_cohesion_alone_is_rate_independent(rate):
    """Without friction and pressure q is q_c at any rate; under pressure without friction the growth is added."""
    law = cohesive_mu_i(0.0, 2e3, **GRAINS, **MODULI)
    state = FRESH
    for _ in range(500):
        state, stress, _ = step(law, state, sheared(2e-3), time_step=2e-3 / rate)
    assert abs(pressure(stress)) < 1e-6 and shear(stress) == pytest.approx(math.sqrt(3.0) * law.strength / 3**0.5)
    stress = steady_shear(law, rate, 1e4, Softening(), strain=1.0)
    assert shear(stress) == pytest.approx(law.strength + math.sqrt(3.0) * growth(law, rate, 1e4) * 1e4, rel=2e-5)


@pytest.mark.parametrize("time_step", [1e-4, 1e-3, 1e-2])
def test_the_rate_is_that_of_the_end_of_the_step(time_step):
    """Steady shear is the same for any time step, large ones too: the return is implicit."""
    wanted = ICE.slope * 1e4 + ICE.strength + math.sqrt(3.0) * growth(ICE, 10.0, 1e4) * 1e4
    stress = steady_shear(ICE, 10.0, 1e4, Softening(), strain=2.0, time_step=time_step)
    assert shear(stress) == pytest.approx(wanted, rel=5e-3)


laws = st.fixed_dictionaries(
    {
        "phi": st.floats(0.0, 60.0),
        "cohesion": st.sampled_from([0.0, 10.0, 1e3, 1e5]),
        "match": st.sampled_from(["triaxial", "plane_strain"]),
        "grows": st.floats(0.0, 3.0),
        "grain": st.floats(-5.0, 1.0),
        "dense": st.floats(500.0, 3000.0),
        "seed": st.integers(0, 2**31),
        "step": st.floats(-6.0, -2.0),
        "correction": st.booleans(),
        "size": st.sampled_from([1e-4, 3e-3, 0.03, 0.3]),
    }
)


def drawn(law, rate_friction):
    """(CohesiveMuI, its `drucker_prager`, rng, time step [s]) of drawn parameters."""
    cone = {**MODULI, "match": law["match"], "volume_correction": law["correction"]}
    grains = (0.279, 10.0 ** law["grain"], law["dense"])
    made = cohesive_mu_i(law["phi"], law["cohesion"], rate_friction, *grains, **cone)
    bare = drucker_prager(friction_angle=law["phi"], cohesion=law["cohesion"], **cone)
    return made, bare, np.random.default_rng(law["seed"]), 10.0 ** law["step"]


@settings(max_examples=60, deadline=None)
@given(law=laws, softens=st.booleans())
def test_without_growth_it_is_drucker_prager_to_the_last_bit(law, softens):
    made, bare, rng, time_step = drawn(law, 0.0)
    soft = softening((law["phi"], law["cohesion"]), (0.5 * law["phi"], 0.0), 10.0) if softens else Softening()
    for b, gradient in random_states(rng, 20, law["size"]):
        start = (*b, rng.uniform(0.0, 0.5), rng.choice([0.0, 2e-3]))
        for function in (stress_step, stress_step_far):
            found = step(made, start, gradient, time_step, soft, function)
            wanted = step(bare, start, gradient, time_step, soft, function)
            assert found[0] == wanted[0] and np.array_equal(found[1], wanted[1]) and found[2] == wanted[2]


@settings(max_examples=60, deadline=None)
@given(law=laws)
def test_without_cohesion_and_softening_it_is_mu_i(law):
    """Of mu1 = gamma / sqrt(3), to rounding."""
    made, _, rng, time_step = drawn({**law, "cohesion": 0.0}, law["grows"])
    mu1 = made.slope / math.sqrt(3.0)
    grains = made.inertial_number, made.grain_diameter, made.grain_density, made.volume_correction
    beads = mu_i(BULK, SHEAR, mu1, mu1 + law["grows"], *grains)
    for b, gradient in random_states(rng, 20, law["size"]):
        start = (*b, rng.uniform(0.0, 0.5), rng.choice([0.0, 2e-3]))
        found, wanted = (step(material, start, gradient, time_step) for material in (made, beads))
        largest = BULK * law["size"]
        np.testing.assert_allclose(found[1], wanted[1], rtol=0, atol=1e-9 * largest)
        np.testing.assert_allclose(found[0], wanted[0], rtol=0, atol=1e-9 * law["size"])
        assert found[2] == wanted[2]


@settings(max_examples=60, deadline=None)
@given(law=laws)
def test_a_return_solves_its_equation(law):
    """q at the rate that the return has taken out, in the cone where nothing is taken out, none beyond the tip."""
    made, _, rng, time_step = drawn(law, law["grows"])
    for _ in range(50):
        trace, norm = rng.uniform(-0.05, 0.01), 10.0 ** rng.uniform(-6.0, -1.0)
        elastic, kept, strain, _, code, yields = returned_cohesive_mu_i(
            made, (made.slope, made.strength), trace, norm, 0.0, 0.0, time_step
        )
        p, trial = -BULK * elastic, math.sqrt(6.0) * SHEAR * norm
        cone = max(made.slope * p + made.strength, 0.0)
        if code == NO_TENSION:
            assert kept == 0.0 and p <= 0.0
            continue
        rate = (1.0 - kept) * math.sqrt(2.0) * norm / time_step
        grown = math.sqrt(3.0) * growth(made, rate, p) * p if p > 0.0 else 0.0
        assert code == ORDINARY and yields == (trial > cone)
        assert strain == pytest.approx(math.sqrt(2.0 / 3.0) * (1.0 - kept) * norm)
        if yields and 1.0 - kept > 1e-6:  # a rate that is more than rounding
            assert kept * trial == pytest.approx(cone + grown, rel=1e-7)
        assert kept * trial <= cone + math.sqrt(3.0) * made.rate_friction * max(p, 0.0) + 1e-9 * trial


def test_it_tears_at_the_tip_of_the_softened_cone():
    state = FRESH
    for _ in range(20):
        state, stress, code = step(ICE, state, 1e-4 * np.eye(3))
    np.testing.assert_allclose(stress, 1e3 / math.tan(math.radians(40.0)) * np.eye(3), rtol=1e-9, atol=1e-9)
    assert code == NO_TENSION and state[7] > 0.0
    _, stress, code = step(ICE, (*FRESH[:6], 5.0, 0.0), 1e-4 * np.eye(3), softening=SOFT)
    assert code == NO_TENSION and np.max(np.abs(stress)) < 1e-9  # all cohesion is lost
