"""Maxima of every step of the 3D solver: against NumPy, a block on a slope, a splash, walls, a restart."""

from itertools import pairwise

import numpy as np
import pytest
from column_scenes import spline, terrain_of
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_points import plain_step, yields_of
from point_scenes import block_of, plane, points_on

from mpmgis.compiled import jit
from mpmgis.frames import peaks as peak_names
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager, elastic, fluid
from mpmgis.laws.material_choice import wave_speed
from mpmgis.laws.softening import Softening
from mpmgis.simulation.time_integration import TimeIntegration
from mpmgis.solvers.points import point_peaks
from mpmgis.system.errors import FormatError

ELASTIC, SAND = elastic(6.7e6, 4e6), drucker_prager(2e5, 1.2e5, 35.0, 0.0)
DENSITY, GRAVITY = 1000.0, 9.81
FLAT = terrain_of(lambda x, y: 0.0 * x, 24.0, 20.0, 4.0)


def cloud(place, velocity, mass):
    """A Frame of points at `place` [n, 3] [m], with volumes for the density of the scenes."""
    mass = np.asarray(mass, float)
    ids = np.arange(len(mass), dtype=np.uint64)
    return Frame(Particles(place, velocity, mass, mass / DENSITY, id=ids), dimension=3)


def on_nodes(solver):
    """float64[rows, columns, 4]: the peaks at the nodes of the whole domain, whose first is its corner."""
    ny, nx = solver.grid.inside.shape
    kept, dx = solver.maxima(), solver.grid.cell_size
    whole = peak_names.no_peaks((ny + 1, nx + 1))
    column = round((kept["transform"][2] - solver.grid.x0) / dx + 0.5)
    row = round((kept["transform"][5] - solver.grid.y0) / dx + 0.5)
    rows, columns = kept["thickness"].shape
    for k, name in enumerate(peak_names.PEAK_NAMES):
        whole[row : row + rows, column : column + columns, k] = kept[name]
    return whole


def thickness_now(solver):
    """float64[rows, columns] [m]: mass under the quadratic spline of each node over density and area, by NumPy."""
    ny, nx = solver.grid.inside.shape
    particles, dx = solver.frame().particles, solver.grid.cell_size
    place = particles.position - solver._corner_from(solver._start.origin)
    thickness = np.zeros((ny + 1, nx + 1))
    for j in range(ny + 1):
        for i in range(nx + 1):
            weight = spline(place[:, 0] / dx - i) * spline(place[:, 1] / dx - j)
            thickness[j, i] = (particles.mass * weight).sum() / (solver.numerics.density * dx * dx)
    return thickness


def test_the_kernel_and_the_frames_agree_on_the_order_of_peaks():
    for name in ("THICKNESS", "SPEED", "PRESSURE", "ARRIVAL"):
        assert getattr(point_peaks, name) == getattr(peak_names, name)


