"""Barriers drawn in pieces, or with corners on nodes: they have the same sides as one whole barrier."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
import shapely.affinity
from column_scenes import terrain_of
from exact_solutions import G
from hypothesis import given, settings
from hypothesis import strategies as some
from point_scenes import block_of, integrate_to, points_on

from mpmgis.laws.material import fluid
from mpmgis.solvers.features.walls import Wall, half_thickness, joined_footprints, margin_in_3d, margin_of, wall_nodes

LENGTH, THICK = 24.0, 4.0  # of a dam [m]; cells are 1 m


def nodes_of(walls, reach=32, margin_of=margin_of):
    x = np.arange(-reach, reach + 1.0)
    return wall_nodes(walls, x, x, np.zeros((len(x), len(x))), 1.0, margin_of)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    some.lists(some.integers(2, 18).map(lambda k: k / 20), min_size=1, max_size=4, unique=True),
    some.floats(0.0, 360.0),
    some.tuples(*[some.floats(-0.5, 0.5)] * 2),
    some.floats(0.0, 1.0),
    some.sampled_from([margin_of, margin_in_3d]),
)
def test_pieces_that_touch_or_overlap_have_the_sides_of_the_whole(cuts, degrees, place, overlap, margin):
    """Wherever a dam is cut, in any direction: same nodes, depths and normals, and each node belongs to its piece."""
    cuts = LENGTH * np.array([0.0, *sorted(cuts), 1.0])

    def placed(west, east):
        box = shapely.box(max(west - overlap, 0.0), 0.0, east, THICK)
        return shapely.affinity.translate(shapely.affinity.rotate(box, degrees, origin=(0.0, 0.0)), *place)

    pieces = tuple(Wall(f"part {k}", placed(*ends), height=5.0) for k, ends in enumerate(pairwise(cuts)))
    whole = Wall("dam", placed(0.0, LENGTH), height=5.0)
    for footprint, half in joined_footprints(pieces):
        assert footprint.symmetric_difference(whole.footprint).area <= 1e-4
        assert half == pytest.approx(half_thickness(whole.footprint), abs=1e-5)
    found, expected = nodes_of(pieces, margin_of=margin), nodes_of((whole,), margin_of=margin)
    known = (found.number > 0) & (expected.number > 0)
    either = (found.number > 0) != (expected.number > 0)
    assert (np.maximum(found.depth, expected.depth)[either] <= 1e-9).all()  # on the rim
    np.testing.assert_allclose(found.depth[known], expected.depth[known], atol=1e-5)
    same = (found.normal * expected.normal).sum(axis=-1)[known]
    assert ((same > 0.9999) | (same < -0.9999)).all()  # in the middle both sides are equally near
    assert (expected.depth[known][same < 0.0] >= 0.5 * THICK - 1e-6).all()
    x, y = np.meshgrid(np.arange(-32, 33.0), np.arange(-32, 33.0))
    for k, wall in enumerate(pieces, 1):
        inside = shapely.contains_xy(wall.footprint.buffer(-overlap - 0.01), x, y)
        assert (found.number[inside] == k).all()


@settings(max_examples=25, deadline=None, derandomize=True)
@given(some.floats(0.3, 2.0), some.floats(5.0, 12.0), some.floats(-8.0, 8.0), some.floats(0.0, 360.0))
def test_a_thin_wall_beside_or_through_a_thick_one_stays_thin(thin, thick, place, degrees):
    """It is widened as a single wall: with the thickness of both walls together, flow would pass through it."""
    wall = shapely.box(-12.0, -0.5 * thin, 12.0, 0.5 * thin)
    block = shapely.box(place - 0.5 * thick, -0.5 * thick, place + 0.5 * thick, 0.5 * thick)
    shapes = [shapely.affinity.rotate(shape, degrees, origin=(0.0, 0.0)) for shape in (wall, block)]
    walls = [Wall(str(k), shape, height=5.0) for k, shape in enumerate(shapes)]
    halves = [half for _, half in joined_footprints(walls)]
    assert halves[0] <= 0.5 * thin + 1e-6 and halves[1] > halves[0]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(some.integers(1, 6), some.integers(1, 6), some.sampled_from([0.0, 0.5, 0.25]), some.booleans())
def test_a_box_with_corners_on_nodes_has_mirrored_normals(wide, deep, place, octagon):
    """Nodes on a corner or equally far from two sides have the normal between those of both."""
    box = shapely.box(place - wide, place - deep, place + wide, place + deep)
    if octagon:
        box = box.intersection(shapely.affinity.rotate(shapely.box(*box.bounds).buffer(0.4 * wide), 45.0))
    for mirrored, sign, flip in (
        (shapely.affinity.scale(box, -1.0, 1.0, origin=(0.0, 0.0)), (-1.0, 1.0), np.fliplr),
        (shapely.affinity.scale(box, 1.0, -1.0, origin=(0.0, 0.0)), (1.0, -1.0), np.flipud),
    ):
        one, other = (nodes_of((Wall("pier", shape, height=5.0),), 12) for shape in (box, mirrored))
        np.testing.assert_array_equal(one.number, flip(other.number))
        outer = (one.number > 0) & (one.share == 0.0) & (one.depth < 0.9 * one.depth.max())
        np.testing.assert_allclose(one.normal[outer], (flip(other.normal) * sign)[outer], atol=1e-9)


def test_the_normal_at_a_corner_on_a_node_is_the_bisector():
    """It was the normal of one side: a flow along the grid pushed a square pier with whole coordinates sideways."""
    nodes = nodes_of((Wall("pier", shapely.box(-4.0, -4.0, 4.0, 4.0), height=5.0),), 12)
    for east, north in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        for away in (3, 4):
            at = 12 + north * away, 12 + east * away
            np.testing.assert_allclose(nodes.normal[at], np.array([east, north]) / np.sqrt(2.0), atol=1e-9)


def forces(walls, cell, speed, points, extent, begin, end):
    """(impulse east, north, along the normals) [N s] on all `walls` between two times, of water 1 m deep."""
    frame = block_of((extent, extent, 1.0), 0.5 * cell, velocity=(speed, 0.0, 0.0))
    frame = type(frame)(frame.particles.take(points(*frame.particles.position[:, :2].T)), dimension=3)
    stress = np.zeros((len(frame.particles.id), 6))
    stress[:, :3] = -1000.0 * G * (1.0 - frame.particles.position[:, 2:])
    terrain = terrain_of(lambda x, y: 0.0 * x, extent, extent, 1.0)
    solver = points_on(terrain, frame, cell, fluid(1000.0 * 60.0**2, 0.0, 0.0), stress=stress, walls=walls)
    sums = []
    for time in (begin, end):
        integrate_to(solver, time)
        booked = solver.balances()["barriers"].values()
        names = "impulse_east", "impulse_north", "normal_impulse"
        sums.append([sum(barrier[name] for barrier in booked) for name in names])
    return np.diff(sums, axis=0)[0]


@pytest.mark.parametrize("width", [2.0, pytest.param(3.0, marks=pytest.mark.thorough)])
def test_a_square_pier_on_nodes_is_not_pushed_sideways(width):
    """A symmetric stream: the lateral force was 18 to 30 % of the drag if corners were on nodes."""
    half = 0.5 * width
    pier = Wall("pier", shapely.box(16.0 - half, 16.0 - half, 16.0 + half, 16.0 + half), height=20.0)
    drag, across, _ = forces(
        (pier,), 0.5, 8.0, lambda x, y: (np.abs(y - 16.0) < 6.0) & (x < 14.0) & (x > 4.0), 32.0, 0.5, 1.0
    )
    assert drag > 0.0 and abs(across) <= 1e-3 * drag


@pytest.mark.parametrize("parts", [2, pytest.param(4, marks=pytest.mark.thorough)])
def test_a_deflecting_dam_in_pieces_bears_what_the_whole_does(parts):
    """15 degrees to a stream of Froude number 4: the edges between pieces acted like walls, and the force was 2.4 to
    3.6 times that on one polygon."""
    ahead, outward = (
        np.array([f(np.radians(15.0)) for f in pair]) for pair in ((np.cos, np.sin), (np.sin, lambda t: -np.cos(t)))
    )
    foot, length, thick = np.array([20.0, 12.0]), 10.0, 3.0

    def dam(begin, end):
        ends = [foot + ahead * length * share for share in (begin, end)]
        return shapely.Polygon([ends[0], ends[1], ends[1] + thick * outward, ends[0] + thick * outward])

    back = foot + thick * np.array([np.tan(np.radians(7.5)), -1.0])
    guide = shapely.Polygon([(2.0, 12.0), foot, foot + thick * outward, back, (2.0, 9.0)])
    shares = np.linspace(0.0, 1.0, parts + 1)
    pieces = [dam(*pair) for pair in pairwise(shares)]
    loads = [
        forces(
            tuple(Wall(f"part {k}", shape, height=20.0) for k, shape in enumerate(shapes)),
            0.5,
            4.0 * np.sqrt(G),
            lambda x, y: (x > 4.0) & (x < 19.0) & (y > 12.05) & (y < 23.0),
            40.0,
            0.8,
            1.2,
        )
        for shapes in ([shapely.union_all([guide, dam(0.0, 1.0)])], [guide, *pieces])
    ]
    np.testing.assert_allclose(loads[1], loads[0], rtol=0.05)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    some.floats(0.05, 9.0),
    some.floats(-0.5, 0.5),
    some.sampled_from([0, 90, 180, 270]),
    some.floats(6.0, 20.0),
    some.sampled_from([margin_of, margin_in_3d]),
)
def test_what_crosses_a_wall_is_counted_once(thickness, place, degrees, length, margin):
    """The weights along each line across a wall sum to 1, for any thickness, length and position of the nodes."""
    box = shapely.box(place, -length, place + thickness, length)
    wall = Wall("dam", shapely.affinity.rotate(box, degrees, origin=(0.0, 0.0)), height=5.0)
    weight = nodes_of((wall,), margin_of=margin).weight
    across = weight.sum(axis=1 if degrees % 180 == 0 else 0)[32 - 2 : 32 + 3]  # lines through the wall's middle
    np.testing.assert_allclose(across, 1.0, atol=1e-6)


@pytest.mark.parametrize("degrees", [20, 45])
@pytest.mark.parametrize("thickness", [0.3, 1.7, 2.6, 3.4, 6.0])
def test_what_crosses_an_oblique_wall_is_counted_once_in_the_mean(thickness, degrees):
    """Sum of the weights over the nodes of a long wall, over its length, within 5 %."""
    box = shapely.affinity.rotate(shapely.box(0.0, -60.0, thickness, 60.0), degrees, origin=(0.0, 0.0))
    walls = (Wall("dam", box, height=5.0),)
    weight = nodes_of(walls, margin_of=margin_in_3d).weight
    y = np.arange(-32.0, 33.0)
    length = 19.0 / np.cos(np.radians(degrees))  # of the wall in 19 rows of nodes
    assert weight[np.abs(y) < 10.0].sum() == pytest.approx(length, rel=0.05)
