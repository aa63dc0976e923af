"""Runout, drop and angles against known geometry; positions along a line and their inverse."""

import math

import numpy as np
import pytest
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.results.flow_line import (
    farthest_place,
    ground_lengths,
    highest_place,
    line_profile,
    places_along,
    positions_along,
    vertex_distances,
)
from mpmgis.results.runout_answer import energy_line, quantiles, slope_angle
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

SLOPE = 0.4
LINE = np.array([[5.0, 50.0], [195.0, 50.0]])


def plane(cell=2.0, slope=SLOPE):
    """A slope that falls to the east, 200 m by 100 m."""
    grid = Grid(None, Affine(cell, 0, 0, 0, -cell, 100), (round(100 / cell), round(200 / cell)))
    x, _ = grid.xy(*np.indices(grid.shape))
    return Terrain(grid, 300 - slope * x)


@given(st.lists(st.floats(-500, 500), min_size=1, max_size=20))
@settings(max_examples=50, deadline=None)
def test_positions_along_a_bent_line_are_inverted(along):
    line = np.array([[0.0, 0.0], [100.0, 0.0], [160.0, 80.0], [400.0, 80.0]])
    along = np.array(along)
    assert positions_along(line, *places_along(line, along)) == pytest.approx(along, abs=1e-9)


def test_vertex_distances():
    assert vertex_distances([[0, 0], [3, 4], [3, 10]]).tolist() == [0, 5, 11]


@pytest.mark.parametrize("cell", [5.0, 2.0, 1.0])
def test_a_footprint_on_a_plane_has_the_planes_angle_and_the_length_of_its_hypotenuse(cell):
    terrain = plane(cell)
    x, y = terrain.grid.xy(*np.indices(terrain.grid.shape))
    mask = (x > 20) & (x < 180) & (abs(y - 50) < 20)
    places = [find(mask, terrain.elevation, terrain.grid, LINE) for find in (highest_place, farthest_place)]
    found = energy_line(*places, LINE, terrain, cell)
    assert found.length == pytest.approx(160 - cell, abs=1e-9 + 2 * cell * (160 % cell > 0))
    assert found.drop == pytest.approx(SLOPE * found.length)
    assert found.angle == pytest.approx(math.degrees(math.atan(SLOPE)))
    assert found.ground == pytest.approx(found.length * math.hypot(1, SLOPE))
    assert found.straight >= found.length - 1e-9


def test_only_points_beyond_the_top_have_a_runout():
    terrain = plane()
    mask = np.zeros(terrain.grid.shape, bool)
    mask[10, 20] = True
    place = highest_place(mask, terrain.elevation, terrain.grid, LINE)
    assert energy_line(place, place, LINE, terrain, 1.0) is None
    assert highest_place(mask & False, terrain.elevation, terrain.grid, LINE) is None


def test_lengths_over_nodata_are_interpolated():
    along = np.arange(5.0)
    assert ground_lengths(along, np.array([4.0, 3.0, np.nan, 1.0, 0.0]))[-1] == pytest.approx(4 * math.sqrt(2))
    assert ground_lengths(along, np.full(5, np.nan))[-1] == 4


def test_a_profile_has_the_lines_corners():
    terrain = plane()
    bent = np.array([[5.0, 50.0], [100.0, 50.0], [100.0, 20.0]])
    along, x, y, elevation, ground = line_profile(bent, terrain, 10.0, 115.0, 7.0)
    assert 95.0 in along and (np.diff(along) > 0).all()
    assert elevation == pytest.approx(300 - SLOPE * x)
    assert (x[-1], y[-1]) == pytest.approx((100, 30))
    assert ground[-1] == pytest.approx(85 * math.hypot(1, SLOPE) + 20)


def test_quantiles_are_positions_of_mass():
    along = np.array([30.0, 10.0, 20.0, 40.0])
    assert quantiles(along, np.ones(4), (0.25, 0.26, 0.5, 1.0)).tolist() == [10, 20, 20, 40]
    assert quantiles(along, np.array([0.0, 99.0, 1.0, 0.0]), (0.99, 0.995)).tolist() == [10, 20]


def test_zero_length_has_no_angle():
    assert math.isnan(slope_angle(3.0, 0.0))
    assert slope_angle(1.0, 1.0) == pytest.approx(45)


def test_ground_length_starts_at_zero_and_is_interpolated_over_nodata():
    """Two hypotenuses (3, 4, 5), a gap with a straight line, and level ground beyond the last height."""
    along, heights = np.array([0.0, 3.0, 6.0, 9.0, 14.0]), np.array([8.0, 4.0, np.nan, -4.0, np.nan])
    assert ground_lengths(along, heights) == pytest.approx([0.0, 5.0, 10.0, 15.0, 20.0])
    assert ground_lengths(along, np.full(5, np.nan)) == pytest.approx(along)
