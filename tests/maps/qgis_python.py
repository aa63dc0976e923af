"""A Python with PyQGIS, and scripts run by it that print one JSON object."""

import json
import os
import shutil
import subprocess
import tempfile
from functools import cache

import pytest

STARTS = """
from qgis.core import QgsApplication
application = QgsApplication([], False)  # newer versions crash where nothing keeps it
application.initQgis()
print("started", flush=True)
"""


@cache
def python_with_qgis():
    """Path of a Python whose PyQGIS starts, or None."""
    for python in ("/usr/bin/python3", shutil.which("python3"), os.environ.get("MPMGIS_QGIS_PYTHON")):
        if python:
            environment = clean_environment(python) | {"QT_QPA_PLATFORM": "offscreen"}
            tried = subprocess.run([python, "-c", STARTS], env=environment, capture_output=True, text=True, check=False)
            if tried.stdout == "started\n":  # some versions of QGIS crash as they end
                return python
    return None


def clean_environment(python):
    """The environment without variables of the Python of the tests.

    The Python inside QGIS takes its library from beside the first `python3` on PATH, and dies where that is another
    version's: the folder of `python`, which has PyQGIS, stands first.
    """
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV", "GDAL", "PROJ"))}
    return kept | {"PATH": os.pathsep.join([os.path.dirname(python), os.environ.get("PATH", os.defpath)])}


@cache
def qgis_process():
    """(path of the program `qgis_process`, "") where it starts, else (None, the reason)."""
    program, python = shutil.which("qgis_process.bin") or shutil.which("qgis_process"), python_with_qgis()
    if program is None or python is None:
        return None, "no qgis_process on this machine (Debian: apt-get install qgis)"
    environment = clean_environment(python) | {"QT_QPA_PLATFORM": "offscreen"}
    with tempfile.TemporaryDirectory() as folder:
        environment |= {"QGIS_CUSTOM_CONFIG_PATH": folder}
        tried = subprocess.run([program, "plugins"], env=environment, capture_output=True, text=True, check=False)
    if tried.returncode:
        words = (tried.stderr.strip().splitlines() or ["nothing"])[-1]
        return None, f"{program} does not start on this machine: it ends with {tried.returncode} and says {words!r}"
    return program, ""


def report_of(script, *arguments, timeout=120):
    """The output of `script` after the word REPORT; skips without PyQGIS."""
    python = python_with_qgis()
    if python is None:
        pytest.skip("no PyQGIS on this machine (Debian: apt-get install python3-qgis)")
    done = subprocess.run(
        [python, str(script), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        env=clean_environment(python),
        check=False,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("REPORT ")]
    assert lines, done.stderr[-2000:]
    return json.loads(lines[0].removeprefix("REPORT "))
