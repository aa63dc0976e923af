"""Ends of stages: free flight at cliffs, flow near a place, calm flow, and checks at fixed times."""

import math

import numpy as np
import pytest
import shapely

from mpmgis.frames.particle_store import Flow
from mpmgis.simulation.stage_end import CHECK_SECONDS, Cliff, Near, StageEnd
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.flow_reach import takes_off
from mpmgis.terrain.grid import Grid

PIXEL, ROWS, COLUMNS = 2.0, 30, 200


def terrain(height):
    """Terrain of height(x) [m], with x to the east from 0 at the western edge."""
    x = (np.arange(COLUMNS) + 0.5) * PIXEL
    grid = Grid.north_up(None, 0.0, ROWS * PIXEL, PIXEL, (ROWS, COLUMNS))
    return Terrain(grid, np.tile(height(x), (ROWS, 1)).astype(float))


def flow(x, speed, depth=1.0, y=30.0):
    """A Flow of one column at each of `x`, to the east."""
    x = np.atleast_1d(np.asarray(x, float))
    full = np.full(len(x), 1.0)
    return Flow(x, y * full, speed * full, 0.0 * full, speed * full, depth * full, full)


def cliff(x):
    """Level, then 20 m lower from x = 200 on."""
    return np.where(x < 200.0, 100.0, 80.0)


def off(height, x, speed, depth=1.0):
    f = flow(x, speed, depth)
    return takes_off(terrain(height), f.x, f.y, f.u, f.v, f.depth)


def test_a_flow_takes_off_where_it_gets_to_a_cliff_within_two_seconds():
    assert off(cliff, [140.0, 158.0, 162.0, 190.0], 20.0).tolist() == [False, False, True, True]
    assert not off(cliff, [190.0], 0.0).any() and not off(cliff, [220.0], 20.0).any()


def test_a_flow_deeper_than_the_drop_stays_on():
    low = lambda x: np.where(x < 200.0, 100.0, 97.0)  # noqa: E731
    assert off(low, [190.0], 20.0, 1.0).all() and not off(low, [190.0], 20.0, 3.5).any()


def test_slopes_alone_are_no_cliff_however_steep():
    for tangent in (0.5, 1.0, 3.0):
        assert not off(lambda x, t=tangent: 1000.0 - t * x, [20.0, 100.0, 300.0], 30.0, 0.5).any()


def test_rough_ground_is_no_cliff():
    rng = np.random.default_rng(1)
    bumps = rng.uniform(-0.2, 0.2, COLUMNS)
    assert not off(lambda x: 300.0 - 0.5 * x + bumps, np.arange(10.0, 300.0, 7.0), 20.0, 1.0).any()


@pytest.mark.parametrize(("radius", "flies"), [(25.0, True), (90.0, False)])
def test_over_round_ground_it_is_the_detachment_indicator(radius, flies):
    """U^2 k / (g c) is 1.6 at the top of one, 0.9 at the steepest place of the other, before it becomes straight."""

    def crest(x):
        past = np.clip(x - 200.0, 0.0, 0.6 * radius)
        return 100.0 + np.sqrt(radius**2 - past**2) - radius - np.maximum(x - 200.0 - 0.6 * radius, 0.0) * 0.75

    assert off(crest, [195.0], 20.0, 0.1).all() == flies


def test_off_the_terrain_nothing_flies():
    assert not off(cliff, [-50.0, 395.0], 30.0).any()


def test_near_is_within_three_depths_or_two_seconds():
    wall = Near("a wall", shapely.box(100.0, 0.0, 104.0, 60.0))
    assert wall.share(flow([59.0], 20.0)) == 0.0 and wall.share(flow([61.0], 20.0)) == 1.0
    assert wall.share(flow([90.0], 0.0, 3.0)) == 0.0 and wall.share(flow([90.0], 0.0, 3.5)) == 1.0
    assert wall.share(flow([50.0, 70.0, 102.0, 300.0], 20.0)) == 0.5
    assert Near("", wall.shape, 1.5).share(flow([102.0], 20.0, 1.0)) == 0.0
    corner = flow([97.0], 0.0, 1.2, y=63.0)  # near in a square, but 4.2 m away
    assert wall.share(corner) == 0.0


class Marching:
    """The part of a solver that a StageEnd uses."""

    def __init__(self, state, unsettled=0.0):
        self.time, self.state, self.unsettled = 0.0, state, unsettled

    def flow(self):
        return self.state

    def frame(self):
        return self


def looked_at(end, solver, until):
    """(time, reason) at which `end` ends the stage, with checks at the times that it requests."""
    while solver.time < until:
        solver.time = min(end.next_time(solver.time), until)
        reason = end.over(solver)
        if reason:
            return solver.time, reason
    return None


def test_a_time_is_met_exactly_and_nothing_else_is_looked_for():
    end = StageEnd(time=3.3)
    assert end.next_time(0.0) == 3.3 and end.next_time(3.3) == math.inf
    assert looked_at(end, Marching(flow([0.0], 1.0)), 10.0) == (3.3, "t = 3.3 s")
    assert StageEnd().next_time(0.0) == math.inf and not StageEnd().over(Marching(flow([0.0], 1.0)))


def test_checks_are_at_multiples_of_their_interval():
    end = StageEnd(time=9.0, reached=Cliff(terrain(cliff)))
    assert end.next_time(0.0) == CHECK_SECONDS and end.next_time(0.1) == CHECK_SECONDS
    assert end.next_time(CHECK_SECONDS) == 2 * CHECK_SECONDS
    solver = Marching(flow([190.0], 20.0))
    solver.time = 0.1
    assert end.over(solver) == ""
    solver.time = CHECK_SECONDS
    assert end.over(solver) == "the flow is within reach of a cliff"


def test_a_hundredth_of_the_flow_makes_a_cliff_and_any_of_it_is_near_a_wall():
    few = np.concatenate([[190.0], np.full(199, 10.0)])
    assert StageEnd(reached=Cliff(terrain(cliff))).over(at(flow(few, 20.0))) == ""
    assert StageEnd(reached=Cliff(terrain(cliff))).over(at(flow(np.repeat(few, 2)[:200], 20.0))) == ""
    assert StageEnd(reached=Cliff(terrain(cliff))).over(at(flow(few[:90], 20.0)))
    assert StageEnd(reached=Near("w", shapely.box(200, 0, 210, 60))).over(at(flow(few, 20.0)))


def at(state):
    solver = Marching(state)
    solver.time = CHECK_SECONDS
    return solver


def test_calm_is_for_a_time_without_a_break():
    wall = Near("w", shapely.box(200, 0, 210, 60))
    end = StageEnd(calm=1.0, disturbing=[wall], unsettled=lambda frame: frame.unsettled)
    solver = Marching(flow([10.0], 1.0))
    assert looked_at(end, solver, 10.0) == (1.25, "the flow was calm for 1 s")
    for broken in ({"state": flow([199.0], 1.0)}, {"unsettled": 0.02}):
        end = StageEnd(calm=1.0, disturbing=[wall], unsettled=lambda frame: frame.unsettled)
        solver = Marching(flow([10.0], 1.0))
        assert looked_at(end, solver, 1.0) is None and end.calm_since == 0.25
        vars(solver).update(broken)
        assert looked_at(end, solver, 2.0) is None and end.calm_since == -1.0
        solver.state, solver.unsettled = flow([10.0], 1.0), 0.005
        assert looked_at(end, solver, 10.0)[0] == 3.25
