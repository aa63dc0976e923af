"""Cliffs and kinks in 3D: distance and direction of the nearest ground, and contact with it."""

import numpy as np
import pytest
from column_scenes import terrain_of
from exact_solutions import G
from point_scenes import block_of, integrate_to, plane, points_on, sorted_points

from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import elastic
from mpmgis.solvers.points import ground_folds
from mpmgis.solvers.points.ground_folds import departure, folded_ground
from mpmgis.solvers.points.point_ground import AWAY, EXACT_X, FOLD_FIRST, FOLD_LEVEL, FOLD_LEVELS
from mpmgis.solvers.points.point_rows import GHOSTS
from mpmgis.system.errors import SceneError

ICE = elastic(6.7e6, 4e6)
DX, DROP, EDGE = 0.5, 10.0, 12.0
NODES = np.arange(-GHOSTS, 67) * DX  # places of the columns of nodes [m]
PROFILE = np.where(NODES < EDGE, DROP, np.where(NODES > EDGE, 0.0, 0.5 * DROP))  # the edge is between two pixels


def cliff(length=30.0, width=6.0, edge=EDGE, drop=DROP):
    """Level ground that drops at `edge` [m] by `drop` [m]."""
    return terrain_of(lambda x, y: np.where(x < edge, drop, 0.0), length, width, DX)


def ground_of(terrain):
    """The Ground of a solver on `terrain`, and the heights at its nodes."""
    frame = block_of((1.0, 1.0, 1.0), DX / 2, (20.0, 2.0, 30.0))
    return points_on(terrain, frame, DX, ICE, friction_law("Coulomb", 0.5))._known_ground


def entries(ground):
    """(row, column, height [m], AWAY and normal) of all nodes of columns on folds, one row a node."""
    rows, columns = np.nonzero(ground.folds[..., FOLD_LEVELS] if ground.folds.shape[0] > 1 else np.zeros((1, 1)))
    for j, i in zip(rows, columns, strict=True):
        first, lowest, levels = ground.folds[j, i, [FOLD_FIRST, FOLD_LEVEL, FOLD_LEVELS]]
        for level in range(levels):
            yield j, i, (lowest + level - GHOSTS) * DX, ground.exact[first + level]


def distance_from_lines(x, z, heights):
    """Distance [m] of (x, z) from the polyline of `heights` at nodes, by dense points on it."""
    s = np.linspace(0.0, len(heights) - 1.0, 400 * (len(heights) - 1) + 1)
    return np.hypot(s * DX - x, np.interp(s, np.arange(len(heights)), heights) - z).min()


def test_distances_from_a_straight_cliff_are_those_of_its_profile():
    """Within the spacing of the dense points, under and above the ground, with the sign of the side."""
    ground, profile, seen = ground_of(cliff()), PROFILE, 0
    for j, i, z, exact in entries(ground):
        if j == 8:
            near = slice(max(i - 4, 0), i + 5)  # what the solver looks at, and more
            away = distance_from_lines((i - near.start) * DX, z, profile[near])
            if away < 2.0 * DX:
                assert abs(exact[AWAY]) == pytest.approx(away, abs=0.03 * DX)
                assert exact[AWAY] == 0.0 or (exact[AWAY] > 0.0) == (z >= profile[i])
                assert np.linalg.norm(exact[EXACT_X:]) == pytest.approx(1.0, abs=1e-6)
                seen += 1
    assert seen > 30


def test_the_way_out_of_a_cliff_is_sideways():
    """Along the face, which is two cells wide, it is almost horizontal; on the plateau it is up."""
    ground, inside = ground_of(cliff()), int(np.flatnonzero(PROFILE == DROP)[-1]) + 1
    for j, i, z, exact in entries(ground):
        if j == 8 and i == inside and 1.0 <= z <= 4.0:
            assert exact[AWAY] < 0.0
            np.testing.assert_allclose(exact[EXACT_X:], [1.0, 0.0, 0.0], atol=0.15)
        if j == 8 and i == inside - 2 and abs(z - DROP) < 0.1:
            np.testing.assert_allclose(exact[EXACT_X:], [0.0, 0.0, 1.0], atol=1e-6)


