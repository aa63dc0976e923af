"""Kernels are compiled without `scipy.linalg`, which numba itself still imports."""

import subprocess
import sys

NEEDLESS = "numba no longer needs this: remove module mpmgis/compiled/blas_import.py"
KERNELS = """
import sys
import numba
import numpy as np
from mpmgis.compiled.jit import jit
assert jit(lambda a: np.sum(a))(np.ones(3)) == 3.0
assert "scipy.linalg" not in sys.modules

@numba.njit
def product(a, b):
    return np.dot(a, b)

a = np.arange(9.0).reshape(3, 3)
assert np.array_equal(product(a, a), a @ a)
assert np.allclose(numba.njit(lambda a: np.linalg.inv(a))(np.eye(3)), np.eye(3))
"""
OWN = "import sys; from numba.np import arraymath; print('scipy.linalg' in sys.modules)"


def said_by(code):
    """What a Python process with this code prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_kernels_of_arrays_are_compiled_without_blas_and_may_call_it_all_the_same(tmp_path):
    file = tmp_path / "kernel.py"  # numba caches kernels of files only
    file.write_text(KERNELS)
    assert said_by(f"import runpy; runpy.run_path({str(file)!r})") == ""


def test_numba_itself_imports_blas_for_functions_of_arrays():
    assert said_by(OWN) == "True", NEEDLESS
