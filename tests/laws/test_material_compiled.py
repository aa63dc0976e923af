"""Materials as the solver's compiler has them: many points at once, the same numbers, either precision."""

import platform
import re

import numba
import numpy as np
import pytest
from compiled import compiled_function
from material_points import random_states

from mpmgis.compiled.jit import FASTMATH
from mpmgis.laws.effect_slots import in_precision
from mpmgis.laws.material import cohesive_mu_i, drucker_prager, elastic, fluid, mu_i
from mpmgis.laws.material_choice import state_at_stress, stored_energy, stress_step, stress_step_far, volume_ratio
from mpmgis.laws.softening import FORMS, SOFTENED, Softening, softened_cone, softening
from mpmgis.laws.solid_material import RETURNED, returned_strain
from mpmgis.scene.material_table import MATERIALS
from mpmgis.solvers.points import point_batch as line
from mpmgis.solvers.points.grid_to_points import _strain
from mpmgis.solvers.points.point_batch import BATCH, LINES
from mpmgis.solvers.points.point_rows import StepFactors

TIME_STEP = 1e-3
VECTORS = r"f(?:mul|div|add|sub)[^<\n]* <\d+ x double>"  # arithmetic on several points
SCALARS = r"f(?:mul|div|add|sub)[^<\n]* double "  # on one number: factors of a whole batch
FEW = 12
OF_BATCH = 0.02  # share of the operations that are on factors of a whole batch, those of all materials together
ICE, NONE = drucker_prager(6.7e6, 4e6, 40.0, 1e3), Softening()
GROWING = cohesive_mu_i(40.0, 1e3, 0.26, 0.279, 0.1, 900.0, bulk_modulus=6.7e6, shear_modulus=4e6)
FADING = {form: softening((40.0, 1e3), (20.0, 0.0), 10.0, form=form) for form in FORMS}
CASES = {
    "elastic": (elastic(6.7e6, 4e6), NONE),
    "frictional": (ICE, NONE),
    "softened": (ICE, FADING["exponential"]),
    "softened-tangent": (ICE, FADING["tangent"]),
    "softened-linear": (ICE, FADING["linear"]),
    "inertial": (mu_i(6.7e6, 4e6, 0.38, 0.64, 0.279, 1e-2, 2500.0), NONE),
    "cohesive-inertial": (GROWING, FADING["exponential"]),
    "fluid": (fluid(7.1e6, 5.0), NONE),
}
SOLIDS = [name for name in CASES if name != "fluid"]
STATE = line.S0, line.S1, line.S2, line.S3, line.S4, line.S5, line.S6, line.S7
MOMENTS = line.XX, line.XY, line.XZ, line.YX, line.YY, line.YZ, line.ZX, line.ZY, line.ZZ


@numba.njit(fastmath=FASTMATH, error_model="numpy")
def strain(scratch, factors, material, soft):
    """What the solver calls for a batch of points, without what follows for large strains."""
    _strain(scratch, factors, material, soft)


def given_points(name, size=0.03):
    """float64[8 + 9, BATCH]: states and gradients of points that yield, are torn, or do neither."""
    rng = np.random.default_rng(1)
    rows = [
        (*b, rng.uniform(0.0, 0.5), rng.choice([0.0, 2e-3]), *np.ravel(gradient))
        for b, gradient in random_states(rng, BATCH, size)
    ]
    given = np.ascontiguousarray(np.transpose(rows))
    if name == "fluid":
        given[0] = rng.uniform(0.96, 1.0, BATCH)
    return given


def arguments(name, given, real=np.float64):
    """Arguments of `strain`: in its lines, the moments that make these gradients in a step."""
    scratch = np.zeros(LINES, real)
    for first, values in zip((*STATE, *MOMENTS), given, strict=True):
        scratch[first : first + BATCH] = values
    gradient = 1.0 / TIME_STEP
    factors = StepFactors(*map(real, (gradient, TIME_STEP, 0.0, 0.0, 0.0, 0.0)))
    return scratch, factors, *(in_precision(law, real) for law in CASES[name])


def strained(name, given, real=np.float64):
    """(states [8, BATCH], stresses [6, BATCH], codes [BATCH]) by the loops of the solver."""
    scratch, *others = arguments(name, given, real)
    strain(scratch, *others)
    lines = scratch[line.N0 : line.CODE + BATCH].reshape(15, BATCH)
    return lines[:8], lines[8:14], lines[14]


def plain_points(name, given, function=stress_step):
    """The same, point by point in plain Python."""
    law, soft = CASES[name]
    answers = [function(law, soft, tuple(row[:8]), tuple(row[8:]), TIME_STEP) for row in given.T]
    return tuple(np.transpose([answer[k] for answer in answers]) for k in range(3))


def of_state(name, state):
    """The numbers of a state that the material uses."""
    return state[:4] if name == "fluid" else state


