"""Kernels as plain Python (NUMBA_DISABLE_JIT=1) give the results of the compiled ones, over steps of both solvers."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from plain_scenes import MADE, results

pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")]
SAME = "ids", "keys", "counts"
TOLERANCE = {np.dtype(np.float64): 1e-11, np.dtype(np.float32): 1e-4}  # of the largest value of each


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Results of all scenes without a compiler, by scene and array."""
    file = tmp_path_factory.mktemp("plain") / "plain.npz"
    script = Path(__file__).with_name("plain_scenes.py")
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, script, file], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    with np.load(file) as arrays:
        return dict(arrays)


@pytest.mark.parametrize("scene", MADE)
def test_plain_kernels_agree_with_compiled_ones(plain, scene):
    compiled = results(scene)
    slack = TOLERANCE[compiled["rows"].dtype]
    assert compiled["counts"].any() and np.abs(compiled["rows"]).max() > 0.0
    for name, array in compiled.items():
        other = plain[f"{scene}/{name}"]
        if name in SAME:
            assert np.array_equal(array, other), name
            continue
        entries = array.reshape(-1, array.shape[-1]) if name == "rows" else array.reshape(1, -1)
        others = other.reshape(entries.shape)
        size = np.abs(entries).max(axis=0 if name == "rows" else None, initial=0.0)
        assert (np.abs(entries - others) <= slack * size + 1e-300).all(), (name, np.abs(entries - others).max(axis=0))


def test_plain_kernels_stop_at_the_end_of_an_array(tmp_path):
    """A read behind an array, which is no error in compiled code, is an error or NaN in plain Python."""
    script = """
import numpy as np
from mpmgis.compiled.simd_lanes import get, lane, load, put
for index in (0, 5):
    four = load(np.arange(8.0), index)
    print([float(four[k]) for k in range(4)])
for function, more in ((get, ()), (put, (1.0,))):
    try:
        function(np.arange(8.0), 4, 4, *more)
    except IndexError:
        print("error")
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=os.environ | {"NUMBA_DISABLE_JIT": "1"}
    )
    assert done.stdout.splitlines() == ["[0.0, 1.0, 2.0, 3.0]", "[5.0, 6.0, 7.0, nan]", "error", "error"], done.stderr
