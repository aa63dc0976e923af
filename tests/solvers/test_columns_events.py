"""Inflow over time and secondary releases: steady flows with exact solutions, slabs, triggers, pauses, restarts."""

from dataclasses import replace

import numpy as np
import pytest
from column_scenes import G, columns_of, node_thickness, solver_on, spline, terrain_of

from mpmgis.compiled.jit import set_threads
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.friction import FRICTIONLESS, friction_law, parameters_of
from mpmgis.laws.ground_metric import WATER
from mpmgis.simulation.release_events import Events, inlet_of, secondary_releases
from mpmgis.simulation.time_integration import TimeIntegration
from mpmgis.solvers.columns import column_loop as kernel
from mpmgis.system.errors import FormatError, SceneError
from mpmgis.terrain.inflow import Hydrograph, batch_times, clearing_time

RUNNY = friction_law("Voellmy", 0.1, 100.0)
SLOPE = np.radians(10.0)


def nothing():
    """A frame without columns: a run that starts empty."""
    none = np.zeros(0)
    return Frame(Particles(np.zeros((0, 3)), np.zeros((0, 3)), none, none, none, none), dimension=2)


def area(west, east, south, north, spacing, thickness=1.0):
    """Columns of an inlet or of a secondary area, with the header of the seeding."""
    frame = columns_of(thickness, west, east, south, north, spacing)
    return replace(frame, particles=replace(frame.particles, id=None), header={"density": 1000.0})


def table(time, discharge=None, thickness=None, speed=None, velocity=None):
    arrays = {"discharge": discharge, "thickness": thickness, "speed": speed, "velocity": velocity}
    given = {name: np.array(values, float) for name, values in arrays.items() if values is not None}
    return Hydrograph(np.array(time, float), **given)


def slope_solver(frame, length=120.0, width=4.0, dx=1.0, **numerics):
    """A 10 degree plane falling eastwards between walls."""
    terrain = terrain_of(lambda x, y: np.tan(SLOPE) * (length - x), length, width, dx)
    return solver_on(terrain, frame, dx, RUNNY, reference_thickness=1.0, **{"edges": "wall", **numerics})


def pool_solver(length, width, dx, frame=None):
    """Level ground between walls, water without friction."""
    terrain = terrain_of(lambda x, y: 0.0 * x, length, width, dx)
    frame = frame or nothing()
    return solver_on(terrain, frame, dx, FRICTIONLESS, WATER, edges="wall", reference_thickness=1.0)


# --------------------------------------------------------------------------------------------------------- the table


def test_volume_is_the_exact_integral_of_the_straight_lines():
    flow = table([10, 20, 40], discharge=[0, 6, 2])
    assert flow.volume(0, 100) == pytest.approx(30 + 80, rel=1e-15)
    assert flow.volume(12, 15) == pytest.approx(0.6 * (15 - 12) * (2 + 5) / 2, rel=1e-14)
    assert flow.volume(15, 30) == pytest.approx(0.5 * (3 + 6) * 5 + 0.5 * (6 + 4) * 10, rel=1e-14)
    assert flow.volume(0, 10) == flow.volume(40, 90) == flow.volume(30, 20) == 0.0


def test_batches_cover_the_inflow_and_their_volumes_add_up_to_it():
    flow = table([3, 7.3, 50, 81], discharge=[1, 9, 0.2, 4])
    times = batch_times(flow, 70.0, 0.37)
    assert times[0, 0] == 3.0 and times[-1, 1] == 70.0 and (times[1:, 0] == times[:-1, 1]).all()
    assert np.diff(times).max() <= 0.37 * (1 + 1e-12)
    total = sum(flow.volume(*pair) for pair in times)
    assert total == pytest.approx(flow.volume(0, 70), rel=1e-13)
    assert len(batch_times(flow, 2.0, 0.37)) == 0


def test_the_next_event_is_later_than_the_given_time():
    """Also at the time of a batch that is not inserted yet: there the 3D time step was zero."""
    solver = slope_solver(nothing())
    events = Events([inlet_of(area(2, 6, 0, 4, 0.5), table([0, 5], discharge=[2, 2]), solver.grid, 5.0)])
    times = events.inlets[0].times
    due = events.next_time(0.0)
    assert due == times[1, 0] and events.next_time(due) == times[2, 0] and events.next_time(5.0) == np.inf