@pytest.mark.parametrize("name", CASES)
def test_a_loop_over_points_gives_the_plain_results(name):
    given, bulk = given_points(name), CASES[name][0].bulk_modulus
    state, stress, code = strained(name, given)
    plain_state, plain_stress, plain_code = plain_points(name, given)
    np.testing.assert_allclose(of_state(name, state), of_state(name, plain_state), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(stress, plain_stress, rtol=1e-12, atol=1e-14 * bulk)
    assert np.array_equal(code, plain_code)
    assert name == "elastic" or len(set(plain_code)) > 1


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="asks for this processor's vectors")
def test_the_loops_run_points_side_by_side():
    """A function that is not inlined, or that the compiler cannot follow, costs five to ten times as much."""
    given = arguments("frictional", given_points("frictional"))
    strain(*given)
    bodies = strain.inspect_llvm(tuple(map(numba.typeof, given))).split("define ")[1:]
    found = [(len(re.findall(VECTORS, body)), len(re.findall(SCALARS, body))) for body in bodies]
    loops = [(vectors, scalars) for vectors, scalars in found if vectors + scalars > FEW]
    assert sum(vectors for vectors, _ in loops) > 1000
    assert all(scalars <= max(FEW, OF_BATCH * vectors) for vectors, scalars in loops)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["frictional", "softened", "inertial", "cohesive-inertial", "fluid"])
def test_in_single_precision_all_of_it_is(name):
    """One source for both precisions: no double in between, and the answers of double to rounding."""
    given, bulk = given_points(name), CASES[name][0].bulk_modulus
    exact, found = strained(name, given), strained(name, given, np.float32)
    least = np.full((8, 1), 1e-5)
    if name == "fluid":
        least[2] = 1e-8 * bulk  # energy of a correction: rounding of J, 6e-8, times the pressure
    assert (np.abs(of_state(name, found[0] - exact[0])) <= of_state(name, least)).all()
    np.testing.assert_allclose(found[1], exact[1], rtol=0, atol=1e-6 * bulk)
    code = strain.inspect_llvm(tuple(map(numba.typeof, arguments(name, given, np.float32))))
    bodies = [body for body in code.split("define ")[1:] if "fmul" in body]
    assert bodies and not any("double" in body for body in bodies)


def test_in_single_precision_small_steps_add_up():
    """Compressed by 2e-9 a step, far below the 6e-8 that single precision resolves beside 1."""
    given = np.zeros((17, BATCH))
    given[:6] = np.array(state_at_stress(ICE, (-1e5, -1e5, -1e5, 0.0, 0.0, 0.0)))[:6, None]
    given[[8, 12, 16]] = -2e-9
    scratch, *others = arguments("frictional", given, np.float32)
    for _ in range(20_000):
        strain(scratch, *others)
        for old, new in zip(STATE, range(line.N0, line.N0 + 8 * BATCH, BATCH), strict=True):
            scratch[old : old + BATCH] = scratch[new : new + BATCH]
    pressed = scratch[line.TXX : line.TXX + 3 * BATCH]
    np.testing.assert_allclose(pressed, -(1e5 + 6.7e6 * 3 * 2e-9 * 20_000), rtol=2e-3)


@pytest.mark.parametrize("name", ["elastic", "frictional", "inertial", "cohesive-inertial", "fluid"])
def test_single_points_and_energy_are_the_same_compiled(name):
    law, soft = CASES[name]
    for size in (0.03, 0.5, 3.0):
        for row in given_points(name, size).T[:8]:
            given = law, soft, tuple(row[:8]), tuple(row[8:]), TIME_STEP
            for function in (stress_step, stress_step_far):
                (state, stress, code), answer = function(*given), compiled_function(function)(*given)
                if code == 2.0 and function is stress_step:
                    continue  # beyond the reach of the series
                np.testing.assert_allclose(answer[0], state, rtol=1e-11, atol=1e-13)
                np.testing.assert_allclose(answer[1], stress, rtol=1e-10, atol=1e-12 * law.bulk_modulus)
                assert answer[2] == code
            for function in (stored_energy, volume_ratio):
                expected = pytest.approx(function(law, state), rel=1e-11)
                assert compiled_function(function)(law, state) == expected


@pytest.mark.parametrize("form", FORMS)
def test_softening_is_the_same_compiled(form):
    for strain_ in (0.0, 0.03, 0.3, 1e9):
        given = FADING[form], 1.2, 300.0, strain_
        assert compiled_function(softened_cone)(*given) == pytest.approx(softened_cone(*given), rel=1e-13)


def test_each_solid_of_a_scene_reaches_its_own_law():
    """A kind without its line in a dispatch would get another law."""
    kinds = {law.kind: law for law, _ in CASES.values()}
    assert {RETURNED.get(kind) for kind in kinds} >= {
        law for law, _ in MATERIALS.values() if "returned" in law.__name__
    }
    cone, found = (0.7, 100.0), set()
    for kind, law in RETURNED.items():
        given = kinds[kind], cone, -1e-3, 5e-3, 0.1, 1e-4, TIME_STEP
        assert returned_strain(*given) == law(*given) == compiled_function(returned_strain)(*given)
        found.add(returned_strain(*given)[:2])
    assert len(found) == len(RETURNED) == len(set(RETURNED))


def test_each_form_of_softening_reaches_its_own_law():
    assert {soft.kind for soft in FADING.values()} == set(SOFTENED)
    cones = [softened_cone(soft, 1.2, 300.0, 0.03) for soft in FADING.values()]
    assert cones == [SOFTENED[soft.kind](soft, 0.03) for soft in FADING.values()] and len(set(cones)) == len(cones)
