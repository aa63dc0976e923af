"""Shares of the nodes in the impulse of a face; stress at beds of any slope, direction and position in a cell."""

import numpy as np
import pytest
from column_scenes import spline, terrain_of
from exact_solutions import G
from face_scenes import DENSITY, SOIL, mean_stress
from hypothesis import given, settings
from hypothesis import strategies as st
from point_scenes import points_on
from scipy.integrate import quad

from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import fluid
from mpmgis.laws.material_choice import wave_speed
from mpmgis.solvers.points.contact_shares import (
    DEEP,
    FAR,
    FAR_WEIGHT,
    MIDDLE_WEIGHT,
    NEAR,
    NEAR_WEIGHT,
    across_part,
    balanced,
    contact_shares,
    mass_share,
    more_across,
    part_before,
    pressure_share,
    pushed_mass,
    row_shares,
    shares_on_slope,
    spline_at,
)

MUD = fluid(1000.0 * 100.0**2, 2000.0, 0.0)
LEVELS = np.arange(-2, 3)
PATCH = 2.5  # [cells]
MASS = st.just(0.0) | st.floats(1e-100, 1.0)  # of a node; squares of smaller masses underflow


def beyond(away, function):
    """Integral of `function` over r from `away` to the end of the spline."""
    low = max(away, -1.5)
    return sum(quad(function, max(low, a), b)[0] for a, b in ((-1.5, -0.5), (-0.5, 0.5), (0.5, 1.5)) if b > low)


@settings(max_examples=60, deadline=None)
@given(st.floats(-2.0, 2.0))
def test_shares_of_level_ground_are_the_integrals_of_the_spline(away):
    assert pressure_share(away) == pytest.approx(beyond(away, lambda r: 4.0 * r * spline(r)), abs=1e-9)
    assert mass_share(away) == pytest.approx(beyond(away, spline), abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.floats(-1.4, 1.4))
def test_part_before_a_wall_has_the_moments_of_the_spline(away):
    """`away` before the wall: what lies at r > -away of a spline that points away from the wall."""
    mass, first, second = (beyond(-away, lambda r, n=n: r**n * spline(r)) for n in range(3))
    centre, spread = part_before(away)
    assert centre == pytest.approx(first / mass, abs=1e-6)
    assert spread == pytest.approx(4.0 * (second / mass - (first / mass) ** 2), abs=1e-5)


def masses_of(foot, rise, thickness=np.inf):
    """Masses [1] of the nodes -2 to 2 of a sheet of `thickness` [cells], normal to its ground."""
    top = min(thickness * np.sqrt(1.0 + rise * rise), 1e3)
    return np.array([shares_on_slope(foot - k, rise)[1] - shares_on_slope(foot + top - k, rise)[1] for k in LEVELS])


@settings(max_examples=200, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(0.0, 8.0), st.tuples(*[MASS] * 5).filter(any))
def test_shares_are_positive_with_the_sum_one_and_none_beyond_its_mass(foot, rise, masses):
    """For any masses and slope: the impulse is neither lost nor multiplied, nor reversed at a node."""
    masses = np.array(masses) / max(masses)
    shares = np.array(contact_shares(foot, rise, *masses))
    near = masses * [0.5 - foot, 1.0, 1.0, 1.0, 0.5 + foot]
    centre = near @ (LEVELS - foot) / max(near.sum(), 1e-300)
    assert shares.min() >= 0.0
    rest = 1.0 - min(max(centre / DEEP, 0.0), 1.0)  # without any share of pressure
    assert shares.sum() == pytest.approx(1.0, abs=1e-12) or shares.sum() == pytest.approx(rest, abs=1e-12)
    if centre >= DEEP:
        assert not shares[masses == 0.0].any()
    if centre <= 0.0:
        np.testing.assert_allclose(shares, [0.0, *(spline_at(foot, k) for k in (-1, 0, 1)), 0.0], atol=1e-12)


