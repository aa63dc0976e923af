"""Splash on thin sheets of a fluid: no point is thrown, little energy is lost, and the limiter of the affine velocity
acts nowhere else (`affine_limit._limit_point`)."""

import numpy as np
import pytest
from column_scenes import terrain_of
from exact_solutions import G
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_points import plain_step, yields_of
from point_scenes import block_of, integrate_to, points_on, sorted_points

from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.effect_slots import PointEffects
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager, fluid
from mpmgis.laws.material_choice import state_at_stress
from mpmgis.laws.softening import Softening
from mpmgis.solvers.points.point_balances import exceeded_by
from mpmgis.solvers.points.point_numerics import PointNumerics
from mpmgis.solvers.points.point_solver import PointSolver

DENSITY, SOUND = 1300.0, 200.0
WATER = fluid(DENSITY * SOUND**2, 0.0, 0.0)
SPLASH = np.array([-0.2, 0.0, -0.225])  # velocity over that of the sheet


def moving(frames, velocities):
    """One Frame of blocks, each with its velocity [m s-1]."""
    place = np.vstack([frame.particles.position for frame in frames])
    volume = np.concatenate([frame.particles.volume for frame in frames])
    velocity = np.vstack([np.tile(v, (len(f.particles.id), 1)) for f, v in zip(frames, velocities, strict=True)])
    ids = np.arange(len(place), dtype=np.uint64)
    return Frame(Particles(place, velocity, DENSITY * volume, volume, id=ids), dimension=3)


def struck(cell=1.0, speed=40.0, points=2, shift=(0.0, 0.0), sparse=None, sound=SOUND, floor=20.0, **numerics):
    """A sheet 3 m thick at `speed` [m s-1] under a splash that falls on it, without gravity, in plane strain.

    `shift` [m] moves both along x and z; `points` is their number along the edge of a cell. With a seed `sparse`, the
    splash is 120 strings of points at random places. Returns (solver, time in which the sheet flies 24 m).
    """
    step, wide = cell / points, 4 * cell
    sheet = block_of((40.0, wide, 3.0), step, (14.0 + shift[0], 0.0, floor + shift[1]), DENSITY)
    splash = block_of((24.0, wide, 6.0), step, (60.0 + shift[0], 0.0, floor + 4.0 + shift[1]), DENSITY)
    if sparse is not None:
        splash = block_of((120 * step, wide, step), step, density=DENSITY)
        string = np.round(splash.particles.position[:, 0] / step - 0.5).astype(int)
        at = np.random.default_rng(sparse).random((120, 2)) * (30.0, 8.0) + (60.0, floor + 3.5)
        splash.particles.position[:, [0, 2]] = at[string] + shift
    frame = moving([sheet, splash], [np.array([speed, 0.0, 0.0]), SPLASH * speed])
    water = WATER._replace(bulk_modulus=DENSITY * sound**2)
    ground = terrain_of(lambda x, y: 0.0 * x, 150.0, wide, cell)
    return points_on(ground, frame, cell, water, gravity=0.0, edges="wall", **numerics), 24.0 / speed


def outcome(**scene):
    """(largest speed over that of the sheet, kinetic energy left, balances)."""
    solver, end = struck(**scene)
    integrate_to(solver, end)
    balances = solver.balances()
    speed = scene.get("speed", 40.0)
    return balances["speed_max"] / speed, balances["kinetic_energy"] / balances["energy_start"], balances


@pytest.mark.thorough
def test_splash_does_not_throw_a_sheet_of_three_cells():
    """1.02 times the sheet's speed and 87 % of the energy. Without the limiter 1.43 and 92 %."""
    fastest, energy, balances = outcome()
    assert fastest <= 1.1 and energy >= 0.85
    assert balances["momentum_error_relative"] <= 1e-12
    assert 1e-4 < balances["clips"]["affine_velocity"] / balances["particle_steps"] < 0.2
    assert 0.0 < balances["energy_lost_to_affine_limit"] < balances["energy_lost"]
    assert balances["energy_lost_to_mixing"] > 0.0


@pytest.mark.thorough
@pytest.mark.parametrize("sparse", [0, 1])
def test_sparse_splash_does_not_throw_the_sheet(sparse):
    """Measured: 1.02 and 88 % of the energy. Without the limiter 1.35 and 1.41, 94 and 95 %."""
    fastest, energy, _ = outcome(sparse=sparse)
    assert fastest <= 1.1 and energy >= 0.85


