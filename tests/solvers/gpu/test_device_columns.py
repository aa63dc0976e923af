"""The depth-averaged solver on a CUDA device, in the simulator, against the CPU's kernels; repeats bit by bit.

The simulator is chosen before numba is imported: the cases run in a process of their own (`simulated_columns.py`).
"""

import pytest
from column_slots import SCENES
from device_cases import LACK

from mpmgis.solvers.columns import column_forest, column_time_step
from mpmgis.solvers.points import point_time_step

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
SCRIPT = "simulated_columns.py"
TOLERANCE = 1e-12  # of the largest value of each: sums of the same numbers in another order, over a few steps
NO_SUMS = {"inexact", "facts", "reason"}
REPEATS = [
    f"{kind}: {name}"
    for kind in ("permuted", "resumed")
    for name in ("slide", "outflow west and south", "lowered bed", "barriers and walls", "forest, erosion and walls")
] + [f"{kind}: {name}" for kind in ("other_launch", "grown") for name in ("slide", "forest, erosion and walls")]


@pytest.mark.parametrize("scene", SCENES)
def test_some_steps_are_those_of_the_processor(found, scene):
    here = found[scene]
    assert not here["inexact"], "ids, keys, counts, reached nodes or the reason to stop differ"
    assert {name: value for name, value in here.items() if name not in NO_SUMS and not value <= TOLERANCE} == {}


def test_the_scenes_contain_what_they_are_for(found):
    facts = {name: found[name]["facts"] for name in SCENES}
    west, south, east, north, nodata = range(5)
    for scene, edges in (
        ("outflow west and south", (west, south)),
        ("outflow east and north", (east, north)),
        ("nodata", (nodata,)),
    ):
        assert all(facts[scene]["out"][edge] > 0.0 for edge in edges), scene
    for scene, total in (
        ("walls at edges", "WALL_TOTAL"),
        ("thin", "THIN_TOTAL"),
        ("viscosity", "STIFF_TOTAL"),
        ("erosion", "ENTRAINED_TOTAL"),
        ("lowered bed", "ENTRAINED_TOTAL"),
        ("greedy erosion", "GREEDY_TOTAL"),
        ("clamp", "CLAMPED_TOTAL"),
        ("speed bound", "SPEED_TOTAL"),
        ("walls at edges", "STRETCH_TOTAL"),
        ("thin", "THIN_AREA_TOTAL"),
        ("weightless", "AIRBORNE_TOTAL"),
        ("barriers", "BARRIER_TOTAL"),
        ("barriers and walls", "BARRIER_TOTAL"),
    ):
        assert facts[scene][total] > 0.0, (scene, total)
    assert all(max(map(abs, held)) > 0.0 for held in facts["barriers"]["held"])
    assert found["too fast"]["reason"] == column_time_step.TOO_FAST
    assert found["triggers"]["reason"] == column_time_step.TRIGGER_REACHED
    for scene in ("forest", "forest breaks", "forest takes all", "forest with limits", "forest, erosion and walls"):
        assert facts[scene]["forest"][column_forest.DETRAINED] > 0.0, scene
    assert facts["forest"]["forest"][column_forest.RESISTED] > 0.0
    assert facts["forest breaks"]["forest"][column_forest.BROKEN_CELLS] > 0.0
    assert facts["forest takes all"]["forest"][column_forest.STOPPED_COLUMNS] > 0.0
    assert facts["forest takes all"]["alive"] == 1


@pytest.mark.parametrize("case", REPEATS)
def test_bits_depend_on_neither_launch_order_nor_pauses_nor_room(found, case):
    assert found[case]["same"]


def test_sums_to_nodes_do_not_need_the_order_of_cells(found):
    assert 0.0 < found["scrambled"]["tiles"] <= TOLERANCE  # 0: the order was the same


def test_reasons_to_stop(found):
    assert all(found["reasons"].values()), found["reasons"]


def test_counts_that_the_sort_shares_with_points_have_the_same_entries():
    names = "ROWS", "ALIVE", "STEP", "SINCE_REORDER"
    assert [getattr(column_time_step, name) for name in names] == [getattr(point_time_step, name) for name in names]