@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 1.2), st.floats(0.2, 1.0) | st.floats(2.0, 8.0), st.tuples(*[st.floats(0.7, 1.4)] * 6))
def test_shares_do_not_jump_where_the_ground_passes_the_middle_between_two_nodes(rise, thickness, factors):
    """Sheets and deep flows with irregular points, up to 50 degrees: a jump would amplify rounding errors."""
    lower = contact_shares(0.5, rise, *(masses_of(0.5, rise, thickness) * factors[:5]))
    upper = contact_shares(-0.5, rise, *(masses_of(-0.5, rise, thickness) * factors[1:]))
    np.testing.assert_allclose([*lower, 0.0], [0.0, *upper], atol=1e-3)


@settings(max_examples=100, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(0.0, 1.0))
def test_shares_of_a_filled_space_have_the_moment_of_the_ground(foot, rise):
    """Up to 45 degrees: the impulse acts at the ground."""
    masses = masses_of(foot, rise)
    assert np.array(contact_shares(foot, rise, *masses)) @ LEVELS == pytest.approx(foot, abs=1e-9)


@settings(max_examples=100, deadline=None)
@given(st.floats(-0.5, 0.5))
def test_a_filled_space_on_level_ground_gets_its_exact_shares(foot):
    masses = [mass_share(foot - k) for k in LEVELS]
    np.testing.assert_allclose(
        contact_shares(foot, 0.0, *masses), [pressure_share(foot - k) for k in LEVELS], atol=1e-9
    )


def across(foot, rise, masses, part=None):
    """(shares of the nodes -2 to 2 in an impulse along their line, and in its component across the line)."""
    shares = np.array(contact_shares(foot, rise, *masses))
    part = max(1.0 - rise * rise, 0.0) if part is None else part
    more = np.array(
        [more_across(foot - k, rise, part, share, mass) for k, share, mass in zip(LEVELS, shares, masses, strict=True)]
    )
    total, moment = more.sum(), more @ LEVELS
    return shares, shares + [balanced(k, one, total, moment) for k, one in zip(LEVELS, more, strict=True)]


def test_the_mean_along_a_slope_is_exact_up_to_the_ninth_degree():
    points = (0.0, NEAR, -NEAR, FAR, -FAR)
    weights = (MIDDLE_WEIGHT, NEAR_WEIGHT, NEAR_WEIGHT, FAR_WEIGHT, FAR_WEIGHT)
    for degree in range(10):
        exact = beyond(-1.5, lambda r, degree=degree: r**degree * spline(r))
        assert np.dot(weights, np.power(points, degree)) == pytest.approx(exact, abs=1e-14)


AWAY = np.linspace(-2.0, 2.0, 16001)  # [cells] of tables of both shares, which are smooth: errors below 1e-8
PRESSED, FILLED = (np.vectorize(share)(AWAY) for share in (pressure_share, mass_share))
LINE = np.arange(-1.5 + 1.0 / 64.0, 1.5, 1.0 / 32.0)  # [cells], midpoints for integrals over a node's spline
WEIGHTS = spline(LINE) / spline(LINE).sum()


def exact_shares(foot, slope_x, slope_y):
    """[3, 5]: shares of the x, y and z components of the impulse of a filled space on ground with these slopes.

    That on an axis is the integral of 4 r w(r) along it with the splines along both others, over the space above the
    ground; in closed form along the line of nodes, by midpoints along the axes across it.
    """
    pressed = np.cumsum(LINE[::-1] * spline(LINE[::-1]))[::-1]
    pressed = pressed / pressed.sum()
    x, y = np.meshgrid(LINE, LINE, indexing="ij")
    weights = np.outer(pressed, WEIGHTS), np.outer(WEIGHTS, pressed), np.outer(WEIGHTS, WEIGHTS)
    shares = np.zeros((3, 5))
    for n, k in enumerate(LEVELS):
        away = foot - k + slope_x * x + slope_y * y
        for axis, values in enumerate((spline(away), spline(away), np.interp(away, AWAY, PRESSED))):
            shares[axis, n] = (weights[axis] * values).sum()
    return shares


