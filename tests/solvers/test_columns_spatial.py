"""Walls, erosion, zones and lakes in the solver: loads, mass taken up, balances; laws plain and compiled."""

import math

import numba
import numpy as np
import pytest
import shapely
import shapely.affinity
from column_scenes import G, columns_of, node_thickness, solver_on, terrain_of
from opening_scenes import walled_columns

from mpmgis.compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from mpmgis.laws.barrier import CORE, CORNER, FACE, deflected, weir_discharge
from mpmgis.laws.entrainment import entrainment_law, erosion_rate
from mpmgis.laws.friction import at_node, friction_law
from mpmgis.laws.ground_metric import WATER
from mpmgis.solvers.columns import column_rows as row
from mpmgis.solvers.columns.feature_arrays import NO_LAKE, Places
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.solvers.columns.spline_bed import beds_at
from mpmgis.solvers.features.lakes import lake_cells, water_depth
from mpmgis.solvers.features.walls import Wall

DX = 5.0


def level(x, y):
    return 0 * x


def channel(height, depth=8.0, length=200.0):
    """Water `depth` [m] deep on one side of a wall `height` [m] high across a channel 40 m wide."""
    terrain = terrain_of(level, length, 40.0, DX)
    frame = columns_of(depth, 0, 92.5, 0, 40, DX / 4)
    return walled_columns([Wall("dam", shapely.box(99.5, -99, 100.5, 99), height)], terrain, frame, DX)


def test_a_pond_at_rest_loads_its_dam_with_hydrostatic_pressure():
    """1/2 rho g h^2 per metre of width, within 4 % (mean of 60 s, the water still oscillates a little)."""
    solver = channel(1000.0)
    solver.advance(40.0)
    before = solver.balances()["barriers"]["dam"]["impulse_east"]
    solver.advance(100.0)
    taken = solver.balances()["barriers"]["dam"]
    x, _, thickness = node_thickness(solver)
    depth = thickness.mean(axis=0)[(x > 10) & (x < 85)].mean()
    load = (taken["impulse_east"] - before) / 60.0 / 40.0
    assert load == pytest.approx(0.5 * 1000.0 * G * depth**2, rel=0.04)
    assert taken["overtopped_mass"] == 0.0
    assert solver.frame().particles.position[:, 0].max() < 100.0


def test_a_weir_lets_pass_what_stands_above_its_crest():
    """The level falls to the crest; the counted mass over the crest is the mass beyond it, within 10 %."""
    solver = channel(5.0)
    solver.advance(150.0)
    p = solver.frame().particles
    beyond = p.mass[p.position[:, 0] > 100.0].sum()
    assert beyond > 0.2 * p.mass.sum()
    assert solver.balances()["barriers"]["dam"]["overtopped_mass"] == pytest.approx(beyond, rel=0.1)
    x, _, thickness = node_thickness(solver)
    assert thickness.mean(axis=0)[(x > 10) & (x < 85)].mean() == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize("degrees", [0, 10, 30, 45])
def test_nothing_passes_a_high_wall_whatever_way_it_runs(degrees):
    """H8: 20 m/s against a ring of walls 1 m thick, with four corners, on cells of 5 m."""
    centre = (150.3, 149.1)
    ring = shapely.affinity.rotate(shapely.box(100, 100, 200, 200), degrees, centre)
    frame = columns_of(5.0, 120, 180, 120, 180, DX / 4, velocity=(20.0, 6.0))
    wall = Wall("ring", ring.exterior.buffer(0.5, join_style="mitre"), 1e6)
    solver = walled_columns([wall], terrain_of(level, 300.0, 300.0, DX), frame, DX)
    solver.advance(30.0)
    p = solver.frame().particles
    assert shapely.contains_xy(ring, p.position[:, 0], p.position[:, 1]).all()
    assert solver.balances()["barriers"]["ring"]["overtopped_mass"] == 0.0


