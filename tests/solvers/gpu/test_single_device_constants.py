"""Device functions in single precision: numba-cuda itself would make a double of a float32 and a constant."""

import numpy as np
import pytest
from law_kernels import compiler_lack

from mpmgis.compiled.float32_constants import single_code

pytestmark = pytest.mark.skipif(bool(compiler_lack()), reason=compiler_lack())
NEEDLESS = "numba-cuda no longer needs this: compile for the device without mpmgis/compiled/float32_constants.py"


def halved(x):
    """What is compiled here."""
    return 0.5 * x


def result_type(function):
    """The type of what `function` returns on a device for a float32."""
    from numba import cuda, types

    _, kind = cuda.compile(function, (types.float32,), device=True, cc=(9, 0))
    return str(kind)


def test_a_copy_computes_in_single_precision():
    copy = type(halved)(single_code(halved.__code__), {"np": np})
    assert result_type(copy) == "float32"


def test_numba_cuda_itself_computes_in_double_precision():
    assert result_type(halved) == "float64", NEEDLESS
