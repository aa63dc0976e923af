"""The depth-averaged solver on a device gives what that on the processor gives: in the simulator of CUDA."""

import json

import pytest
from device_cases import LACK, in_simulator

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
ROUNDING = 1e-10


def test_runs_on_a_device_are_those_on_the_processor():
    """Frames, restarts in both directions, inflow, removal, other laws, released areas, the stop rule.

    The CPU's kernels run as plain Python here, and compiled in the benchmark below.
    """
    found = json.loads(in_simulator("tests/solvers/gpu/column_runs.py", NUMBA_DISABLE_JIT="1"))
    assert found.pop("same_bits_after_resuming")
    assert {name: value for name, value in found.items() if not value < ROUNDING} == {} and len(found) >= 8


def test_the_benchmark_compares_and_writes_its_table(tmp_path):
    small = ("--checked", "64", "--steps", "2", "--sets", "Voellmy")
    said = in_simulator("tests/bench/gpu_columns.py", tmp_path, *small)
    (row,) = json.loads((tmp_path / "gpu_columns.json").read_text())["agreement"]
    assert row["agrees"] and row["same_bits"] and row["place_cells"] < ROUNDING
    assert said == (tmp_path / "gpu_columns.txt").read_text() and "agrees: effects Voellmy" in said
