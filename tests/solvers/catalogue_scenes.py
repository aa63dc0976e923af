"""Scenes of the verification catalogue with their errors, for the tests and validation.md."""

import numpy as np
from column_scenes import node_thickness, relative_l1, seeded, solver_on, terrain_of
from exact_solutions import G, SimilarityCap, ThackerBowl

from mpmgis.laws.curvature import CURVATURE
from mpmgis.laws.friction import friction_law
from mpmgis.laws.ground_metric import WATER
from mpmgis.solvers.columns import column_rows as row

BOWL = ThackerBowl(1.0, 10.0)
CAP = {"slope": np.radians(35), "half_length": 80.0, "half_width": 80.0, "depth": 4.0}


def pool_in_bowl(kind, dx, periods=1.0, per_side=4, staggered=True, **numerics):
    """V9: (relative L1 error of the depth, solver) after `periods` of Thacker's "slosh" or "breathe".

    The bowl's radius is 10 m, so that `dx` / 10 is the resolution.
    """
    period, solution = BOWL.slosh(2.0) if kind == "slosh" else BOWL.breathe(8.0)
    side = round(14.0 / dx) * dx
    terrain = terrain_of(BOWL.bed, 2 * side, 2 * side, dx, -side, -side)
    start = seeded(lambda x, y: solution(x, y, 0.0)[0], -side, side, -side, side, dx, per_side, staggered)
    p = start.particles
    p.velocity[:, 0], p.velocity[:, 1] = solution(p.position[:, 0], p.position[:, 1], 0.0)[1:]
    solver = solver_on(terrain, start, dx, metric=WATER, **numerics)
    solver.advance(periods * period)
    x, y, h = node_thickness(solver, walls=False)
    exact = solution(*np.meshgrid(x, y), periods * period)[0]
    return relative_l1(h, exact), solver


def cap_on_slope(dx, time, friction_degrees=25.0, per_side=4, **numerics):
    """V8: (relative L2 error of the thickness, relative error of the largest speed, solver) of Hutter's cap.

    Its answer is exact without friction. With it the friction acts along the mean motion and not along each column's.
    """
    delta = np.radians(friction_degrees)
    cap, cos = SimilarityCap(**CAP, delta=delta, end=time), np.cos(CAP["slope"])
    half, wide, across = (round(length / dx) * dx for length in (90 * cos, 90, 100 + 8 * time))
    east = round((150 + cap.acceleration * time**2 / 2 + 12 * time) * cos / dx) * dx
    terrain = terrain_of(lambda x, y: -np.tan(CAP["slope"]) * x, east + half, 2 * across, dx, -half, -across)
    start = seeded(lambda x, y: cap(x / cos, y, 0.0)[0] / cos, -half, half, -wide, wide, dx, per_side)
    solver = solver_on(terrain, start, dx, friction_law("Coulomb", float(np.tan(delta))), **numerics)
    solver.advance(time)
    x, y, h = node_thickness(solver, walls=False)
    exact, u, v = cap(*np.meshgrid(x / cos, y), time)
    error = np.sqrt(((h * cos - exact) ** 2).sum() / (exact**2).sum())
    fastest = np.linalg.norm(solver.frame().particles.velocity, axis=1).max()
    return float(error), float(fastest / np.hypot(u, v)[exact > 0].max() - 1.0), solver


def small_body(height, x, y, side, dx, length, width, friction=None, curvature=None, per_side=4, **numerics):
    """A sheet 1e-7 m thick on [x, x + side] x [y, y + side]: its own pressure moves nothing, it goes as a point."""
    terrain = terrain_of(height, length, width, dx)
    frame = seeded(1e-7, x, x + side, y, y + side, dx, per_side)
    return solver_on(
        terrain, frame, dx, friction or friction_law("Coulomb", 0.0), curvature=curvature or CURVATURE, **numerics
    )