def test_the_clearing_time_is_that_of_critical_outflow_or_of_a_slide():
    assert clearing_time(20.0, 10.0, 4.0, 0.0, 0.0) == pytest.approx(10.0 / (G * 20 / 4) ** (1 / 3))
    fast = clearing_time(20.0, 10.0, 4.0, 1.0, 10.0)
    assert fast == pytest.approx(10.0 / (0.5 * (10 + np.sqrt(100 + 2 * G * 10 * 0.5))))


# --------------------------------------------------------------------------------------------------- steady inflows


def test_a_steady_inflow_into_a_pool_pushes_as_deep_water_does():
    """Free outflow of a channel's end that is fed from above, q = Q x / L (spatially varied flow; momentum is kept).

    q^2 / h + g h^2 / 2 = 3/2 g h_c^2 with critical flow at x = L. If columns kept the pressure of their inflow
    thickness, the pool would become twice as deep. Measured: mean error over the pool 0.9 %.
    """
    dx, source, q, width = 1.0, 20.0, 5.0, 4.0
    solver = pool_solver(200.0, width, dx)
    inlet = inlet_of(area(0, source, 0, width, dx / 4), table([0, 1000], discharge=[q * width] * 2), solver.grid, 1e6)
    assert len(inlet.layers) == 8
    depth = []
    for frame in TimeIntegration(solver, 36.0, 0.5, events=Events([inlet])):
        if frame.time >= 24.0:
            depth.append(node_thickness(solver)[2].mean(axis=0))
    x = node_thickness(solver)[0]
    at = (x > 0) & (x <= source - dx)
    critical = (q * q / G) ** (1 / 3)

    def exact(flux):
        roots = np.roots([0.5 * G, 0.0, -1.5 * G * critical**2, flux**2])
        return max(roots.real[abs(roots.imag) < 1e-9])

    wanted = np.array([exact(q * place / source) for place in x[at]])
    got = np.mean(depth, axis=0)[at]
    assert exact(0.0) == pytest.approx(np.sqrt(3) * critical)
    assert np.abs(got - wanted).sum() / wanted.sum() < 0.02
    assert abs(got[:3].mean() / wanted[:3].mean() - 1) < 0.02


def test_a_steady_inflow_runs_down_a_slope_as_normal_flow():
    """h u = q and sin = mu cos + U^2 / (xi h_n) far behind the front; mass is the integral of discharge."""
    q, width, end = 4.0, 4.0, 50.0
    mu, xi = parameters_of(RUNNY).values()
    drive = np.sin(SLOPE) - mu * np.cos(SLOPE)
    speed = (xi * q * drive) ** (1 / 3)
    flow = table([0, 100], discharge=[q * width] * 2, speed=[speed] * 2)
    solver = slope_solver(nothing(), length=200.0)
    events = Events([inlet_of(area(4, 12, 0, width, 0.25), flow, solver.grid, end)])
    flux, thickness, beyond = [], [], []
    for frame in TimeIntegration(solver, end, 1.0, events=events):
        p = frame.particles
        beyond.append(p.volume[p.position[:, 0] > 50].sum() / width)
        if frame.time > end - 10:
            here = (p.position[:, 0] > 30) & (p.position[:, 0] < 70)
            thickness.append(p.volume[here].sum() / (40.0 * width))
            flux.append((p.volume * p.velocity[:, 0])[here].sum() / (40.0 * width))
    mass = solver.balances()
    assert mass["mass_now"] + mass["mass_out"] == pytest.approx(1000 * flow.volume(0, end), rel=1e-12)
    assert abs(mass["mass_error_relative"]) <= 1e-12 and mass["speed_bound_ratio"] < 1.0
    assert np.mean(flux) == pytest.approx(q, rel=0.01)
    assert (beyond[-1] - beyond[-11]) / 10 == pytest.approx(q, rel=0.01)
    assert np.mean(thickness) == pytest.approx(q / speed / np.cos(SLOPE), rel=0.01)


def test_a_basin_fills_to_the_level_of_what_came_in():
    """The inflow is so slow that the surface stays level; the stream enters normal to the end of the basin."""
    length, width = 40.0, 4.0
    solver = pool_solver(length, width, 1.0, area(0, length, 0, width, 0.25))
    flow = table([0, 60, 120], discharge=[0, 1, 0], velocity=[[0.5, 0]] * 3)
    inlet = inlet_of(area(0, 8, 0, width, 0.25), flow, solver.grid, 1e6)
    for frame in TimeIntegration(solver, 150.0, 15.0, events=Events([inlet])):
        volume = length * width + sum(inlet.volumes[inlet.times[:, 0] <= frame.time])
        assert frame.particles.volume.sum() == pytest.approx(volume, rel=1e-12)
        level = node_thickness(solver)[2].mean(axis=0)
        assert np.abs(level / (volume / (length * width)) - 1).max() < 0.02, frame.time
    assert solver.balances()["mass_now"] == pytest.approx(160e3 + 60e3, rel=1e-12)


