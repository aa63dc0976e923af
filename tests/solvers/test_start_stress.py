"""Stress at the start of the 3D solver: equilibrium of a layer on a slope, strength of the material, surface slopes."""

import numpy as np
import pytest
from column_scenes import columns_of, terrain_of
from hypothesis import example, given
from hypothesis import strategies as some
from point_scenes import points_on

from mpmgis.conversion.initial_points import point_options, points_from
from mpmgis.conversion.initial_stress import USED, kirchhoff_stress, lateral_ratio, stress_of_weight, surface_slopes
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager, fluid, mu_i
from mpmgis.laws.quantities import GRAVITY

SLOPES, DIRECTIONS = some.floats(0.0, 0.95), some.floats(0.0, 2.0 * np.pi)
RATIOS = some.floats(-0.2, 0.49)  # Poisson's
BULK = 2e6


def shear_modulus(ratio):
    """[Pa] for BULK and Poisson's `ratio`."""
    return 1.5 * BULK * (1.0 - 2.0 * ratio) / (1.0 + ratio)


def stress_at(steepness, direction, ratio, bed_friction=1.0, strength=np.inf, weight=-1e4):
    """(float64[3, 3] stress [Pa], unit normal of the slope) of a layer with the slope `steepness` up in `direction`."""
    slope = steepness * np.array([[np.cos(direction), np.sin(direction)]])
    found = kirchhoff_stress(np.array([weight]), BULK, shear_modulus(ratio), slope, bed_friction, strength)[0]
    xx, yy, zz, xy, xz, yz = found
    normal = np.array([*-slope[0], 1.0]) / np.sqrt(1.0 + steepness**2)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), normal


def used_strength(stress):
    """|s| / sqrt(2) over p [1]."""
    pressure = -np.trace(stress) / 3.0
    return np.sqrt(0.5 * ((stress + pressure * np.eye(3)) ** 2).sum()) / pressure


@given(SLOPES, DIRECTIONS, RATIOS)
def test_a_layer_bears_the_weight_above_it(steepness, direction, ratio):
    """The stress on a plane parallel to the slope is vertical: infinite slope, -rho g d cos(theta) upwards."""
    stress, normal = stress_at(steepness, direction, ratio)
    np.testing.assert_allclose(stress @ normal, [0.0, 0.0, -1e4 / normal[2]], atol=1e-8)


@given(SLOPES, DIRECTIONS, RATIOS, some.floats(0.0, 2.0))
def test_the_bed_bears_no_more_than_its_friction(steepness, direction, ratio, friction):
    stress, normal = stress_at(steepness, direction, ratio, bed_friction=friction)
    traction = stress @ normal
    pressed = traction @ normal
    assert pressed == pytest.approx(-1e4)
    along = np.linalg.norm(traction - pressed * normal)
    assert along == pytest.approx(1e4 * min(steepness, friction, 1.0), abs=1e-8)


@example(5e-324, 1.0, 0.0, 0.125)
@given(SLOPES, DIRECTIONS, RATIOS, some.floats(0.05, 1.2))
def test_the_material_bears_its_stress_at_the_start(steepness, direction, ratio, strength):
    """At most 0.9 of its strength if a layer can rest with that; otherwise at most the stress that the slope requires,
    sin of its angle, and never more than the strength."""
    stress, _ = stress_at(steepness, direction, ratio, strength=strength)
    least = steepness / np.hypot(1.0, steepness)
    assert used_strength(stress) <= min(strength, max(USED * strength, least)) * (1.0 + 1e-9)


@given(some.floats(0.0, 1.0), RATIOS, some.floats(0.05, 1.2))
def test_lateral_stress_is_the_least_that_the_material_bears(shear, ratio, strength):
    """With slightly less lateral stress more than 0.9 of the strength is used, or it is that of an elastic layer."""
    confined = ratio / (1.0 - ratio)
    k = float(lateral_ratio(confined, np.array([shear]), strength)[0])
    assert k >= confined
    if k > confined + 1e-6 and k < 1.0 + 2.0 * shear**2 - 1e-6:
        k -= 1e-6
        third = k if k <= 1.0 else 0.5 * (1.0 + k)
        stress = -np.array([[1.0, shear, 0.0], [shear, k, 0.0], [0.0, 0.0, third]])
        assert used_strength(stress) > USED * strength