def test_distances_from_a_twisted_ground():
    """Against dense points on the bilinear surface: the fans differ from it by at most an eighth of a cell's twist."""
    rng = np.random.default_rng(5)
    nodes = np.zeros((16, 16, 4))
    nodes[..., 0] = rng.uniform(0.0, 2.0, (16, 16))
    ground = folded_ground(nodes, nodes[..., 0], DX, 0.0)
    fine = np.linspace(4.0, 11.0, 281)
    v, u = np.meshgrid(fine, fine, indexing="ij")
    j, i = np.minimum(v.astype(int), 10), np.minimum(u.astype(int), 10)
    h, b, a = nodes[..., 0], v - j, u - i
    surface = (1 - b) * ((1 - a) * h[j, i] + a * h[j, i + 1]) + b * ((1 - a) * h[j + 1, i] + a * h[j + 1, i + 1])
    seen = 0
    for row, column, z, exact in entries(ground):
        if row in (7, 8) and column in (7, 8) and abs(exact[AWAY]) < 1.5 * DX:
            away = np.sqrt(((u - column) * DX) ** 2 + ((v - row) * DX) ** 2 + (surface - z) ** 2).min()
            assert abs(exact[AWAY]) == pytest.approx(away, abs=0.12)
            seen += 1
    assert seen > 10


@pytest.mark.parametrize("degrees", [0.0, 30.0, 68.0])
def test_planes_of_any_slope_have_no_folds(degrees):
    """On a plane (z - b) c is exact: no memory, and the solver uses no stored distances."""
    ground = ground_of(plane(degrees, length=40.0, width=10.0, height=100.0, pixel=DX))
    assert ground.folds.shape[:2] == (1, 1) and ground.exact.shape[0] == 1
    assert departure(ground.nodes, ground.nodes[..., 0], DX).max() < 0.01 * DX


def test_ground_too_rough_to_keep_is_refused(monkeypatch):
    """In one line with the share of the terrain that folds."""
    monkeypatch.setattr(ground_folds, "MOST_NODES", 100)
    with pytest.raises(SceneError, match=r"folds within a cell of 0\.5 m on [0-9]+ % of the terrain") as error:
        ground_of(cliff())
    assert "\n" not in str(error.value)


def falling(gap, mu=0.5, time=0.8):
    """A block that falls beside the cliff, its side `gap` [cells] before the foot; (solver, its start)."""
    foot = NODES[np.flatnonzero(PROFILE == 0.0)[0]]
    frame = block_of((2.0, 2.0, 2.0), DX / 2, (foot + gap * DX, 2.0, 6.0))
    solver = points_on(cliff(), frame, DX, ICE, friction_law("Coulomb", mu))
    start = sorted_points(solver).position
    integrate_to(solver, time)
    return solver, start


@pytest.mark.thorough
def test_nodes_next_to_a_cliff_have_no_contact_with_ground_metres_below():
    """A block falls freely a cell and a half before the foot of a cliff: no contact, no impulse. One cell before it
    the nodes within half a cell of the face take 3 of 62 000 N s."""
    solver, start = falling(1.5)
    moved = sorted_points(solver).position - start
    assert solver.balances()["ground_impulse"] == [0.0, 0.0, 0.0]
    assert np.abs(moved[:, :2]).max() <= 1e-9
    assert moved[:, 2].mean() == pytest.approx(-0.5 * G * 0.8**2, rel=0.01)


def test_a_block_that_runs_into_a_cliff_is_stopped_by_its_face():
    """8 m/s against the foot of 10 m: it comes back or stops, the face takes its momentum, and it is not thrown up."""
    terrain = cliff()
    frame = block_of((3.0, 2.0, 2.0), DX / 2, (16.0, 2.0, 0.0), velocity=(-8.0, 0.0, 0.0))
    solver = points_on(terrain, frame, DX, ICE, friction_law("Coulomb", 0.0))
    integrate_to(solver, 1.2)
    now, balances = sorted_points(solver), solver.balances()
    assert now.position[:, 0].min() > EDGE - DX  # outside the face
    assert now.velocity[:, 0].mean() > -0.1  # stopped or thrown back
    assert balances["ground_impulse"][0] >= 0.98 * 8.0 * balances["mass_start"]
    assert now.position[:, 2].max() < 2.0 + 2.0 * DX  # no point is lifted over it
    assert balances["mass_lifted_onto_ground"] == 0.0 and balances["momentum_error_relative"] <= 1e-10
