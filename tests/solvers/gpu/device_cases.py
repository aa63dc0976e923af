"""Results of scripts of cases in the CUDA simulator, which is chosen before numba is imported; and how they compare."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
LACK = "" if importlib.util.find_spec("numba_cuda") else "numba-cuda is not installed (pip install 'mpmgis[gpu]')"
# of places [cells] and of momentum, affine momentum, state, peaks, yields, outflow, impulses, losses and loads over the
# largest of each: sums of the same numbers in another order, over a few steps
TOLERANCE = {"float64": 1e-12, "float32": 1e-4}
each_precision = pytest.mark.parametrize("precision", TOLERANCE)
LOSSES = {"float64": 1e-12, "float32": 2e-4}
CORRECTION = {"float64": 1e-12, "float32": 2e-3}  # energy of corrections of J by 0.01, a difference of stored energies
PLACES = {"float64": 1e-12, "float32": 1e-5}  # the ground of the device is in the precision of the points
COMPARED = (
    *("momentum", "affine", "state", "peaks", "yields", "ledger", "left_cells", "impulse", "losses", "time"),
    *("barrier_sums", "face_yields", "correction"),
)


def in_simulator(*command, **environment):
    """What a Python `command`, run from ROOT in the simulator with the `environment`, prints."""
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1800,
        env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_NUM_THREADS": "1"} | environment,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def results_of(script, *parts):
    """Name of case -> result, of the cases of a `script` beside this file whose names contain one of `parts`.

    The CPU's kernels run there as plain Python, because steps of a few particles take less time than compiling them;
    `solvers/test_plain_kernels.py` compares plain and compiled kernels.
    """
    said = in_simulator(Path(__file__).with_name(script), *parts, NUMBA_DISABLE_JIT="1")
    return dict(json.loads(line) for line in said.splitlines())


def require_agreement(here, precision, slack=1.0):
    """Fail unless the result `here` of `compared` says that device and processor agree, to `slack` tolerances."""
    assert here["exact"], "keys, ids, counts or touched ground differ"
    assert here["place"] <= slack * PLACES[precision]
    bounds = dict.fromkeys(COMPARED, TOLERANCE[precision])
    bounds |= {"losses": LOSSES[precision], "correction": CORRECTION[precision]}
    worst = {name: here[name] for name in COMPARED if not here[name] <= slack * bounds[name]}
    assert not worst
    assert here["counted"] == 0.0