@pytest.mark.parametrize("wide", [1, 2])
def test_peaks_equal_those_of_the_plain_loop_in_every_step(wide):
    """Thickness, speed along the ground, pressure of the whole velocity, arrival, from the nodes of the plain loop."""
    terrain = plane(30, length=40.0, width=12.0, height=60.0, pixel=4.0)
    corner = (20.3, 5.2, 60.0 - 20.3 * np.tan(np.radians(30)))
    frame = block_of((2.0 * wide, 1.5, 1.5), 0.5, corner, velocity=(14.0, -3.0, -2.0), turned=np.radians(30))
    frame.particles.velocity[:] += np.random.default_rng(3).normal(size=frame.particles.velocity.shape)
    dx, dt, steps, least = 1.0, 4e-3, 12, 0.2
    solver = points_on(
        terrain, frame, dx, ELASTIC, friction_law("Coulomb", 0.3), time_step=dt, maxima=True, arrival_thickness=least
    )
    place = frame.particles.position - solver._corner_from((0.0, 0.0, 0.0))
    n = len(place)
    velocity, affine, state, stress = (
        frame.particles.velocity.copy(),
        np.zeros((n, 3, 3)),
        np.zeros((n, 8)),
        np.zeros((n, 6)),
    )
    ground = solver._ground[..., :3]
    nodes = np.zeros((int(place[:, 2].max() / dx) + 14, *ground.shape[:2], 4))
    normal = np.dstack([-ground[..., 1], -ground[..., 2], np.ones(ground.shape[:2])])
    normal /= np.linalg.norm(normal, axis=2)[..., None]
    expected, yields = peak_names.no_peaks(ground.shape[:2]), yields_of(solver)
    for step in range(steps):
        plain_step(
            place,
            velocity,
            affine,
            frame.particles.mass,
            state,
            stress,
            nodes,
            ground,
            yields,
            dx,
            dt,
            DENSITY,
            GRAVITY,
            0.3,
            ELASTIC,
            Softening(),
            wave_speed(ELASTIC, DENSITY),
        )
        mass = nodes[..., 3].sum(axis=0)
        mean = (nodes[..., :3] * nodes[..., 3:]).sum(axis=0) / np.maximum(mass, 1e-300)[..., None]
        thickness = mass / (DENSITY * dx * dx)
        along = mean - (mean * normal).sum(axis=2)[..., None] * normal
        flow = thickness >= least
        new = (thickness, np.linalg.norm(along, axis=2) * flow, DENSITY * (mean**2).sum(axis=2) * flow)
        for k, values in enumerate(new):
            np.maximum(expected[..., k], values, out=expected[..., k])
        expected[flow & (expected[..., 3] < 0.0), 3] = (step + 1) * dt
    solver.advance(steps * dt)
    assert solver.step == steps
    ny, nx = solver.grid.inside.shape
    expected = expected[4 : 4 + ny + 1, 4 : 4 + nx + 1]
    found = on_nodes(solver)
    assert (found[..., 3] > dt * 1.5).sum() >= wide and (found[..., 1] > 10.0).sum() >= 8
    np.testing.assert_allclose(found, expected, rtol=2e-6, atol=1e-7)


@pytest.mark.thorough
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 1 << 30), dx=st.sampled_from([0.05, 0.7, 2.0, 5.0]), single=st.booleans())
def test_thickness_and_arrival_are_those_of_numpy_in_every_step(seed, dx, single):
    """Random heaps of points of unequal mass in cells of any size, both precisions."""
    random = np.random.default_rng(seed)
    terrain = terrain_of(lambda x, y: 0.3 * x, 9 * dx, 8 * dx, dx)
    place = random.uniform((2, 2, 2.6), (5, 6, 4.0), (60, 3)) * dx
    speed = np.sqrt(GRAVITY * dx)
    frame = cloud(place, random.normal(0.0, speed, (60, 3)), random.uniform(0.05, 0.3, 60) * DENSITY * dx**3)
    least, precision = 0.3 * dx, "float32" if single else "float64"
    solver = points_on(
        terrain,
        frame,
        dx,
        fluid(DENSITY * 400 * GRAVITY * dx, 0.0, 0.0),
        maxima=True,
        arrival_thickness=least,
        precision=precision,
    )
    expected = peak_names.no_peaks(tuple(n + 1 for n in solver.grid.inside.shape))
    lone = 0.5625 * frame.particles.mass.max() / (DENSITY * dx * dx)
    end, doubtful = 0.4 * np.sqrt(dx / GRAVITY), np.zeros(expected.shape[:2], bool)
    while solver.time < end and solver.particles:
        thickness = thickness_now(solver)
        solver.advance(end, max_steps=1)
        expected[..., 0] = np.maximum(expected[..., 0], thickness)
        new = (thickness >= max(least, lone)) & (expected[..., 3] < 0.0)
        expected[new, 3] = solver.time
        doubtful |= np.abs(thickness - max(least, lone)) < 1e-4 * dx  # rounding decides
    found = on_nodes(solver)
    np.testing.assert_allclose(found[..., 0], expected[..., 0], atol=(1e-5 if single else 1e-6) * dx)
    np.testing.assert_allclose(found[~doubtful, 3], expected[~doubtful, 3], rtol=1e-5)
    assert ((found[..., 1] > 0) == (found[..., 3] >= 0)).all() and (found[..., 3] > 0).any()


