"""Seeding kernels as plain Python (NUMBA_DISABLE_JIT=1, in a process of its own) give what the compiled ones give."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPT = """
import json, sys
import numpy as np
from seed_sites import PIXELS, area_of, inclined, ring
from mpmgis.seeding.column_seeding import seed_columns
answers = []
for options in json.loads(sys.argv[1]):
    with np.errstate(over="ignore"):  # plain NumPy says that unsigned numbers wrap
        columns = seed_columns(inclined(PIXELS["rotated"]), area_of(ring(12, 4)), seed=3, **options).particles
    answers.append([columns.position.tolist(), columns.mass.tolist(), columns.area.tolist()])
print(json.dumps(answers))
"""
OPTIONS = [
    {"per_cell": 4},
    {"per_cell": 4, "points": "jittered"},
    {"per_cell": 4, "points": "random"},
    {"count": 60, "points": "halton"},
    {"count": 60, "mass": "equal"},
    {"per_cell": 4, "refine_slope": 1.5},
]


def answers(**environment):
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", SCRIPT, json.dumps(OPTIONS)],
        env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def both():
    return answers(), answers(NUMBA_DISABLE_JIT="1")


@pytest.mark.thorough
@pytest.mark.parametrize("case", range(len(OPTIONS)), ids=[str(list(o.values())) for o in OPTIONS])
def test_plain_python_agrees(both, case):
    for compiled, plain in zip(both[0][case], both[1][case], strict=True):
        np.testing.assert_allclose(np.array(compiled), np.array(plain), rtol=1e-9, atol=1e-9)
