"""Hard cases of the depth-averaged solver (numbers in README.md).

Besides what a case asserts itself, `Watch` holds mass, energy, and the speed that energy allows.
"""

import numpy as np
import pytest
from column_scenes import G, columns_of, joined, terrain_of
from hard_scenes import EDGES, Watch, along_the_bed, box_of_columns, columns_on
from point_scenes import sorted_points
from scene_strategies import Box, ColumnScene, Ground

from mpmgis.laws.curvature import CURVATURE
from mpmgis.laws.effect_slots import ColumnEffects
from mpmgis.laws.friction import friction_law
from mpmgis.simulation.time_integration import TimeIntegration
from mpmgis.solvers.columns import column_time_step
from mpmgis.solvers.columns.column_solver import ColumnNumerics, ColumnSolver
from mpmgis.terrain.elevation import Terrain

pytestmark = pytest.mark.usefixtures("one_thread")


def level(x, y):
    """Level ground."""
    return 0.0 * x


def falling(degrees):
    """A plane that falls to the east."""
    return lambda x, y: -np.tan(np.radians(degrees)) * x


def test_a_flow_over_a_vertical_cliff_keeps_its_mass_and_is_reported():
    """H1: 60 m vertically in one cell: no abort, no column faster than its drop allows in any frame; the share of the
    mass whose speed was limited is reported."""

    def cliff(x, y):
        return np.where(x < 80, 60.0, 0.0) - 0.5 * x

    solver = columns_on(cliff, columns_of(2.0, 10, 60, 20, 80, 1.25), mu=0.1)
    watch = Watch(solver, EDGES)
    for _ in TimeIntegration(solver, 10.0, 1.0):
        watch.look()
    assert solver.frame().particles.position[:, 0].mean() > 100.0 or solver.balances()["mass_out"] > 0.0
    assert solver.balances()["speed_limited_share_max"] > 0.0


def test_a_thin_sheet_on_high_steps_continues():
    """H1, H2: 0.1 mm of frictionless water on steps of 10 m. At an edge the grid gives a column above it the speed of a
    column that falls beside it, far above the limit for 0.1 mm: its speed is limited, and the run does not end as too
    fast (found by `test_random_scenes`)."""
    scene = ColumnScene(
        Ground("steps", 5.0, 0.0, 10.0, 0.5, 0, 200.0, 100.0),
        (Box(0.0, 0.2, 0.3, 0.6, 1e-4, 4, 0.0, 0.0),),
        mu=0.0,
        xi=1e12,
        cfl=0.1,
        edges="wall",
    )
    Watch(scene.solver()).march(4.0)


def test_a_thin_layer_is_stopped_by_friction():
    """H2: 0.1 mm at 5 m/s on a slope of 20 degrees with mu = 0.6 stops after v^2 / (2 g (mu cos - sin)) and stays."""
    solver = columns_on(falling(20), columns_of(1e-4, 40, 60, 40, 60, 1.25, velocity=(5.0, 0.0)), mu=0.6)
    start = sorted_points(solver).position
    Watch(solver).march(20.0)
    slope, speed2 = np.radians(20), 25.0 / np.cos(np.radians(20)) ** 2
    way = speed2 / (2 * G * (0.6 * np.cos(slope) - np.sin(slope))) * np.cos(slope)
    after = sorted_points(solver)
    assert np.all(after.velocity == 0.0)
    assert (after.position - start)[:, 0].mean() == pytest.approx(way, rel=0.05)  # the distance is 2.8 % shorter


def test_one_column_alone_stays_a_point_on_rough_ground():
    """H3: a single column on a slope with a wall of 2 m in its path: finite, speed within its energy."""
    solver = columns_on(
        lambda x, y: falling(30)(x, y) + np.where((x > 90) & (x < 100), 2.0, 0.0),
        columns_of(0.5, 40, 45, 50, 55, 5.0),
        mu=0.05,
    )
    Watch(solver).march(8.0)


