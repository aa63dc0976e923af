"""Functions in single precision: their constants are float32, which numba itself would make float64."""

import numba
import numpy as np
import pytest
from numba import types

from mpmgis.compiled import float32_constants, jit  # noqa: F401  (jit chooses the folder of the cache)

NEEDLESS = "numba no longer needs this: remove module mpmgis/compiled/float32_constants.py"
PAIR = (0.25, 4.0)
needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def halved(x):
    """What is compiled here: a constant, and a global with constants."""
    return 0.5 * x + PAIR[0]


def result_type(function):
    """The type of what the compiled `function` returns for a float32."""
    kernel = numba.njit(function)
    assert kernel(np.float32(3.0)) == 1.75
    return kernel.nopython_signatures[0].return_type


@needs_compiler
def test_a_copy_computes_in_single_precision():
    assert result_type(float32_constants.of_precision(halved, (types.float32,))) == types.float32


@needs_compiler
def test_numba_itself_computes_in_double_precision():
    assert result_type(halved) == types.float64, NEEDLESS


def test_a_function_of_double_precision_is_not_copied():
    assert float32_constants.of_precision(halved, (types.float64,)) is halved
    assert float32_constants.of_precision(halved, (types.float32, types.float64)) is halved


def test_the_first_array_decides():
    single, double = types.Array(types.float32, 1, "C"), types.Array(types.float64, 1, "C")
    assert float32_constants.of_precision(halved, (single, double)) is not halved
    assert float32_constants.of_precision(halved, (double, single)) is halved


@pytest.mark.parametrize(
    "value, smallest, expected",
    [(0.1, 0.0, np.float32(0.1)), (1e-300, 1e-30, np.float32(1e-30)), (0.0, 1e-30, np.float32(0.0))],
)
def test_floats_become_float32(value, smallest, expected):
    made = float32_constants.single(value, smallest)
    assert type(made) is np.float32 and made == expected
    assert float32_constants.single((value, 2, "x"), smallest) == (expected, 2, "x")


def test_names_within_a_function_are_found():
    def outer():
        return [PAIR[k] for k in range(2)], lambda: NEEDLESS

    assert {"PAIR", "NEEDLESS", "range"} <= set(float32_constants.global_names(outer.__code__))
