"""H34: the most difficult scenes give the same bits for any number of threads and for slices of any length."""

from dataclasses import replace

import numpy as np
import pytest
from hard_scenes import Watch
from scene_strategies import Box, ColumnScene, Ground, PointScene

from mpmgis.compiled.jit import set_threads

ROUGH = Ground("noise", 35.0, 0.7, 2.0, 0.5, 3, 200.0, 100.0)
THREE = (
    Box(0.1, 0.1, 0.3, 0.3, 3.0, 4, 30.0, 0.5),
    Box(0.3, 0.2, 0.3, 0.3, 20.0, 2, 0.0, 0.0),
    Box(0.9, 0.0, 0.02, 0.3, 1e-4, 4, 5.0, 3.0),
)
STEEP = Ground("cliff", 20.0, 0.3, 2.0, 0.4, 0, 40.0, 20.0)
SCENES = {
    "columns on rough ground": (ColumnScene(ROUGH, THREE, 0.1, 1000.0, 0.6, "open"), 4.0),
    "columns between walls": (ColumnScene(ROUGH, THREE, 0.0, 1e12, 0.9, "wall"), 4.0),
    "sand off a step": (
        PointScene(STEEP, Box(0.3, 0.2, 0.1, 0.3, 2.0, 2, 3.0, 0.0), 0.4, 0.4, "wall", 0.3, 30.0, 0.0, 0.0),
        0.4,
    ),
    "water off a step": (
        PointScene(STEEP, Box(0.3, 0.2, 0.1, 0.3, 2.0, 2, 3.0, 0.0), 0.1, 0.9, "open", 1.0, None, 0.0, 0.001),
        0.4,
    ),
}


LONG = [(name, precision) for name in SCENES if "step" in name for precision in ("float64", "float32")][1:]


@pytest.mark.parametrize(
    ("name", "precision"),
    [*((name, None) for name in list(SCENES)[:3]), *(pytest.param(*case, marks=pytest.mark.thorough) for case in LONG)],
)
def test_threads_and_slices_change_no_bit(name, precision):
    scene, end = SCENES[name]
    scene = replace(scene, precision=precision) if precision else scene
    states = []
    for threads, slices in ((1, 1 << 40), (2, 7)):
        set_threads(threads)
        solver = scene.solver()
        Watch(solver).march(end, looks=2, slices=slices)
        states.append(solver.state())
    set_threads(None)
    for key in ("rows", "clock", "ledger", "counts"):
        np.testing.assert_array_equal(states[0][key], states[1][key], err_msg=key)
