"""Frames of the depth-averaged solver as points and back, and into the solver again."""

from dataclasses import replace

import numpy as np
import pytest
from converting import ORIGIN, columns_on, slope, terrain_of

from mpmgis.conversion.columns_to_points import columns_to_points, velocity_gradient
from mpmgis.conversion.conserved_sums import conservation_error
from mpmgis.conversion.conversion_options import PointOptions
from mpmgis.conversion.points_to_columns import points_to_columns
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.laws.effect_slots import ColumnEffects
from mpmgis.laws.friction import friction_law
from mpmgis.solvers.columns.column_solver import ColumnNumerics, ColumnSolver

RATE = np.array([[0.1, 0.03], [-0.07, 0.02]])


def solver_of(frame, ground):
    return ColumnSolver(
        frame, ground, ColumnEffects(friction=friction_law("Coulomb", 0.3)), ColumnNumerics(5.0, density=1300.0)
    )


def test_a_run_keeps_what_a_conversion_wants(tmp_path):
    """The state of a frame holds the columns' velocity gradient; `linear` and the points' affine motion come of it."""
    ground = terrain_of(slope(0.3, 0.0))

    def spread(x, y):
        return RATE[0, 0] * (x - 40) + RATE[0, 1] * (y - 35), RATE[1, 0] * (x - 40) + RATE[1, 1] * (y - 35)

    solver = solver_of(columns_on(ground, 2.0, spread), ground)
    solver.advance(0.02)
    write_frame(tmp_path / "frame.h5", solver.frame())
    frame = read_frame(tmp_path / "frame.h5")
    x, y = frame.map_xy()
    core = (np.abs(x - ORIGIN[0] - 40) < 10) & (np.abs(y - ORIGIN[1] - 35) < 8)
    assert velocity_gradient(frame)[core].mean(axis=0) == pytest.approx(RATE, abs=0.005)
    options = PointOptions(cell=1.0, vertical_velocity="linear")
    result = columns_to_points(frame, ground, options)
    assert max(conservation_error(result.report.before, result.report.after)) < 1e-13
    affine = result.frame.state["affine"]
    assert np.trace(affine, axis1=1, axis2=2) == pytest.approx(np.zeros(len(affine)), abs=1e-12)
    back = points_to_columns(result.frame, ground).frame
    again = solver_of(back, ground)
    assert again.mass_start == pytest.approx(solver.mass_start, rel=1e-12)
    assert again.frame().particles.thickness == pytest.approx(frame.particles.thickness, rel=1e-9)
    across = -0.5 * frame.particles.thickness * np.trace(velocity_gradient(frame), axis1=1, axis2=2)  # mean of `linear`
    kept = frame.particles.velocity[:, :2] - np.outer(across, [0.3 / (1 + 0.3**2), 0.0])
    assert again.frame().particles.velocity[:, :2] == pytest.approx(kept, abs=1e-12)


@pytest.mark.parametrize("rows", [np.float64(3.0), np.zeros((4, 12)), np.zeros((3, 2)), np.zeros(3), np.array("rows")])
@pytest.mark.parametrize("name", ["rows", "velocity_gradient"])
def test_a_state_of_another_shape_is_ignored(name, rows):
    """As a damaged file has it: the columns are converted as if there were no state."""
    ground = terrain_of(slope(0.3, 0.0))
    still = columns_on(ground, 2.0, (0.0, 0.0))
    assert not velocity_gradient(replace(still, state={name: rows})).any()
    assert replace(still, state={"told": np.ones((len(still.particles), 3))}).particle_state("told", 3).all()