def test_nothing_comes_in_between_two_pulses():
    """Two triangles of 8 and 4 m3 with a pause of 4 s: the pause inserts no column, and each pulse is complete."""
    solver = slope_solver(nothing())
    flow = table([1, 2, 3, 7, 8, 9], discharge=[0, 8, 0, 0, 4, 0], speed=[3] * 6)
    events = Events([inlet_of(area(4, 12, 0, 4, 0.25), flow, solver.grid, 20.0)])
    numbers, released = {}, {}
    for frame in TimeIntegration(solver, 12.0, 0.5, events=events):
        numbers[frame.time] = int(frame.particles.id.max()) + 1
        released[frame.time] = solver.balances()["mass_released"]
    pause = [time for time in numbers if 3.0 <= time < 7.0]
    assert len(pause) == 8 and len({numbers[time] for time in pause}) == 1
    assert min(numbers) == 1.0 and numbers[2.0] < numbers[3.0] < numbers[8.0] < numbers[9.0] == numbers[12.0]
    assert [released[time] for time in pause] == pytest.approx([8e3] * 8, rel=1e-12)
    assert released[12.0] == pytest.approx(12e3, rel=1e-12)
    assert solver.balances()["mass_now"] == pytest.approx(12e3, rel=1e-12)


def test_the_inflow_has_the_speed_of_the_hydrograph():
    solver = slope_solver(nothing())
    frame = area(4, 12, 0, 4, 0.25)
    inlet = inlet_of(frame, table([0, 10], discharge=[1, 1], speed=[2, 6]), solver.grid, 100.0)
    k = int(np.argmin(np.abs(inlet.times[:, 0] - 5.0)))
    velocity = inlet.batch(k).particles.velocity
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), 2 + 0.4 * inlet.times[k, 0], rtol=1e-12)
    np.testing.assert_allclose(velocity[:, 2] / velocity[:, 0], -np.tan(SLOPE), rtol=1e-9)
    assert (velocity[:, 0] > 0).all() and np.abs(velocity[:, 1]).max() < 1e-9
    given = table([0, 10], discharge=[1, 1], velocity=[[1, 2], [3, 2]])
    velocity = inlet_of(frame, given, solver.grid, 100.0).batch(0).particles.velocity
    np.testing.assert_allclose(velocity[0], [1, 2, -np.tan(SLOPE)], rtol=1e-9)
    with pytest.raises(SceneError, match="level"):
        inlet_of(frame, table([0, 10], discharge=[1, 1], speed=[2, 6]), pool_solver(50, 4, 1).grid, 100.0)
    with pytest.raises(SceneError, match="nothing flows in before"):
        inlet_of(frame, table([50, 60], discharge=[1, 1]), solver.grid, 40.0)


# -------------------------------------------------------------------------------------------------------------- slabs


def test_one_slab_is_a_release_to_the_last_bit():
    frame = area(10, 30, 0, 4, 0.25, thickness=1.0)
    solver = slope_solver(nothing())
    events = Events([inlet_of(frame, table([0], thickness=[1.0]), solver.grid, 100.0)])
    inflow = list(TimeIntegration(solver, 3.0, 1.0, events=events))
    plain = list(TimeIntegration(slope_solver(frame), 3.0, 1.0))
    assert [f.time for f in inflow] == [f.time for f in plain] == [0.0, 1.0, 2.0, 3.0]
    for a, b in zip(inflow, plain, strict=True):
        for name in ("position", "velocity", "mass", "area", "id"):
            assert getattr(a.particles, name).tobytes() == getattr(b.particles, name).tobytes(), name


