"""What decides effects: the energy line's reach and the steepest way down, on ground where both are known."""

import itertools

import numpy as np
import pytest
from affine import Affine

from mpmgis.laws.quantities import GRAVITY
from mpmgis.terrain.elevation import Terrain, continued
from mpmgis.terrain.flow_reach import reach_facts, reach_of, release_facts, steepest_profile
from mpmgis.terrain.grid import Grid


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


def test_a_line_that_ends_before_the_edge_reports_the_distance():
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


def test_speed_at_the_start_is_head_on_the_energy_line():
    """40 m/s are 81.6 m: on level ground with mu = 0.2 the line ends 408 m away, and its speed is that of the start."""
    plain = terrain_of(lambda x, y: 0.0 * x + 100.0, width=2000.0)
    at = RELEASE + np.array([900.0, 700.0])
    head = 40.0**2 / (2.0 * GRAVITY)
    still = reach_of(plain, at, plain.sample(*at.T), 0.2)
    fast = reach_of(plain, at, plain.sample(*at.T), 0.2, np.array([0.0, 0.0, head, 0.0]))
    x = 1020.0 + np.array([0.0, 380.0, 430.0])
    assert fast.below_line(plain.grid, x, np.full(3, 1000.0)).tolist() == [True, True, False]
    assert not still.below_line(plain.grid, x, np.full(3, 1000.0))[1:].any()
    facts = reach_facts(plain, fast)
    assert facts["speed"] == pytest.approx(40.0, rel=0.01) and facts["drop"] == 0.0
    assert facts["edge_distance"] == pytest.approx(1000.0 - 408.0 - 20.0, abs=50.0)


@pytest.mark.parametrize("seed", range(10))
def test_a_plane_bends_nowhere_whatever_its_size_collar_and_holes(seed):
    """Nor would a flow take off from it: 0 to round-off at speeds of 40 to 140 m/s."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(2, 160, 2)
    pixel, (a, b) = float(rng.uniform(0.5, 30.0)), rng.uniform(-1.0, 1.0, 2)
    grid = Grid(None, Affine(pixel, 0, 0.0, 0, -pixel, pixel * rows), (int(rows), int(columns)))
    x, y = grid.xy(*np.mgrid[0:rows, 0:columns])
    height = 1500.0 + a * x + b * y
    if seed % 2:
        collar = rng.integers(0, 1 + min(rows, columns) // 3)
        height[:collar], height[rows - collar :] = np.nan, np.nan
        height[:, : collar // 2] = np.nan
    height[rng.random(height.shape) < rng.choice([0.0, 0.02, 0.3])] = np.nan
    known = np.argwhere(np.isfinite(height))
    some = known[rng.integers(0, len(known), 5)]
    terrain = Terrain(grid, height)
    xy = np.column_stack(grid.xy(some[:, 0], some[:, 1]))
    facts = reach_facts(terrain, reach_of(terrain, xy, height[tuple(some.T)], 0.1, rng.uniform(80.0, 1000.0)))
    assert facts["centrifugal_ratio"] < 1e-8 and facts.get("detachment_ratio", 0.0) < 1e-8


def test_a_continued_plane_is_the_plane():
    rng = np.random.default_rng(1)
    row, column = np.mgrid[0:30, 0:40]
    plane = 800.0 - 2.0 * row + 0.5 * column
    holed = np.where(rng.random(plane.shape) < 0.5, np.nan, plane)
    around = continued(holed, 7)
    row, column = np.mgrid[-7:37, -7:47]
    np.testing.assert_allclose(around, 800.0 - 2.0 * row + 0.5 * column, atol=1e-9)


def test_ground_that_falls_behind_a_ridge_is_in_reach():
    """The line ends on the gentle slope behind; what creeps on there leaves the terrain, so the edge is in reach."""

    def ridge(x, y):
        return 300.0 - 0.5 * np.minimum(x, 500.0) - 0.05 * np.maximum(x - 500.0, 0.0) + 0.02 * np.abs(y - 3000.0)

    terrain = terrain_of(ridge, length=4000.0, width=6000.0)
    at = RELEASE + np.array([0.0, 2700.0])
    facts = reach_facts(terrain, reach_of(terrain, at, terrain.sample(*at.T), 0.3))
    assert facts["line_edge_distance"] > 90.0 and facts["edge_distance"] == 0.0


def test_a_place_uphill_of_the_release_is_not_in_reach_unless_it_starts_uphill():
    """Not even near it: 60 m above the highest part of the release. With 40 m/s it could get there."""
    terrain = terrain_of(lambda x, y: 1000.0 - 0.5 * x, width=2000.0)
    at = RELEASE + np.array([800.0, 700.0])
    uphill = np.array([780.0]), np.array([1000.0])
    still = reach_of(terrain, at, terrain.sample(*at.T), 0.2)
    assert not np.any(still.at(terrain.grid, *uphill))
    fast = reach_of(terrain, at, terrain.sample(*at.T), 0.2, 40.0**2 / (2.0 * GRAVITY))
    assert np.any(fast.at(terrain.grid, *uphill))


def test_areas_that_lie_apart_have_a_line_each():
    """A low source far from a high one does not carry the high one's energy, nor does it lose its own."""
    terrain = terrain_of(lambda x, y: 0.0 * x + 100.0, length=6000.0, width=600.0)
    both = np.concatenate([RELEASE, RELEASE + np.array([4000.0, 0.0])])
    head = np.array([100.0] * 4 + [10.0] * 4)
    reach = reach_of(terrain, both, terrain.sample(*both.T), 0.2, head)
    x = np.array([120.0 + 480.0, 120.0 + 540.0, 4120.0 - 40.0, 4120.0 + 90.0])
    assert reach.below_line(terrain.grid, x, np.full(4, 300.0)).tolist() == [True, False, True, False]