@pytest.mark.thorough
def test_half_the_cells():
    """Six cells over the sheet: 1.31 and 95 %. Without the limiter 1.45 and 96 %."""
    fastest, energy, _ = outcome(cell=0.5)
    assert fastest <= 1.35 and energy >= 0.93


@pytest.mark.thorough
@pytest.mark.parametrize(
    "scene",
    [
        {"shift": (0.25, 0.75)},
        {"shift": (0.5, 0.5), "points": 3},
        {"shift": (0.6, 0.1)},
        {"points": 3},
        {"points": 4},
        {"speed": 80.0},
        {"sound": 400.0},
        {"speed": 80.0, "points": 3},
        {"precision": "float32"},
    ],
    ids=str,
)
def test_other_offsets_densities_of_points_and_speeds(scene):
    """Measured: 1.02 to 1.07, 85 to 89 % of the energy. Without the limiter 1.42 to 1.49, 91 to 92 %."""
    fastest, energy, _ = outcome(**scene)
    assert fastest <= 1.1 and energy >= (0.83 if "sound" in scene else 0.85)  # twice the steps lose more


@pytest.mark.thorough
@pytest.mark.parametrize(("speed", "most", "least"), [(20.0, 1.1, 0.84), (10.0, 1.3, 0.84), (5.0, 1.3, 0.83)])
def test_slow_sheets(speed, most, least):
    """At 0.1, 0.05 and 0.025 times the speed of pressure waves: 1.03, 1.21 and 1.24, and 85, 86 and 86 %.

    Without the limiter 1.42, 1.39 and 1.35 times the sheet's speed, and 91, 90 and 89 % of the energy.
    """
    fastest, energy, _ = outcome(speed=speed)
    assert fastest <= most and energy >= least


@pytest.mark.thorough
def test_the_front_of_a_dam_break_is_as_fast_as_ritter_has_it():
    """The place that 1 % of the water has passed after 4 sqrt(H / g): 1.6 % beyond Ritter's (1892) on 8 cells, 1.1 % on
    16 cells (9.634 and 9.592 m, exact 9.485 m); with the weights of the spline as shares it was 9.544 and 9.586 m.

    h = (2 c - x / t)^2 / (9 g) leaves t (2 c - x / t)^3 / (27 g) beyond x.
    """
    height, length, cell = 2.0, 16.0, 0.25
    frame = block_of((length, 4 * cell, height), 0.5 * cell)
    wave = np.sqrt(9.81 * height)
    stress = np.zeros((len(frame.particles.id), 6))
    stress[:, :3] = -9810.0 * (height - frame.particles.position[:, 2:])
    ground = terrain_of(lambda x, y: 0.0 * x, 60.0, 4 * cell, cell)
    water = fluid(1000.0 * (10.0 * wave) ** 2, 0.0, 0.0)
    solver = points_on(ground, frame, cell, water, stress=stress, gravity=9.81, edges="wall")
    time = 4.0 * height / wave
    integrate_to(solver, time)
    exact = time * (2.0 * wave - np.cbrt(0.01 * height * length * 27.0 * 9.81 / time))
    passed = np.quantile(sorted_points(solver).position[:, 0], 0.99) - length
    assert passed == pytest.approx(exact, rel=0.02)


@pytest.mark.slow
@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    speed=st.floats(30.0, 80.0),
    points=st.integers(2, 4),
    shift=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
    sound=st.floats(150.0, 300.0),
)
def test_any_sheet_is_held_together(speed, points, shift, sound):
    fastest, energy, _ = outcome(speed=speed, points=points, shift=shift, sound=sound)
    assert fastest <= 1.15 and energy >= 0.8


@pytest.mark.thorough
@pytest.mark.parametrize("shift", [0.0, 0.37])
def test_a_sheet_that_turns_and_one_that_shears_are_not_limited(shift):
    """Velocities that are linear in space: R^2 is 1, for any thickness and position of the sheet."""
    frame = block_of((8.0, 8.0, 1.0), 0.5, (4.0 + shift, 4.0, 6.0 + shift), DENSITY)
    place = frame.particles.position - frame.particles.position.mean(axis=0)
    gradient = np.array([[0.0, -3.0, 2.0], [3.0, 0.0, 1.0], [-2.0, 1.0, 0.0]])
    frame = moving([frame], [np.array([5.0, 0.0, 0.0])])
    frame.particles.velocity[:] += place @ gradient.T
    affine = np.tile(gradient, (len(place), 1, 1))
    numerics = PointNumerics(1.0, density=DENSITY, gravity=0.0)
    ground = terrain_of(lambda x, y: 0.0 * x, 20.0, 20.0, 1.0)
    solver = PointSolver(frame, ground, PointEffects(WATER), numerics, affine=affine)
    solver.advance(1e9, max_steps=5)
    assert solver.balances()["clips"]["affine_velocity"] == 0


