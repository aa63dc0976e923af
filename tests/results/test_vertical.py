"""Vertical profiles of columns of points with known density and speed over height."""

import math

import numpy as np
import pytest
from affine import Affine

from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import GRAVITY
from mpmgis.maps.averaging.placement import Bed
from mpmgis.results.vertical_answer import VerticalFound, vertical_profiles
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

SLOPE, DENSITY, WIDTH = 0.5, 1500.0, 8.0
UP = 1 / math.hypot(1, SLOPE)
POINT = np.array([[50.0, 50.0]])


def bed():
    """A slope that falls to the east, 100 m by 100 m."""
    grid = Grid(None, Affine(2, 0, 0, 0, -2, 100), (50, 50))
    x, _ = grid.xy(*np.indices(grid.shape))
    return Bed.of(Terrain(grid, 200 - SLOPE * x))


def column(height, spacing, speed_of=lambda d: 0.0 * d, loosened=1.0, time=0.0):
    """Points on a lattice, `height` [m] high over the bed's normal; `speed_of` that distance, along the slope."""
    steps = np.arange(44 + spacing / 2, 56, spacing)
    up = np.arange(spacing / 2, height / UP, spacing)
    x, y, z = (values.ravel() for values in np.meshgrid(steps, steps, up, indexing="ij"))
    speed = speed_of(z * UP)
    velocity = np.stack([speed * UP, 0 * x, -speed * UP * SLOPE], axis=1)
    volume = np.full(len(x), spacing**3)
    position = np.stack([x, y, 200 - SLOPE * x + z], axis=1)
    return Frame(Particles(position, velocity, DENSITY * volume / loosened, volume), time=time, dimension=3)


@pytest.mark.parametrize("layer", [0.2, 0.5, 0.7])
def test_a_uniform_column_has_its_density_and_speed_in_every_layer_of_any_height(layer):
    frame = column(4.0 * UP, 0.5, lambda d: 6.0 + 0 * d)
    (found,) = vertical_profiles(frame, bed(), DENSITY, POINT, WIDTH, layer)
    full = found.edges[1:] <= 4.0 * UP + 1e-9
    assert full.sum() >= 4
    assert found.density[full] == pytest.approx(DENSITY, rel=1e-9)
    assert found.parallel[full] == pytest.approx(6.0) and found.normal[full] == pytest.approx(0, abs=1e-9)
    assert found.pressure[full] == pytest.approx(DENSITY * 36)
    assert found.momentum_flux[0] == pytest.approx(DENSITY * 36 * 4.0 * UP, rel=1e-9)
    assert found.momentum_flux[1] == pytest.approx(2.0 * UP, abs=layer / 2)
    gravity = GRAVITY * UP  # across the slope
    assert found.overburden_force[0] == pytest.approx(0.5 * DENSITY * gravity * (4.0 * UP) ** 2, rel=2 * layer**2 / 16)
    assert found.overburden_force[1] == pytest.approx(4.0 * UP / 3, abs=layer / 2)
    assert found.overburden[0] == pytest.approx(DENSITY * gravity * (4.0 * UP - 0.5 * layer), rel=1e-9)
    assert found.depth == pytest.approx(3.75 * UP)
    assert (found.density * np.diff(found.edges)).sum() == pytest.approx(DENSITY * 4.0 * UP)


@pytest.mark.parametrize(("percentile", "below"), [(100.0, 8), (99.0, 8), (75.0, 6), (50.1, 5), (50.0, 4), (1.0, 1)])
def test_the_depth_is_a_percentile_of_the_distances_by_mass(percentile, below):
    """For eight layers of equal mass: the middle of the layer at `percentile` % of the mass."""
    frame = column(4.0 * UP, 0.5)
    (found,) = vertical_profiles(frame, bed(), DENSITY, POINT, WIDTH, 0.5, percentile)
    (whole,) = vertical_profiles(frame, bed(), DENSITY, POINT, WIDTH, 0.5)
    assert found.depth == pytest.approx((below - 0.5) * 0.5 * UP)
    np.testing.assert_array_equal(found.density, whole.density)


def test_a_sheared_column_has_its_force_to_the_second_order_of_the_spacing():
    errors = []
    for spacing in (0.5, 0.25):
        frame = column(4.0 * UP, spacing, lambda d: 2.0 * d)
        (found,) = vertical_profiles(frame, bed(), DENSITY, POINT, WIDTH, spacing * UP)
        exact = DENSITY * 4.0 * (4.0 * UP) ** 3 / 3  # integral of density (2 d)^2
        errors.append(abs(found.momentum_flux[0] / exact - 1))
        middles = 0.5 * (found.edges[1:] + found.edges[:-1])
        held = found.count > 0
        assert found.parallel[held] == pytest.approx(2.0 * middles[held])
    assert errors[0] < 0.01 and errors[1] == pytest.approx(errors[0] / 4, rel=0.02)


def test_looser_material_has_lower_density_and_pressure():
    dense, loose = (column(3.0, 0.5, lambda d: 5.0 + 0 * d, factor) for factor in (1.0, 2.0))
    (first,), (second,) = (vertical_profiles(frame, bed(), DENSITY, POINT, WIDTH, 0.5) for frame in (dense, loose))
    assert second.density == pytest.approx(0.5 * first.density)
    assert second.momentum_flux[0] == pytest.approx(0.5 * first.momentum_flux[0])


def test_profile_without_particles():
    (found,) = vertical_profiles(column(3.0, 0.5), bed(), DENSITY, np.array([[10.0, 10.0]]), WIDTH, 0.5)
    assert (found.count.sum(), found.depth, found.momentum_flux[0]) == (0, 0.0, 0.0)
    assert math.isnan(found.momentum_flux[1]) and np.isnan(found.parallel).all()


def test_points_below_the_bed_are_counted_below_it():
    frame = column(2.0, 0.5)
    frame.particles.position[:, 2] -= 1.0
    (found,) = vertical_profiles(frame, bed(), DENSITY, POINT, WIDTH, 0.25)
    assert found.edges[0] == pytest.approx(-1.0, abs=0.25) and found.count[found.edges[1:] <= 0].sum() > 0
    assert (found.density * np.diff(found.edges)).sum() == pytest.approx(DENSITY * 2.0 * UP, rel=1e-6)


def test_too_many_layers_are_rejected():
    with pytest.raises(ValueError, match="layers of 0"):
        vertical_profiles(column(3.0, 0.5), bed(), DENSITY, POINT, WIDTH, 1e-4)


def test_no_load_without_flow():
    (found,) = vertical_profiles(column(4.0 * UP, 0.5), bed(), DENSITY, np.array([[20.0, 20.0]]), WIDTH, 0.5)
    of_all = VerticalFound("still", ("here",), np.array([20.0]), np.array([20.0]), WIDTH, ([found],))
    ((*_, depth, force, height, largest, weight, height_of_weight),) = of_all.load_rows()
    assert (depth, force, largest, weight) == (0.0, 0.0, 0.0, 0.0)
    assert math.isnan(height) and math.isnan(height_of_weight)
