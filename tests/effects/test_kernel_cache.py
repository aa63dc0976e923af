"""Where compiled kernels are kept, and what they run on: as the user says, whatever a parent process or machine has."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from mpmgis.kernels.jit import jit  # this process has chosen, and says so in its environment

TELL = "import mpmgis.kernels.jit, numba; print(numba.config.CACHE_DIR)"


def folder_of_a_child(**environment):
    child = [sys.executable, "-c", TELL]
    return Path(subprocess.run(child, env=environment, capture_output=True, text=True, check=True).stdout.strip())


def test_a_child_chooses_for_itself(tmp_path):
    found = folder_of_a_child(**os.environ | {"MPMGIS_CACHE_DIR": str(tmp_path)})
    assert found.is_relative_to(tmp_path)


def test_numbas_own_variable_is_the_users(tmp_path):
    given = tmp_path / "given"
    told = {"NUMBA_CACHE_DIR": str(given), "MPMGIS_CACHE_DIR": str(tmp_path)}
    assert folder_of_a_child(**os.environ | told) == given


def threads_of_a_child(first="numba", then="mpmgis.kernels.jit", **environment):
    tell = f"import {first}, {then}; mpmgis.kernels.jit.ready_threads(); print(numba.threading_layer())"
    child = subprocess.run([sys.executable, "-c", tell], env=environment, capture_output=True, text=True, check=True)
    return child.stdout.strip()


def test_threads_are_openmps_whatever_else_is_installed_unless_the_user_says_so():
    if importlib.util.find_spec("numba.np.ufunc.omppool") is None or sys.platform == "darwin":
        pytest.skip("numba has no OpenMP here")
    own = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_THREADING_LAYER")}
    assert threads_of_a_child(**own) == threads_of_a_child("mpmgis.kernels.jit", "numba", **own) == "omp"
    assert threads_of_a_child(**own | {"NUMBA_THREADING_LAYER_PRIORITY": "workqueue omp tbb"}) == "workqueue"


def half(number):
    """What the processes below compile, one for whole numbers and one for others."""
    return number / 2


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_two_processes_that_compile_at_a_time_do_not_take_each_others_code(monkeypatch):
    """Both have read the index before either wrote it, and the first is last to write its code."""
    first, second = jit(half), jit(half)
    files, late = first._cache._cache_file, []
    files.flush()
    monkeypatch.setattr(files, "_save_data", lambda *given: late.append(given))
    assert first(3) == 1.5
    second._cache._cache_file.flush()  # as if it had read the index before
    assert second(7.5) == 3.75
    monkeypatch.undo()
    for given in late:
        files._save_data(*given)
    third = jit(half)
    assert third(7.5) == 3.75 and third.signatures == [(numba.float64,)]
    assert third.stats.cache_hits and third(3) == 1.5
