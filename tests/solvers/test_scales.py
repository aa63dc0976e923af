"""One scene with cells of a millimetre to a hundred metres at any place of the map."""

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scaled_scenes import DENSITY, LONG, SLAB, WIDE, Scene

from mpmgis.conversion.conversion_options import ColumnOptions
from mpmgis.conversion.points_to_columns import points_to_columns
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.terrain.release_parts import require_on_terrain

SAME = 1e-6  # [cells]; [1] of masses
ONE = Scene(1.0)
POINT_SETS = ("lattice", "staggered", "jittered", "random", "halton")
COORDINATES = st.floats(-1e7, 1e7).map(lambda metres: round(metres, 3)) | st.sampled_from([0.0, -1e7, 1e7, 5_100_000.0])
SCENES = st.builds(
    Scene,
    st.floats(-3.0, 2.0).map(lambda power: 10.0**power) | st.sampled_from([1e-3, 4e-3, 5e-3, 8e-3, 0.05, 0.1]),
    COORDINATES,
    COORDINATES,
    st.integers(0, 30_000),
)


def require_same(frame, scene, other, reference):
    """Assert that the particles of `frame` have scaled positions and masses of frame `other` of scene `reference`."""
    mine, theirs = frame.particles, other.particles
    assert len(mine) == len(theirs)
    np.testing.assert_allclose(scene.in_cells(frame), reference.in_cells(other), atol=SAME)
    for name in ("mass", "volume"):
        np.testing.assert_allclose(getattr(mine, name) / scene.cell**3, getattr(theirs, name), rtol=SAME)


@given(SCENES, st.sampled_from(POINT_SETS), st.sampled_from([1, 4, 9, 16]))
@settings(max_examples=60, deadline=None)
def test_a_seed_is_the_same_in_any_size_at_any_place(scene, points, per_cell):
    frame = scene.seed(points, per_cell)
    require_same(frame, scene, ONE.seed(points, per_cell), ONE)
    assert len(frame.particles) == (SLAB[1] - SLAB[0]) * WIDE * per_cell
    if points != "jittered":  # its quads differ in area
        assert np.ptp(frame.particles.mass) <= 1e-9 * frame.particles.mass.max()  # the slope, out of rounded elevations


@given(SCENES)
@settings(max_examples=60, deadline=None)
def test_points_and_both_solvers_start_alike_in_any_size_at_any_place(scene):
    frame, expected = scene.points(), ONE.points()
    require_same(frame, scene, expected, ONE)
    assert np.ptp(frame.particles.mass) <= 1e-9 * frame.particles.mass.max()  # the slope, out of rounded elevations
    stress, reference = (each.state["vertical_stress"] for each in (frame, expected))
    np.testing.assert_allclose(stress / scene.cell, reference, rtol=SAME)
    for solver, other in ((scene.point_solver(), ONE.point_solver()), (scene.column_solver(), ONE.column_solver())):
        assert solver.grid.inside.shape == (WIDE, LONG) and solver.grid.inside.all()
        np.testing.assert_allclose(solver.grid.bed / scene.cell - scene.foot, other.grid.bed - ONE.foot, atol=SAME)
        require_same(solver.frame(), scene, other.frame(), ONE)
        assert solver.energy_start == pytest.approx(np.multiply(other.energy_start, scene.cell**4), rel=1e-5)


@given(SCENES)
@settings(max_examples=30, deadline=None)
def test_points_become_columns_alike_in_any_size_at_any_place(scene):
    """Points are a quarter of a cell from the cell borders: each cell has the same points in every scene."""
    made, expected = (
        points_to_columns(each.points(), each.terrain(), ColumnOptions(by="cell", cell=each.cell)).frame
        for each in (scene, ONE)
    )
    require_same(made, scene, expected, ONE)


@lru_cache(1000)
def flown(scene, name, seconds):
    """(steps, frame) of the solver `name` of `scene` after the scaled time of `seconds` [s] with cells of 1 m."""
    solver = getattr(scene, name)()
    solver.advance(scene.moved_by(seconds))
    return solver.step, solver.frame()


@given(SCENES)
@settings(max_examples=12, deadline=None)
def test_a_flow_is_the_same_by_froude_in_any_size_at_any_place(scene):
    """Lengths scale with the cells, times with their square root: weight, friction and stiffness per weight act."""
    for name, seconds, close in (("column_solver", 1.5, 1e-4), ("point_solver", 0.5, 1e-2)):  # rounding grows in 3D
        (step, frame), (steps, reference) = flown(scene, name, seconds), flown(ONE, name, seconds)
        assert step == steps > 5
        np.testing.assert_allclose(scene.in_cells(frame), ONE.in_cells(reference), atol=close)
        speed, expected = (each.particles.velocity[np.argsort(each.particles.id)] for each in (frame, reference))
        np.testing.assert_allclose(speed / np.sqrt(scene.cell), expected, atol=10.0 * close)
        assert np.abs(expected).max() > 0.1


@pytest.mark.parametrize("cell", [0.004, 0.005, 0.008, 0.05, 0.1, 0.3])
def test_the_laboratory_blocks_of_the_issue_have_1280_equal_points(cell):
    """10 x 4 x 4 cells with eight points each on a strip of the same width, at coordinates of a UTM zone."""
    scene = Scene(cell, 500_000.0, 5_100_000.0)
    assert len(scene.seed().particles) == 160
    mass = scene.point_solver().frame().particles.mass
    slope = np.sqrt(1.25)  # vertical thickness of four cells normal to the ground: round(8 sqrt(1.25)) = 9 points
    assert len(mass) == 160 * 9
    np.testing.assert_allclose(mass, DENSITY * 160 * 0.25 * 4.0 * slope * cell**3 / len(mass), rtol=1e-9)


def test_a_release_as_wide_as_the_terrain_is_on_it_and_one_a_cell_off_is_not():
    for east in (0.0, 612_345.678, -9_999_999.9):
        scene = Scene(0.001, east, -east)
        grid = scene.terrain().grid
        require_on_terrain(scene.release().parts[0], grid)
        ColumnGrid.on(scene.terrain(), 0.001)
        beyond = Scene(0.001, east, -east + 0.001).release().parts[0]
        with pytest.raises(Exception, match="leaves the terrain"):
            require_on_terrain(beyond, grid)
