"""Contact of the 3D flow with the ground: slabs near their friction angle, waves, rest after a fall, properties."""

import numpy as np
import pytest
from contact_scenes import FRICTION, slab
from exact_solutions import G
from hypothesis import given, settings
from hypothesis import strategies as st
from point_scenes import block_of, march_to, points_on, sorted_points
from test_points_catalogue import SOIL, column, level, watched

from mpmgis.effects.contact import CoulombContact
from mpmgis.effects.material import drucker_prager
from mpmgis.kernels import point_contact as contact

MU = np.tan(np.radians(FRICTION))
plain = getattr(contact.normal_impulse, "py_func", contact.normal_impulse)


@pytest.mark.parametrize(("above", "precision"), [(0.0, "float64"), (0.3, "float64"), (0.6, "float32")])
def test_a_slab_a_degree_below_its_friction_angle_rests(above, precision):
    """It settles by 1 cm in 6 s, at most 5 cm asked (waves of separation carried it 2.1 m before)."""
    moved, speed, _, _ = slab(24.0, 6.0, above=above, precision=precision)
    assert abs(moved) <= 0.02
    assert abs(speed) <= 2e-3


@pytest.mark.parametrize("weighted", [False, True])
def test_a_slab_a_degree_above_its_friction_angle_slides(weighted):
    """6 % farther than the exact path in 6 s (15 asked without stress at the start); at its exact friction the path is
    proportional to tan 26 - tan 25, so that 6 % of the path are 0.3 % of the friction."""
    moved, _, exact, _ = slab(26.0, 6.0, above=0.3, weighted=weighted)
    assert moved == pytest.approx(exact, rel=0.08)
    assert moved >= exact


@pytest.mark.parametrize("above", [0.0, 0.3])
def test_a_slab_far_above_its_friction_angle_slides_exactly(above):
    """35 degrees: 0.1 % (0.5 asked)."""
    moved, speed, exact, _ = slab(35.0, 3.0, above=above)
    assert moved == pytest.approx(exact, rel=0.005)
    assert speed == pytest.approx(2.0 * exact / 3.0, rel=0.005)


def test_friction_takes_what_the_law_says():
    """Energy that the ledger books to the ground: mu times the weight on the bed times the path, within 1 %."""
    moved, _, _, solver = slab(35.0, 3.0, above=0.3, weighted=True)
    law = MU * solver.mass_start * G * np.cos(np.radians(35.0)) * moved
    assert solver.balances()["energy_lost_to_ground"] == pytest.approx(law, rel=0.01)


@pytest.mark.parametrize("speed", [2.0, 5.0])
def test_a_slab_stops_on_the_flat_after_its_exact_path(speed):
    """v^2 / (2 mu g) to 0.5 %."""
    moved, left, exact, _ = slab(0.0, 4.0, above=0.45, weighted=True, speed=speed)
    assert moved == pytest.approx(exact, rel=0.008)
    assert abs(left) <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("above", [0.0, 0.3, 0.6])
def test_slabs_on_half_the_cells(above):
    """1 cm at 24 degrees, 4 to 12 % of the path too much at 26, 0.1 % at 35."""
    assert abs(slab(24.0, 6.0, 0.25, above)[0]) <= 0.02
    moved, _, exact, _ = slab(26.0, 6.0, 0.25, above)
    assert moved == pytest.approx(exact, rel=0.15)
    moved, _, exact, _ = slab(35.0, 3.0, 0.25, above)
    assert moved == pytest.approx(exact, rel=0.005)


@pytest.mark.parametrize("layers", [20, 4])
@pytest.mark.parametrize("above", [0.05, 0.5, 0.75])
def test_what_falls_comes_to_rest_on_the_ground(layers, above):
    """Sand that falls by two cells: the gap under its lowest points is 0 to 0.3 cells, wherever the ground lies."""
    frame = block_of((3.0, 3.0, 0.5 * layers), 0.5, (0.0, 0.0, above + 2.0))
    sand = drucker_prager(1e7, 6e6, 30.0, 0.0, "plane_strain")
    solver = points_on(level(3.0, 3.0, 1.0, above), frame, 1.0, sand, CoulombContact(0.5), edges="wall")
    march_to(solver, 4.0)
    gap = sorted_points(solver).position[:, 2].min() - above - 0.25
    assert -0.15 <= gap <= 0.3


def test_the_ground_absorbs_waves_and_bears_the_weight():
    """A column that is let go without stress swings for ever on rigid ground. Here a hundredth of its kinetic energy is
    left after two periods, and the ground bears the weight to 1 %."""
    solver = column(SOIL, 10, wide=4, at_rest=False)
    period = 4.0 * 10.0 / SOIL.wave_speed(1000.0)
    first = watched(solver, 0.0, period, 16)[3]
    layers, _, force, left = watched(solver, 3.0 * period, 4.0 * period, 16)
    assert left <= 0.01 * first
    assert force == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(layers, 1.0, atol=0.03)


RANGE = {"min_value": 1e-3, "max_value": 1e3, "allow_nan": False}


@given(
    into=st.floats(-10.0, 10.0), force=st.floats(0.0, 1e3), yielded=st.floats(0.0, 0.1), dt=st.floats(0.01, 0.6),
    give=st.floats(0.5, 50.0), impedance=st.floats(0.5, 4.0), scale=st.floats(**RANGE),
)  # fmt: skip
@settings(max_examples=300, deadline=None)
def test_the_ground_pushes_and_never_pulls(into, force, yielded, dt, give, impedance, scale):
    """In units of cells, speed of sound and full nodes, scaled at will: the impulse is not negative, what is left of
    the speed into the ground is not more than there was or than the ground returns, and it yields within its bounds."""
    dx, sound = scale, 3.0
    memory = np.array([force, yielded * dx, 0.0])
    impulse = plain(into * sound, give, memory, dt * dx / sound, dx, impedance / dt, sound)
    assert impulse >= 0.0
    assert 0.0 <= memory[contact.YIELDED] <= contact.MOST_YIELDED * dx * (1.0 + 1e-9)
    if impulse > 0.0 and into > 0.0:
        assert into * sound - impulse * give <= into * sound


@given(weight=st.floats(**RANGE), dt=st.floats(0.05, 0.5), give=st.floats(0.5, 20.0))
@settings(max_examples=50, deadline=None)
def test_a_steady_load_is_borne_without_yielding(weight, dt, give):
    """A mass on the ground under a constant force: after a while the ground bears just that, and has not yielded."""
    memory, into = np.array([-1.0, 0.0, 0.0]), 0.0
    for _ in range(4000):
        into += weight * dt * give
        impulse = plain(into, give, memory, dt, 1.0, 1.0, 1.0)
        into -= impulse * give
    assert impulse == pytest.approx(weight * dt, rel=1e-3)
    assert memory[contact.YIELDED] <= contact.MOST_YIELDED


def test_a_restart_goes_on_with_what_the_ground_remembers():
    """Bits of a slab that stops and goes on from its state are those of one that does not."""
    whole = slab(24.0, 1.0, above=0.3)[3]
    begun = slab(24.0, 0.5, above=0.3)[3]
    other = slab(24.0, 0.01, above=0.3)[3]
    other.restore(begun.frame())
    march_to(begun, 1.0)
    march_to(other, 1.0)
    assert np.array_equal(sorted_points(begun).position, sorted_points(other).position)
    np.testing.assert_allclose(sorted_points(whole).position, sorted_points(other).position, atol=1e-3)
