"""Volumes of fluid points from the density at the nodes: open parts of splines, the correction, its effect."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
import shapely.affinity
from bore_scenes import DENSITY, stream_at_wall
from column_scenes import spline, terrain_of
from exact_solutions import G
from hypothesis import given, settings
from hypothesis import strategies as some
from point_scenes import block_of, integrate_to, load_between, points_on
from test_corner_pools import pool

from mpmgis.laws.fluid_material import LARGEST_GAP, SMALLEST_VOLUME, fluid_energy, gap_at_density
from mpmgis.laws.material import fluid
from mpmgis.laws.material_choice import stress_step
from mpmgis.laws.softening import Softening
from mpmgis.solvers.features.walls import Wall, filled_at, half_thickness, margin_in_3d, wall_nodes
from mpmgis.solvers.points import point_density as kernel
from mpmgis.solvers.points.ground_contact import YIELD_ENTRIES
from mpmgis.solvers.points.point_barriers import FILLED, FILLED_TOP
from mpmgis.solvers.points.point_ground import GROUND_ENTRIES, GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y, Ground
from mpmgis.solvers.points.point_rows import GHOSTS

WATER = fluid(1e6, 0.0, 0.0)


MIDDLES = (np.arange(60) + 0.5) / 20.0 - 1.5  # of 60 parts of the support of a spline
WEIGHTS = spline(MIDDLES) / spline(MIDDLES).sum()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(some.floats(0.0, 45.0), some.floats(0.0, 360.0), some.floats(-2.5, 2.5), some.floats(0.05, 20.0))
def test_the_open_part_of_a_node_is_that_of_its_spline_above_the_ground(degrees, azimuth, above, cell):
    """Against quadrature, on planes of any slope and direction; `above` [cells] is the height of the node."""
    rise = np.tan(np.radians(degrees)) * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
    nodes = np.zeros((1, 1, GROUND_ENTRIES))
    nodes[0, 0, [GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y]] = (3.0 - above) * cell, *rise
    ground = Ground(nodes, np.zeros((1, 1, 4), np.int32), np.zeros((1, 4), np.float32))
    numbers = solver_settings(cell)
    found = kernel.open_part(0, 0, GHOSTS + 3, ground, np.zeros((1, 1, YIELD_ENTRIES)), 0, nodes, False, numbers)
    x, y, z = np.meshgrid(MIDDLES, MIDDLES, MIDDLES, indexing="ij")
    weight = WEIGHTS[:, None, None] * WEIGHTS[None, :, None] * WEIGHTS[None, None, :]
    exact = weight[z + above > rise[0] * x + rise[1] * y].sum()
    assert found == pytest.approx(exact, abs=0.02)


def solver_settings(cell, **numerics):
    """Settings of the kernel of a small run with cells of `cell` [m]."""
    frame = block_of((2.0 * cell, 2.0 * cell, 2.0 * cell), 0.5 * cell, (4.0 * cell, 4.0 * cell, 0.0), DENSITY)
    terrain = terrain_of(lambda x, y: 0.0 * x, 10.0 * cell, 10.0 * cell, cell)
    return points_on(terrain, frame, cell, WATER, **numerics)._settings


@settings(max_examples=40, deadline=None, derandomize=True)
@given(some.floats(0.05, 20.0), some.floats(0.0, 360.0), some.floats(2.0, 9.0), some.floats(-1.0, 1.0), some.booleans())
def test_walls_fill_the_part_of_a_spline_that_is_behind_their_sides(cell, azimuth, width, off, angled):
    """Against quadrature: straight and angled walls of any direction, width, place and cell, wider than three cells or
    as wide as the solver makes them."""
    shape = shapely.box(-8.0, -0.5 * width + off, 8.0, 0.5 * width + off)
    if angled:
        shape = shape.union(shapely.box(-8.0, off, -8.0 + width, 9.0))
    shape = shapely.affinity.scale(
        shapely.affinity.rotate(shape, azimuth, origin=(0.0, 0.0)), cell, cell, origin=(0, 0)
    )
    axis, wall = np.arange(-16.0, 17.0) * cell, Wall("dam", shape, height=9.0 * cell)
    nodes = wall_nodes((wall,), axis, axis, np.zeros((33, 33)), cell, margin_in_3d)
    filled, crest = filled_at((wall,), nodes, axis, axis, cell, margin_in_3d)
    margin = margin_in_3d(half_thickness(shape), cell)
    widened = shape.buffer(margin, quad_segs=32) if margin else shape
    weight = np.outer(WEIGHTS, WEIGHTS)
    for j, i in ((16, 16), *np.argwhere((filled > 0.05) & (filled < 0.95))[::7]):
        x, y = np.meshgrid(axis[i] + MIDDLES * cell, axis[j] + MIDDLES * cell)
        exact = weight[shapely.contains_xy(widened, x, y)].sum()
        assert filled[j, i] == pytest.approx(exact, abs=0.02)
    assert (crest == 9.0 * cell).all()


def test_walls_on_the_edges_and_crests_close_a_part_of_the_splines():
    ground = Ground(np.zeros((20, 20, GROUND_ENTRIES)), np.zeros((1, 1, 4), np.int32), np.zeros((1, 4), np.float32))
    numbers, untouched = solver_settings(0.5, edges="wall"), np.zeros((20, 20, YIELD_ENTRIES))
    barriers = np.zeros((20, 20, 40))
    barriers[:, 9, FILLED], barriers[:, 9, FILLED_TOP] = 0.3, 1.0

    def at(j, i, level):
        return kernel.open_part(j, i, GHOSTS + level, ground, untouched, 0, barriers, True, numbers)

    assert at(GHOSTS + 5, GHOSTS, 5) == pytest.approx(0.5) and at(GHOSTS, GHOSTS, 5) == pytest.approx(0.25)
    assert at(GHOSTS + 10, GHOSTS + 10, 5) == pytest.approx(0.25) and at(GHOSTS, GHOSTS, 0) == pytest.approx(0.125)
    assert at(GHOSTS + 5, 8, 5) == 1.0 and at(GHOSTS + 5, 8, 0) == pytest.approx(0.5)
    heights = [at(GHOSTS + 5, 9, level) for level in (2, 0, 1, 4)]
    assert heights == pytest.approx([0.85, 0.35, 0.7 * (47.0 / 48.0) + 0.3 / 48.0, 1.0], abs=0.01)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(some.floats(SMALLEST_VOLUME, 1.0), some.floats(0.01, 20.0), some.booleans(), some.floats(0.0, 0.25))
def test_the_gap_of_a_volume_ends_at_the_band(volume, density, inside, band):
    gap = gap_at_density(volume, density, inside, band)
    off, closed = volume * density - 1.0, (volume + gap) * density - 1.0
    assert abs(gap) <= LARGEST_GAP
    if abs(off) <= band or (off < 0.0 and not inside):
        assert gap == 0.0
    elif abs(gap) < LARGEST_GAP:
        assert closed == pytest.approx(np.sign(off) * band, rel=1e-9, abs=1e-12)
    else:
        assert (gap < 0.0) == (off > 0.0)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    some.floats(SMALLEST_VOLUME, 1.0),
    some.floats(-0.1, 0.1),
    some.integers(16, 32),
    some.floats(1e-6, 1.0),
    some.floats(-0.02, 0.02),
    some.sampled_from([0.0, 1.0]),
)
def test_a_correction_acts_evenly_and_its_energy_is_known(volume, change, count, step, growth, tait):
    """Over `count` steps of a fluid that its motion compresses or expands by `growth` in total."""
    water, rates = WATER._replace(tait=tait), [growth / (3.0 * count), 0.0, 0.0, 0.0]
    state, stored = (volume, change / (count * step), *[0.0] * 6), 0.0
    for _ in range(count):
        before = state[0]
        state, *_ = stress_step(water, Softening(), state, (*(2 * rates), rates[0]), step)
        moved = min(max(before + change / count, SMALLEST_VOLUME), 1.0)
        assert state[0] == pytest.approx(min(max(moved * (1.0 + growth / count), SMALLEST_VOLUME), 1.0), rel=1e-12)
        stored += fluid_energy(water, moved) - fluid_energy(water, before)
    assert state[2] == pytest.approx(stored, rel=2e-3, abs=1e-9 * water.bulk_modulus)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_water_that_rests_evenly_is_not_corrected(precision):
    """Between walls on the edges, on the ground and below its surface the density of regular points is exact."""
    frame = block_of((16.0, 4.0, 4.0), 0.5, density=DENSITY)
    terrain = terrain_of(lambda x, y: 0.0 * x, 16.0, 4.0, 1.0)
    solver = points_on(terrain, frame, 1.0, fluid(DENSITY * G * 400.0, 0.0, 0.0), edges="wall", precision=precision)
    integrate_to(solver, 2.0)
    assert solver.balances()["volume_corrections"] == 0


def test_drops_in_the_air_are_not_corrected():
    """Their density is that of a free surface; they fall exactly."""
    frame = block_of((1.0, 1.0, 1.0), 0.5, (4.0, 4.0, 40.0), DENSITY)
    terrain = terrain_of(lambda x, y: 0.0 * x, 10.0, 10.0, 1.0)
    solver = points_on(terrain, frame, 1.0, WATER)
    integrate_to(solver, 2.0)
    assert solver.balances()["volume_corrections"] == 0
    velocity = solver.frame().particles.velocity
    np.testing.assert_allclose(velocity, np.tile([0.0, 0.0, -2.0 * G], (8, 1)), rtol=1e-6, atol=1e-9)


def test_points_that_crowd_push_each_other_apart():
    """A block at twice the density of its fluid, all J = 1, between walls: it rises to the level of its volume."""
    frame = block_of((4.0, 4.0, 2.0), 0.5, density=DENSITY)
    particles = frame.particles
    frame.particles.position[:, 2] *= 0.5
    terrain = terrain_of(lambda x, y: 0.0 * x, 4.0, 4.0, 1.0)
    stiff = fluid(DENSITY * G * 200.0, 0.0, 0.0)
    solver = points_on(terrain, frame, 1.0, stiff, edges="wall")
    integrate_to(solver, 12.0)
    middle = float((solver.frame().particles.position[:, 2] * particles.mass).sum() / particles.mass.sum())
    assert 0.88 <= middle <= 1.02
    assert solver.balances()["volume_corrections"] > 0


def test_the_stream_that_a_wall_stops_becomes_a_bore_of_the_exact_load():
    """Points packed in the corner of ground and wall: without corrections the load is 0.81 of the exact one."""
    solver, exact = stream_at_wall(2.0, 4.0)
    found = load_between(solver, 3.0, 4.0) / exact
    print(found, solver.balances()["energy_of_volume_corrections"] / solver.balances()["energy_start"])
    assert 0.9 <= found <= 1.03


@pytest.mark.thorough
def test_a_stream_of_few_points_does_not_stop_as_a_leak():
    """858 points, one per cell, four cells deep: points are moved back onto the ground in mirrored pairs."""
    solver, exact = stream_at_wall(2.0, 6.0, cell=0.5, width=1.5, per_cell=1)
    found = load_between(solver, 3.0, 6.0) / exact
    print(found, solver.balances()["clips"])
    assert solver.time == pytest.approx(6.0)
    assert 0.8 <= found <= 1.2


@pytest.mark.slow
@pytest.mark.parametrize("froude", [1.2, 2.0])
def test_corrections_make_no_peaks_of_the_load(froude):
    """Over spans of one or two steps, the load is at most 1.5 and 1.6 times the exact one without corrections, 1.4 and
    1.8 with them, and 1.8 and 3.4 with instantaneous corrections."""
    solver, exact = stream_at_wall(froude, 5.0)
    times = np.arange(3.0, 5.0, 0.0075 / (froude * np.sqrt(G)))
    most = max(load_between(solver, *span) for span in pairwise(times)) / exact
    print(froude, most)
    assert most <= 2.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("froude", "options"),
    [
        (2.0, {}),
        (1.2, {}),
        (1.6, {"place": 0.8}),
        (2.0, {"per_cell": 1}),
        (2.0, {"per_cell": 3}),
        (2.0, {"cell": 0.125}),
        (2.0, {"precision": "float32"}),
        (2.0, {"viscosity": 20.0}),
        (2.0, {"tait": 1.0}),
    ],
)
def test_bores_of_other_streams(froude, options):
    solver, exact = stream_at_wall(froude, 5.0, **options)
    found = load_between(solver, 3.0, 5.0) / exact
    print(froude, options, found)
    assert 0.87 <= found <= 1.1


@pytest.mark.parametrize(
    ("azimuth", "side", "least"),
    [*(pytest.param(azimuth, 1.5, 0.94, marks=pytest.mark.slow) for azimuth in (0.0, 20.0)), (20.0, 1.0, 0.9)],
)
def test_a_basin_filled_from_the_start_keeps_its_load(azimuth, side, least):
    """Points packed at the bottom: after 20 s the load was 0.70 of the hydrostatic one, 0.66 in the smallest basin."""
    solver, hydrostatic, _ = pool(azimuth, length=side, width=side, gap=0.0)
    found = load_between(solver, 16.0, 20.0) / hydrostatic
    print(azimuth, side, found)
    assert least <= found <= 1.05