def test_nodes_with_next_to_no_mass_give_no_wild_velocities():
    """H4: a film of 1e-12 m beside a pile of 1 m on level ground: velocities stay finite, momentum is kept."""
    pile, film = columns_of(1.0, 60, 100, 30, 70, 2.5), columns_of(1e-12, 100, 160, 30, 70, 2.5)
    solver = columns_on(level, joined(pile, film), mu=0.0)
    Watch(solver).march(3.0)
    p = solver.frame().particles
    assert np.linalg.norm((p.mass[:, None] * p.velocity).sum(axis=0)) <= 1e-9 * p.mass.sum()
    assert np.linalg.norm(p.velocity, axis=1).max() <= 2.0 * np.sqrt(G) * np.sqrt(1.05)


def test_a_hole_in_the_terrain_takes_what_falls_in():
    """H10: nodata in the path of the flow: the mass balance closes, the rest passes beside it."""
    terrain = terrain_of(falling(20), 200.0, 100.0, 5.0)
    elevation = terrain.elevation.copy()
    elevation[8:12, 20:24] = np.nan
    terrain = Terrain(terrain.grid, elevation)
    frame = along_the_bed(columns_of(1.0, 30, 70, 20, 80, 1.25), terrain, 5.0)
    effects = ColumnEffects(friction=friction_law("Voellmy", 0.1, 1e12), curvature=CURVATURE)
    solver = ColumnSolver(frame, terrain, effects, ColumnNumerics(5.0, stop_at_rest=False))
    Watch(solver).march(12.0)
    out = solver.balances()["outflow"]
    assert 0.0 < out["nodata"]["mass"] <= 0.5 * solver.mass_start
    assert solver.frame().particles.mass.sum() + out["east"]["mass"] >= 0.45 * solver.mass_start


def test_friction_above_the_slope_holds_for_a_hundred_seconds():
    """H12: no displacement in 100 s on 35 degrees; with the stop rule the run ends early."""
    frame = columns_of(0.05, 50, 100, 25, 75, 2.5)
    held = columns_on(falling(35), frame, mu=2.0)
    start = sorted_points(held).position.copy()
    Watch(held).march(100.0, looks=2)
    assert np.array_equal(sorted_points(held).position, start)
    ending = columns_on(falling(35), frame, mu=2.0, stop_at_rest=True)
    march = TimeIntegration(ending, 100.0, 10.0)
    list(march)
    assert ending.time < 100.0 and "at rest" in march.reason


@pytest.mark.parametrize("mu", [0.0, 0.4])
def test_slopes_of_68_degrees(mu):
    """H13: the speed of H2, and without friction that of a sliding point, g sin cos t, within 2 %."""
    solver = columns_on(falling(68), columns_of(0.5, 10, 40, 30, 70, 1.25), mu=mu, length=400.0)
    Watch(solver).march(6.0)
    slope = np.radians(68)
    exact = G * np.cos(slope) * (np.sin(slope) - mu * np.cos(slope)) * 6.0
    assert solver.frame().particles.velocity[:, 0].mean() == pytest.approx(exact, rel=0.02)


def test_flat_ground_and_no_motion_have_no_direction():
    """H22, H23: T = 0 and u = 0: no division by zero; with friction all stays at rest, without it the flow rotates."""
    pile = columns_of(lambda x, y: np.maximum(2.0 - np.hypot(x - 100, y - 50) / 10, 0.0), 75, 125, 25, 75, 1.25)
    held = columns_on(level, pile, mu=5.0)
    start = sorted_points(held).position.copy()
    Watch(held).march(5.0)
    assert np.array_equal(sorted_points(held).position, start)
    free = columns_on(level, pile, mu=0.0)
    Watch(free).march(2.0)
    p = free.frame().particles
    np.testing.assert_allclose(np.average(p.position[:, :2], axis=0, weights=p.mass), (100.0, 50.0), atol=1e-9)


