"""One step against a plain loop, and what must hold for any scene: sums, symmetry, threads, edges, rest."""

import numpy as np
import pytest
from affine import Affine
from column_scenes import G, columns_of, dam_break, joined, node_thickness, relative_l1, seeded, solver_on, terrain_of
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.frames.particles import Frame
from mpmgis.laws.curvature import CURVATURE
from mpmgis.laws.friction import FRICTIONLESS, friction_law, slowed_speed, stress_parts
from mpmgis.laws.ground_metric import SLOPE, WATER
from mpmgis.simulation.time_integration import TimeIntegration
from mpmgis.solvers.columns import column_time_step
from mpmgis.solvers.columns.column_solver import ColumnSolver
from mpmgis.system.errors import FormatError, SceneError, UnphysicalError
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid


def rough(x, y):
    """A rough 20 degree slope."""
    return 0.36 * (400 - x) + 4 * np.sin(x / 40) * np.cos(y / 35)


def pile(per_side=4, velocity=(1.0, -2.0)):
    def cap(x, y):
        return np.maximum(3.0 - ((x - 150) ** 2 + (y - 100) ** 2) / 300, 0.0)

    return seeded(cap, 100, 200, 50, 150, 5.0, per_side, velocity=velocity)


def rough_solver(law=None, metric=None, curvature=None, **numerics):
    frame = pile()
    terrain = terrain_of(rough, 400, 200, 5)
    return solver_on(terrain, frame, 5.0, law or friction_law("Voellmy", 0.2, 800.0), metric, curvature, **numerics)


def splines(position, start, dx):
    """(nodes, weights, slopes) of one particle on one axis: quadratic B-splines, as in textbooks."""
    s = (position - start) / dx
    first = int(np.floor(s - 0.5))
    nodes = first + np.arange(3)
    distance = s - nodes
    weights = np.where(np.abs(distance) < 0.5, 0.75 - distance**2, 0.5 * (1.5 - np.abs(distance)) ** 2)
    slopes = np.where(np.abs(distance) < 0.5, -2 * distance, -np.sign(distance) * (1.5 - np.abs(distance))) / dx
    return nodes, weights, slopes


def bending(bed, node, dx):
    """Hessian of the spline bed at a node [m-1], from the splines' values and derivatives there."""
    value, slope, second = np.array([1, 6, 1]) / 8, np.array([-1, 0, 1]) / (2 * dx), np.array([1, -2, 1]) / dx**2
    b = bed[node[0] - 1 : node[0] + 2, node[1] - 1 : node[1] + 2]
    return np.array([[value @ b @ second, slope @ b @ slope], [slope @ b @ slope, second @ b @ value]])


