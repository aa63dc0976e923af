"""Predicted time of a run without its steps: proportional to the number of particles and cells, above a minimum."""

import pytest

from mpmgis.simulation.measured_cost import seconds_of_checks, seconds_of_frames, seconds_to_columns, seconds_to_points


def test_frames_cost_a_floor_and_more_for_each_particle():
    few, many = (seconds_of_frames("points", particles, 10) for particles in (0, 1_000_000))
    assert 0.1 < few < 0.5 and many - few == pytest.approx(10 * 0.6)
    assert seconds_of_frames("points", 0, 10, written=False) == 0.0


def test_switches_cost_a_floor_and_more_for_each_point_and_node():
    for cost in (seconds_to_points, seconds_to_columns):
        floor = cost(0, 0)
        assert 0.0 < floor < 0.1
        assert cost(2000, 0) - floor == pytest.approx(2 * (cost(1000, 0) - floor))
        assert cost(1000, 1000) > cost(1000, 0)


def test_checks_cost_by_their_conditions():
    assert seconds_of_checks(1000, 4, ("time",)) == 0.0
    assert seconds_of_checks(1000, 4, {"calm": 1.0}) > seconds_of_checks(1000, 4, {"reach": "cliff"}) > 0.0
