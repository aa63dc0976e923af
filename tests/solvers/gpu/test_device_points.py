"""The 3D solver on a CUDA device, in the simulator, against the CPU's kernels; repeats bit by bit.

The simulator is chosen before numba is imported: the cases run in a process of their own (`simulated_points.py`).
"""

import pytest
from device_cases import LACK, each_precision, require_agreement

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
SCRIPT = "simulated_points.py"
SCENES = (
    *("slab", "drag", "fluidised bed", "sticking"),
    *("cliff", "cliff with drag", "cliff with mud", "cliff that sticks"),
    *("wall", "along a wall", "outflow", "under ground", "zones", "reordered"),
)
YIELDING = (
    *("Drucker-Prager", "Drucker-Prager without friction", "mu(I)"),
    *("cohesive mu(I)", "cohesive mu(I) with softening"),
)


@each_precision
@pytest.mark.parametrize("scene", (*SCENES, "elastic", "fluid", *YIELDING))
def test_some_steps_are_those_of_the_processor(found, scene, precision):
    require_agreement(found[f"{scene} {precision}"], precision)


def test_the_scenes_contain_what_they_are_for(found):
    assert found["outflow float64"]["out"] > 0.0
    assert found["under ground float64"]["clips"]["LIFTED_TOTAL"] > 0
    assert found["wall float64"]["clips"]["WALL_TOTAL"] > 0


@each_precision
@pytest.mark.parametrize("material", YIELDING)
def test_points_yield_in_shear_and_in_tension_in_the_first_step(found, material, precision):
    here = found[f"{material} {precision}"]
    assert here["yield at once"] == here["alive"] == 8 and here["torn at once"] == 4


@each_precision
def test_elastic_points_are_strained_and_fluid_is_compressed_and_expands(found, precision):
    assert found[f"elastic {precision}"]["least state"] < -0.01
    assert found[f"fluid {precision}"]["least state"] < 0.95 and found[f"fluid {precision}"]["torn"] > 0


@each_precision
@pytest.mark.parametrize("case", ["permuted", "permuted outflow", "resumed", "other launch"])
def test_bits_depend_on_neither_launch_order_nor_pauses(found, case, precision):
    assert found[f"{case} {precision}"]["same"]


def test_reasons_to_stop(found):
    assert all(found["reasons"].values())
