"""The two parts of curvature, alone and together: as plain Python, compiled, and from a scene."""

import numpy as np
import pytest

from mpmgis.compiled import law_functions  # noqa: F401  (registers the methods of laws)
from mpmgis.compiled.jit import jit
from mpmgis.laws.curvature import CURVATURE, LOAD, NO_CURVATURE, PARTS, TURN
from mpmgis.scene import TerrainFacts, resolve, scene_from_tables
from mpmgis.system.errors import SceneError

STATE = (8.0, -3.0, -0.6, 0.1, -0.4, 0.15)  # u, v, and the bed's gradient before and after
TABLES = {
    "terrain": {"dem": "dtm.tif"},
    "release": {"source": "area.shp", "thickness": 1.0},
    "output": {"end_time": 10.0, "frame_interval": 1.0},
}


@jit
def answers(law, state, gravity, centrifugal):
    u, v = law.turned_velocity(*state)
    return law.curvature_active(), u, v, law.effective_gravity(gravity, centrifugal)


@pytest.mark.parametrize("law", [NO_CURVATURE, CURVATURE, TURN, LOAD])
def test_a_part_does_its_part_and_no_more(law):
    """Turning is that of the whole law or zero, and so is the load; compiled and plain agree to the last bit."""
    active, u, v, gravity = answers(law, STATE, 9.81, 1.7)
    assert (active, u, v, gravity) == answers.py_func(law, STATE, 9.81, 1.7)
    turns, loads = type(law) in (Curvature, CurvatureTurnOnly), type(law) in (Curvature, CurvatureLoadOnly)
    assert (u, v) == (CURVATURE.turned_velocity(*STATE) if turns else STATE[:2])
    assert gravity == (9.81 + 1.7 if loads else 9.81)
    assert active == (turns or loads)
    whole = Curvature if loads else NoCurvature
    assert type(law).centrifugal_acceleration is whole.centrifugal_acceleration


def test_the_turn_keeps_the_length_on_the_bed():
    u, v = TURN.turned_velocity(*STATE)
    before = np.linalg.norm([*STATE[:2], STATE[0] * STATE[2] + STATE[1] * STATE[3]])
    np.testing.assert_allclose(np.linalg.norm([u, v, u * STATE[4] + v * STATE[5]]), before, rtol=1e-14)


@pytest.mark.parametrize("part", PARTS)
def test_a_scene_may_ask_for_a_part(part):
    scene = scene_from_tables(TABLES | {"curvature": {"use": part}})
    slots, decisions = resolve(scene, TerrainFacts(0.0, 0.3, 100.0, 20.0))
    assert slots.curvature == PARTS[part]()
    [decision] = [d for d in decisions if d.effect == "curvature"]
    assert (decision.state, decision.decided_by) == ("on", "forced") and part in decision.reason
    with pytest.raises(SceneError, match=f"use = '{part}'"):
        scene_from_tables(TABLES | {"curvature": {"use": part}, "numerics": {"form": "swe"}})
