"""The 3D solver on a CUDA device, in the simulator, against the CPU's kernels; repeats bit by bit.

The simulator is chosen before numba is imported: the cases run in a process of their own (`simulated_points.py`).
"""

import pytest
from device_cases import LACK, require_agreement, results_of
from law_kernels import PRECISIONS

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
SCENES = ("slab", "drag", "cliff", "cliff with drag", "wall", "outflow", "under ground", "zones", "reordered")

each_precision = pytest.mark.parametrize("precision", PRECISIONS)


@pytest.fixture(scope="module")
def found():
    """Results of all cases, by name."""
    return results_of("simulated_points.py")


@each_precision
@pytest.mark.parametrize("scene", SCENES)
def test_some_steps_are_those_of_the_processor(found, scene, precision):
    require_agreement(found[f"{scene} {precision}"], precision)


def test_the_scenes_contain_what_they_are_for(found):
    assert found["outflow float64"]["out"] > 0.0
    assert found["under ground float64"]["clips"]["LIFTED_TOTAL"] > 0
    assert found["wall float64"]["clips"]["WALL_TOTAL"] > 0


@each_precision
@pytest.mark.parametrize("case", ["permuted", "permuted outflow", "resumed", "other launch"])
def test_bits_depend_on_neither_launch_order_nor_pauses(found, case, precision):
    assert found[f"{case} {precision}"]["same"]


def test_reasons_to_stop(found):
    assert all(found["reasons"].values())