def plain_step(particles, solver, dt, law, curved):
    """One step in plain Python, dense, in the order of theory.md: the reference."""
    dx, density, grid = solver.grid.cell_size, solver.numerics.density, solver.grid
    shape = grid.bed.shape
    mass, momentum = np.zeros(shape), np.zeros((*shape, 2))
    stencils = []
    for p in range(len(particles)):
        x, y = particles.position[p, :2]
        (i, wx, gx), (j, wy, gy) = splines(x, grid.x0, dx), splines(y, grid.y0, dx)
        i, j = i + 1, j + 1
        w = wy[:, None] * wx[None, :]
        dwx, dwy = wy[:, None] * gx[None, :], gy[:, None] * wx[None, :]
        b = grid.bed[j[0] : j[0] + 3, i[0] : i[0] + 3]
        gradient = np.array([(dwx * b).sum(), (dwy * b).sum()])
        c2 = 1 / (1 + gradient @ gradient)
        m, area, u = particles.mass[p], particles.area[p], particles.velocity[p, :2]
        h = m / (density * area)
        projection = np.eye(2) - c2 * np.outer(gradient, gradient)
        for a in range(3):
            for c in range(3):
                n = (j[a], i[c])
                mass[n] += w[a, c] * m
                force = 0.5 * density * area * G * c2 * h * h * projection @ np.array([dwx[a, c], dwy[a, c]])
                force -= m * G * c2 * gradient * w[a, c]
                momentum[n] += w[a, c] * m * u + dt * force
        stencils.append((i[0], j[0], w, dwx, dwy, gradient))
    velocity = np.zeros_like(momentum)
    for n in zip(*np.nonzero(mass), strict=True):
        u = momentum[n] / mass[n]
        gradient = grid.gradient[n]
        c2 = 1 / (1 + gradient @ gradient)
        speed = np.sqrt(u @ u + (u @ gradient) ** 2)
        h = max(mass[n] / (density * dx * dx), solver._settings.thickness_floor)
        load = max(0.0, G + u @ bending(grid.bed, n, dx) @ u) if curved else G
        dry, _, drag = stress_parts(law, density, G, density * h * load * c2, h * np.sqrt(c2), speed)
        per_mass = density * h * np.sqrt(c2)
        slowed = slowed_speed(speed, dt, dry / per_mass, 0.0, drag / (h * np.sqrt(c2)))
        velocity[n] = u * slowed / speed if speed > 0 else 0
    out = []
    for p, (i, j, w, dwx, dwy, gradient) in enumerate(stencils):
        v = velocity[j : j + 3, i : i + 3]
        u = (w[..., None] * v).sum(axis=(0, 1))
        du = np.array([[(d * v[..., k]).sum() for d in (dwx, dwy)] for k in (0, 1)])
        area = particles.area[p] * np.linalg.det(np.eye(2) + dt * du)
        position = particles.position[p, :2] + dt * u
        if curved:
            (i2, wx, gx), (j2, wy, gy) = splines(position[0], grid.x0, dx), splines(position[1], grid.y0, dx)
            b = grid.bed[j2[0] + 1 : j2[0] + 4, i2[0] + 1 : i2[0] + 4]
            new = np.array([(wy[:, None] * gx * b).sum(), (gy[:, None] * wx * b).sum()])
            before, normal = np.append(u, u @ gradient), np.append(-new, 1) / np.sqrt(1 + new @ new)
            tangent = before - (before @ normal) * normal
            u = (tangent * np.linalg.norm(before) / np.linalg.norm(tangent))[:2]
        out.append([*position, *u, area])
    return np.array(out)


@pytest.mark.parametrize("curved", [False, pytest.param(True, marks=pytest.mark.thorough)])
@pytest.mark.parametrize(
    "law",
    [
        FRICTIONLESS,
        pytest.param(friction_law("Coulomb", 0.3), marks=pytest.mark.thorough),
        friction_law("Voellmy", 0.2, 800.0),
    ],
)
def test_a_step_equals_the_plain_loop(law, curved):
    terrain = terrain_of(rough, 400, 200, 5)
    frame = pile(per_side=1)
    solver = solver_on(terrain, frame, 5.0, law, curvature=CURVATURE if curved else None, time_step=0.05)
    expected = plain_step(frame.particles, solver, 0.05, law, curved)
    solver.advance(0.05)
    p = solver.frame().particles
    order = np.argsort(p.id)
    computed = np.column_stack([p.position[:, :2], p.velocity[:, :2], p.area])[order]
    np.testing.assert_allclose(computed, expected, rtol=1e-11, atol=1e-11)


def test_mass_is_constant_and_momentum_is_conserved_without_a_bed_force():
    """Frictionless on a horizontal bed: the momentum of the columns stays."""
    terrain = terrain_of(lambda x, y: 0 * x, 400, 200, 5)
    frame = pile(velocity=(2.0, 1.0))
    solver = solver_on(terrain, frame, 5.0, FRICTIONLESS)
    solver.advance(3.0)
    before, after = frame.particles, solver.frame().particles
    assert solver.balances()["mass_error_relative"] == 0.0
    for k in (0, 1):
        first, last = ((p.mass * p.velocity[:, k]).sum() for p in (before, after))
        np.testing.assert_allclose(last, first, rtol=1e-13)