def shares_and_exact_ones(foot, slope, azimuth):
    """(shares along the line, across it, `exact_shares`) of a filled space on ground that rises to `azimuth` [rad]."""
    slope_x, slope_y = slope * np.cos(azimuth), slope * np.sin(azimuth)
    nz, away = 1.0 / np.hypot(1.0, slope), slope_x * LINE[:, None] + slope_y * LINE + foot
    masses = [(np.outer(WEIGHTS, WEIGHTS) * np.interp(away - k, AWAY, FILLED)).sum() for k in LEVELS]
    both = across(foot, slope, masses, across_part(-slope_x * nz, -slope_y * nz, nz))
    return *both, exact_shares(foot, slope_x, slope_y)


@settings(max_examples=60, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(0.01, 1.0), st.floats(0.0, 2.0 * np.pi))
def test_a_filled_space_gets_its_exact_shares_on_slopes_to_any_side(foot, slope, azimuth):
    """Up to 45 degrees: both sets against integrals over the space. The limit of light nodes takes up to 0.0135 across
    the line; nodes more than 2 cells below the ground have no share, which changes the others above a slope of 0.8."""
    along, other, exact = shares_and_exact_ones(foot, slope, azimuth)
    np.testing.assert_allclose(along, exact[2], atol=0.006 if slope <= 0.8 else 0.018)
    exact_across = np.cos(azimuth) ** 2 * exact[0] + np.sin(azimuth) ** 2 * exact[1]
    np.testing.assert_allclose(other, exact_across, atol=0.015 if slope <= 0.8 else 0.018)  # 0.0178 on 45 degrees


@pytest.mark.xfail(reason="nodes more than 2 cells below the ground have no share: 0.017 off", strict=True)
def test_a_filled_space_gets_its_exact_shares_on_45_degrees():
    """The bound of gentler slopes."""
    along, _, exact = shares_and_exact_ones(0.0, 1.0, 0.0)
    np.testing.assert_allclose(along, exact[2], atol=0.006)


@settings(max_examples=200, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.4))
def test_the_part_of_a_push_across_is_the_mean_of_both_axes(east, north, slope):
    length = np.hypot(east, north)
    if length < 1e-3:
        east, north, length = 1.0, 0.0, 1.0
    nz = 1.0 / np.hypot(1.0, slope)
    nx, ny = slope * nz * east / length, slope * nz * north / length
    squares = np.array([east, north]) ** 2 / length**2
    expected = max(squares @ (1.0 - slope**2 * squares), 0.0) if slope > 1e-6 else 1.0
    assert across_part(nx, ny, nz) == pytest.approx(expected if nx * nx + ny * ny > 0.0 else 0.0, abs=1e-9)


@settings(max_examples=200, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(0.0, 1.0), st.tuples(*[MASS] * 5).filter(any))
def test_a_push_across_a_line_has_the_sum_and_the_moment_of_that_along_it(foot, rise, masses):
    """For any masses: together the impulses are normal to the ground, without torque."""
    along, other = across(foot, rise, np.array(masses) / max(masses))
    assert other.sum() == pytest.approx(along.sum(), abs=1e-12)
    assert other @ LEVELS == pytest.approx(along @ LEVELS, abs=1e-12)


