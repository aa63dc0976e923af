"""A flow handed from one solver to the other: what is kept, what lies outside, off the terrain, or in the air."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from converting import DENSITY, ORIGIN, columns_on, over_bed, slope, terrain_of

from mpmgis.conversion.columns_to_points import columns_to_points
from mpmgis.conversion.conversion_options import PointOptions
from mpmgis.conversion.solver_switch import switch_to_columns, switch_to_points
from mpmgis.system.errors import InputError

TERRAIN = terrain_of(slope())
OPTIONS = PointOptions(spacing=0.5, cell=1.0, relevel=True)
SHEAR = np.array([[0.2, -0.1], [0.05, 0.1]])  # [s-1]


def everywhere(frame):
    return np.ones(len(frame.particles), bool)


def east_of(distance):
    """Holds what lies more than `distance` [m] east of ORIGIN."""
    return lambda frame: frame.map_xy()[0] - ORIGIN[0] > distance


def box(west, east, south=0.0, north=80.0):
    return shapely.box(ORIGIN[0] + west, ORIGIN[1] + south, ORIGIN[0] + east, ORIGIN[1] + north)


def moving(**more):
    """Columns whose velocity and its gradient are known."""

    def velocity(x, y):
        return 5.0 + SHEAR[0, 0] * x + SHEAR[0, 1] * y, 1.0 + SHEAR[1, 0] * x + SHEAR[1, 1] * y

    columns = columns_on(TERRAIN, velocity=velocity, solver="columns", **more)
    slopes = np.array([-0.5, 0.2])
    columns.particles.velocity[:, 2] = columns.particles.velocity[:, :2] @ slopes
    return replace(columns, state={"velocity_gradient": np.tile(SHEAR, (len(columns.particles), 1, 1))})


def require_kept(account, tolerance=1e-12):
    mass, momentum = account.errors()
    assert abs(mass) <= tolerance and momentum <= tolerance


def test_columns_become_points_with_all_that_they_had():
    columns = moving()
    made = switch_to_points(columns, TERRAIN, OPTIONS, everywhere)
    require_kept(made.account)
    assert made.rest is None and made.account.outside.count == made.account.off.count == 0
    assert made.frame.particles.mass.sum() == pytest.approx(columns.particles.mass.sum(), rel=1e-12)
    assert made.account.after.momentum[2] == pytest.approx(made.account.before.momentum[2], rel=1e-9)  # tangent
    n = len(made.frame.particles)
    assert made.vertical_stress.shape == (n,) and made.vertical_stress.max() < 0.0
    np.testing.assert_allclose(made.gradient[:, :2, :2], np.tile(SHEAR, (n, 1, 1)))
    assert not made.frame.state


def test_what_is_outside_a_window_is_left_as_columns_with_its_gradient():
    columns = moving()
    made = switch_to_points(columns, TERRAIN, OPTIONS, everywhere, box(37.3, 100.0))
    require_kept(made.account)
    outside, rest = made.account.outside, made.rest.particles
    assert outside.mass == pytest.approx(rest.mass.sum(), rel=1e-12) and outside.count == len(rest)
    assert 0.35 < outside.mass / columns.particles.mass.sum() < 0.5
    assert outside.momentum[0] == pytest.approx((rest.mass * rest.velocity[:, 0]).sum(), rel=1e-12)
    assert made.rest.state["velocity_gradient"].shape == (len(rest), 2, 2)
    assert made.frame.map_xy()[0].min() > ORIGIN[0] + 37.3
    with pytest.raises(InputError, match="none of the 768 columns is in the window"):
        switch_to_points(columns, TERRAIN, OPTIONS, everywhere, box(70.0, 100.0))


def test_particles_off_the_next_grid_have_left_the_terrain():
    columns = moving()
    points = switch_to_points(columns, TERRAIN, OPTIONS, east_of(30.0))
    require_kept(points.account)
    assert 0.2 < points.account.off.mass / points.account.before.mass < 0.3
    back = switch_to_columns(points.frame, TERRAIN, 1.0, east_of(40.0))
    require_kept(back.account)
    assert 0.3 < back.account.off.mass / back.account.before.mass < 0.4
    assert (back.frame.map_xy()[0] > ORIGIN[0] + 40.0).all()
    with pytest.raises(InputError, match="no flow is on the grid"):
        switch_to_columns(points.frame, TERRAIN, 1.0, east_of(90.0))


@pytest.mark.parametrize("cell", [0.625, 1.25, 2.5])
def test_there_and_back_keeps_mass_momentum_and_thickness(cell):
    """To 1e-12, and the thickness to 2 % where columns fill their cells."""
    columns = columns_on(TERRAIN, velocity=(5.0, 1.0), spacing=1.25)
    columns.particles.velocity[:, 2] = columns.particles.velocity[:, :2] @ np.array([-0.5, 0.2])
    points = switch_to_points(columns, TERRAIN, replace(OPTIONS, relevel=False), everywhere)
    back = switch_to_columns(points.frame, TERRAIN, cell, everywhere)
    require_kept(back.account)
    before, after = columns.particles, back.frame.particles
    assert after.mass.sum() == pytest.approx(before.mass.sum(), rel=1e-12)
    np.testing.assert_allclose(
        (after.mass[:, None] * after.velocity).sum(axis=0),
        (before.mass[:, None] * before.velocity).sum(axis=0),
        rtol=1e-11,
    )
    inner = np.logical_and.reduce(
        [abs(v - m) < 0.5 * w - 4.0 for v, m, w in zip(after.position.T[:2], (40.0, 35.0), (40.0, 30.0), strict=True)]
    )
    np.testing.assert_allclose(after.thickness[inner], 2.0, rtol=0.02)
    assert back.gradient.shape == (len(after), 2, 2) and not back.frame.state
    assert back.account.laid == 0.0


def test_points_in_the_air_are_laid_onto_the_bed_and_that_is_reported():
    points = switch_to_points(moving(), TERRAIN, OPTIONS, everywhere).frame
    high = points.map_xy()[0] < ORIGIN[0] + 24.0
    points.particles.position[high, 2] += 12.0
    back = switch_to_columns(points, TERRAIN, 1.0, everywhere)
    require_kept(back.account)
    assert back.account.laid == pytest.approx(points.particles.mass[high].sum(), rel=0.05)
    np.testing.assert_allclose(over_bed(back.frame, TERRAIN), 0.0, atol=1e-9)
    assert back.account.before.potential - back.account.after.potential > 0.9 * back.account.laid * 9.81 * 12.0
    words = " ".join(back.account.lines())
    assert "were moved onto it" in words and "kept to" in words and "kinetic energy" in words


def test_columns_next_to_the_points_continue_unchanged():
    columns = moving()
    points = switch_to_points(columns, TERRAIN, OPTIONS, everywhere, box(40.0, 100.0))
    back = switch_to_columns(points.frame, TERRAIN, 1.25, everywhere, beside=points.rest)
    require_kept(back.account)
    n, rest = len(points.rest.particles), points.rest.particles
    made = back.frame.particles
    assert made.mass.sum() == pytest.approx(columns.particles.mass.sum(), rel=1e-12)
    np.testing.assert_array_equal(made.mass[-n:], rest.mass)
    np.testing.assert_allclose(
        np.column_stack(back.frame.map_xy())[-n:], np.column_stack(points.rest.map_xy()), rtol=0, atol=1e-8
    )
    np.testing.assert_array_equal(back.gradient[-n:], points.rest.state["velocity_gradient"])
    assert len(np.unique(made.id)) == len(made)
    alone = switch_to_columns(
        replace(points.frame, particles=points.frame.particles.take(slice(0, 0))),
        TERRAIN,
        1.25,
        everywhere,
        beside=points.rest,
    )
    require_kept(alone.account)
    np.testing.assert_array_equal(alone.frame.particles.mass, rest.mass)


def test_the_numbers_of_an_account_are_plain():
    import json

    numbers = switch_to_points(moving(), TERRAIN, OPTIONS, everywhere, box(40.0, 100.0)).account.as_numbers()
    again = json.loads(json.dumps(numbers))
    assert again["outside"]["mass"] == numbers["outside"]["mass"] > 0.0
    assert again["before"]["mass"] == pytest.approx(768 * 1.25**2 * 2.0 * DENSITY, rel=1e-12)


def test_columns_alone_are_cut_as_squares_on_request():
    """Of a few columns that came into a window nobody knows the neighbours."""
    columns = moving(spacing=2.0)
    rows = np.arange(len(columns.particles)) // 20
    some = replace(columns, particles=columns.particles.take((rows == 0) | (rows == 2)), state={})  # 2 by 4 m apart
    options = replace(OPTIONS, stretched=False)
    made = columns_to_points(some, TERRAIN, options)
    side = made.report.widest
    assert side == pytest.approx(0.5, rel=1e-9)  # a square of 2 m in 4 x 4
    assert columns_to_points(some, TERRAIN, OPTIONS).report.widest < side