def test_free_flight_has_the_peaks_of_one_velocity():
    """Away from the ground a cloud has one velocity: the speed is its part along the slope, the pressure uses all."""
    terrain = plane(30, length=60.0, width=20.0, height=60.0, pixel=4.0)
    frame = block_of((3.0, 3.0, 2.0), 0.5, (20.0, 8.0, 70.0), velocity=(6.0, 2.0, 0.0))
    solver = points_on(terrain, frame, 1.0, ELASTIC, maxima=True)
    solver.advance(1.0)
    velocity = np.array([6.0, 2.0, -GRAVITY])
    normal = np.array([np.sin(np.radians(30)), 0.0, np.cos(np.radians(30))])
    kept = solver.maxima()
    speed = np.linalg.norm(velocity - (velocity @ normal) * normal)
    assert kept["speed"].max() == pytest.approx(speed, rel=1e-4)
    assert kept["pressure"].max() == pytest.approx(DENSITY * (velocity @ velocity), rel=1e-4)
    assert kept["thickness"].max() == pytest.approx(2.0, rel=0.02)


def test_a_sliding_block_leaves_its_known_peaks():
    """At each place below the block, the speed is that of its tail when it leaves, the arrival that of its front."""
    degrees, mu, length, thick = 35.0, 0.3, 12.0, 2.0
    angle = np.radians(degrees)
    terrain = plane(degrees, length=160.0, width=24.0, height=130.0)
    west = 30.0
    corner = (west, 8.0, 130.0 - west * np.tan(angle))
    frame = block_of((length, 8.0, thick), 0.5, corner, turned=angle)
    solver = points_on(terrain, frame, 1.0, elastic(6.7e6, 4e6), friction_law("Coulomb", mu), maxima=True)
    solver.advance(6.0)
    found = on_nodes(solver)[12]  # along the middle
    acceleration = GRAVITY * (np.sin(angle) - mu * np.cos(angle))
    along = (np.arange(len(found)) - west) / np.cos(angle)
    passed = (along > length + 4.0) & (along < 0.5 * acceleration * 36.0 - 4.0)
    assert passed.sum() > 15
    tail = np.sqrt(2 * acceleration * along[passed])
    np.testing.assert_allclose(found[passed, 1], tail, rtol=0.05)
    np.testing.assert_allclose(found[passed, 2], DENSITY * tail**2, rtol=0.1)
    # the front's upper edge is over a node before its lower one, and the spline reaches it a cell and a half before
    ahead = (1.5 + thick * np.sin(angle)) / np.cos(angle)
    early, front = (np.sqrt(2 * (along[passed] - length - reach) / acceleration) for reach in (ahead, 0.0))
    assert (found[passed, 3] >= early - 0.02).all() and (found[passed, 3] <= front + 0.02).all()
    np.testing.assert_allclose(found[passed, 0], thick / np.cos(angle), rtol=0.06)


@pytest.mark.thorough
def test_a_single_point_in_the_air_makes_no_speed_pressure_or_arrival():
    """In cells so large that one point is thicker than arrival_thickness; two points that fly together do."""
    place = np.array([[6.0, 6.0, 9.0], [16.0, 10.0, 9.0], [16.2, 10.1, 9.2]])
    frame = cloud(place, np.tile((0.0, 0.0, -30.0), (3, 1)), np.full(3, DENSITY))
    solver = points_on(FLAT, frame, 2.0, fluid(1e6, 0.0, 0.0), maxima=True)
    solver.advance(0.1)
    found = on_nodes(solver)
    one, two = found[:5, :5], found[:, 6:]
    assert one[..., 0].max() == pytest.approx(0.25 * 0.75**2) and not one[..., 1:3].any()
    assert (one[..., 3] == -1.0).all()
    assert two[..., 2].max() > 0.9 * DENSITY * 30.0**2 and (two[..., 3] > 0).any()


