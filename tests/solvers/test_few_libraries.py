"""Laws, kernels and solvers need only Numba, NumPy, SciPy and h5py: machines with a GPU may have no other libraries.

The package `solvers.gpu` and the benchmarks for a GPU also need numba-cuda and its dependencies.
"""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from plain_array_runs import RUNS, results

LIBRARIES = ("numba", "llvmlite", "numpy", "scipy", "h5py", "mpmgis")
ABSENT = ("rasterio", "shapely", "pyproj", "affine", "geopandas", "pandas", "pyogrio", "psutil", "filelock", "rich")
WITH_CUDA = (*LIBRARIES, "numba_cuda", "cuda", "nvidia", "packaging", "gpu", "gpu_columns", "written_run")
ONLY_THESE = """
import sys

class OnlyThese:
    def find_spec(self, name, path=None, target=None):
        first = name.partition(".")[0]
        if first not in LIBRARIES and first not in sys.stdlib_module_names and not first.startswith("_"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

assert not set(ABSENT) & set(sys.modules)
sys.modules.update(dict.fromkeys(ABSENT))  # `find_spec` returns None for them
sys.meta_path.insert(0, OnlyThese())
"""
EVERY_MODULE = """
import importlib, pkgutil

for name in ("compiled", "laws", "solvers.columns", "solvers.points"):
    package = importlib.import_module(f"mpmgis.{name}")
    for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        importlib.import_module(found.name)
        print(found.name)
importlib.import_module("mpmgis.frames.frame_files")
"""
EVERY_MODULE_FOR_A_DEVICE = f"""
import importlib, pkgutil

import mpmgis.solvers.gpu

for found in pkgutil.walk_packages(mpmgis.solvers.gpu.__path__, "mpmgis.solvers.gpu."):
    importlib.import_module(found.name)
    print(found.name)
sys.path.insert(0, {str(Path(__file__).parents[1] / "bench")!r})
for name in ("gpu", "gpu_columns"):
    bench = importlib.import_module(name)
    print(name, bench.slab(64)[1].dimension if name == "gpu" else len(bench.sheet(64)[1].particles))
    print(*getattr(bench, "MATERIALS", ()), sep="\\n")
"""


def with_few(code, libraries=LIBRARIES):
    """Standard output of `code` in a process that can import only `libraries`."""
    given = f"LIBRARIES, ABSENT = {libraries!r}, {ABSENT!r}\n"
    done = subprocess.run(
        [sys.executable, "-c", given + ONLY_THESE + code], capture_output=True, text=True, timeout=580
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", ABSENT)
def test_the_others_are_absent(name):
    imported = with_few(f"try:\n    import {name}\nexcept ModuleNotFoundError as error:\n    print(error.name)")
    assert imported.split() == [name]


def test_every_module_of_laws_kernels_and_solvers_and_that_of_frames_is_imported():
    imported = with_few(EVERY_MODULE).split()
    assert {"mpmgis.solvers.points.point_loop", "mpmgis.laws.friction", "mpmgis.solvers.points.point_solver"} <= set(
        imported
    )
    assert len(imported) > 60


@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason="numba-cuda is not installed")
def test_the_kernels_and_benchmarks_for_a_device_are_imported_with_numba_cuda_too():
    lines = set(with_few(EVERY_MODULE_FOR_A_DEVICE, WITH_CUDA).splitlines())
    assert {
        "mpmgis.solvers.gpu.device_point_loop",
        "mpmgis.solvers.gpu.device_column_loop",
        "mpmgis.solvers.gpu.device_laws",
        "gpu 3",
        "gpu_columns 64",
    } <= lines
    assert "Drucker-Prager" in lines and "Drucker-Prager at a barrier" not in lines  # which needs shapely


def test_runs_of_plain_arrays_and_their_frames_are_the_same_to_the_bit(tmp_path):
    script = Path(__file__).with_name("plain_array_runs.py")
    with_few(
        f"import runpy\nsys.argv = {[str(script), str(tmp_path)]!r}\nrunpy.run_path(sys.argv[0], run_name='__main__')"
    )
    for name, run in RUNS.items():
        expected = results(run(Affine), tmp_path / f"{name}_here.h5")
        with np.load(tmp_path / f"{name}.npz") as got:
            assert set(got) == set(expected) and len(expected["position"]) >= 400
            for key, values in expected.items():
                np.testing.assert_array_equal(got[key], values, err_msg=f"{name}: {key}")
        assert np.ptp(expected["position"][:, 0]) > (11.0 if name == "columns" else 4.0)