@pytest.mark.parametrize("degrees", [30, 45, 60])
def test_nothing_passes_where_a_wall_meets_the_edge_at_an_acute_angle(degrees):
    """H8: 20 m/s into the corner of a wall 1 m thick and the domain's edge."""
    along = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    half, middle = 61.0 / along[1], np.array([140.0, 60.0])
    line = shapely.LineString([middle - half * along, middle + half * along])

    def beside(x, y):
        return (y - middle[1]) * along[0] - (x - middle[0]) * along[1]

    frame = columns_of(
        lambda x, y: np.where(beside(x, y) > 2 * DX, 5.0, 0.0), 20, 180, 60, 120, DX / 4, velocity=(20.0, 6.0)
    )
    wall = Wall("w", line.buffer(0.5, cap_style="flat"), 1e6)
    solver = walled_columns([wall], terrain_of(level, 200.0, 120.0, DX), frame, DX)
    solver.advance(15.0)
    p = solver.frame().particles
    assert (beside(*p.position[:, :2].T) > -DX).all()
    assert p.mass.sum() == pytest.approx(frame.particles.mass.sum(), rel=1e-12)


def test_the_impulse_on_a_wall_is_the_momentum_that_the_flow_lost():
    """H8: away from all other walls, to round-off."""
    frame = columns_of(2.0, 60, 90, 150, 250, DX / 4, velocity=(20.0, 0.0))
    solver = walled_columns(
        [Wall("w", shapely.box(120, 60, 121, 340), 100.0)], terrain_of(level, 400.0, 400.0, DX), frame, DX
    )
    solver.advance(4.0)
    p, taken = solver.frame().particles, solver.balances()["barriers"]["w"]
    lost = frame.particles.mass.sum() * 20.0 - (p.mass * p.velocity[:, 0]).sum()
    assert solver.balances()["mass_out"] == 0.0 and taken["impulse_east"] > 0.5 * frame.particles.mass.sum() * 20.0
    assert taken["impulse_east"] == pytest.approx(lost, rel=1e-10)


def weightless_slab(coefficient, erodible, share=1.0, **laws):
    """A slab 2 m thick that slides at 10 m/s over erodible ground, with almost no weight."""
    terrain = terrain_of(level, 600.0, 40.0, DX)
    frame = columns_of(2.0, 50, 250, 0, 40, DX / 4, velocity=(10.0, 0.0))
    shape = ColumnGrid.on(terrain, DX).bed.shape
    law = entrainment_law("ErosionSpeed", coefficient, **laws)
    places = Places(erodible=np.full(shape, erodible), erodible_share=np.full(shape, share))
    return frame, solver_on(terrain, frame, DX, edges="wall", gravity=1e-9, places=places, laws={"entrainment": law})


@pytest.mark.parametrize(("step", "steps"), [(0.05, 60), (0.25, 12), (0.05, 5), (0.25, 2), (0.25, 1)])
def test_a_path_is_short_by_half_a_step_before_each_frame(step, steps):
    """A thin sheet that friction stops on level ground, a frame every `steps` steps: v^2 / (2 mu g) - v dt / (2 n)."""
    frame = columns_of(0.001, 20, 60, 0, 40, DX / 4, velocity=(10.0, 0.0))
    terrain = terrain_of(level, 100.0, 40.0, DX)
    solver = solver_on(terrain, frame, DX, friction_law("Coulomb", 0.5), edges="wall", time_step=step)
    for number in range(1, round(3.0 / (step * steps)) + 1):
        solver.advance(number * step * steps)
    p, start = solver.frame().particles, frame.particles
    path = np.average(p.position[:, 0], weights=p.mass) - np.average(start.position[:, 0], weights=start.mass)
    short = 0.0 if step * steps > 2.1 else 10.0 * step / (2 * steps)
    assert not p.velocity.any()
    assert path == pytest.approx(100.0 / (2 * 0.5 * G) - short, abs=0.1 * step)


def test_ground_is_eroded_in_proportion_to_the_share_that_is_erodible():
    taken = []
    for share in (1.0, 0.25):
        _, solver = weightless_slab(0.02, 1e9, share)
        solver.advance(1e9, max_steps=1)
        taken.append(solver.balances()["mass_entrained"])
    assert taken[1] == pytest.approx(0.25 * taken[0], rel=1e-12) and taken[1] > 0.0