def test_slabs_laid_on_one_another_are_as_thick_as_both():
    frame = area(10, 30, 0, 4, 0.25)
    solver = slope_solver(nothing())
    events = Events([inlet_of(frame, table([0, 1e-9], thickness=[1.0, 0.5]), solver.grid, 100.0)])
    events.let_in(solver)
    solver.wait(1e-9)
    events.let_in(solver)
    rows, ids, _ = solver._alive()
    middle = (rows[:, kernel.X] > 13) & (rows[:, kernel.X] < 27)
    thickness = rows[:, kernel.MASS] / (1000 * rows[:, kernel.AREA])
    np.testing.assert_allclose(thickness[middle], 1.5, rtol=1e-3)
    assert len(np.unique(ids)) == len(ids) == 2 * len(frame.particles)
    assert solver.balances()["energy_lost"] == pytest.approx(0.0, abs=1e-6 * solver.energy()[1])


def test_settled_areas_are_those_of_a_plain_loop():
    """Open edges and walls: m / (rho h_g) with the mass of the grid summed node by node, mirrored at walls."""
    rng = np.random.default_rng(4)
    dx, n, cells = 2.0, 300, 8
    rows = np.zeros((n, kernel.GY + 1))
    rows[:, kernel.X], rows[:, kernel.Y] = rng.uniform(0, cells * dx, (2, n))
    rows[:, kernel.MASS], rows[:, kernel.AREA] = rng.uniform(1, 2, n), 1.0
    keys = np.where(rng.random(n) < 0.1, kernel.GONE, 0).astype(np.int32)
    here = keys != kernel.GONE
    for wall in (False, True):
        mass, nodes = np.zeros((cells + 3, cells + 3)), np.arange(cells + 3) - 1
        for x, y, m in rows[here][:, [kernel.X, kernel.Y, kernel.MASS]]:
            for mx in (x, -x, 2 * cells * dx - x) if wall else (x,):
                for my in (y, -y, 2 * cells * dx - y) if wall else (y,):
                    mass += m * np.outer(spline(my / dx - nodes), spline(mx / dx - nodes))
        got = rows.copy()
        walls = np.array((0, 0, cells + 2, cells + 2) if wall else (-9, -9, -9, -9))
        marked = np.ones((cells, 4), np.uint8)
        marked[3, 2] = 0
        kernel.settle_areas(got, keys, kernel.GONE, marked, 0, 4, walls, dx, 1000.0, 0.0, False)
        for p in range(n):
            x, y = rows[p, kernel.X] / dx, rows[p, kernel.Y] / dx
            if keys[p] == kernel.GONE or x < 4 or (int(y), int(x)) == (3, 6):
                assert got[p, kernel.AREA] == 1.0
                continue
            seen = spline(y - nodes) @ mass @ spline(x - nodes)
            assert got[p, kernel.AREA] == pytest.approx(rows[p, kernel.MASS] * dx * dx / seen, rel=1e-12)


# ------------------------------------------------------------------------------------------------- secondary releases


def avalanche(trigger=None, second=60.0, **numerics):
    """A release above, an area at rest further down; solver and events."""
    solver = slope_solver(area(4, 24, 0, 4, 0.25), **numerics)
    lower = area(second, second + 10, 0, 4, 0.25, 0.5)
    events = Events((), secondary_releases([("lower", lower, trigger)], solver.grid))
    return solver, events


def test_a_secondary_area_moves_when_the_flow_gets_there():
    solver, events = avalanche()
    frames = list(TimeIntegration(solver, 20.0, 0.5, events=events))
    front = [f.particles.position[f.particles.id < 1280, 0].max() for f in frames]
    number = [len(f.particles) for f in frames]
    first = int(np.argmax(np.array(number) > number[0]))
    assert first > 0 and number[-1] == number[0] + 40 * 16
    assert front[first - 1] < 61.5 and front[first] > 57.0  # within the reach of a spline
    p = frames[first].particles
    assert p.id.max() == len(p) - 1
    released = p.id >= 1280
    assert p.volume[released].sum() == pytest.approx(0.5 * 40, rel=1e-12)
    balances = solver.balances()
    assert balances["mass_released"] == pytest.approx(1000 * (80 + 20), rel=1e-12)
    assert abs(balances["mass_error_relative"]) <= 1e-12 and balances["energy_lost"] > 0
    assert events.record() == {"batches": 0, "secondary_releases": ["lower"]}


def test_a_secondary_area_is_released_by_its_trigger_thickness():
    arrivals = []
    for trigger in (None, 0.2, 5.0):
        solver, events = avalanche(trigger)
        times = [f.time for f in TimeIntegration(solver, 20.0, 0.25, events=events) if len(f.particles) > 1280]
        arrivals.append(times[0] if times else np.inf)
    assert arrivals[0] < arrivals[1] < arrivals[2] == np.inf