@pytest.mark.thorough
def test_the_limited_step_equals_the_plain_loop():
    """Places and velocities to 1e-11 after four steps in which some points are limited, and as many are counted."""
    rng = np.random.default_rng(5)
    frame = block_of((3.0, 2.5, 3.0), 0.5, (4.3, 3.2, 0.6), DENSITY)
    frame.particles.velocity[:] = 20.0 * rng.normal(size=frame.particles.velocity.shape)
    ground = terrain_of(lambda x, y: 3.0 - 0.2 * x, 16.0, 12.0, 1.0)
    frame.particles.position[:, 2] += 3.0 - 0.2 * frame.particles.position[:, 0]
    solver = points_on(ground, frame, 1.0, WATER, time_step=1e-3)
    corner = solver._corner_from((0.0, 0.0, 0.0))
    place, velocity = frame.particles.position - corner, frame.particles.velocity.copy()
    n = len(place)
    nodes = np.zeros((20, *solver._ground.shape[:2], 4))
    yields = yields_of(solver)
    state, stress, affine, count = np.zeros((n, 8)), np.zeros((n, 6)), np.zeros((n, 3, 3)), 0
    for values, k in zip(state_at_stress(WATER, tuple(stress.T)), range(8), strict=True):
        state[:, k] = values
    for _ in range(4):
        count += plain_step(
            place,
            velocity,
            affine,
            frame.particles.mass,
            state,
            stress,
            nodes,
            solver._ground[..., :3],
            yields,
            1.0,
            1e-3,
            DENSITY,
            9.81,
            0.0,
            WATER,
            Softening(),
            solver._settings.signal_speed,
        )
    integrate_to(solver, 4e-3)
    now = sorted_points(solver)
    assert 0.05 * n < count < 3.9 * n and solver.balances()["clips"]["affine_velocity"] == count
    np.testing.assert_allclose(now.position, place + corner, rtol=0, atol=1e-11)
    np.testing.assert_allclose(now.velocity, velocity, rtol=0, atol=1e-9)


# the percentile of speed


@settings(deadline=None)
@given(
    values=st.lists(st.floats(0.0, 100.0), min_size=1, max_size=400),
    share=st.sampled_from([1e-3, 0.01, 0.1, 0.5]),
    seed=st.integers(0, 99),
    even=st.booleans(),
)
def test_exceeded_by_is_the_least_value_that_at_most_the_share_exceeds(values, share, seed, even):
    values = np.array(values)
    mass = np.ones(len(values)) if even else np.random.default_rng(seed).lognormal(0.0, 2.0, len(values))
    allowed = share * mass.sum() * (1.0 + 1e-9)
    expected = min(value for value in values if mass[values > value].sum() <= allowed)
    assert exceeded_by(share, values, mass) == expected


@pytest.mark.thorough
def test_the_percentile_of_a_run_is_that_of_its_fastest_frame():
    solver, end = struck()
    speeds = [40.0]
    for until in np.linspace(0.0, end, 5)[1:]:
        integrate_to(solver, until)
        solver.note_deepest()
        speed = np.linalg.norm(sorted_points(solver).velocity, axis=1)
        speeds.append(np.quantile(speed, 0.999, method="inverted_cdf"))
    balances = solver.balances()
    assert balances["speed_p999_now"] == pytest.approx(speeds[-1], rel=1e-3)
    assert balances["speed_p999"] == pytest.approx(max(speeds), rel=1e-3)
    assert balances["speed_p999"] <= balances["speed_max"]
    again, _ = struck()
    again.restore(solver.frame())
    assert all(again.balances()[name] == balances[name] for name in ("speed_p999", "speed_p999_time"))


