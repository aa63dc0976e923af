"""The 3D solver in single precision: the same flow in half the memory, anywhere on the terrain (H5, H33)."""

import re

import numba
import numpy as np
import pytest
from column_scenes import terrain_of
from plain_points import plain_step, yields_of
from point_scenes import block_of, integrate_to, plane, points_on, sorted_points

from mpmgis.laws.effect_slots import in_precision
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager
from mpmgis.laws.material_choice import wave_speed
from mpmgis.laws.softening import Softening
from mpmgis.solvers.points import grid_to_points, point_batch, point_edges, point_rows
from mpmgis.solvers.points.point_rows import Edges, StepFactors
from mpmgis.system.errors import FormatError

SAND = drucker_prager(6.7e6, 4e6, 35.0, 500.0)
MU = 0.3


def sliding(precision, east=0.0, length=200.0, velocity=(0.0, 0.0, 0.0), **numerics):
    """A block of sand on a plane of 20 degrees and `length` [m], `east` [m] away from its place in other tests."""
    slope = np.tan(np.radians(20))
    terrain = terrain_of(lambda x, y: slope * np.maximum(60.0 + east - x, 0.0), length, 40.0, 4.0)
    corner = (20.0 + east, 16.0, 40.0 * slope)
    frame = block_of((6.0, 8.0, 4.0), 0.5, corner, velocity=velocity, turned=np.radians(20))
    return points_on(terrain, frame, 1.0, SAND, friction_law("Coulomb", MU), precision=precision, **numerics)


@pytest.mark.thorough
def test_three_steps_equal_the_plain_loop_in_double_precision():
    """Places within 1e-6 cells, velocities within 1e-5 m/s of 4 m/s."""
    frame = block_of((2.0, 1.5, 1.5), 0.5, (20.3, 5.2, 60.0 - 20.3 * 0.57735), velocity=(4.0, -1.0, -2.0))
    frame.particles.velocity[:] += np.random.default_rng(3).normal(size=frame.particles.velocity.shape)
    terrain = plane(30, length=40.0, width=12.0, height=60.0, pixel=4.0)
    solver = points_on(terrain, frame, 1.0, SAND, friction_law("Coulomb", MU), time_step=2e-3, precision="float32")
    place, velocity = frame.particles.position - solver._corner_from((0.0, 0.0, 0.0)), frame.particles.velocity.copy()
    n = len(place)
    ground = solver._ground[..., :3]
    nodes = np.zeros((int(place[:, 2].max()) + 14, *ground.shape[:2], 4))
    arrays = place, velocity, np.zeros((n, 3, 3)), frame.particles.mass, np.zeros((n, 8)), np.zeros((n, 6))
    sound, yields = wave_speed(SAND, 1000.0), yields_of(solver)
    for _ in range(3):
        plain_step(*arrays, nodes, ground, yields, 1.0, 2e-3, 1000.0, 9.81, MU, SAND, Softening(), sound)
    solver.advance(3 * 2e-3)
    now = sorted_points(solver)
    np.testing.assert_allclose(now.position, place + solver._corner_from((0.0, 0.0, 0.0)), rtol=0, atol=1e-6)
    np.testing.assert_allclose(now.velocity, velocity, rtol=0, atol=1e-5)


@pytest.mark.thorough
def test_runout_and_mass_are_those_of_double_precision():
    """H33: the front within one cell after 2 s, mass within 1e-6, momentum to rounding of the points."""
    double, single = sliding("float64"), sliding("float32")
    for solver in (double, single):
        integrate_to(solver, 2.0)
    far, near = (sorted_points(solver).position[:, 0] for solver in (double, single))
    assert far.max() > 31.0  # from 27
    assert abs(near.max() - far.max()) < 0.1 and abs(near.mean() - far.mean()) < 1e-3
    balances = single.balances()
    assert balances["mass_now"] == pytest.approx(double.balances()["mass_now"], rel=1e-6)
    assert balances["mass_error_relative"] == 0.0
    assert balances["momentum_error_relative"] <= 1e-5


@pytest.mark.thorough
def test_nothing_is_lost_far_from_the_corner():
    """The same bits ten kilometres east, where single precision relative to the corner would resolve a millimetre."""
    here, far = sliding("float32"), sliding("float32", east=10_000.0, length=10_200.0)
    for solver in (here, far):
        integrate_to(solver, 0.3)
    assert np.array_equal(here.state()["rows"], far.state()["rows"])


@pytest.mark.thorough
def test_a_creep_of_a_millimetre_a_second_moves():
    moved = []
    for precision in ("float64", "float32"):
        solver = sliding(precision, velocity=(1e-3, 0.0, 0.0), gravity=0.0)
        start = sorted_points(solver).position
        integrate_to(solver, 1.0)
        moved.append((sorted_points(solver).position - start)[:, 0].mean())
    assert moved[1] == pytest.approx(moved[0], rel=0.02) and moved[0] >= 1e-3


def test_a_frame_of_the_other_precision_is_not_resumed_from():
    frame = sliding("float64").frame()
    with pytest.raises(FormatError, match="of another scene"):
        sliding("float32").restore(frame)


LAW = in_precision(SAND, np.float32), in_precision(Softening(), np.float32)
ONE = np.float32(1.0)
PARTS = {  # loops over lines -> module, whether they use integers, further arguments
    "weigh": (point_rows, True, ()),
    "_weigh_moments": (grid_to_points, False, ()),
    "_strain": (grid_to_points, False, (StepFactors(*(ONE,) * 6), *LAW)),
    "find_blocks": (point_edges, True, ()),
    "all_inside": (point_edges, True, (Edges(*(ONE,) * 4),)),
}


@pytest.mark.parametrize("name", PARTS)
def test_loops_have_no_double_in_them(name):
    """A constant of double precision would halve the speed of its loop."""
    module, uses_integers, further = PARTS[name]
    scratch, integers = np.zeros(point_batch.LINES, np.float32), np.zeros(point_batch.INTEGERS, np.int32)
    given = (scratch, *((integers,) if uses_integers else ()), *further)
    names = ", ".join(f"a{k}" for k in range(len(given)))
    space = {"part": getattr(module, name)}
    exec(f"def call({names}):\n    part({names})", space)
    call = numba.njit(fastmath={"nsz"}, error_model="numpy")(space["call"])
    call(*given)
    code = "".join(call.inspect_llvm().values())
    assert re.search(r"<\d+ x float>", code) and not re.search(r"<\d+ x double>", code)