def turned(solver_of, angle):
    """Centroid, spread and footprint of a run on a terrain raster that is turned by `angle` about the pile's start."""
    cos, sin = np.cos(angle), np.sin(angle)
    pixel, rows, columns = 5.0, 120, 160
    turn = Affine.translation(150, 100) * Affine.rotation(np.degrees(angle)) * Affine.translation(-150, -100)
    grid = Grid(None, turn * Affine(pixel, 0, -150, 0, -pixel, 400), (rows, columns))
    x, y = grid.xy(*np.mgrid[0:rows, 0:columns])
    back_x, back_y = cos * (x - 150) + sin * (y - 100) + 150, -sin * (x - 150) + cos * (y - 100) + 100
    terrain = Terrain(grid, rough(back_x, back_y))
    frame = pile(velocity=(0.0, 0.0))
    p = frame.particles
    relative = p.position[:, :2] - (150, 100)
    p.position[:, :2] = relative @ np.array([[cos, sin], [-sin, cos]]) + (150, 100)
    solver = solver_on(terrain, frame, 5.0, friction_law("Voellmy", 0.25, 800.0), curvature=CURVATURE)
    solver.advance(15.0)
    q = solver.frame().particles
    relative = q.position[:, :2] - (150, 100)
    back = relative @ np.array([[cos, -sin], [sin, cos]])
    back = back[np.argsort(q.id)]
    return back, np.sort(back[:, 0])[int(0.99 * len(back))]


def test_v22_turning_the_scene_turns_the_result():
    """90 degrees to round-off, 30 and 45 degrees within one cell of runout."""
    back, runout = turned(rough_solver, 0.0)
    quarter, _ = turned(rough_solver, np.pi / 2)
    np.testing.assert_allclose(quarter, back, atol=1e-10)
    for degrees in (30, 45):
        _, other = turned(rough_solver, np.radians(degrees))
        assert abs(other - runout) <= 5.0


