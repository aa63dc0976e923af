"""Prediction of the time of a run from two seconds of its steps."""

import itertools

import numpy as np
import pytest
from column_scenes import seeded, solver_on, terrain_of

from mpmgis.simulation.measured_cost import predicted_in_2d, slower_than_nominal
from mpmgis.simulation.stepping import measured_pace


def pool():
    terrain = terrain_of(lambda x, y: 0 * x, 20.0, 20.0, 1.0)
    return solver_on(terrain, seeded(1.0, 5, 15, 5, 15, 1.0, staggered=False), 1.0, edges="wall")


def test_the_pace_is_wall_time_over_steps_and_particles():
    """A clock that advances by 1 s at each reading: the trial ends at the third, after 4 + 8 steps of 1600 columns."""
    solver, ticks = pool(), itertools.count()
    pace = measured_pace(solver, seconds=3.0, clock=lambda: float(next(ticks)))
    assert solver.step == 2 + 4 + 8
    assert pace == pytest.approx(4.0 / ((4 + 8) * 1600))


def test_where_nothing_moves_there_is_no_pace():
    solver = pool()
    solver.advance(np.inf, max_steps=1)
    solver.advance = lambda until, max_steps: None
    assert measured_pace(solver, seconds=0.01) is None


def test_a_slower_machine_is_predicted_to_take_longer_in_proportion():
    seconds, _ = predicted_in_2d(1_000_000, 1.0, 1e6, 0, 5.0, 0.3, 100.0, 40.0, 2)
    pace = 2 * seconds / (100.0 * (20.0 + np.sqrt(9.81)) / (0.3 * 5.0) * 1_000_000)
    assert slower_than_nominal("columns", pace, 1_000_000, 2) == pytest.approx(2.0, rel=1e-2)
