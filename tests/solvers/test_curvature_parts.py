"""The two parts of curvature, alone and together: in the solver, and from a scene."""

import numpy as np
import pytest
from column_scenes import columns_of, solver_on, terrain_of

from mpmgis.laws.curvature import CURVATURE, LOAD, NO_CURVATURE, PARTS, TURN, centrifugal_acceleration, turned_velocity
from mpmgis.laws.friction import friction_law
from mpmgis.scene import TerrainFacts, resolve, scene_from_tables
from mpmgis.system.errors import SceneError

STATE = (8.0, -3.0, -0.6, 0.1, -0.4, 0.15)  # u, v, and the bed's gradient before and after
TABLES = {
    "terrain": {"dem": "dtm.tif"},
    "release": {"source": "area.shp", "thickness": 1.0},
    "output": {"end_time": 10.0, "frame_interval": 1.0},
}


def state_after(curvature, mu):
    """The columns after three steps down into a hollow."""
    terrain = terrain_of(lambda x, y: 0.002 * (x - 60.0) ** 2 + 0.05 * y, 100.0, 60.0, 5.0)
    frame = columns_of(1.0, 10.0, 40.0, 20.0, 40.0, 2.5, velocity=(8.0, -3.0))
    solver = solver_on(terrain, frame, 5.0, friction_law("Coulomb", mu), curvature=curvature, time_step=0.1)
    solver.advance(1.0, max_steps=3)
    return solver._alive()[0].tobytes()


def test_a_part_does_its_part_and_no_more():
    """Without friction the load does nothing, to the last bit; with it each part changes the flow."""
    assert state_after(LOAD, 0.0) == state_after(NO_CURVATURE, 0.0)
    assert state_after(CURVATURE, 0.0) == state_after(TURN, 0.0) != state_after(NO_CURVATURE, 0.0)
    assert len({state_after(part, 0.2) for part in (NO_CURVATURE, TURN, LOAD, CURVATURE)}) == 4
    assert CURVATURE == TURN + LOAD and len({NO_CURVATURE, TURN, LOAD, CURVATURE}) == 4


def test_the_turn_keeps_the_length_on_the_bed():
    u, v = turned_velocity(*STATE)
    before = np.linalg.norm([*STATE[:2], STATE[0] * STATE[2] + STATE[1] * STATE[3]])
    np.testing.assert_allclose(np.linalg.norm([u, v, u * STATE[4] + v * STATE[5]]), before, rtol=1e-14)


def test_the_centrifugal_acceleration_is_that_of_the_height_along_the_way():
    """The second derivative in time of b(u t, v t) = (b_xx x^2 + 2 b_xy x y + b_yy y^2) / 2."""
    u, v, bend_xx, bend_xy, bend_yy = 3.0, -2.0, 0.01, 0.03, -0.02
    height = 0.5 * np.array([u, v]) @ np.array([[bend_xx, bend_xy], [bend_xy, bend_yy]]) @ np.array([u, v])
    assert centrifugal_acceleration(u, v, bend_xx, bend_xy, bend_yy) == pytest.approx(2.0 * height)


@pytest.mark.parametrize("part", PARTS)
def test_a_scene_may_ask_for_a_part(part):
    scene = scene_from_tables(TABLES | {"curvature": {"use": part}})
    slots, decisions = resolve(scene, TerrainFacts(0.0, 0.3, 100.0, 20.0))
    assert slots.curvature == PARTS[part]
    [decision] = [d for d in decisions if d.effect == "curvature"]
    assert (decision.state, decision.decided_by) == ("on", "forced") and part in decision.reason
    with pytest.raises(SceneError, match=f"use = '{part}'"):
        scene_from_tables(TABLES | {"curvature": {"use": part}, "numerics": {"form": "swe"}})
