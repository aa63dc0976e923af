"""Parts of the benchmarks for a GPU that need a device run in the simulator too, as far as it can take its place."""

import json
import os

import pytest
from device_cases import LACK, in_simulator

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
# in place of compute-sanitizer: runs the command after its own four arguments, and fails as it does
SANITIZER = """#!/bin/sh
echo "========= $1 $2 $3 $4"
shift 4
"$@" || exit 9
echo "========= ERROR SUMMARY: 0 errors"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the benchmarks' files, and a stand-in for compute-sanitizer."""
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def found(folder):
    """Results of `simulated_bench.py`."""
    tool = folder / "compute-sanitizer"
    tool.write_text(SANITIZER)
    tool.chmod(0o755)
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    return json.loads(in_simulator("tests/solvers/gpu/simulated_bench.py", folder, NUMBA_DISABLE_JIT="1", PATH=path))


@pytest.mark.parametrize("particles", ["points", "columns"])
def test_steps_on_device_and_processor_are_timed(found, particles):
    (device, large), (processor, too_large) = found[particles]["on_device"], found[particles]["on_processor"]
    for row in (device, processor):
        assert row[particles] == 64 and 0.0 < row["ns_least"] <= row["ns"]
    assert device["ns"] <= device["ns_most"] and device[f"bytes_per_{particles[:-1]}"] == 6400 / 64
    assert large["not_run"] == "the device has 1 GB free" and large[particles] == 100_000_000
    assert too_large["not_run"] == "too large for the processor"


@pytest.mark.parametrize("particles", ["points", "columns"])
def test_the_sanitizer_runs_some_steps(found, particles):
    said = found[particles]["sanitizer"]
    assert said["ran"] and said["clean"], said
    assert said["last_lines"] == ["========= --tool memcheck --error-exitcode 9", "========= ERROR SUMMARY: 0 errors"]


def test_bandwidth_and_whole_scenes(found):
    assert found["points"]["copy_bandwidth"] > 0.0
    (scene,) = found["points"]["scenes"]
    for where in ("device", "processor"):
        assert scene[where]["points"] == 64 and scene[where]["steps"] >= 2
        assert 0.0 < scene[where]["seconds_of_frames"] < scene[where]["seconds"]
    assert scene["times_faster"] == scene["processor"]["seconds"] / scene["device"]["seconds"]


@pytest.mark.parametrize(("particles", "kernel"), [("points", "grid_to_points"), ("columns", "grid_to_columns")])
def test_each_kernel_of_a_step_is_timed(found, particles, kernel):
    times = found[particles]["kernels"]
    assert {"begin_step", "rank_points", kernel} <= set(times) and min(times.values()) > 0.0
    assert list(times.values()) == sorted(times.values(), reverse=True)


def test_the_processor_is_timed_on_one_thread_and_on_more(found):
    rows = found["points"]["on_threads"]
    assert rows[0]["threads"] == 1 and rows[0]["times_faster"] == 1.0
    assert all(row["ns_least"] * row["times_faster"] == pytest.approx(rows[0]["ns_least"]) for row in rows)


def test_all_parts_are_in_the_text(found, folder):
    text = (folder / "gpu.txt").read_text()
    assert "times its floor" in text and "whole scene, device: 64 points, float32" in text and "TB/s" in text
    text = (folder / "gpu_columns.txt").read_text()
    assert "device: 64 columns, Voellmy: ns " in text and "bytes_per_column 100" in text
    assert "device: 100000000 columns, Voellmy: the device has 1 GB free" in text
    assert "kernel grid_to_columns: " in text
    assert found["columns"] == json.loads((folder / "gpu_columns.json").read_text())