@pytest.mark.parametrize("foot", [-0.4, -0.1, 0.2, 0.45])
@pytest.mark.parametrize(("rise", "most"), [(0.1, 0.02), (0.2, 0.04), (0.58, 0.09)])
def test_water_over_a_slope_leaves_the_nodes_at_rest_along_it(rise, most, foot):
    """Of nodes around a filled space under its hydrostatic pressure, four cells deep: acceleration along the slope over
    g. With the shares along the line for both components it was 0.05, 0.1 and 0.14."""
    step = 1.0 / 200.0
    line = np.arange(-1.5 + 0.5 * step, 1.5, step)
    x, z = np.meshgrid(line, np.arange(-4.0 + 0.5 * step, 4.0, step), indexing="ij")
    pressure = np.where(z > foot + rise * x, foot + 4.0 - z, 0.0)
    east = spline(x)
    nodes = []
    for level in LEVELS:
        weight = east * spline(z - level) * step * step
        mass = weight[pressure > 0.0].sum()
        nodes.append([mass, (4.0 * weight * pressure * -x).sum(), (4.0 * weight * pressure * (level - z)).sum() - mass])
    mass, along_x, along_z = np.array(nodes).T
    along, other = across(foot, rise, mass)
    force = np.array([along_x - other * rise * -along_z.sum(), along_z + along * -along_z.sum()])
    speed = np.array([1.0, rise]) @ force / np.sqrt(1.0 + rise * rise) / np.maximum(mass, 1e-9)
    assert np.abs(speed[mass > 0.15]).max() <= most


@settings(max_examples=200, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(0.0, 1.0), st.tuples(*[MASS] * 5).filter(any))
def test_shares_at_a_face_end_at_the_three_nodes_that_it_owns(foot, rise, masses):
    masses = np.array(masses) / max(masses)
    shares = np.array(row_shares(foot, rise, *masses))
    assert shares.min() >= 0.0 and shares[0] == shares[4] == 0.0
    assert shares.sum() <= 1.0 + 1e-12


@settings(max_examples=100, deadline=None)
@given(st.floats(-0.5, 0.5))
def test_a_filled_space_before_a_face_gets_its_exact_shares(foot):
    shares = row_shares(foot, 0.0, *(mass_share(foot - k) for k in LEVELS))
    np.testing.assert_allclose(shares, [pressure_share(foot - k) for k in LEVELS], atol=1e-9)


def test_a_light_node_is_not_pushed_beyond_its_share():
    assert pushed_mass(1e-9, 0.5, 1.0) == pytest.approx(0.05)
    assert pushed_mass(0.3, 0.5, 1.0) == 0.3


def resting_on(degrees, azimuth, above, material=SOIL, friction=0.0, length=14.0, deep=8.0, rim=3.0):
    """Errors of the vertical stress [1] of a body at rest in a basin with a plane bed, in patches of its lowest cells.

    Patches are PATCH cells wide and two cells high. The bed has a `friction`.
    The bed rises by `degrees` towards `azimuth` [degrees] from east and lies `above` [cells] a node in the middle.
    Walls stand around the basin, `rim` [cells] from the patches. A hydrostatic stress is the equilibrium.
    """
    rise, heading, spacing = np.tan(np.radians(degrees)), np.radians(azimuth), 0.5
    east, north = np.cos(heading), np.sin(heading)

    def bed(x, y):
        return 30.0 + above + rise * ((x - 0.5 * length) * east + (y - 0.5 * length) * north)

    surface = 30.0 + above + deep + 0.2 * length * rise * (abs(east) + abs(north))
    places, volumes = [], []
    axis = spacing * (np.arange(round(length / spacing)) + 0.5)
    for x, y in np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2):
        depth = surface - bed(x, y)
        count = round(depth / spacing)
        up = (np.arange(count) + 0.5) * depth / max(count, 1)
        places.append(np.column_stack([np.full(count, x), np.full(count, y), surface - depth + up]))
        volumes.append(np.full(count, spacing**2 * depth / max(count, 1)))
    position, volume = np.concatenate(places), np.concatenate(volumes)
    stress = np.zeros((len(volume), 6))
    stress[:, :3] = -DENSITY * G * (surface - position[:, 2:])
    ids = np.arange(len(volume), dtype=np.uint64)
    frame = Frame(Particles(position, np.zeros_like(position), DENSITY * volume, volume, id=ids), dimension=3)
    terrain = terrain_of(bed, length, length, 1.0)
    solver = points_on(terrain, frame, 1.0, material, friction_law("Coulomb", friction), stress=stress, edges="wall")
    swing = 4.0 * deep / wave_speed(material, DENSITY)
    found, place = mean_stress(solver, 6.0 * swing, 8.0 * swing)
    exact = -DENSITY * G * (surface - place[:, 2])
    lowest = (place[:, 2] - bed(place[:, 0], place[:, 1])) * np.cos(np.radians(degrees)) < 2.0
    errors = []
    firsts = np.arange(rim, length - rim - PATCH + 1e-9, 0.5 * PATCH)
    for x, y in np.stack(np.meshgrid(firsts, firsts), axis=-1).reshape(-1, 2):
        near = (abs(place[:, :2] - [x + 0.5 * PATCH, y + 0.5 * PATCH]) < 0.5 * PATCH).all(axis=1) & lowest
        errors.append(found[near, 2].sum() / exact[near].sum() - 1.0)
    return np.array(errors)