@pytest.mark.parametrize(("offset", "apart"), [(0.0, 1e-5), (1.25, 1e-5), (2.5, 0.05)])
def test_columns_exactly_on_grid_lines(offset, apart):
    """H24: columns on nodes, cell centres and borders of blocks have one owner; a tiny offset gives the same result.

    Beside cell centres a column reaches one more row of nodes, with zero weight: 3 cm in 3 s.
    """
    ends = []
    for hair in (0.0, 1e-9):
        frame = box_of_columns(1.0, 37.5, 82.5, 22.5, 67.5, 5.0)  # in the middle of each square
        frame.particles.position[:, :2] += offset + hair
        solver = columns_on(falling(20), frame, mu=0.1)
        Watch(solver).march(3.0)
        ends.append(sorted_points(solver).position)
    np.testing.assert_allclose(*ends, atol=apart)


def test_a_flow_crushed_at_the_foot_of_a_steep_slope_stays_finite():
    """H26: 68 degrees straight into a wall: columns are squeezed into towers; in the slope form the work for this is a
    fiftieth of the energy of their height; no energy is created, and the time step does not vanish."""
    solver = columns_on(falling(68), columns_of(3.0, 60, 140, 20, 80, 2.5), mu=0.4, edges="wall")
    Watch(solver).march(8.0)
    assert solver.time == 8.0 and solver.step < 2000


def test_a_deep_pit_fills_up():
    """H26: flow from all sides into a pit of 40 m: its depth is less than twice the volume over the bottom area."""

    def pit(x, y):
        away = np.maximum(np.hypot(x - 100, y - 50) - 10.0, 0.0)
        return 0.7 * away - np.where(away == 0.0, 40.0, 0.0)

    def ring(x, y):
        return np.where(np.hypot(x - 100, y - 50) > 25, 1.0, 0.0)

    solver = columns_on(pit, columns_of(ring, 60, 140, 10, 90, 2.5), mu=0.1, edges="wall")
    Watch(solver).march(20.0)
    p = solver.frame().particles
    within = np.hypot(p.position[:, 0] - 100, p.position[:, 1] - 50) < 20
    assert p.mass[within].sum() > 0.5 * p.mass.sum()
    assert (
        float(solver._clock[column_time_step.DEPTH_NOW]) < 2.0 * p.volume.sum() / 300.0
    )  # over the area of the bottom


def test_a_flow_that_flies_apart_keeps_positive_areas():
    """H27: a block on level ground that expands at 2 per second, without friction: areas grow, none is negative."""
    frame = columns_of(1.0, 80, 120, 30, 70, 2.5)
    p = frame.particles
    p.velocity[:, :2] = 2.0 * (p.position[:, :2] - (100.0, 50.0))
    solver = columns_on(level, frame, mu=0.0)
    Watch(solver).march(1.0)
    assert sorted_points(solver).area.min() > p.area.max()


@pytest.mark.parametrize(("mu", "moves"), [(0.0, True), (1e9, False)])
def test_no_friction_and_endless_friction(mu, moves):
    """H29: both are valid values; a scene refuses a value that is not finite."""
    solver = columns_on(falling(30), columns_of(1.0, 50, 90, 30, 70, 2.5), mu=mu)
    start = sorted_points(solver).position.copy()
    Watch(solver).march(3.0)
    assert np.array_equal(sorted_points(solver).position, start) is not moves


def rest(steps):
    """A pile held by friction on a slope of 10 degrees, for the given number of steps."""
    solver = columns_on(falling(10), columns_of(0.2, 50, 70, 40, 60, 2.5), mu=0.9)
    before = sorted_points(solver)
    solver.advance(1e12, max_steps=steps)
    after = sorted_points(solver)
    assert solver.step == steps
    assert np.array_equal(after.position, before.position) and np.array_equal(after.mass, before.mass)
    assert solver.balances()["mass_error_relative"] == 0.0


def test_ten_thousand_steps_at_rest_change_nothing():
    """H41, short."""
    rest(10_000)


@pytest.mark.slow
def test_a_million_steps_at_rest_change_nothing():
    """H41: masses and positions are the same to the last bit."""
    rest(1_000_000)