def test_columns_that_take_up_mass_keep_their_momentum_and_shrink_as_their_new_speeds_tell():
    """A step of a slab whose speed falls to the east; away from its rim, also the affine momentum m du/dx."""
    _, solver = weightless_slab(0.02, 1e9)
    rows = solver.arrays.rows
    rows[:, row.U], rows[:, row.CXX] = 10.0 - 0.02 * (rows[:, row.X] - 50.0), -0.02
    before = rows[np.argsort(solver.arrays.ids)].reshape(32, 160, -1)[16, 10:150]
    solver.advance(1e9, max_steps=1)
    after = solver.arrays.rows[np.argsort(solver.arrays.ids)].reshape(32, 160, -1)[16, 10:150]
    assert (after[:, row.MASS] > 1.004 * before[:, row.MASS]).all()
    for speed in (row.U, row.CXX):
        momenta = [here[:, row.MASS] * here[:, speed] for here in (before, after)]
        np.testing.assert_allclose(momenta[1], momenta[0], rtol=1e-11)
    stretch = 1.0 + solver.time * np.gradient(after[:, row.U], DX / 4)
    np.testing.assert_allclose(after[:, row.AREA], before[:, row.AREA] * stretch, rtol=1e-6)


@pytest.mark.thorough
def test_an_eroding_slab_grows_by_the_law_and_keeps_its_momentum():
    """dh/dt = k u with h u constant: h^2 = h0^2 + 2 k h0 u0 t; until the mass has doubled."""
    k, time = 0.02, 15.0
    frame, solver = weightless_slab(k, 1e9)
    solver.advance(time)
    x, _, thickness = node_thickness(solver)
    p = solver.frame().particles
    middle = np.average(p.position[:, 0], weights=p.mass)
    grown = thickness.mean(axis=0)[np.abs(x - middle) < 40].mean()
    assert grown == pytest.approx(math.sqrt(4.0 + 2 * k * 2.0 * 10.0 * time), rel=0.01)
    assert grown > 3.9
    momentum = frame.particles.mass.sum() * 10.0
    assert (p.mass * p.velocity[:, 0]).sum() == pytest.approx(momentum, rel=0.01)
    balances = solver.balances()
    assert abs(balances["mass_error_relative"]) <= 1e-12
    assert balances["mass_now"] == pytest.approx(balances["mass_start"] + balances["mass_entrained"], rel=1e-12)


@pytest.mark.thorough
def test_no_more_is_taken_than_lies_there_and_the_bed_sinks_by_it():
    _, solver = weightless_slab(0.02, 400.0, lowering=1.0 / 1600.0)
    bed = solver.fields.bed.copy()
    solver.advance(15.0)
    left, sunk = solver.fields.erodible, bed - solver.fields.bed
    assert left.min() == 0.0
    assert sunk.max() == pytest.approx(400.0 / 1600.0, rel=1e-12)
    np.testing.assert_allclose(sunk, (400.0 - left) / 1600.0, atol=1e-12)


def test_laws_of_zones_agree_with_compiled():
    @numba.njit
    def all_of(energy, speed, friction, values, u, v, hold, mu, open_speed, head):
        return (
            deflected(u, v, 0.6, 0.8, hold, mu, open_speed),
            weir_discharge(9.81, head, 4.0),
            erosion_rate(energy, 1000.0, 2500.0, 12.0),
            erosion_rate(speed, 1000.0, 2500.0, 12.0),
            at_node(friction, values, 0, 0),
        )

    for hold in (FACE, CORE, CORNER):
        for u, v in ((-3.0, -1.0), (2.0, 2.0), (0.0, 0.0)):
            for open_speed, head in ((0.0, -1.0), (0.5, 2.0)):
                values = np.array([[[0.3, 700.0]]])
                laws = (
                    entrainment_law("ErosionEnergy", 5000.0),
                    entrainment_law("ErosionSpeed", 1e-3),
                    friction_law("Voellmy", 0.1, 1.0),
                    values,
                )
                arguments = (*laws, u, v, hold, 0.3, open_speed, head)
                assert all_of(*arguments) == all_of.py_func(*arguments)
    assert deflected(-3.0, -1.0, 0.6, 0.8, CORNER, 0.0, 0.0) == (0.0, 0.0)
    assert weir_discharge(9.81, 3.0, 0.0) == pytest.approx(math.sqrt(9.81) * 2.0**1.5)
    assert erosion_rate(entrainment_law("ErosionEnergy", 5000.0), 1000.0, 2500.0, 12.0) == 6.0


