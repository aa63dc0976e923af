"""Solvers on a device give what those on the processor give: in the simulator of CUDA, which needs no device."""

import json
import os
import subprocess
import sys

import pytest
from device_cases import LACK, ROOT, in_simulator

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
ROUNDING = 1e-10


def test_runs_of_points_on_a_device_are_those_on_the_processor():
    found = json.loads(in_simulator("tests/solvers/gpu/device_runs.py"))
    assert found.pop("same_bits_after_resuming") and found.pop("same_bits_with_a_barrier")
    assert found.pop("load") > 0.0
    assert {name: value for name, value in found.items() if not value < ROUNDING} == {}


def test_runs_of_columns_on_a_device_are_those_on_the_processor():
    """Frames, restarts in both directions, inflow, removal, other laws, released areas, the stop rule.

    The CPU's kernels run as plain Python here, and compiled in the benchmark below.
    """
    found = json.loads(in_simulator("tests/solvers/gpu/column_runs.py", NUMBA_DISABLE_JIT="1"))
    assert found.pop("same_bits_after_resuming")
    assert {name: value for name, value in found.items() if not value < ROUNDING} == {} and len(found) >= 8


@pytest.mark.parametrize(
    ("bench", "options", "words"),
    [
        (
            "gpu",
            "--checked 32 --materials Drucker-Prager --precisions float64 --scene-millions 0",
            "Drucker-Prager, float64",
        ),
        ("gpu_columns", "--checked 64 --sets Voellmy", "effects Voellmy"),
    ],
)
def test_the_benchmark_compares_and_writes_its_table(tmp_path, bench, options, words):
    said = in_simulator(f"tests/bench/{bench}.py", tmp_path, "--steps", "2", *options.split())
    (row,) = json.loads((tmp_path / f"{bench}.json").read_text())["agreement"]
    assert row["agrees"] and row["same_bits"] and row["place_cells"] < ROUNDING
    assert said == (tmp_path / f"{bench}.txt").read_text() and f"agrees: {words}" in said


def test_the_benchmark_says_in_one_line_that_there_is_no_device(tmp_path):
    command = [sys.executable, "tests/bench/gpu.py", tmp_path / "out"]
    hidden = os.environ | {"CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=200, env=hidden)
    assert done.returncode == 1 and done.stderr.startswith("nothing is measured: ") and done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