@pytest.mark.parametrize(
    ("degrees", "azimuth", "above"),
    [
        (2.0, 0.0, 0.125),
        (10.0, 45.0, 0.3),
        *(
            pytest.param(*case, marks=pytest.mark.thorough)
            for case in (
                (2.0, 0.0, 0.625),
                (5.0, 30.0, 0.3),
                (20.0, 30.0, 0.3),
                (30.0, 45.0, 0.3),
                (40.0, 20.0, 0.3),
                (45.0, 0.0, 0.1),
                (45.0, 0.0, 0.6),
            )
        ),
    ],
)
def test_stress_at_an_inclined_bed(degrees, azimuth, above):
    """Within 3 %. With the spline as share the errors were -74 to +42 % at 2 degrees, 20 % at 10 and 4 % at 30."""
    assert np.abs(resting_on(degrees, azimuth, above)).max() <= 0.03


@pytest.mark.thorough
@pytest.mark.parametrize(("degrees", "azimuth"), [(20.0, 60.0), (30.0, 225.0)])
def test_stress_at_an_inclined_bed_is_even(degrees, azimuth):
    """Root of the mean square of the errors, nine cells from the walls."""
    errors = resting_on(degrees, azimuth, 0.3, length=26.0, rim=9.0)
    assert np.sqrt((errors**2).mean()) <= 0.005


@pytest.mark.thorough
@pytest.mark.parametrize(("degrees", "azimuth"), [(20.0, 60.0), (30.0, 225.0)])
def test_stress_at_an_inclined_bed_near_walls_is_even(degrees, azimuth):
    """Root of the mean square of the errors, three cells from the walls."""
    assert np.sqrt((resting_on(degrees, azimuth, 0.3) ** 2).mean()) <= 0.008


@pytest.mark.thorough
@pytest.mark.parametrize(("degrees", "azimuth"), [(10.0, 45.0), (30.0, 30.0)])
def test_stress_of_a_fluid_at_an_inclined_bed(degrees, azimuth):
    """Within 6 %: sound goes on in the fluid for the whole time of the mean."""
    assert np.abs(resting_on(degrees, azimuth, 0.3, MUD)).max() <= 0.06


@pytest.mark.thorough
@pytest.mark.parametrize(("degrees", "azimuth", "off"), [(5.0, 30.0, 0.05), (30.0, 0.0, 0.065), (45.0, 0.0, 0.12)])
def test_stress_at_an_inclined_bed_with_friction(degrees, azimuth, off):
    """Friction 0.5: 1.2 to 3.0, 1.5 to 5.7 and -1.1 to 10.0 %; the body arches between its walls."""
    assert np.abs(resting_on(degrees, azimuth, 0.3, friction=0.5)).max() <= off


@pytest.mark.slow
@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.floats(0.0, 45.0), st.floats(0.0, 360.0), st.floats(0.0, 1.0))
def test_stress_at_any_bed(degrees, azimuth, above):
    assert np.abs(resting_on(degrees, azimuth, above)).max() <= 0.03
