"""Coordinates along and across a path: exact on a straight line, true to area in a bend."""

import numpy as np
import pytest
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.results.flow_line import vertex_distances
from mpmgis.results.path_coordinates import PathBins, path_coordinates
from mpmgis.terrain.grid import Grid

PLACES = st.floats(-1000.0, 1000.0)
ANGLES = st.floats(0.0, 2.0 * np.pi)


def arc(radius, turn, start=0.0, count=400):
    """A path that turns left (right for a negative `turn`) on a circle about the origin."""
    angle = start + np.linspace(0.0, turn, count)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


@settings(max_examples=100, deadline=None)
@given(places=st.lists(st.tuples(PLACES, PLACES), min_size=1, max_size=30), vertices=st.integers(2, 9))
def test_a_straight_path_gives_x_and_y(places, vertices):
    x, y = np.array(places).T
    line = np.column_stack([np.linspace(0.0, 700.0, vertices), np.zeros(vertices)])
    along, across = path_coordinates(line, x, y)
    np.testing.assert_allclose(along, x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(across, y, rtol=0, atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(angle=ANGLES, x=PLACES, y=PLACES, east=PLACES, north=PLACES)
def test_a_turned_and_shifted_path_gives_the_same(angle, x, y, east, north):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    shift = np.array([6e5 + east, 5e6 + north])
    line = np.array([[0.0, 0.0], [250.0, 0.0], [900.0, 0.0]]) @ turn.T + shift
    place = turn @ (x, y) + shift
    along, across = path_coordinates(line, place[:1], place[1:])
    assert along[0] == pytest.approx(x, abs=1e-7) and across[0] == pytest.approx(y, abs=1e-7)


@settings(max_examples=60, deadline=None)
@given(
    radius=st.floats(50.0, 500.0), turn=st.floats(0.5, 5.0), share=st.floats(0.05, 0.95), across=st.floats(-0.8, 0.8)
)
def test_on_a_bend_s_is_the_arc_and_l_the_distance_from_it(radius, turn, share, across):
    own = (1.0 - across) * radius  # to the left is towards the middle
    angle = share * turn
    found = path_coordinates(arc(radius, turn), np.array([own * np.cos(angle)]), np.array([own * np.sin(angle)]))
    step = radius * turn / 399.0
    assert found[0][0] == pytest.approx(radius * angle, abs=2.0 * step)
    assert found[1][0] == pytest.approx(across * radius, abs=step**2 / radius + 1e-6)


@settings(max_examples=8, deadline=None)
@given(
    start=ANGLES, cell=st.floats(1.5, 3.0), radius=st.floats(150.0, 300.0), left=st.booleans(), turn=st.floats(1.0, 2.5)
)
def test_area_is_kept_in_a_bend(start, cell, radius, left, turn):
    """The area within w of an arc of length L is 2 w L (Pappus), of its inner half w L (1 - w / 2 R)."""
    width = 60.0
    line = arc(radius, turn if left else -turn, start)
    length = vertex_distances(line)[-1]
    count = int(2.0 * (radius + width + 5.0) / cell)
    grid = Grid(None, Affine(cell, 0.0, -count * cell / 2, 0.0, -cell, count * cell / 2), (count, count))
    x, y = (values.ravel() for values in grid.xy(*np.meshgrid(np.arange(count), np.arange(count), indexing="ij")))
    along, across = path_coordinates(line, x, y)
    ring = (np.hypot(x, y) > radius - width) & (np.hypot(x, y) < radius + width)
    there = ring & (along > 0.0) & (along < length) & (np.abs(across) < width + cell)
    bins = PathBins.over(along[there].min(), along[there].max(), 20.0)
    areas = bins.areas(bins.of(along[there]), grid.cell_area)
    assert areas.sum() == pytest.approx(np.count_nonzero(there) * grid.cell_area)
    assert areas.sum() == pytest.approx(2.0 * width * length, rel=0.01)
    inner = there & (across > 0.0 if left else across < 0.0)
    expected = width * length * (1.0 - 0.5 * width / radius)
    assert np.count_nonzero(inner) * grid.cell_area == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_both_sides_of_a_corner(turn):
    """Outside a corner the nearest point is its vertex; points there are on its outer side."""
    line = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0 * turn]])
    x = np.array([103.0, 110.0, 110.0, 90.0])
    y = np.array([-4.0, -0.001, -10.0, 10.0]) * turn
    along, across = path_coordinates(line, x, y)
    np.testing.assert_allclose(along, [100.0, 100.0, 100.0, 90.0 if along[3] < 100.0 else 110.0])
    np.testing.assert_allclose(across, np.array([-5.0, -np.hypot(10.0, 0.001), -np.hypot(10.0, 10.0), 10.0]) * turn)


def test_parts_of_a_path_contain_its_ends():
    bins = PathBins.over(-12.0, 31.0, 10.0)
    np.testing.assert_allclose(bins.edges, [-20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0])
    part = bins.of(np.array([-12.0, 0.0, 9.9, 31.0]))
    assert part.tolist() == [0, 2, 2, 5]
    found = bins.largest(part, np.array([1.0, 2.0, 3.0, np.nan]))
    np.testing.assert_allclose(found, [1.0, np.nan, 3.0, np.nan, np.nan, np.nan])