@pytest.mark.thorough
def test_a_basin_with_walls_is_as_deep_at_them_as_amid_it():
    """The mirror image beyond a wall counts, as it does for columns; the corner of the domain too."""
    terrain = terrain_of(lambda x, y: 0.0 * x, 8.0, 6.0, 2.0)
    frame = block_of((8.0, 6.0, 2.0), 0.5)
    solver = points_on(terrain, frame, 1.0, fluid(1e6, 0.0, 0.0), edges="wall", maxima=True)
    solver.advance(1e-3)
    np.testing.assert_allclose(on_nodes(solver)[..., 0], 2.0, rtol=1e-6)
    open_edges = points_on(terrain, frame, 1.0, fluid(1e6, 0.0, 0.0), maxima=True)
    open_edges.advance(1e-3)
    assert on_nodes(open_edges)[0, 0, 0] == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("precision", ["float64", pytest.param("float32", marks=pytest.mark.thorough)])
def test_nothing_of_the_flow_changes_and_threads_change_nothing(precision):
    frame = block_of((4, 4, 4), 0.5, (10, 8, 0))
    made = [
        points_on(FLAT, frame, 1.0, SAND, friction_law("Coulomb", 0.6), precision=precision, maxima=maxima)
        for maxima in (False, True, True)
    ]
    threads = jit.set_threads(None)
    for solver in made[:2]:
        solver.advance(0.6)
    jit.set_threads(1)
    made[2].advance(0.6)
    jit.set_threads(threads)
    assert made[0].maxima() == {} and not {"peaks", "peak_nodes"} & set(made[0].state())
    for other in (made[0], made[2]):
        np.testing.assert_array_equal(made[1].frame().state["rows"], other.frame().state["rows"])
    for name, values in made[1].maxima().items():
        np.testing.assert_array_equal(values, made[2].maxima()[name])


def test_a_restart_has_the_peaks_of_the_whole_run_and_going_back_forgets_them():
    def heap():
        frame = block_of((4, 4, 4), 0.5, (10, 8, 0), velocity=(5.0, 0.0, 0.0))
        return points_on(FLAT, frame, 1.0, SAND, friction_law("Coulomb", 0.3), maxima=True)

    whole = list(TimeIntegration(heap(), 1.5, 0.25))
    again = heap()
    again.advance(0.7)  # its maxima are not part of the run that it continues
    again.restore(whole[2])
    frames = list(TimeIntegration(again, 1.5, 0.25, resumed=True))
    for name, values in whole[-1].maxima.items():
        np.testing.assert_array_equal(frames[-1].maxima[name], values)
    for frame, later in pairwise(whole):
        assert (later.maxima["thickness"].sum() - frame.maxima["thickness"].sum()) >= -1e-6
    del whole[2].state["peaks"]
    with pytest.raises(FormatError, match="peaks is missing"):
        heap().restore(whole[2])


def test_what_leaves_over_an_edge_leaves_its_peaks():
    frame = block_of((4, 4, 2), 0.5, (18, 8, 0), velocity=(20.0, 0.0, 0.0))
    solver = points_on(FLAT, frame, 1.0, SAND, friction_law("Coulomb", 0.0), maxima=True)
    solver.advance(1.0)
    found = on_nodes(solver)
    assert solver.particles == 0
    assert found[10, -1, 1] == pytest.approx(20.0, rel=0.1) and found[10, -2, 0] > 1.5
