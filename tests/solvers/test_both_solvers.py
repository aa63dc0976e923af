"""What holds for columns and for points: the same bits for any threads and slices of steps, and after a restart."""

from functools import partial

import numpy as np
import pytest
from column_scenes import columns_of, solver_on, terrain_of
from test_barrier_face_loads import still_water
from test_columns_spatial import channel
from test_columns_step import rough_solver, same_state
from test_forest import forested, hill, seeded, wood
from test_openings import slit_dam
from test_points import sliding
from test_points_drag import slab
from test_points_single import sliding as sand

from mpmgis.compiled.jit import set_threads
from mpmgis.laws.curvature import CURVATURE
from mpmgis.laws.entrainment import entrainment_law
from mpmgis.laws.friction import friction_law
from mpmgis.solvers.columns.feature_arrays import Places
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.system.errors import FormatError


def lowered():
    """Columns that lower a curved bed: nodes read the bed of their neighbours before any of them is lowered."""
    terrain = terrain_of(lambda x, y: 0.36 * (400 - x) + 4 * np.sin(x / 20) * np.cos(y / 18), 400, 200, 5.0)
    places = Places(erodible=np.full(ColumnGrid.on(terrain, 5.0).bed.shape, 500.0))
    laws = {"entrainment": entrainment_law("ErosionEnergy", 500.0, 1e-3), "curvature": CURVATURE}
    frame = columns_of(2.0, 40, 100, 60, 120, 1.25)
    return solver_on(terrain, frame, 5.0, friction_law("Voellmy", 0.15, 800.0), places=places, laws=laws)


def in_forest():
    """Columns that stop in a forest, and erode its ground."""
    frame = seeded(1.5, 45, 75, 105, 135, 5.0, per_side=3)
    return forested(frame, hill, 240.0, 240.0, 5.0, wood(3, 500.0, 2e4), 0.15, 5e-3, 300.0)


SOLVERS = {  # name -> what makes a solver, the times of two frames [s]
    "columns": (partial(rough_solver, curvature=CURVATURE, maxima=True), 3.0, 6.0),
    "columns at a wall": (partial(channel, 5.0), 3.0, 6.0),
    "columns on a bed that they lower": (lowered, 1.0, 2.0),
    "columns in a forest": (in_forest, 4.0, 8.0),
    "columns through openings": (lambda: slit_dam()[0], 1.0, 2.0),
    "points": (partial(sliding, 0.3, maxima=True), 0.3, 0.6),
    "points in single precision": (partial(sand, "float32"), 0.3, 0.5),
    "points with drag": (lambda: slab(1.0, 0.7, long=12.0, wide=8.0)[0], 0.2, 0.4),
    "points at a wall": (partial(still_water, 0.3, mu=0.5), 0.1, 0.2),
}
LONG = "columns through openings", "points in single precision", "points with drag", "columns in a forest"


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.thorough] * (n in LONG)) for n in SOLVERS])
def test_threads_slices_and_restarts_change_no_bit(name):
    """All arrays of the state: particles, clock, sums, peaks, bed, loads on barriers, yield of faces."""
    make, first, end = SOLVERS[name]
    whole, sliced, again = make(), make(), make()
    set_threads(1)
    whole.advance(first, end)
    set_threads(2)
    while sliced.advance(first, end, 7) == sliced.RUNNING:
        pass
    again.restore(sliced.frame())
    for solver in (whole, sliced, again):
        solver.advance(end)
    set_threads(None)
    assert whole.step == sliced.step == again.step > 1
    for other in (sliced, again):
        same_state(whole, other)
    assert whole.balances() == again.balances()


@pytest.mark.parametrize("name", ["columns", "points"])
def test_a_state_that_lacks_an_array_or_is_of_another_scene_is_refused(name):
    make, first, end = SOLVERS[name]
    solver = make()
    solver.advance(first, end)
    for array in solver.state():
        frame = solver.frame()
        values = frame.state.pop(array)
        with pytest.raises(FormatError, match=f"no state for a restart: {array} is missing; start with --overwrite"):
            make().restore(frame)
        if array not in ("left_blocks", "left_sums", "peaks", "peak_nodes", "yields", "yield_columns"):
            frame.state[array] = values[..., None]
            with pytest.raises(FormatError, match=rf"of another scene: its {array} is .*, expected .*\]; start with"):
                make().restore(frame)
    frame.state.clear()
    with pytest.raises(FormatError, match="no state for a restart; start with"):
        make().restore(frame)


@pytest.mark.parametrize("name", ["columns", "points"])
def test_shorter_steps_are_of_that_share_until_they_are_whole_again(name):
    make, first, _ = SOLVERS[name]
    whole, half = make(), make()
    half.share_step(0.5)
    for solver in (whole, half):
        solver.advance(first)
    assert half.step == pytest.approx(2 * whole.step, rel=0.05)
    half.share_step(1.0)
    assert half._settings == whole._settings