def energy_per_mass(solver, height):
    """Mean over the mass of g b + U^2 / 2 [J/kg] on the true bed `height(x, y)`."""
    p = solver.frame().particles
    bed = height(p.position[:, 0], p.position[:, 1])
    return float(np.average(G * bed + 0.5 * (p.velocity**2).sum(axis=1), weights=p.mass))


def energy_drift_in_a_valley(radius, dx, **numerics):
    """V20: share of the energy that a body wins in a parabolic valley of `radius` [m] in two thirds of a swing."""

    def valley(x, y):
        return (x - radius) ** 2 / (2 * radius) + 0 * y

    solver = small_body(valley, 0.5 * radius, 8 * dx, 2 * dx, dx, 2 * radius, 20 * dx, **numerics)
    start = energy_per_mass(solver, valley)
    solver.advance(4.0 * np.sqrt(radius / 10.0))
    return energy_per_mass(solver, valley) / start - 1.0, solver


def runout_angle(curvature, dx, mu=0.4, per_side=4, **numerics):
    """V21: (angle [deg] from where a body started to where it rests, solver) on a track that flattens gently."""

    def track(x, y):
        return 150.0 * np.exp(-x / 250.0) + 0 * y

    solver = small_body(
        track, 20.0, 8 * dx, 2 * dx, dx, 500.0, 20 * dx, friction_law("Coulomb", mu), curvature, per_side, **numerics
    )
    before = solver.frame().particles.position[:, 0].mean()
    solver.advance(60.0)
    p = solver.frame().particles
    assert np.all(p.velocity == 0.0)
    after = p.position[:, 0].mean()
    return float(np.degrees(np.arctan((track(before, 0) - track(after, 0)) / (after - before)))), solver


def spin_in_bowl(dx, **numerics):
    """V11: (angular momentum, kinetic energy, largest error of place [m]) after one turn over before, and the solver.

    A thin disc of 5 m that turns as if rigid: the bowl pulls every column round the middle in the same time.
    """
    omega = 2 * np.pi / BOWL.slosh(0.0)[0]
    terrain = terrain_of(BOWL.bed, 16.0, 16.0, dx, -8.0, -8.0)
    disc = seeded(lambda x, y: np.where(x * x + y * y < 25.0, 1e-7, 0.0), -6, 6, -6, 6, dx)
    p = disc.particles
    p.velocity[:, 0], p.velocity[:, 1] = -omega * p.position[:, 1], omega * p.position[:, 0]
    solver = solver_on(terrain, disc, dx, metric=WATER, **numerics)
    solver.arrays.rows[:, row.CXY], solver.arrays.rows[:, row.CYX] = -omega, omega
    before = _spin(solver)
    solver.advance(2 * np.pi / omega)
    after = _spin(solver)
    return after[0] / before[0], after[1] / before[1], float(np.abs(after[2] - before[2]).max()), solver


def _spin(solver):
    """(angular momentum with the share of the affine velocities [kg m2/s], kinetic energy [J], places by id [m])."""
    rows, ids, _ = solver._alive()
    rows = rows[np.argsort(ids)]
    dx, mass = solver.grid.cell_size, rows[:, row.MASS]
    x, y = rows[:, row.X] + solver.grid.x0, rows[:, row.Y] + solver.grid.y0
    u, v = rows[:, row.U], rows[:, row.V]
    affine = dx * dx / 4 * (rows[:, row.CYX] - rows[:, row.CXY])
    return (mass * (x * v - y * u + affine)).sum(), 0.5 * (mass * (u * u + v * v)).sum(), np.column_stack((x, y))


def speed_over_bound(solver):
    """Largest |U| of the columns now over what their drop allows, sqrt(2 g drop + 4 g h_max) (H2); 1 is equality."""
    start, p = solver._start.particles, solver.frame().particles
    fastest = (start.velocity**2).sum(axis=1).max()
    drop = np.maximum(solver.bed_start.max() - p.position[:, 2], 0.0)
    return float(
        np.sqrt(((p.velocity**2).sum(axis=1) / (2 * G * drop + 4 * G * start.thickness.max() + fastest)).max())
    )
