"""Inner corners of barriers: rows of nodes reach into them exactly, and a pool between four walls keeps its load."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from column_scenes import terrain_of
from exact_solutions import G
from hypothesis import example, given, settings
from hypothesis import strategies as some
from point_scenes import block_of, load_between, points_on
from test_barrier_face_rows import CELLS, faces_on, place_of

from mpmgis.laws.material import fluid
from mpmgis.solvers.features.walls import Wall, half_thickness, margin_in_3d
from mpmgis.solvers.points.point_faces import COLUMNS, FACE_FOLLOWS, FACE_NEXT, FACE_TAKEN

DENSITY = 1000.0


def wedge(degrees, opening, apex, far=500.0):
    """The part of the plane between two rays from `apex`, at `degrees` and `degrees + opening` from east."""
    angles = np.radians(np.linspace(degrees, degrees + opening, 20))
    return shapely.Polygon([apex, *(apex + far * np.column_stack([np.cos(angles), np.sin(angles)]))])


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    some.floats(0.05, 20.0),
    some.floats(0.0, 360.0),
    some.floats(35.0, 140.0),
    some.floats(-1.0, 1.0),
    some.floats(-1.0, 1.0),
)
@example(1.0, 270.0, 91.0, -0.75, 0.0)  # the node behind the corner is nearest to it, 0.1 degrees beside the normal
def test_rows_reach_into_an_inner_corner(cell, degrees, opening, east, north):
    """Each has the plane and the normal of one of both sides; the rows of a side reach the corner to within a cell."""
    apex = cell * np.array([east, north])
    box = shapely.box(*(0.8 * CELLS * cell * np.array([-1.0, -1.0, 1.0, 1.0])))
    wall = Wall("dam", box.difference(wedge(degrees, opening, apex, 500.0 * cell)), height=9.0 * cell)
    faces, x, y = faces_on((wall,), cell)
    faces = [face for face in faces if face is not None]
    first, second = np.radians([degrees, degrees + opening])
    normals = np.array([[-np.sin(first), np.cos(first)], [np.sin(second), -np.cos(second)]])
    margin = margin_in_3d(half_thickness(wall.footprint), cell)
    corner = np.linalg.solve(normals, [margin, margin]) + apex
    nearest = [np.inf, np.inf]
    for face in faces:
        side = int(np.argmax(normals @ face.normal))
        np.testing.assert_allclose(face.normal, normals[side], atol=1e-6)
        place = place_of(face, x, y, cell)
        nearest[side] = min(nearest[side], np.abs(place - corner).max() / cell)
        place[1 - face.axis] += face.along * cell
        assert np.dot(place - apex, normals[side]) == pytest.approx(margin, abs=1e-6 * cell)
        assert 0.0 < face.spread <= 1.0
    assert max(nearest) < 1.0


def off_the_rim(basin):
    """Largest distance [cells] of a row's place from the rim of the wall around `basin` (cells of 1 m), number of rows,
    and whether two rows are the same."""
    wall = Wall("dam", shapely.box(-35.0, -35.0, 35.0, 35.0).difference(basin), height=9.0)
    faces, x, y = faces_on((wall,), 1.0)
    faces = [face for face in faces if face is not None]
    widened = wall.footprint.buffer(
        margin_in_3d(half_thickness(wall.footprint), 1.0), join_style="mitre", mitre_limit=50.0
    )
    places = np.array([place_of(face, x, y, 1.0) for face in faces])
    places[np.arange(len(faces)), [1 - face.axis for face in faces]] += [face.along for face in faces]
    rows = {(face.j, face.i, face.axis, face.out, *np.round(face.normal, 6)) for face in faces}
    off = widened.boundary.distance(shapely.points(places))
    return max(off, default=0.0), len(faces), len(rows) < len(faces)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(some.integers(5, 60), some.floats(9.0, 15.0), some.floats(0.0, 360.0))
def test_rows_stay_on_curved_walls(sides, radius, degrees):
    """A half-circle of `sides` corners whose ends meet a straight side."""
    angles = np.linspace(0.0, np.pi, sides)
    basin = shapely.Polygon(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    off, rows, twice = off_the_rim(shapely.affinity.rotate(basin, degrees, origin=(0.0, 0.0)))
    assert off <= 0.2 and rows > radius and not twice


@settings(max_examples=25, deadline=None, derandomize=True)
@given(some.floats(5.0, 28.0), some.floats(2.0, 8.0), some.floats(0.0, 360.0))
def test_rows_stay_on_a_wall_with_a_kink_before_a_corner(kink, length, degrees):
    """The side turns by `kink` degrees `length` cells before it meets another."""
    east, north = length * np.cos(np.radians(kink)), length * np.sin(np.radians(kink))
    basin = shapely.Polygon([(-18.0, 0.0), (0.0, 0.0), (east, north), (east, 18.0), (-18.0, 18.0)])
    off, _, twice = off_the_rim(shapely.affinity.rotate(basin, degrees, origin=(0.0, 0.0)))
    assert off <= 0.2 and not twice


@settings(max_examples=25, deadline=None, derandomize=True)
@given(some.floats(2.2, 6.0), some.floats(0.0, 360.0))
def test_rows_stay_on_the_sides_of_a_narrow_basin(width, degrees):
    basin = shapely.affinity.rotate(shapely.box(-0.5 * width, 0.0, 0.5 * width, 99.0), degrees, origin=(0.0, 0.0))
    off, _, twice = off_the_rim(basin)
    assert off <= 0.2 and not twice


def test_rows_of_an_outer_corner_stay_whole():
    """The sides of a convex pier end before its corners."""
    faces, _, _ = faces_on((Wall("pier", shapely.box(-6.0, -5.0, 6.0, 5.0), height=9.0),), 1.0)
    whole = [face for face in faces if face is not None]
    assert whole and all((face.along, face.shift, face.spread) == (0.0, 0.0, 1.0) for face in whole)


def pool(azimuth, cell=0.125, length=1.5, width=1.0, gap=1.8, viscosity=0.0, **numerics):
    """(PointSolver, hydrostatic load on all walls [N], level [m]) of water that starts with a gap of `gap` cells before
    four walls around `length` x `width` m, at `azimuth` [degrees] to the grid, without stress."""
    ring = shapely.affinity.rotate(shapely.box(0.0, 0.0, length, width), azimuth)
    outside = shapely.affinity.rotate(shapely.box(-0.6, -0.6, length + 0.6, width + 0.6), azimuth)
    west, south, east, north = outside.buffer(0.6).bounds
    cells = np.ceil([(east - west) / cell, (north - south) / cell])
    ring, outside = (shapely.affinity.translate(shape, -west, -south) for shape in (ring, outside))
    frame = block_of((*(cells * cell), 0.625), 0.5 * cell, density=DENSITY)
    inside = shapely.contains_xy(ring.buffer(-gap * cell, join_style="mitre"), *frame.particles.position[:, :2].T)
    frame = replace(frame, particles=frame.particles.take(inside))
    terrain = terrain_of(lambda x, y: 0.0 * x, *(cells * cell), cell)
    walls = (Wall("dam", outside.difference(ring), height=2.0),)
    water = fluid(DENSITY * G * 0.625 * 100.0, viscosity, 0.0)
    solver = points_on(terrain, frame, cell, water, walls=walls, edges="wall", **numerics)
    level = frame.particles.volume.sum() / (length * width)
    return solver, 0.5 * DENSITY * G * level**2 * 2.0 * (length + width), level


@pytest.mark.parametrize(("azimuth", "begin", "least"), [(0.0, 10.0, 0.97), (30.0, 5.0, 0.95)])
def test_a_pool_between_four_walls_keeps_its_load(azimuth, begin, least):
    """Before, points crept into the walls at the corners."""
    solver, hydrostatic, _ = pool(azimuth)
    found = load_between(solver, begin, begin + 5.0) / hydrostatic
    print(azimuth, found)
    assert least <= found <= 1.05


def test_faces_that_share_node_columns_settle_together_and_meet_the_ground_once():
    solver, _, _ = pool(30.0)
    faces, chained = solver._faces, 0
    for f, face in enumerate(faces):
        if face[FACE_NEXT] > 0.0:
            assert faces[int(face[FACE_NEXT]) - 1, FACE_FOLLOWS] == 1.0 and int(face[FACE_NEXT]) - 1 > f
            chained += 1
    assert chained == (faces[:, FACE_FOLLOWS] > 0.0).sum() > 0
    assert 0 < (faces[:, FACE_TAKEN] > 0.0).sum() < len(faces)
    assert faces[:, FACE_TAKEN].max() < 2**COLUMNS