@pytest.mark.parametrize("k", [0.25, 1.0])
def test_lateral_stress_of_known_cases(k):
    """Elastic: nu / (1 - nu). Level ground with m = 0.9 mu: |s| / sqrt(2) / p = sqrt(3) (1 - K) / (1 + 2 K)."""
    assert lateral_ratio(k, np.zeros(1), np.inf)[0] == k
    strength = 0.3
    expected = (np.sqrt(3.0) - 0.27) / (np.sqrt(3.0) + 0.54)
    assert lateral_ratio(0.25, np.zeros(1), strength)[0] == pytest.approx(expected)


def test_a_fluid_has_the_same_pressure_in_all_directions_on_any_slope():
    terrain = terrain_of(lambda x, y: 0.5 * x, 20.0, 20.0, 1.0)
    made = points_from(columns_of(2.0, 5, 15, 5, 15, 0.5), terrain, point_options(1.0, 2)).frame
    weight = made.state["vertical_stress"]
    stress = stress_of_weight(made, terrain, weight, fluid(2e6, 0.1, 0.0), friction_law("Coulomb", 0.4), 1.0, GRAVITY)
    np.testing.assert_allclose(stress, np.column_stack([weight] * 3 + [0.0 * weight] * 3))


@given(
    some.floats(-2.0, 2.0),
    some.floats(-2.0, 2.0),
    some.sampled_from([0.0, 5e6]),
    some.sampled_from([1e-3, 1.0, 1e2]),
    some.integers(0, 2**32),
)
def test_slopes_of_a_plane_are_exact(east, north, away, scale, seed):
    """Any number of particles anywhere, in any unit, at any origin."""
    x, y = scale * np.random.default_rng(seed).uniform(0.0, 20.0, (2, 300))
    found = surface_slopes(x + away * scale, y, 1000.0 * scale + east * x + north * y, 4.0 * scale)
    np.testing.assert_allclose(found, np.tile([east, north], (300, 1)), atol=2e-6)


def test_slopes_follow_a_surface_and_are_level_where_they_are_not_known():
    """A cone of 30 degrees; a row along x; a particle alone."""
    x, y = np.random.default_rng(1).uniform(-20.0, 20.0, (2, 20000))
    r = np.hypot(x, y)
    found = surface_slopes(x, y, -np.tan(np.radians(30.0)) * r, 1.0)
    away = (r > 5.0) & (r < 18.0)
    np.testing.assert_allclose(np.hypot(*found.T)[away], np.tan(np.radians(30.0)), rtol=0.05)
    row = np.arange(10.0)
    np.testing.assert_allclose(surface_slopes(row, 0.0 * row, 0.3 * row, 1.0), np.tile([0.3, 0.0], (10, 1)), atol=1e-12)
    np.testing.assert_array_equal(surface_slopes(row[:1], row[:1], row[:1], 1.0), [[0.0, 0.0]])


def test_stress_does_not_depend_on_chunks(monkeypatch):
    """The same in one chunk and in many."""
    terrain = terrain_of(lambda x, y: 0.3 * x + 0.1 * y, 40.0, 40.0, 1.0)
    made = points_from(columns_of(2.0, 5, 35, 5, 35, 0.5), terrain, point_options(1.0, 2)).frame
    sand = drucker_prager(2e6, 1.2e6, 35.0, 0.0)
    given = made, terrain, made.state["vertical_stress"], sand, friction_law("Coulomb", 0.6), 1.0, GRAVITY
    whole = stress_of_weight(*given)
    monkeypatch.setattr("mpmgis.conversion.initial_stress.CHUNK", 1000)
    np.testing.assert_array_equal(stress_of_weight(*given), whole)


def test_a_level_pile_on_a_slope_starts_without_shear_stress():
    """Its surface is level: no force acts along the bed."""
    terrain = terrain_of(lambda x, y: 0.4 * x, 40.0, 20.0, 1.0)
    columns = columns_of(lambda x, y: np.maximum(8.0 - 0.4 * x, 0.0), 5, 20, 5, 15, 0.5)
    made = points_from(columns, terrain, point_options(1.0, 2)).frame
    weight = made.state["vertical_stress"]
    sand = drucker_prager(2e6, 1.2e6, 35.0, 0.0)
    stress = stress_of_weight(made, terrain, weight, sand, friction_law("Coulomb", 0.6), 1.0, GRAVITY)
    assert np.abs(stress[:, 3:]).max() <= 0.02 * np.abs(weight).max()


