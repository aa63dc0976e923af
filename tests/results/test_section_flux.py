"""Paths and masses that cross a line, and a known flux of a section."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.results.hydrograph_answer import HydrographFound
from mpmgis.results.section_flux import (
    Balance,
    SectionState,
    azimuth_to_the_right,
    continued,
    crossed_between,
    crossings,
    is_beyond,
    mass_beyond,
    section_pieces,
    trapezoids,
)

BENT = np.array([[0.0, -40.0], [0.0, 0.0], [20.0, 10.0], [20.0, 40.0]])  # northwards: its right is east
WHOLE = continued(BENT, 1000.0)
places = st.lists(st.tuples(st.integers(-60, 60), st.integers(-60, 60)), min_size=2, max_size=12)


def state(xy, mass=None, ids=None, time=0.0, dimension=2):
    xy = np.array(xy, float)
    mass = np.ones(len(xy)) if mass is None else np.array(mass, float)
    ids = np.arange(len(xy), dtype=np.uint64) if ids is None else np.array(ids, np.uint64)
    return SectionState(time, dimension, (0.0, 0.0), ids, xy, mass, mass / 1000)


@pytest.mark.parametrize(
    ("before", "after", "times"),
    [
        ((-10, -20), (10, -20), 1),
        ((10, -20), (-10, -20), -1),
        ((-10, -20), (-1, 30), 0),
        ((-10, 60), (40, 60), 0),  # beyond its end
        ((-10, 5), (30, 5), 1),  # across the slanting piece
        ((-10, 0), (30, 0), 1),  # through a vertex, once
        ((0, -20), (5, -20), 1),  # from the line itself, which belongs to its left
        ((-5, -20), (0, -20), 0),
    ],
)
def test_a_straight_path_crosses_a_line_once_or_not(before, after, times):
    assert crossings(BENT, np.array([before], float), np.array([after], float)).tolist() == [times]


@given(places)
@settings(max_examples=200, deadline=None)
def test_crossings_of_the_extended_line_equal_the_change_of_side(path):
    path = np.array(path, float) + np.array([0.37, 0.21])  # off the line: a place on it has no side
    count = crossings(WHOLE, path[:-1], path[1:]).sum()
    first, last = is_beyond(WHOLE, path[[0, -1]]).astype(int)
    assert count == last - first


@given(places, places)
@settings(max_examples=100, deadline=None)
def test_mass_beyond_is_the_sum_of_its_sources(before, after):
    ids = np.arange(len(before)), np.arange(len(after)) + len(before) // 2
    states = state(before, 1.0 + np.arange(len(before)), ids[0]), state(after, 2.0 + np.arange(len(after)), ids[1])
    found = crossed_between(BENT, WHOLE, *states)
    change = mass_beyond(WHOLE, states[1]) - mass_beyond(WHOLE, states[0])
    assert found.mass + found.round_mass + found.began_beyond == pytest.approx(change, abs=1e-9)


def test_the_balance_closes_with_new_lost_and_growing_particles():
    """5 kg (2 kg entrained before) cross, 3 begin and 7 end beyond; 11 grow to 13 beyond; 1 stays before."""
    before = state([(-10, 0), (50, 5), (50, 9), (-10, 9)], [5, 7, 11, 1], [0, 1, 2, 3])
    after = state([(40, 0), (50, 9), (-10, 9), (60, 0)], [7, 13, 1, 3], [0, 2, 3, 4], time=1.0)
    counted = crossed_between(BENT, WHOLE, before, after)
    beyond = mass_beyond(WHOLE, after) - mass_beyond(WHOLE, before)
    balance = Balance(beyond, counted.mass, counted.round_mass, counted.began_beyond)
    assert (balance.beyond, balance.crossed, balance.round_ends) == (5.0, 6.0, 0.0)
    assert balance.began == 3 - 7 + 2 + 1 and balance.error == 0.0 and balance.turned().error == 0.0
    assert Balance(5.0, 6.0, 0.5, -1.0).error == -0.5
    assert (counted.began, counted.ended) == (3.0, 7.0)


def test_mass_around_an_end_has_not_crossed():
    found = crossed_between(BENT, WHOLE, state([(-10, 60), (-10, -20)], [5, 7]), state([(40, 60), (10, -20)], [5, 7]))
    assert (found.mass, found.round_mass, found.began) == (7, 5, 0)
    assert found.volume == pytest.approx(0.007)


def test_particles_without_unique_ids_are_not_counted():
    assert crossed_between(BENT, WHOLE, state([(0, 0)]), state([(0, 0)], dimension=3)) is None
    nameless = SectionState(0.0, 2, (0.0, 0.0), None, np.zeros((1, 2)), np.ones(1), np.ones(1))
    assert crossed_between(BENT, WHOLE, nameless, state([(0, 0)])) is None


def test_a_section_has_normals_to_its_right_as_long_as_its_pieces():
    middles, normals = section_pieces(BENT, 3.0)
    assert len(middles) == len(normals) == 14 + 8 + 10
    assert normals.sum(axis=0) == pytest.approx([80, -20])
    assert np.hypot(*normals.T).sum() == pytest.approx(40 + np.hypot(20, 10) + 30)
    assert azimuth_to_the_right(np.array([[0.0, 0.0], [0.0, 5.0]])) == pytest.approx(90)
    assert azimuth_to_the_right(np.array([[0.0, 0.0], [-5.0, 0.0]])) == pytest.approx(0)


def test_rows_have_means_sums_and_the_flux_of_the_cells():
    times = np.array([0.0, 2.0, 3.0])
    cells = np.array([[0.0, 0.0], [4.0, 4000.0], [2.0, 2000.0]])
    found = HydrographFound(
        "a", times, np.array([6.0, 1.0]), np.array([6000.0, 1000.0]), np.ones(2, bool), cells, 90.0, None
    )
    assert trapezoids(times, cells)[:, 0].tolist() == [4, 3]
    assert [row[1:5] for row in found.rows()[1:]] == [(3, 3000, 6, 6000), (1, 1000, 7, 7000)]
    assert found.rows()[2][7:] == (7, 7000)
    assert found.peak() == (3, 2)