def test_areas_that_share_corners_are_all_released_and_those_within_others_refused():
    solver = slope_solver(area(4, 24, 0, 4, 0.25))
    both = [("a", area(40, 50, 0, 4, 0.25), None), ("b", area(50, 60, 0, 4, 0.25), None)]
    events = Events((), secondary_releases(both, solver.grid))
    list(TimeIntegration(solver, 20.0, 5.0, events=events))
    assert events.record()["secondary_releases"] == ["a", "b"]
    with pytest.raises(SceneError, match="within cells of others"):
        secondary_releases([*both, ("c", area(44, 45, 0, 1, 0.25), None)], solver.grid)


# -------------------------------------------------------------------------------------- pauses, stop rules, restarts


def test_no_stop_rule_ends_a_run_while_something_is_to_come():
    """Friction above the slope: all is at rest immediately, but there is inflow until 6 s."""
    terrain = terrain_of(lambda x, y: 0.1 * (120 - x), 120, 4, 1)
    frame = area(4, 12, 0, 4, 0.25, 0.01)
    solver = solver_on(terrain, frame, 1.0, friction_law("Voellmy", 2.0, 100.0), stop_at_rest=True, edges="wall")
    flow = table([2, 6], discharge=[0.01, 0.01])
    events = Events([inlet_of(area(40, 48, 0, 4, 0.25), flow, solver.grid, 300.0)])
    march = TimeIntegration(solver, 300.0, 1.0, events=events)
    list(march)
    assert 6.0 <= solver.time < 60.0 and "at rest" in march.reason
    assert solver.balances()["mass_released"] == pytest.approx(1000 * (0.32 + 0.04), rel=1e-12)


def busy():
    """Release, two secondary areas, and inflow that continues after their release."""
    solver = slope_solver(area(4, 24, 0, 4, 0.25), maxima=True)
    flow = table([2, 4, 9], discharge=[0, 8, 1], speed=[3, 3, 3])
    areas = [("a", area(40, 46, 0, 4, 0.25, 0.5), None), ("b", area(60, 66, 0, 4, 0.25, 0.5), 0.1)]
    inlet = inlet_of(area(4, 12, 0, 4, 0.25), flow, solver.grid, 14.0)
    return solver, Events([inlet], secondary_releases(areas, solver.grid))


def test_a_run_goes_on_from_any_frame_to_the_same_bits():
    """On one thread and on two by turns."""
    set_threads(1)
    solver, events = busy()
    frames = list(TimeIntegration(solver, 14.0, 1.0, events=events))
    assert events.record()["secondary_releases"] == ["a", "b"] and events.record()["batches"] > 20
    counts = [len(f.particles) for f in frames]
    assert len(set(counts)) > 6
    for k, threads in ((0, 2), (2, 1), (5, 2), (8, 1), (11, 2)):
        set_threads(threads)
        again, later = busy()
        again.restore(frames[k])
        later.restore(frames[k])
        rest = list(TimeIntegration(again, 14.0, 1.0, resumed=True, events=later))
        assert [f.time for f in rest] == [f.time for f in frames[k + 1 :]]
        for name in ("position", "velocity", "mass", "area", "id"):
            assert getattr(rest[-1].particles, name).tobytes() == getattr(frames[-1].particles, name).tobytes(), name
        assert set(rest[-1].state) == set(frames[-1].state)
        for name, values in frames[-1].state.items():
            assert np.asarray(values).tobytes() == np.asarray(rest[-1].state[name]).tobytes(), name
    set_threads(None)


def test_a_run_that_had_ended_when_it_was_killed_has_nothing_left_to_do():
    def resting():
        solver, events = avalanche(stop_at_rest=True)
        solver.arrays.rows[:, kernel.U] = 0.0
        return solver, events

    solver, events = resting()
    march = TimeIntegration(solver, 400.0, 7.0, events=events)
    last = list(march)[-1]
    assert "at rest" in march.reason and last.time % 7.0 != 0.0
    again, later = resting()
    again.restore(last)
    later.restore(last)
    resumed = TimeIntegration(again, 400.0, 7.0, resumed=True, events=later)
    assert list(resumed) == [] and resumed.reason == march.reason and again.step == solver.step


def test_the_state_of_other_events_is_refused():
    solver, events = busy()
    frame = next(iter(TimeIntegration(solver, 14.0, 1.0, events=events)))
    with pytest.raises(FormatError, match="another scene"):
        Events().restore(frame)
