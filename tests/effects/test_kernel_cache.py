"""Where compiled kernels are kept: as the user says, whatever a parent process chose for itself."""

import os
import subprocess
import sys
from pathlib import Path

import mpmgis.kernels.jit  # noqa: F401  this process has chosen, and says so in its environment

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
