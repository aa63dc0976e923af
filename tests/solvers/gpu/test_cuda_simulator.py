"""The repairs of the CUDA simulator: each has its effect, and numba-cuda still needs it."""

import json
from pathlib import Path

import pytest
from device_cases import LACK, in_simulator

pytestmark = pytest.mark.skipif(bool(LACK), reason=LACK)
NEEDLESS = "numba-cuda no longer needs this: remove {} from mpmgis/solvers/gpu/cuda_simulator.py"


@pytest.fixture(scope="module")
def found():
    """What the simulator does with and without the repairs."""
    return json.loads(in_simulator(Path(__file__).with_name("simulated_repairs.py")))


def test_threads_of_a_block_share_their_arrays(found):
    assert found["same array"]
    assert not found["same array without repair"], NEEDLESS.format("shared_array")


def test_threads_of_a_block_that_do_not_wait_need_no_threads_of_the_host(found):
    assert found["launch"]["started"] == 0
    assert found["launch without repair"]["started"] == 4, NEEDLESS.format("run_in_turn")


def test_threads_of_a_block_wait_for_each_other(found):
    here = found["turns"]
    assert here["seen"] == [[1, 2, 3, 0]] * 3 and here["numbers"] == [0, 1, 2, 3, 4, 5]
    (error,) = here["errors"]
    assert "the third" in error and here["values"] == [0, 1, 2, 3]


def test_arrays_in_kernels_are_those_of_numpy(found):
    assert found["launch"]["kinds"] == ["ndarray"]
    assert found["launch without repair"]["kinds"] != ["ndarray"], NEEDLESS.format("FakeWithinKernelCUDAArray")


def test_numbers_in_kernels_are_made_by_numpy(found):
    assert found["slowness of numbers"] > 1.5, NEEDLESS.format("plain_number")  # 6 with numba 0.68
