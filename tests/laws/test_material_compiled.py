"""Materials as the solver's compiler has them: many points at once, the same numbers, either precision."""

import platform
import re

import numba
import numpy as np
import pytest
from compiled import compiled
from material_points import random_states

from mpmgis.compiled.jit import FASTMATH
from mpmgis.compiled.simd_lanes import get, put
from mpmgis.laws.material import cohesive_mu_i, drucker_prager, elastic, fluid, mu_i
from mpmgis.laws.softening import Softening, softening

POINTS, ASKED, ANSWERED = 32, 17, 15
ICE, NONE = drucker_prager(6.7e6, 4e6, 40.0, 1e3), Softening()
GROWING = cohesive_mu_i(40.0, 1e3, 0.26, 0.279, 0.1, 900.0, bulk_modulus=6.7e6, shear_modulus=4e6)
CASES = {
    "elastic": (elastic(6.7e6, 4e6), NONE),
    "frictional": (ICE, NONE),
    "softened": (ICE, softening((40.0, 1e3), (20.0, 0.0), 10.0)),
    "softened-tangent": (ICE, softening((40.0, 1e3), (20.0, 0.0), 10.0, form="tangent")),
    "softened-linear": (ICE, softening((40.0, 1e3), (20.0, 0.0), 10.0, form="linear")),
    "inertial": (mu_i(6.7e6, 4e6, 0.38, 0.64, 0.279, 1e-2, 2500.0, 1.0), NONE),
    "cohesive-inertial": (GROWING, softening((40.0, 1e3), (20.0, 0.0), 10.0)),
    "fluid": (fluid(7.1e6, 5.0, 0.0), NONE),
}
SOLIDS = [name for name in CASES if name != "fluid"]


def _loop():
    """Kernel that steps POINTS points between two line buffers, as the solver does."""
    asked = ", ".join(f"get(given, {k * POINTS}, p)" for k in range(ASKED))
    answers = "".join(f"        put(found, {k * POINTS}, p, answer[{k}])\n" for k in range(ANSWERED))
    source = (
        "def loop(law, softening, time_step, given, found, count):\n"
        "    for p in range(count):\n"
        f"        answer = law.stress_step({asked}, time_step, softening)\n{answers}"
    )
    namespace = {"get": get, "put": put}
    exec(source, namespace)
    return namespace["loop"]


loop = numba.njit(fastmath=FASTMATH, error_model="numpy")(_loop())


def given_points(name, size=0.03):
    """float64[ASKED, POINTS]: states and gradients of points that yield, are torn, or do neither."""
    rng = np.random.default_rng(1)
    rows = [
        (*b, rng.uniform(0.0, 0.5), rng.choice([0.0, 2e-3]), *np.ravel(gradient))
        for b, gradient in random_states(rng, POINTS, size)
    ]
    given = np.ascontiguousarray(np.transpose(rows))
    if name == "fluid":
        given[0] = rng.uniform(0.96, 1.0, POINTS)
    return given


def in_single(law):
    """The law with fields of single precision."""
    return type(law)(*map(np.float32, law))


@pytest.mark.parametrize("name", CASES)
def test_a_loop_over_points_gives_the_plain_results(name):
    law, soft = CASES[name]
    given, found = given_points(name), np.empty((ANSWERED, POINTS))
    loop(law, soft, 1e-3, given, found, POINTS)
    plain = np.transpose([law.stress_step(*given[:, p], 1e-3, soft) for p in range(POINTS)])
    np.testing.assert_allclose(found[:8], plain[:8], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found[8:14], plain[8:14], rtol=1e-12, atol=1e-14 * law.bulk_modulus)
    assert np.array_equal(found[14], plain[14])
    assert name == "elastic" or len(set(plain[14])) > 1


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="asks for this processor's vectors")
@pytest.mark.parametrize("name", SOLIDS)
def test_the_loop_runs_points_side_by_side(name):
    """A method that is not inlined, or that the compiler cannot follow, costs five to ten times as much."""
    law, soft = CASES[name]
    loop(law, soft, 1e-3, given_points(name), np.empty((ANSWERED, POINTS)), POINTS)
    code = loop.inspect_llvm(tuple(map(numba.typeof, (law, soft, 1e-3, np.ones((2, 2)), np.ones((2, 2)), 1))))
    assert re.search(r"fdiv .*<\d+ x double>", code)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["frictional", "softened", "inertial", "cohesive-inertial", "fluid"])