def test_v22_far_from_the_origin_nothing_changes():
    """The same scene at UTM coordinates: bitwise the same in the local frame."""
    near = rough_solver()
    east, north = 500_000.0, 5_000_000.0
    here = terrain_of(rough, 400, 200, 5)
    far_grid = Grid(None, Affine.translation(east, north) * here.grid.transform, here.grid.shape)
    far_terrain = Terrain(far_grid, here.elevation)
    frame = pile()
    far = solver_on(
        far_terrain, Frame(frame.particles, origin=(east, north, 0.0)), 5.0, friction_law("Voellmy", 0.2, 800.0)
    )
    near.advance(5.0)
    far.advance(5.0)
    a, b = near.frame().particles, far.frame().particles
    for name in ("position", "velocity", "area"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes()


def test_outflow_is_summed_by_edge_and_the_run_continues():
    terrain = terrain_of(lambda x, y: 0.5 * (200 - x), 200, 100, 5)
    frame = columns_of(1.0, 100, 160, 20, 80, 1.25, velocity=(10.0, 0.0))
    solver = solver_on(terrain, frame, 5.0, friction_law("Coulomb", 0.2))
    solver.advance(4.0)
    balances = solver.balances()
    assert set(balances["outflow"]) == {"east"}
    assert 0 < balances["mass_out"] < balances["mass_start"]
    assert abs(balances["mass_error_relative"]) <= 1e-12
    assert balances["outflow"]["east"]["particles"] + len(solver.frame().particles) == len(frame.particles)
    march = TimeIntegration(solver, 60.0, 30.0)
    list(march)
    assert "left the terrain" in march.reason


def test_walls_keep_everything_in():
    terrain = terrain_of(lambda x, y: 0.3 * (200 - x), 200, 100, 5)
    solver = solver_on(terrain, columns_of(2.0, 20, 80, 20, 80, 1.25), 5.0, friction_law("Coulomb", 0.05), edges="wall")
    solver.advance(30.0)
    p = solver.frame().particles
    assert solver.balances()["mass_out"] == 0.0
    assert p.position[:, 0].min() > 0 and p.position[:, 0].max() < 200
    assert p.position[:, 0].mean() > 150


def test_stop_rule_ends_a_run_that_rests_and_names_the_rule():
    solver = rough_solver(friction_law("Coulomb", 0.9), stop_at_rest=True)
    march = TimeIntegration(solver, 300.0, 10.0)
    frames = list(march)
    assert "at rest" in march.reason
    assert frames[-1].time < 300.0
    assert [f.time for f in frames[:-1]] == [10.0 * k for k in range(len(frames) - 1)]


def test_a_flow_with_a_part_that_still_slides_is_not_at_rest():
    """Three bodies: one leaves the terrain, one stops within 10 s, one slides at 2 m/s where the slope is the friction.

    The kinetic energy is then far below 1 % of its peak. A fifth of the mass on the terrain, 2 % of all, still moves.
    """
    tangent, spacing = 0.3, 1.25
    terrain = terrain_of(lambda x, y: tangent * np.maximum(300.0 - x, 0.0), 800, 60, 5)
    places = ((100, 120, 0.05, 2.0), (400, 480, 0.05, 30.0), (740, 780, 0.9, 30.0))  # west, east, thickness, speed
    parts = [columns_of(h, west, east, 10, 50, spacing, velocity=(u, 0.0)) for west, east, h, u in places]
    solver = solver_on(terrain, joined(*parts), 5.0, friction_law("Coulomb", tangent), stop_at_rest=True)
    march = TimeIntegration(solver, 25.0, 5.0)
    list(march)
    balances = solver.balances()
    assert balances["kinetic_energy"] < 1e-3 * balances["kinetic_energy_peak"]
    assert march.reason == "end_time reached" and solver.time == 25.0
    assert march.end.moving == pytest.approx(0.2, abs=0.02) and not march.end.came_to_rest


@given(
    st.lists(st.tuples(*(st.floats(0.0, 1.0, allow_subnormal=False) for _ in range(4))), min_size=1, max_size=60),
    st.floats(0.05, 5.0),
)
def test_no_stop_rule_ends_a_flow_of_which_much_is_fast(states, step):
    """Any history of kinetic energy, moving and flowing shares, and reached nodes."""
    clock, counts = np.zeros(column_time_step.CLOCK), np.zeros(column_time_step.COUNTS, np.int64)
    clock[column_time_step.KINETIC_LOW_SINCE] = -1.0
    for kinetic, moving, part, wet in states:
        clock[column_time_step.TIME] += step
        clock[column_time_step.KINETIC_NOW] = kinetic**8
        clock[column_time_step.KINETIC_PEAK] = max(clock[column_time_step.KINETIC_PEAK], kinetic**8)
        clock[column_time_step.MOVING_SHARE], clock[column_time_step.FLOWING_SHARE] = moving, moving * part
        clock[column_time_step.MOVING_PEAK] = max(clock[column_time_step.MOVING_PEAK], moving)
        counts[column_time_step.WET] += int(2 * wet)
        if column_time_step.stop_rule(clock, counts) != column_time_step.RUNNING:
            assert moving * part < 0.05
            break


def test_frames_are_at_their_times_exactly():
    """H39: a frame interval that no step divides is hit to the last bit."""
    solver = rough_solver()
    march = TimeIntegration(solver, 2.0, 0.7)
    assert [f.time for f in march] == [0.0, 0.7, 1.4, 2.0]


def test_peaks_go_on_after_a_restart_and_are_stored_only_where_the_flow_was():
    whole, first, again = (rough_solver(maxima=True) for _ in range(3))
    for solver in (whole, first):
        solver.advance(2.0)
    again.restore(first.frame())
    stored = first.state()
    assert 0 < len(stored["peak_nodes"]) == len(stored["peaks"]) < 0.5 * whole.grid.bed.size
    for solver in (whole, again):
        solver.advance(5.0)
    for name, values in whole.maxima().items():
        np.testing.assert_array_equal(again.maxima()[name], values)
    other = first.frame()
    other.state["peak_nodes"] = other.state["peak_nodes"] + whole.grid.bed.size
    with pytest.raises(FormatError, match="another scene"):
        rough_solver(maxima=True).restore(other)


def test_peaks_of_every_step_are_kept_only_on_request():
    solver = rough_solver(maxima=True)
    fastest = 0.0
    for _ in range(40):
        solver.advance(1e9, max_steps=5)
        fastest = max(fastest, np.linalg.norm(solver.frame().particles.velocity, axis=1).max())
    peaks = solver.frame().maxima
    assert 0.5 * fastest < peaks["speed"].max() < 1.5 * fastest
    assert peaks["thickness"].max() >= 2.5
    assert (peaks["arrival_time"] >= 0).sum() == (peaks["speed"] > 0).sum()
    assert peaks["arrival_thickness"] == 0.05
    assert rough_solver().frame().maxima == {}


def test_arrival_speed_and_pressure_require_the_arrival_thickness():
    """Thickness peaks do not depend on the threshold; the others exist exactly where the flow was that thick."""
    kept = {}
    for thickness in (0.02, 1.5):
        solver = rough_solver(maxima=True, arrival_thickness=thickness)
        solver.advance(1e9, max_steps=200)
        kept[thickness] = solver.maxima()
        peaks = kept[thickness]
        thick = peaks["thickness"] >= thickness
        assert peaks["arrival_thickness"] == thickness
        assert 0 < thick.sum() < thick.size
        np.testing.assert_array_equal(peaks["arrival_time"] >= 0, thick)
        np.testing.assert_array_equal(peaks["speed"] > 0, thick)
        np.testing.assert_array_equal(peaks["pressure"] > 0, thick)
    thin, thick = kept[0.02], kept[1.5]
    np.testing.assert_array_equal(thin["thickness"], thick["thickness"])
    both = thick["arrival_time"] >= 0
    assert (thin["arrival_time"] <= thick["arrival_time"])[both].all()
    assert (thin["arrival_time"] < thick["arrival_time"])[both].any()


def test_an_unphysical_run_stops_with_its_place():
    solver = rough_solver()
    solver.arrays.rows[7, 3] = np.nan
    with pytest.raises(UnphysicalError, match="not finite"):
        list(TimeIntegration(solver, 5.0, 1.0))
    solver = rough_solver()
    solver.arrays.rows[:, 2] = 500.0
    with pytest.raises(UnphysicalError, match="as its drop in height allows") as error:
        list(TimeIntegration(solver, 5.0, 1.0))
    assert "\n" not in str(error.value) and error.value.exit_code == 3


def test_columns_that_start_off_the_terrain_are_refused():
    terrain = terrain_of(rough, 400, 200, 5)
    with pytest.raises(SceneError, match="outside"):
        solver_on(terrain, columns_of(1.0, 390, 410, 50, 60, 1.25), 5.0)
    with pytest.raises(SceneError, match="cell_size"):
        solver_on(terrain, columns_of(1.0, 100, 110, 50, 60, 1.25), 150.0)
    with pytest.raises(SceneError, match="columns"):
        ColumnSolver(Frame(pile().particles, dimension=3), terrain, None, None)


def test_water_form_refuses_curvature():
    with pytest.raises(SceneError, match="curvature"):
        rough_solver(metric=WATER, curvature=CURVATURE)


def test_one_column_alone_moves_as_a_point():
    """H3: one particle: its affine matrix is finite and it slides."""
    terrain = terrain_of(lambda x, y: 0.5 * (400 - x), 400, 200, 5)
    solver = solver_on(terrain, columns_of(1e-6, 100, 105, 50, 55, 5.0), 5.0, FRICTIONLESS)
    solver.advance(3.0)
    p = solver.frame().particles
    assert len(p) == 1 and np.isfinite(p.position).all()
    np.testing.assert_allclose(np.linalg.norm(p.velocity[0]), G * np.sin(np.arctan(0.5)) * 3.0, rtol=1e-6)


def pool(form, **numerics):
    """Frictionless water that flows into a walled corner, 12.4 m deep there if at rest; and the largest depth there."""
    terrain = terrain_of(lambda x, y: 0.2 * (600 - x) + 0.2 * (300 - y), 600, 300, 5)

    def cap(x, y):
        return np.maximum(5 - ((x - 100) ** 2 + (y - 150) ** 2) / 200, 0)

    solver = solver_on(terrain, columns_of(cap, 50, 150, 100, 200, 2.5), 5.0, metric=form, edges="wall", **numerics)
    deepest = 0.0
    for time in range(20, 81, 4):
        solver.advance(time)
        deepest = max(deepest, node_thickness(solver)[2].max())
    return deepest, solver


@pytest.mark.parametrize("form", [SLOPE, WATER])
def test_water_does_not_heap_in_a_corner(form):
    """H26: a converging flow splashes to some 2.5 times the pool's depth, no more, and gains no energy."""
    deepest, solver = pool(form)
    assert deepest < 35.0
    assert sum(solver.energy()) <= 1.001 * sum(solver.energy_start)


def test_an_optional_clamp_keeps_the_exact_solutions():
    _, h, exact, solver = dam_break(0.5, metric=WATER, clamp=2.0)
    assert relative_l1(h, exact) <= 0.006 and solver.balances()["speed_limited_share_max"] <= 1e-3


@pytest.mark.thorough
def test_a_thin_slow_flow_onto_a_steep_slope_is_not_outrun_by_its_time_step():
    terrain = terrain_of(lambda x, y: np.where(x < 100, 0.0, (100 - x) * np.tan(np.radians(35))), 400, 100, 5)
    frame = columns_of(1e-3, 50, 95, 30, 70, 1.25, velocity=(0.05, 0.0))
    solver = solver_on(terrain, frame, 5.0, curvature=CURVATURE)
    list(TimeIntegration(solver, 30.0, 5.0))  # raised UnphysicalError when a step was as long as the slow flow allowed
    fall = np.sqrt(2 * 5.0 / (G * np.sin(np.radians(35)) * np.cos(np.radians(35))))
    assert solver.step >= 30.0 / (0.3 * fall)


def test_ground_next_to_a_rotated_raster_is_outside():
    grid = Grid(None, Affine.rotation(45) * Affine.scale(5.0, -5.0), (80, 80))
    x, _ = grid.xy(*np.mgrid[0:80, 0:80])
    solver = solver_on(Terrain(grid, 0.1 * x), columns_of(1.0, 280, 290, -5, 5, 1.25), 5.0)
    inside = solver.grid.inside
    j, i = np.nonzero(inside)
    row, column = grid.rowcol(solver.grid.x0 + 5.0 * (i + 0.5), solver.grid.y0 + 5.0 * (j + 0.5))
    assert row.min() > -0.5 and row.max() < 79.5 and column.min() > -0.5 and column.max() < 79.5
    assert inside.sum() > 0.85 * 80 * 80


def test_every_particle_is_in_the_tile_of_its_block():
    """Stencil base and block key are rounded in the same way, also if 1/dx is not a binary number."""
    from mpmgis.solvers.columns.column_blocks import block_key
    from mpmgis.solvers.columns.spline_weights import weights

    for dx in (0.3, 1 / 3, 0.6, 0.7, 3.3):
        for cell in (7, 15, 31, 63, 127, 255, 511, 1023):
            edge = (cell + 0.5) * dx
            for x in (np.nextafter(edge, -np.inf), edge, np.nextafter(edge, np.inf)):
                base, *_ = weights(x, 1.0 / dx)
                assert 0 <= base - 8 * (block_key(x, x, 1.0 / dx) & 0xFFFF) <= 7, (dx, cell, x)


def same_state(solver, again):
    """Assert that all arrays of the states are bitwise equal."""
    first, second = solver.state(), again.state()
    assert set(first) == set(second)
    for name, values in first.items():
        assert np.asarray(values).tobytes() == np.asarray(second[name]).tobytes(), name


@pytest.mark.parametrize("breaks", [(0.7,), (0.7, 1.4, 2.1), (1.9, 2.4)])
def test_a_run_that_was_broken_has_the_same_state_while_columns_leave(breaks):
    terrain = terrain_of(lambda x, y: 0.5 * (200 - x), 200, 100, 5)
    frame = columns_of(2.0, 140, 190, 30, 70, 1.25, velocity=(10.0, 0.0))
    whole, broken = (solver_on(terrain, frame, 5.0) for _ in range(2))
    for time in (*breaks, 2.6):
        whole.advance(time)
        broken.advance(time)
        again = solver_on(terrain, frame, 5.0)
        again.restore(broken.frame())
        broken = again
    assert 0 < broken.particles < len(frame.particles)
    same_state(whole, broken)


def test_energy_that_left_over_an_edge_is_not_called_lost():
    terrain = terrain_of(lambda x, y: 0.5 * (200 - x), 200, 100, 5)
    solver = solver_on(terrain, columns_of(1.0, 100, 160, 20, 80, 1.25), 5.0)
    solver.advance(30.0)
    balances = solver.balances()
    assert balances["mass_now"] == 0.0
    assert abs(balances["energy_lost"]) < 0.05 * sum(solver.energy_start)