@pytest.mark.parametrize("degrees", [10.0, 20.0, 28.0])
def test_a_ridge_on_level_ground_bears_its_weight(degrees):
    """Vertical stress on its flanks, over the weight above: 1.00 to 1.06 (an infinite layer along the flank)."""
    terrain, steep = terrain_of(lambda x, y: 0.0 * x, 40.0, 20.0, 1.0), np.tan(np.radians(degrees))
    columns = columns_of(lambda x, y: np.maximum(steep * (12.0 - np.abs(x - 20.0)), 0.0), 5, 35, 5, 15, 0.5)
    made = points_from(columns, terrain, point_options(1.0, 2)).frame
    sand, weight = drucker_prager(2e6, 1.2e6, 40.0, 0.0), made.state["vertical_stress"]
    stress = stress_of_weight(made, terrain, weight, sand, friction_law("Coulomb", 0.8), 0.5, GRAVITY)
    away = np.abs(made.map_xy()[0] - 20.0)
    flank = (away > 3.0) & (away < 8.0)
    assert 0.97 <= (stress[flank, 2].sum() / weight[flank].sum()) <= 1.07


def test_cohesion_bears_stress_too():
    """Clay without friction: K of an elastic layer to the depth at which its cohesion is used, larger below."""
    terrain = terrain_of(lambda x, y: 0.0 * x, 20.0, 20.0, 1.0)
    made = points_from(columns_of(4.0, 5, 15, 5, 15, 0.5), terrain, point_options(1.0, 2)).frame
    weight, clay = made.state["vertical_stress"], drucker_prager(2e6, 1.2e6, 0.0, 8e3, tension_limit=1e3)
    stress = stress_of_weight(made, terrain, weight, clay, friction_law("Coulomb", 0.6), 1.0, GRAVITY)
    ratio, confined = stress[:, 0] / weight, (2e6 - 0.8e6) / (2e6 - 0.8e6 + 2.4e6)
    high, low = weight > -1e4, weight < -3e4
    np.testing.assert_allclose(ratio[high], confined)
    assert np.all(ratio[low] > confined + 0.1)
    used = (1.0 - ratio[low]) * -weight[low] / np.sqrt(3.0)  # |s| / sqrt(2) of (1, K, K)
    share = used / (USED * clay.strength / np.sqrt(3.0))  # cohesion counts over the stress normal to the layer, not p
    assert share.min() >= 0.7 and share.max() <= 1.0


@pytest.mark.parametrize(("degrees", "direction"), [(18.0, 0.0), (18.0, 90.0), (20.0, 0.0)])
def test_a_layer_below_its_friction_angle_rests_from_the_start(degrees, direction):
    """mu1 = tan 20.8 degrees. A layer of 8 cells moved 0.06 of its thickness on 20 degrees when it started with the
    stress of level ground; measured now 0.0003 to 0.0011."""
    slope, heading = np.tan(np.radians(degrees)), np.radians(direction)
    length, width = (16.0, 1.0) if direction == 0.0 else (1.0, 16.0)
    along = np.cos(heading), np.sin(heading)
    terrain = terrain_of(lambda x, y: 20.0 - slope * (along[0] * x + along[1] * y), length, width, 0.125)
    columns = columns_of(1.06, 0, length, 0, width, 0.0625, density=1500.0)
    made = points_from(columns, terrain, point_options(0.125, 2)).frame
    material, contact = mu_i(835706.0, 385712.0, 0.38, 0.64, 0.279, 0.1, 2500.0, 0.0), friction_law("Coulomb", 1.0)
    weight = made.state.pop("vertical_stress")
    stress = stress_of_weight(made, terrain, weight, material, contact, 0.125, GRAVITY)
    made.state.clear()
    solver = points_on(terrain, made, 0.125, material, contact, stress=stress, edges="wall")
    solver.advance(0.3)
    order = np.argsort(solver.frame().particles.id)
    moved = np.linalg.norm(solver.frame().particles.position[order] - made.particles.position, axis=1)
    place = made.particles.position[:, 0 if direction == 0.0 else 1]
    middle = np.abs(place - np.median(place)) < 2.0
    assert moved[middle].mean() <= 0.003