@pytest.mark.thorough
def test_friction_zones_brake_inside_their_polygons():
    """A thin sheet on 20 degrees: it slides on frictionless ground; mu above the slope holds it to the last bit."""
    slope = math.tan(math.radians(20))
    terrain = terrain_of(lambda x, y: slope * (400 - x), 400, 200, DX)
    frame = columns_of(0.05, 100, 140, 20, 180, DX / 4)
    values = np.zeros((*ColumnGrid.on(terrain, DX).bed.shape, 1))
    values[:20] = 2.0  # rows south of 95 m
    places, laws = Places(zone_values=values), {"zones": True}
    solver = solver_on(terrain, frame, DX, friction_law("Coulomb", 0.5), places=places, laws=laws, time_step=0.02)
    solver.advance(3.0)
    p = solver.frame().particles
    order = np.argsort(p.id)
    moved = (p.position[order] - frame.particles.position)[:, 0]
    y = frame.particles.position[:, 1]
    assert moved[y < 75].max() == 0.0  # nearer to the border the moving part drags it
    free = 0.5 * G * math.sin(math.radians(20)) * math.cos(math.radians(20)) * 9.0
    assert np.median(moved[y > 105]) == pytest.approx(free, rel=0.02)


def test_v10_two_lakes_at_two_levels_rest_while_a_dry_valley_is_none():
    """Lakes at rest to 1e-12 m/s, each at its own level; ground as low but dry is no lake."""
    terrain = terrain_of(lambda x, y: 10 + 4 * np.cos(2 * np.pi * x / 100) + 0 * y, 300, 60, DX)
    grid = ColumnGrid.on(terrain, DX)
    levels = ((0, 100, 9.0), (100, 200, 8.0))  # the third hollow is dry

    def depth(x, y):
        bed = beds_at(grid.bed, x - grid.x0, y - grid.y0, DX)[0]
        return sum(np.where((x > a) & (x < b), np.maximum(still - bed, 0), 0) for a, b, still in levels)

    frame = columns_of(depth, 0, 300, 0, 60, DX / 4)
    p = frame.particles
    water = water_depth(p.position[:, 0], p.position[:, 1], p.volume, grid.inside.shape, DX)
    lake_level = np.full(grid.inside.shape, NO_LAKE)
    for a, b, still in levels:
        touched = np.zeros(grid.inside.shape, bool)
        touched[:, int(a / DX) : int(b / DX)] = True
        cells, others = lake_cells(grid.bed[1:-1, 1:-1], still, water, touched)
        assert cells.any() and not others
        lake_level[cells] = still
    assert (lake_level[:, 40:] == NO_LAKE).all()
    assert not lake_cells(grid.bed[1:-1, 1:-1], 12.0, water)[0].any()  # it was not filled so high
    places = Places(lake_level=lake_level)
    solver = solver_on(terrain, frame, DX, metric=WATER, still_water=True, places=places, edges="wall")
    solver.advance(1e9, max_steps=1000)
    assert np.linalg.norm(solver.frame().particles.velocity, axis=1).max() <= 1e-12


def test_the_bed_of_a_plane_is_plane_up_to_the_cells_without_elevation():
    """Beside a hole, no node within reach of a column on known ground has curvature; far inside it the bed is level."""
    terrain = terrain_of(lambda x, y: 500.0 - 0.6 * x + 0.2 * y, 400.0, 300.0, 5.0)
    terrain.elevation[:8] = np.nan
    terrain.elevation[25:45, 30:60] = np.nan
    grid = ColumnGrid.on(terrain, 5.0)
    x, y = grid.node_points()
    cells = np.argwhere(grid.inside)
    felt = np.zeros(grid.bed.shape, bool)
    for j in range(4):
        for i in range(4):
            felt[cells[:, 0] + j, cells[:, 1] + i] = True
    np.testing.assert_allclose(grid.bed[felt], (500.0 - 0.6 * x + 0.2 * y)[felt], atol=1e-9)
    assert grid.bed.min() > 500.0 - 0.6 * 410.0 - 10.0
