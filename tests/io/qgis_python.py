"""A Python that has PyQGIS, and scripts run by it that answer with one JSON object."""

import json
import os
import shutil
import subprocess
from functools import cache

import pytest


@cache
def python_with_qgis():
    """Path of a Python that has PyQGIS, or None."""
    for python in ("/usr/bin/python3", shutil.which("python3"), os.environ.get("MPMGIS_QGIS_PYTHON")):
        if (
            python
            and subprocess.run([python, "-c", "import qgis.core"], capture_output=True, check=False).returncode == 0
        ):
            return python
    return None


def clean_environment():
    """The environment without what belongs to the Python of the tests."""
    return {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV", "GDAL", "PROJ"))}


def report_of(script, *arguments, timeout=120):
    """What `script`, run by that Python, tells on stdout behind the word REPORT; skips where there is none."""
    python = python_with_qgis()
    if python is None:
        pytest.skip("no PyQGIS on this machine (Debian: apt-get install python3-qgis)")
    done = subprocess.run(
        [python, str(script), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        env=clean_environment(),
        check=False,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("REPORT ")]
    assert lines, done.stderr[-2000:]
    return json.loads(lines[0].removeprefix("REPORT "))
