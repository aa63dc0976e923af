"""The depth-averaged solver on a device gives what that on the processor gives: in the simulator of CUDA."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LACK = "" if importlib.util.find_spec("numba_cuda") else "numba-cuda is not installed (pip install 'mpmgis[gpu]')"
pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
ROUNDING = 1e-10


def in_simulator(*command, **environment):
    done = subprocess.run(
        [sys.executable, *command], cwd=ROOT, capture_output=True, text=True, timeout=1200,
        env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_NUM_THREADS": "1"} | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_runs_on_a_device_are_those_on_the_processor():
    """Frames, restarts in both directions, inflow, removal, other laws, released areas, the stop rule.

    The CPU's kernels run as plain Python here, and compiled in the benchmark below.
    """
    found = json.loads(in_simulator("tests/gpu/column_runs.py", NUMBA_DISABLE_JIT="1"))
    assert found.pop("same_bits_after_resuming")
    assert {name: value for name, value in found.items() if not value < ROUNDING} == {} and len(found) >= 9


def test_the_benchmark_compares_and_writes_its_table(tmp_path):
    small = ("--checked", "64", "--steps", "2", "--sets", "Voellmy")
    said = in_simulator("tests/bench/gpu_columns.py", tmp_path, *small)
    (row,) = json.loads((tmp_path / "gpu_columns.json").read_text())["agreement"]
    assert row["agrees"] and row["same_bits"] and row["place_cells"] < ROUNDING
    assert said == (tmp_path / "gpu_columns.txt").read_text() and "agrees: effects Voellmy" in said
