"""What decides effects: the energy line's reach and the steepest way down, on ground where both are known."""

import itertools

import numpy as np
import pytest
from affine import Affine

from mpmgis.fields import GRAVITY
from mpmgis.geo.grid import Grid
from mpmgis.geo.reach import reach_facts, reach_of, release_facts, steepest_profile
from mpmgis.geo.terrain import Terrain


def terrain_of(height, length=2000.0, width=600.0, pixel=10.0):
    rows, columns = round(width / pixel), round(length / pixel)
    grid = Grid(None, Affine(pixel, 0, 0.0, 0, -pixel, width), (rows, columns))
    x, y = grid.xy(*np.mgrid[0:rows, 0:columns])
    return Terrain(grid, np.asarray(height(x, y), float) + 0 * x)


def ramp(x, y):
    """A slope of tan 0.5 for 1000 m, then flat."""
    return np.maximum(500.0 - 0.5 * x, 0.0)


RELEASE = np.array([[100.0, 280.0], [100.0, 320.0], [140.0, 280.0], [140.0, 320.0]])


def reached(terrain, mu):
    return reach_of(terrain, RELEASE, terrain.sample(*RELEASE.T), mu)


def test_the_energy_line_ends_drop_over_mu_away():
    terrain = terrain_of(ramp)
    facts_reach = reached(terrain, 0.4)
    inside, near = facts_reach.at(terrain.grid, np.array([1100.0, 1260.0, 1300.0, 1900.0, -50.0]), np.full(5, 300.0))
    # the line starts at 450 m above (120, 300) and is down after 1125 m, at E 1245; near is two release widths more
    assert inside.tolist() == [True, False, False, False, False]
    assert near.tolist() == [True, True, True, False, False]
    facts = reach_facts(terrain, facts_reach)
    assert facts["drop"] == pytest.approx(450.0, abs=5.0)
    assert facts["speed"] == pytest.approx(np.sqrt(2 * GRAVITY * (450.0 - 0.4 * 880.0)), rel=0.02)
    assert facts["slope_median"] == pytest.approx(0.5)
    assert facts["edge_distance"] == 0.0  # the line reaches the sides of this narrow terrain


def test_a_line_that_ends_before_the_edge_says_how_far():
    terrain = terrain_of(ramp, width=6000.0)
    around = RELEASE + np.array([0.0, 2700.0])
    reach = reach_of(terrain, around + np.array([300.0, 0.0]), np.full(4, 300.0), 0.45)
    assert reach_facts(terrain, reach)["edge_distance"] == pytest.approx(300.0, abs=150.0)


def test_ground_that_bends_away_counts_for_flight_and_a_plane_does_not():
    plane = terrain_of(lambda x, y: 1000.0 - 0.5 * x)
    assert reach_facts(plane, reached(plane, 0.2))["detachment_ratio"] < 1e-6
    brow = terrain_of(lambda x, y: 500.0 - 50.0 * np.exp((x - 1000.0) / 300.0) - 0.1 * x)
    assert reach_facts(brow, reached(brow, 0.05))["detachment_ratio"] > 0.5
    hollow = terrain_of(lambda x, y: 300.0 * np.exp(-x / 400.0))
    facts = reach_facts(hollow, reached(hollow, 0.1))
    assert facts["detachment_ratio"] < 0.05 < facts["centrifugal_ratio"]


def test_the_steepest_way_goes_down_the_ramp_and_out_of_a_pit():
    profile = np.array(steepest_profile(terrain_of(ramp), (105.0, 305.0), 0.4))
    assert profile[0] == pytest.approx((0.0, 447.5))
    assert len(profile) <= 200 and (np.diff(profile[:, 0]) > 0).all()
    downhill = profile[profile[:, 1] > 6.0]
    np.testing.assert_allclose(downhill[:, 1], 447.5 - 0.5 * downhill[:, 0], atol=1e-6)
    assert 1000.0 < profile[-1, 0] < 1300.0

    def pitted(x, y):
        return ramp(x, y) - 30.0 * np.exp(-((x - 500.0) ** 2 + (y - 305.0) ** 2) / 40.0**2)

    through = np.array(steepest_profile(terrain_of(pitted), (105.0, 305.0), 0.2))
    assert through[-1, 1] < 1.0


def plain_way_down(terrain, start_xy, mu):
    """The same search written as one says it, cell by cell: (way [m], elevation [m]) of all cells of the way."""
    elevation, spacing = terrain.elevation, terrain.grid.cell_size
    start = tuple(round(float(v)) for v in terrain.grid.rowcol(*start_xy))
    top, parent, way = float(elevation[start]), {start: None}, {start: 0.0}
    waiting, visited = {start}, []
    while waiting:
        cell = min(waiting, key=lambda c: (elevation[c], way[c], c))
        waiting.remove(cell)
        visited.append(cell)
        for i, j in itertools.product((-1, 0, 1), repeat=2):
            beside = (cell[0] + i, cell[1] + j)
            inside = 0 <= beside[0] < elevation.shape[0] and 0 <= beside[1] < elevation.shape[1]
            if not inside or beside in parent:
                continue
            length = way[cell] + float(np.hypot(i, j)) * spacing
            if elevation[beside] < top - mu * length + spacing:
                parent[beside], way[beside] = cell, length
                waiting.add(beside)
    depth = [float(elevation[cell]) for cell in visited]
    lowest = int(np.argmin(depth))
    shore = depth[lowest] + 0.02 * (top - depth[lowest])
    bottom = itertools.takewhile(lambda cell: elevation[cell] <= shore, visited[lowest:])
    cell, path = max(bottom, key=way.get), []
    while cell is not None:
        path.insert(0, (way[cell], float(elevation[cell])))
        cell = parent[cell]
    return path


@pytest.mark.parametrize("seed", range(12))
def test_the_way_down_random_ground_is_that_of_a_plain_search(seed):
    """On rough, stepped (equal heights), smooth and holed ground: the very numbers, thinned to what was asked for."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(5, 40, 2)
    height = rng.normal(size=(rows, columns)) * rng.choice([1.0, 20.0]) - 4.0 * np.arange(columns)
    height = np.round(height) if seed % 3 == 0 else height
    height[rng.random(height.shape) < (0.1 if seed % 2 else 0.0)] = np.nan
    grid = Grid(None, Affine(10, 0, 0.0, 0, -10, 10.0 * rows), (int(rows), int(columns)))
    start = tuple(float(v) for v in grid.xy(rows // 2, columns // 3))
    height[rows // 2, columns // 3] = np.nanmax(height)
    terrain, mu = Terrain(grid, height), float(rng.uniform(0.02, 0.3))
    plain = plain_way_down(terrain, start, mu)
    assert list(steepest_profile(terrain, start, mu, most_points=10_000)) == plain
    thinned = steepest_profile(terrain, start, mu, most_points=5)
    assert len(thinned) <= 5 and set(thinned) <= set(plain) and thinned[-1] == plain[-1]


def test_a_start_without_ground_has_no_profile():
    terrain = terrain_of(lambda x, y: np.where(x < 200.0, np.nan, 100.0))
    assert steepest_profile(terrain, (100.0, 300.0), 0.2) == ()


def test_a_release_is_as_long_as_its_rectangle():
    terrain = terrain_of(lambda x, y: 1000.0 - 0.5 * x)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(100.5, 200.0), np.arange(200.5, 230.0)))
    facts = release_facts(terrain, np.column_stack([x, y]), np.ones(len(x)), np.full(len(x), 3.0))
    assert facts["release_length"] == pytest.approx(100.0, rel=1e-3)
    assert facts["release_thickness"] == pytest.approx(3.0)