def test_in_single_precision_all_of_it_is(name):
    """One source for both precisions: no double in between, and the answers of double to rounding."""
    law, soft = CASES[name]
    single, single_soft = in_single(law), in_single(soft)
    given = given_points(name)
    exact, found = np.empty((ANSWERED, POINTS)), np.empty((ANSWERED, POINTS), np.float32)
    loop(law, soft, 1e-3, given, exact, POINTS)
    arguments = single, single_soft, np.float32(1e-3), given.astype(np.float32), found, POINTS
    loop(*arguments)
    least = np.full((8, 1), 1e-5)
    if name == "fluid":
        least[2] = 1e-8 * law.bulk_modulus  # energy of a correction: rounding of J, 6e-8, times the pressure
    assert (np.abs(found[:8] - exact[:8]) <= least).all()
    np.testing.assert_allclose(found[8:14], exact[8:14], rtol=0, atol=1e-6 * law.bulk_modulus)
    body = loop.inspect_llvm(tuple(map(numba.typeof, arguments))).split("define")[1]
    assert "fmul" in body and "double" not in body


def test_in_single_precision_small_steps_add_up():
    """Compressed by 2e-9 a step, far below the 6e-8 that single precision resolves beside 1."""
    law, soft = in_single(ICE), in_single(NONE)
    given, found = np.zeros((ASKED, POINTS), np.float32), np.empty((ANSWERED, POINTS), np.float32)
    given[:6] = np.array(ICE.state_at_stress(-1e5, -1e5, -1e5, 0.0, 0.0, 0.0))[:6, None]
    given[[8, 12, 16]] = -2e-9
    for _ in range(20_000):
        loop(law, soft, np.float32(1e-3), given, found, POINTS)
        given[:8] = found[:8]
    np.testing.assert_allclose(found[8:11], -(1e5 + 6.7e6 * 3 * 2e-9 * 20_000), rtol=2e-3)


@pytest.mark.parametrize("name", ["elastic", "frictional", "inertial", "cohesive-inertial", "fluid"])
def test_far_path_and_energy_are_the_same_compiled(name):
    law, soft = CASES[name]
    far = compiled("stress_step_far", ASKED + 2)
    for size in (0.03, 0.5, 3.0):
        for row in given_points(name, size).T[:8]:
            plain = law.stress_step_far(*row, 1e-3, soft)
            answer = far(law, *row, 1e-3, soft)
            np.testing.assert_allclose(answer[:8], plain[:8], rtol=1e-11, atol=1e-13)
            np.testing.assert_allclose(answer[8:14], plain[8:14], rtol=1e-10, atol=1e-12 * law.bulk_modulus)
            assert answer[14] == plain[14]
            energy = law.stored_energy(*plain[:8])
            assert compiled("stored_energy", 8)(law, *plain[:8]) == pytest.approx(energy, rel=1e-11)


@pytest.mark.parametrize("name", ["frictional", "softened", "softened-tangent", "softened-linear"])
def test_softening_is_the_same_compiled(name):
    soft = CASES[name][1]
    for strain in (0.0, 0.03, 0.3, 1e9):
        plain = soft.softened_cone(1.2, 300.0, strain)
        assert compiled("softened_cone", 3)(soft, 1.2, 300.0, strain) == pytest.approx(plain, rel=1e-13)