def front_of_sand(degrees, slowed, cell, high, stiff, speed, precision, travel=40.0):
    """(lowest point [cells over the ground], share of the points more than 0.3 cells under the ground, solver).

    Sand `high` cells thick slides `travel` cells down a plane, with friction of `slowed` times the slope. Pressure
    waves have a speed of about sqrt(`stiff` g cell); the sand starts with `speed` [sqrt(g cell)].
    """
    slope = np.radians(degrees)
    fall, down = np.tan(slope), np.array([np.cos(slope), 0.0, -np.sin(slope)])
    velocity = speed * np.sqrt(G * cell) * down
    sand = block_of((20 * cell, 3 * cell, high * cell), 0.5 * cell, density=DENSITY, velocity=velocity)
    place = sand.particles.position
    place[:, 0] += 6.0 * cell
    place[:, 2] += 200.0 * cell - fall * place[:, 0] + 0.02 * cell
    young = DENSITY * stiff * G * cell
    terrain = terrain_of(lambda x, y: 200.0 * cell - fall * x, 140.0 * cell, 3.0 * cell, cell)
    material = drucker_prager(0.6 * young, 0.3 * young, 30.0, 0.0)
    contact = friction_law("Coulomb", slowed * fall)
    solver = points_on(terrain, sand, cell, material, contact, edges="wall", precision=precision)
    pull = (1.0 - slowed) * G * np.sin(slope) * np.cos(slope)
    solver.advance((np.sqrt(velocity[0] ** 2 + 2.0 * pull * travel * cell) - velocity[0]) / pull)
    position = sorted_points(solver).position
    above = (position[:, 2] - 200.0 * cell + fall * position[:, 0]) / cell
    return above.min(), np.mean(above < -0.3), solver


def collapse_in_a_strip(along, wide, precision):
    """The solver of a column of sand, 8 cells long and high, after its collapse on rough ground in a strip `wide`
    cells wide between smooth walls, along the axis `along` (0 or 1)."""
    sides, shape = [8.0, 8.0, 8.0], [24.0, 24.0]
    sides[1 - along] = shape[1 - along] = float(wide)
    sand = block_of(tuple(sides), 0.5, density=DENSITY)
    young = 0.8 * DENSITY * 49.0 * G * 8.0
    material = drucker_prager(young / 1.2, young / 2.6, 30.0, 0.0)
    terrain = terrain_of(lambda x, y: 0.0 * x, shape[0], shape[1], 1.0)
    solver = points_on(terrain, sand, 1.0, material, friction_law("Coulomb", 0.6), edges="wall", precision=precision)
    integrate_to(solver, 5.0 * np.sqrt(8.0 / G))
    return solver


@pytest.mark.parametrize(
    ("along", "wide", "precision"), [(0, 3, "float64"), (1, 3, "float64"), (0, 3, "float32"), (0, 5, "float64")]
)
def test_flow_along_a_wall_keeps_its_affine_velocity(along, wide, precision):
    """The limit takes 0.20 % of the initial energy of this collapse. Before, it took 0.64 %: it acted on every point
    near the ground within three cells of a wall, so on all points of a strip."""
    balances = collapse_in_a_strip(along, wide, precision).balances()
    assert balances["energy_lost_to_affine_limit"] <= 0.005 * balances["energy_start"]


FRONTS = {
    "degrees": st.floats(12.0, 40.0),
    "slowed": st.floats(0.05, 0.9),
    "cell": st.sampled_from([0.01, 0.3, 1.57, 10.0]),
    "high": st.integers(1, 4),
    "stiff": st.floats(100.0, 3000.0),
    "speed": st.sampled_from([0.0, 5.0]),
    "precision": st.sampled_from(["float64", "float32"]),
}


def test_the_front_of_a_thin_flow_does_not_sink():
    """Before, the lowest point was 0.54 cells under the ground after 80 cells of travel: each node column that the
    front reached began with the yield of a thinner flow, and yielded again."""
    lowest, _, solver = front_of_sand(32.0, 0.45, 1.57, 2, 200.0, 5.0, "float64", travel=80.0)
    assert lowest >= -0.2
    assert solver.balances()["clips"]["lifted_onto_ground"] == 0


@pytest.mark.thorough
@settings(max_examples=12, deadline=None, derandomize=True)
@given(**FRONTS)
def test_no_front_of_a_thin_flow_sinks(**scene):
    """Before, single points far ahead of the front of sand near rest were 0.4 cells under the ground."""
    lowest, sunk, _ = front_of_sand(**scene)
    assert lowest >= -0.5
    assert sunk <= 0.005
