"""Rigid barriers of the 3D solver on a CUDA device, in the simulator, against the CPU's kernels."""

import pytest
from device_cases import LACK, each_precision, require_agreement

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
SCRIPT = "simulated_barriers.py"
SCENES = (
    *("smooth face", "face with friction", "face and drag", "thin wall", "overtopping", "over a face", "opening"),
    *("at a crest", "two barriers", "at the edge", "at a cliff", "on friction zones", "turned on a slope"),
    *("inner corner", "inner corner with friction", "inner corner, turned"),
    *("drawn 0", "drawn 1", "drawn 3", "drawn 11"),
)
OVER = 7  # index of the mass that passed above a crest in the loads of a barrier


@each_precision
@pytest.mark.parametrize("scene", SCENES)
def test_steps_at_barriers_are_those_of_the_processor(found, scene, precision):
    require_agreement(found[f"{scene} {precision}"], precision)
    assert all(abs(loads[0]) > 0.0 for loads in found[f"{scene} {precision}"]["loads"])


def test_the_scenes_contain_what_they_are_for(found):
    here = {scene: found[f"{scene} float64"] for scene in SCENES}
    assert here["face with friction"]["faces"] > 0 and here["face with friction"]["faces_yield"] > 0.0
    assert here["smooth face"]["faces"] > 0 and here["smooth face"]["faces_yield"] == 0.0
    assert here["overtopping"]["faces"] == 0 and here["overtopping"]["loads"][0][OVER] > 0.0
    assert here["over a face"]["faces"] > 0 and here["over a face"]["loads"][0][OVER] > 0.0
    assert len(here["two barriers"]["loads"]) == 2


@each_precision
@pytest.mark.parametrize("case", ["permuted", "permuted opening", "resumed"])
def test_bits_depend_on_neither_launch_order_nor_pauses(found, case, precision):
    assert found[f"{case} {precision}"]["same"]


def test_only_what_the_barriers_need_is_launched(found):
    standing = {"press_on_crests", "hold_at_barriers", "sum_booked", "collect_barriers"}
    faces = {
        "keep_before_faces",
        "share_face_rows",
        "weigh_face_rows",
        "weigh_face_columns",
        "settle_faces",
        "book_faces",
    }
    assert found["launched slab"] == []
    assert set(found["launched overtopping"]) == standing
    assert set(found["launched two barriers"]) == standing | faces
    assert set(found["launched opening"]) == standing | faces | {"weigh_flow"}


def test_rows_of_loads_are_those_of_their_barrier(found):
    assert found["rows of loads"]["worst"] == 0 and found["rows of loads"]["cases"] == 30
