"""Place and time of the largest thickness and speed: the same as from checks of every step."""

import numpy as np
import pytest
from column_scenes import seeded, solver_on, terrain_of
from point_scenes import block_of, points_on, sorted_points

from mpmgis.laws.friction import friction_law
from mpmgis.laws.ground_metric import SLOPE
from mpmgis.laws.material import elastic

BOWL = 150.0  # [m] radius of curvature of a hollow that the flow runs into


def hollow(cell):
    """A slope of 45 degrees to the east that a hollow catches."""
    return terrain_of(lambda x, y: np.where(x < 60, 100 - x, 40 + (x - 60) * 0.8) + (y - 30) ** 2 / BOWL, 120, 60, cell)


def test_the_fastest_column_and_the_deepest_node_of_all_steps():
    frame = seeded(lambda x, y: 2.0 + 0.02 * (x - 10) + 0.01 * y, 10, 40, 15, 40, 5.0)
    solver = solver_on(hollow(5.0), frame, 5.0, friction=friction_law("Coulomb", 0.2), metric=SLOPE)
    at_start = solver.balances()
    assert at_start["speed_max"] == 0.0 and at_start["thickness_max_time"] == 0.0
    k = int(np.argmax(frame.particles.thickness))
    assert at_start["thickness_max_at"] == pytest.approx(frame.particles.position[k, :2].tolist())
    fastest, deepest = (0.0,), (at_start["thickness_max"], 0.0)
    for _ in range(400):
        before = solver.balances()["thickness_max"]
        solver.advance(8.0, max_steps=1)
        flow, now = solver.frame().particles, solver.balances()
        speed = np.sqrt((flow.velocity**2).sum(axis=1))
        k = int(np.argmax(speed))
        if speed[k] > fastest[0] * (1 + 1e-12):
            fastest = speed[k], *flow.position[k, :2], solver.time
        if now["thickness_max"] > before:
            deepest = now["thickness_max"], solver.time
            assert now["thickness_max"] == now["thickness_max_now"]
            away = np.hypot(*(flow.position[:, :2] - now["thickness_max_at"]).T)
            assert away.min() < 5.0  # at a node of the flow
        if solver.time >= 8.0:
            break
    told = solver.balances()
    assert told["speed_max"] == pytest.approx(fastest[0], rel=1e-12) and fastest[0] > 8.0
    assert told["speed_max_at"] == pytest.approx(list(fastest[1:3]), abs=1e-9)
    assert told["speed_max_time"] == fastest[3]
    assert (told["thickness_max"], told["thickness_max_time"]) == deepest and deepest[1] > 0.0
    again = solver_on(hollow(5.0), frame, 5.0, friction=friction_law("Coulomb", 0.2), metric=SLOPE)
    again.restore(solver.frame())
    assert all(again.balances()[name] == told[name] for name in told if "_max" in name)


@pytest.mark.thorough
def test_the_fastest_point_of_all_steps_and_the_thickest_flow_of_all_looks():
    frame = block_of((10.0, 6.0, 4.0), 1.0, corner=(20.0, 20.0, 60.0), velocity=(3.0, 0.0, 0.0))
    ground = terrain_of(lambda x, y: np.where(x < 40, 50 - 0.5 * x, 30 + 0.0 * x), 100, 60, 2.0)
    solver = points_on(ground, frame, 2.0, elastic(1e6, 5e5))
    start = solver.balances()
    assert start["speed_max"] == pytest.approx(3.0) and start["speed_max_time"] == 0.0
    assert start["thickness_max"] == pytest.approx(4.0, rel=1e-12)  # a lattice of half a cell is even on its cells
    fastest = (3.0,)
    for _ in range(3000):
        solver.advance(1.5, max_steps=1)
        points = sorted_points(solver)
        speed = np.sqrt((points.velocity**2).sum(axis=1))
        k = int(np.argmax(speed))
        if speed[k] > fastest[0] * (1 + 1e-12):
            fastest = speed[k], points.position[k], solver.time
        if solver.time >= 1.5:
            break
    told = solver.balances()
    assert told["speed_max"] == pytest.approx(fastest[0], rel=1e-9) and fastest[0] > 8.0
    assert told["speed_max_at"] == pytest.approx(fastest[1][:2].tolist(), abs=1e-6)
    assert told["speed_max_time"] == fastest[2]
    drop = 64.0 - 0.5 - fastest[1][2]  # from the highest point
    assert told["speed_bound_ratio"] == pytest.approx(fastest[0] / np.sqrt(2 * 9.81 * drop + 9.0), rel=1e-3)
    solver.note_deepest()
    mass = solver.frame().particles.mass.sum()
    assert 0.0 < solver.balances()["thickness_max"] <= mass / (1000.0 * 4.0)
    again = points_on(ground, frame, 2.0, elastic(1e6, 5e5))
    again.restore(solver.frame())
    assert all(again.balances()[name] == value for name, value in solver.balances().items() if "_max" in name)
