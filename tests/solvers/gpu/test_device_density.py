"""Correction of the volumes of fluid points on a CUDA device, in the simulator, against the CPU's kernels."""

import pytest
from device_cases import LACK, each_precision, require_agreement

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
SCRIPT = "simulated_density.py"
GROUND = (
    *("ground that yields", "ground that yields at once", "ground that does not yield", "ground and drag"),
    *("in the air", "another law of pressure", "longer step", "folded ground"),
)
EDGES = "eastern wall", "western wall", "corner of walls", "corner of walls too", "corner without walls"
BARRIERS = (
    *("before a wall", "before a wall with friction", "before a thin wall", "over a wall", "turned wall on a slope"),
    *("opening", "inner corner", "inner corner, turned", "yard"),
)
POOLS = "pool before a wall", "pool over a wall"
ACTS = (*GROUND, *EDGES, *BARRIERS, *POOLS, "second correction")
RESTS = "free surface", "folds only", "between corrections"


@each_precision
@pytest.mark.parametrize("scene", ACTS)
def test_corrected_volumes_are_those_of_the_processor(found, scene, precision):
    here = found[f"{scene} {precision}"]
    require_agreement(here, precision)
    assert here["corrected"] > 0


@each_precision
@pytest.mark.parametrize("scene", RESTS)
def test_other_volumes_are_not_corrected(found, scene, precision):
    require_agreement(found[f"{scene} {precision}"], precision)
    assert found[f"{scene} {precision}"]["corrected"] == 0


def test_the_scenes_contain_what_they_are_for(found):
    here = {scene: found[f"{scene} float64"] for scene in (*ACTS, *RESTS)}
    assert all(here[scene]["yield"] > 0.0 for scene in (*GROUND[:2], *EDGES, "before a wall"))
    assert here["ground that does not yield"]["yield"] == here["in the air"]["yield"] == 0.0
    assert here["folded ground"]["folds"] == here["folds only"]["folds"] == 1
    assert here["opening"]["openings"] > 0 and here["yard"]["openings"] > 0
    assert all(here[scene]["filled"] > 0 for scene in (*BARRIERS, *POOLS))
    for scene in ("folded ground", "opening", "yard", *POOLS):  # there are points of both kinds
        assert here[scene]["corrected"] < here[scene]["alive"], scene
    for scene in (*POOLS, "free surface"):
        assert here[scene]["least before"] < 0.85, scene


@each_precision
def test_points_expand_in_pools_and_are_compressed_elsewhere(found, precision):
    for scene in ACTS[:-1]:
        assert (found[f"{scene} {precision}"]["gained"] < 0.0) == (scene in POOLS), scene


@each_precision
@pytest.mark.parametrize("case", ["permuted", "permuted pool", "resumed", "other launch"])
def test_bits_depend_on_neither_launch_order_nor_pauses(found, case, precision):
    assert found[f"{case} {precision}"]["same"]


def test_only_fluids_launch_the_correction(found):
    assert found["launches fluid"] > 0 and found["launches soil"] == 0
