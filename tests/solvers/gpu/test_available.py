"""The message about the device of this machine, and runs on the processor without numba-cuda."""

import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from mpmgis.solvers.gpu import available
from mpmgis.solvers.gpu.available import Device, Found, found_device, require_device
from mpmgis.system.errors import SceneError

ROOT = Path(__file__).resolve().parents[3]
H100 = Device("NVIDIA H100", (9, 0), 80_000_000_000, 79_000_000_000)
with_numba_cuda = pytest.mark.skipif(
    importlib.util.find_spec("numba_cuda") is None, reason="numba-cuda is not installed (pip install 'mpmgis[gpu]')"
)


def run_python(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, env=os.environ | environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_without_numba_cuda_the_message_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    found = found_device()
    assert found.device is None and found.line() == f"numba-cuda is not installed; {available.INSTALL} installs it"
    with pytest.raises(SceneError, match=r"pip install 'mpmgis.gpu.'.*device = 'cpu'"):
        require_device()


@with_numba_cuda
@pytest.mark.parametrize("installed", ["0.29.9", "0.31.0", "1.0"])
def test_other_versions_of_numba_cuda_are_refused(monkeypatch, installed):
    monkeypatch.setattr(available, "version", {"numba-cuda": installed, "numpy": "2.4.6"}.get)
    assert found_device().lack.startswith(f"numba-cuda {installed} is installed, expected 0.30.4 or later, below 0.31")


@with_numba_cuda
@pytest.mark.parametrize(("numpy", "works"), [("1.26.4", True), ("2.4.6", True), ("2.5.0", False), ("3.0.1", False)])
def test_a_numpy_that_numba_cuda_does_not_work_with_is_refused(monkeypatch, numpy, works):
    monkeypatch.setattr(available, "version", {"numba-cuda": "0.30.4", "numpy": numpy}.get)
    refused = found_device().lack.startswith(f"numba-cuda 0.30.4 needs NumPy below 2.5, got {numpy}; pip install")
    assert refused is not works


@with_numba_cuda
def test_the_device_or_its_absence_is_one_line():
    line = found_device().line()
    assert line and "\n" not in line and len(line) < 250


@with_numba_cuda
def test_the_simulator_is_named():
    code = "from mpmgis.solvers.gpu.available import require_device; print(require_device(1e15).line())"
    assert "simulator" in run_python(code, NUMBA_ENABLE_CUDASIM="1")


def test_a_run_that_is_too_large_for_the_device_is_refused(monkeypatch):
    monkeypatch.setattr(available, "found_device", lambda: Found(H100))
    assert require_device(70e9) == H100
    with pytest.raises(SceneError, match=r"needs 90 GB on the device \(NVIDIA H100, compute capability 9.0, 79 of 80"):
        require_device(90e9)


@pytest.mark.parametrize(
    ("solver", "key", "not_its_own"),
    [("points", "points_per_cell", "particles_per_cell"), ("columns", "particles_per_cell", "points_per_cell")],
)
def test_the_advice_on_memory_is_that_of_the_solver(monkeypatch, solver, key, not_its_own):
    monkeypatch.setattr(available, "found_device", lambda: Found(H100))
    with pytest.raises(SceneError) as caught:
        require_device(90e9, solver)
    assert key in str(caught.value) and not_its_own not in str(caught.value)
    assert ("float32" in str(caught.value)) == (solver == "points")


def test_the_range_of_versions_is_that_of_the_extra():
    extra = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    wanted, numpy = extra["gpu"]
    bounds = re.fullmatch(r"numba-cuda\[cu13\]>=([\d.]+),<([\d.]+)", wanted).groups()
    assert tuple(tuple(map(int, bound.split("."))) for bound in bounds) == available.TESTED
    bare = wanted.replace("[cu13]", "")  # the simulator needs no compiler of CUDA
    assert bare in extra["test-gpu"]
    assert numpy in extra["test-gpu"] and numpy == "numpy<" + ".".join(map(str, available.NO_NUMPY))


def test_solvers_import_no_code_for_devices():
    code = """
import sys
import mpmgis.simulation.scene_run, mpmgis.solvers.points.point_solver, mpmgis.solvers.gpu.available
print([name for name in sys.modules if name.startswith(("numba.cuda", "numba_cuda", "mpmgis.solvers.gpu."))])
"""
    assert run_python(code) == "['mpmgis.solvers.gpu.available']"
