"""Rows of nodes around smooth sides of barriers: they meet the side exactly for any position, angle and cell size."""

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.solvers.features.walls import WIDENED_IN_3D, Wall, half_thickness, margin_in_3d, wall_nodes
from mpmgis.solvers.points.barrier_faces import faces_of

CELLS = 40


def faces_on(walls, cell, rough=None, elevation=0.0, rise=(0.0, 0.0)):
    """(list of Face, x, y) on a square grid of cells of `cell` [m]; the ground is `rough` in places.

    The ground is a plane through `elevation` [m] that rises by `rise` [1] east and north.
    """
    x = y = (np.arange(CELLS) - 0.5 * CELLS) * cell
    bed = elevation + rise[0] * x[None, :] + rise[1] * y[:, None]
    nodes = wall_nodes(walls, x, y, bed, cell, margin_in_3d, WIDENED_IN_3D)
    smooth = np.ones(bed.shape, bool) if rough is None else ~rough
    return faces_of(nodes, bed, smooth, cell), x, y


def place_of(face, x, y, cell):
    """Place [m] at which a face meets its row."""
    place = np.array([x[face.i], y[face.j]])
    place[face.axis] += face.foot * cell
    return place


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(0.05, 20.0), st.floats(-500.0, 4000.0), st.floats(3.6, 9.0), st.floats(-0.4, 0.4))
def test_a_wall_has_its_faces_at_any_elevation_and_slope(cell, elevation, high, rise):
    """One for each row on both sides; their tops are between the ground and the crest.

    On a slope the ground before the wall is higher than under it, by up to three cells of the rise.
    """
    high += 3.0 * abs(rise)
    box = shapely.box(-2.0 * cell, -2 * CELLS * cell, 2.0 * cell, 2 * CELLS * cell)
    wall = Wall("dam", box, height=high * cell)
    faces = [face for face in faces_on((wall,), cell, None, elevation, (rise, 0.3 * rise))[0] if face is not None]
    assert {side: sum(face.out == side for face in faces) for side in (-1, 1)} == {-1: CELLS, 1: CELLS}
    for face in faces:
        ground = elevation + cell * (rise * (face.i - 0.5 * CELLS) + 0.3 * rise * (face.j - 0.5 * CELLS))
        assert 1.0 < (face.top - ground) / cell < high - 1.0


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(0.05, 20.0), st.floats(-0.5, 0.5), st.floats(0.0, 180.0), st.sampled_from([0.2, 3.0, 3.5, 6.0]))
def test_rows_meet_both_sides_of_a_wall_exactly(cell, offset, degrees, thick):
    """At least three cells apart, with the side's normal and no node column in two rows."""
    box = shapely.box(-0.5 * thick * cell, -2 * CELLS * cell, 0.5 * thick * cell, 2 * CELLS * cell)
    wall = Wall(
        "dam", shapely.affinity.translate(shapely.affinity.rotate(box, degrees), offset * cell), height=9 * cell
    )
    faces, x, y = faces_on((wall,), cell)
    across = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    half = 0.5 * thick * cell + margin_in_3d(half_thickness(wall.footprint), cell)
    columns, rows = [], {1: 0, -1: 0}
    for face in (face for face in faces if face is not None):
        side = np.sign(np.dot(face.normal, across))
        away = np.dot(place_of(face, x, y, cell) - [offset * cell, 0.0], across)
        assert away == pytest.approx(side * half, abs=1e-6 * cell)
        np.testing.assert_allclose(face.normal, side * across, atol=1e-6)
        assert -0.5 - 1e-6 <= face.foot <= 0.5 + 1e-6 and face.top == pytest.approx(6.4 * cell)
        columns += face.columns()
        rows[side] += 1
    assert len(columns) == len(set(columns))
    least = CELLS if min(np.abs(across)) < 0.4 else CELLS // 2  # oblique walls leave the grid through its other edges
    assert all(count >= least - 8 for count in rows.values())


def test_rows_beside_each_other_follow_each_other():
    """One run of faces for each side, and a gap between them."""
    faces, _, _ = faces_on((Wall("dam", shapely.box(-2.0, -99.0, 2.1, 99.0), height=9.0),), 1.0)
    gaps = [k for k, face in enumerate(faces) if face is None]
    assert len(faces) == 2 * CELLS + 1 and gaps == [CELLS]
    assert [face.j for face in faces[:CELLS]] == list(range(CELLS))


def test_no_rows_at_corners_openings_low_walls_and_on_rough_ground():
    short = shapely.box(-2.0, -5.0, 2.0, 5.0)
    faces, x, y = faces_on((Wall("dam", short, height=9.0),), 1.0)
    ends = np.array([2.0, 5.0]) + margin_in_3d(half_thickness(short), 1.0)
    for face in (face for face in faces if face is not None):
        place = np.abs(place_of(face, x, y, 1.0))
        assert place[face.axis] == pytest.approx(ends[face.axis], abs=1e-6)
        assert place[1 - face.axis] <= ends[1 - face.axis] - 0.9  # further out nodes are nearer to the other side
    assert not faces_on((Wall("step", shapely.box(-2.0, -99.0, 2.0, 99.0), height=3.4),), 1.0)[0]
    rough = np.zeros((CELLS, CELLS), bool)
    rough[:20] = True
    faces, _, _ = faces_on((Wall("dam", shapely.box(-2.0, -99.0, 2.0, 99.0), height=9.0),), 1.0, rough)
    assert {face.j for face in faces if face is not None} == set(range(20, CELLS))
    halves = (
        Wall("south", shapely.box(-2.0, -99.0, 2.0, -2.0), height=9.0),
        Wall("north", shapely.box(-2.0, 2.0, 2.0, 99.0), height=9.0),
    )
    faces, _, y = faces_on(halves, 1.0)
    assert all(abs(y[face.j]) > 2.0 for face in faces if face is not None and face.axis == 0)


@pytest.mark.parametrize("aside", [0.0, 0.25, 0.5])
def test_where_two_parts_of_a_wall_touch_in_a_point_there_is_no_face(aside):
    """Like an outline that crosses itself. Nodes between the parts have no side; the sides of both parts have faces."""
    one = shapely.Polygon([(-8.0, -12.0), (8.0, -12.0), (0.0, 0.0)])
    other = shapely.affinity.scale(one, yfact=-1.0, origin=(0.0, 0.0))
    hourglass = shapely.affinity.translate(shapely.MultiPolygon([one, other]), aside, aside)
    with np.errstate(divide="raise", invalid="raise"):
        faces = [face for face in faces_on((Wall("hourglass", hourglass, height=8.0),), 1.0)[0] if face is not None]
    assert faces and all(np.isfinite([face.foot, face.top]).all() for face in faces)
    assert all(np.hypot(*face.normal) == pytest.approx(1.0) for face in faces)
    assert {(np.sign(face.normal[0]), np.sign(face.normal[1])) for face in faces} >= {
        (-1, 1),
        (1, 1),
        (-1, -1),
        (1, -1),
    }
