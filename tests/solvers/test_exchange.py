"""Particles that enter and leave between steps, as solvers in step exchange them: points inserted, columns removed."""

import numpy as np
import pytest
from column_scenes import columns_of, joined, solver_on, terrain_of
from point_scenes import block_of, integrate_to

from mpmgis.frames.particles import Frame
from mpmgis.laws.effect_slots import PointEffects
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager
from mpmgis.solvers.points.point_numerics import PointNumerics
from mpmgis.solvers.points.point_solver import PointSolver
from mpmgis.system.errors import SceneError

SAND = drucker_prager(2e5, 1.2e5, 35.0, 0.0)
FLAT = terrain_of(lambda x, y: 0.0 * x, 60.0, 60.0, 5.0)


def block(corner, velocity=(0.0, 0.0, 0.0)):
    """A cube of 4 m, its points' stress [Pa] and velocity gradient [s-1]."""
    frame = block_of((4, 4, 4), 0.5, corner, velocity=velocity)
    n = len(frame.particles)
    return frame, np.full((n, 6), -500.0) * [1, 1, 2, 0, 0, 0], np.tile(np.diag([0.1, -0.1, 0.0]), (n, 1, 1))


def solver_of(frame, stress=None, affine=None):
    effects = PointEffects(SAND, contact=friction_law("Coulomb", 0.6))
    return PointSolver(frame, FLAT, effects, PointNumerics(1.0), stress, affine=affine)


def nothing():
    some = block((10, 10, 0))[0]
    return Frame(some.particles.take(slice(0, 0)), dimension=3)


def states_equal(one, other):
    a, b = one.state(), other.state()
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a if name != "counts")


def test_points_that_come_onto_an_empty_terrain_are_a_start():
    frame, stress, affine = block((28, 28, 0), (3.0, 0.0, 0.0))
    begun, empty = solver_of(frame, stress, affine), solver_of(nothing())
    empty.insert(frame, stress, affine)
    for time in (0.1, 0.2):
        for solver in (begun, empty):
            integrate_to(solver, time, time + 0.1)
        assert states_equal(begun, empty)
    assert begun.balances() == empty.balances() and empty.mass_start == begun.mass_start


def test_points_that_come_into_a_flow_are_counted_as_if_from_the_start():
    solver = solver_of(*block((28, 28, 0), (3.0, 0.0, 0.0)))
    integrate_to(solver, 0.1, 0.2)
    frame, stress, affine = block((10, 10, 1.0), (0.0, 2.0, -1.0))
    frame.particles.id[:] += 1000
    own = solver.frame().particles
    before = (own.mass[:, None] * own.velocity).sum(axis=0)
    solver.insert(frame, stress, affine)
    now = solver.frame().particles
    assert len(now) == 1024 and solver.particles == 1024
    np.testing.assert_allclose(
        (now.mass[:, None] * now.velocity).sum(axis=0), before + 64e3 * np.array([0.0, 2.0, -1.0]), rtol=1e-12
    )
    integrate_to(solver, 0.2, 0.3, 0.8)
    balances = solver.balances()
    assert balances["mass_start"] == pytest.approx(128e3) and abs(balances["mass_error_relative"]) <= 1e-15
    assert abs(balances["momentum_error_relative"]) <= 1e-12
    assert set(solver.frame().particles.id.tolist()) == set(range(512)) | set(range(1000, 1512))
    assert 0.0 < balances["energy_lost"] < 128e3 * 9.81 * 5.0


@pytest.mark.parametrize("turns", [(False, False), (True, False), (False, True), (True, True)])
def test_points_inserted_before_the_first_step_are_those_of_a_start(turns):
    """Two blocks, with and without a velocity gradient at the start."""
    parts = [block((28, 28, 0), (3.0, 0.0, 0.0)), block((10, 10, 1.0), (0.0, 2.0, -1.0))]
    parts[1][0].particles.id[:] += 1000
    gradients = [affine if turn else None for (_, _, affine), turn in zip(parts, turns, strict=True)]
    zero = np.zeros_like(parts[0][2])
    whole = solver_of(
        joined(*(part[0] for part in parts)),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([zero if gradient is None else gradient for gradient in gradients]),
    )
    grown = solver_of(parts[0][0], parts[0][1], gradients[0])
    grown.insert(parts[1][0], parts[1][1], gradients[1])
    for solver in (whole, grown):
        integrate_to(solver, 0.1, 0.2)
    one, other = (solver.frame().particles for solver in (whole, grown))
    rows = [np.argsort(some.id) for some in (one, other)]
    for name in ("position", "velocity", "mass"):
        np.testing.assert_allclose(getattr(other, name)[rows[1]], getattr(one, name)[rows[0]], rtol=0, atol=1e-12)
    assert grown.mass_start == whole.mass_start and grown.energy_start == pytest.approx(whole.energy_start)


def test_a_restart_after_that_sees_the_same():
    solver = solver_of(*block((28, 28, 0), (3.0, 0.0, 0.0)))
    integrate_to(solver, 0.1, 0.2)
    solver.insert(*block((10, 10, 1.0)))
    integrate_to(solver, 0.2, 0.3)
    kept, started = solver.frame(), solver.started()
    integrate_to(solver, 0.3, 0.4)
    again = solver_of(kept)
    again.restore(kept)
    again.start_from(started)
    integrate_to(again, 0.3, 0.4)
    assert states_equal(solver, again) and solver.balances() == again.balances()


def test_points_off_the_terrain_are_refused():
    solver = solver_of(*block((28, 28, 0)))
    with pytest.raises(SceneError, match="outside the terrain"):
        solver.insert(block((70, 10, 0))[0])
    assert solver.particles == 512


def test_columns_that_are_taken_out_were_never_there():
    """One of two heaps far apart is removed; the other one moves as if it had always been alone."""
    left, right = (columns_of(2.0, west, west + 10, 20, 30, 0.5) for west in (10, 40))
    ids = np.arange(len(left.particles) + len(right.particles), dtype=np.uint64)
    both = joined(left, right)
    solver, alone = (solver_on(FLAT, frame, 2.0, friction_law("Coulomb", 0.3)) for frame in (both, left))
    assert solver.advance(0.5) == alone.advance(0.5)
    assert solver.take_out(lambda x, y: x > 70.0) is None
    taken = solver.take_out(lambda x, y: x > 30.0)
    assert taken.particles.mass.sum() == pytest.approx(right.particles.mass.sum(), rel=1e-12)
    assert taken.particles.id.tolist() == ids[len(left.particles) :].tolist()
    assert taken.state["velocity_gradient"].shape == (len(right.particles), 2, 2) and not taken.maxima
    assert np.abs(taken.state["velocity_gradient"]).max() > 0.1
    assert solver.mass_start == pytest.approx(alone.mass_start, rel=1e-12)
    for until in (0.7, 1.0):
        assert solver.advance(until) == alone.advance(until)
    own, others = (p.take(np.argsort(p.id)) for p in (solver.frame().particles, alone.frame().particles))
    np.testing.assert_allclose(own.position, others.position, atol=1e-9)
    np.testing.assert_allclose(own.velocity, others.velocity, atol=1e-9)
    balances, wanted = solver.balances(), alone.balances()
    assert abs(balances["mass_error_relative"]) <= 1e-12
    for name in ("mass_now", "kinetic_energy", "potential_energy"):
        assert balances[name] == pytest.approx(wanted[name], rel=1e-6), name
    assert balances["energy_lost"] > wanted["energy_lost"] > 0.0  # the removed columns had lost some energy before
