"""Copies of functions whose constants are float32, for kernels in single precision.

Numba types every float in a function as float64, and float32 times float64 as float64 (all versions up to 0.68, and
numba-cuda 0.30). A law that is compiled for float32 would therefore compute in double precision as soon as it contains
`0.5`: at half the speed on a processor, and at a small part of it on most graphics cards. Laws are written once, with
plain constants; they are compiled from a copy whose byte code has float32 in place of each float.

`tests/compiled/test_single_constants.py` and `tests/solvers/gpu/test_single_device_constants.py` fail when numba or
numba-cuda no longer needs this.
"""

from collections.abc import Callable, Iterator
from types import CodeType, FunctionType
from typing import Any

import numpy as np
from numba import types

_copies = {}  # function -> its copy with constants of single precision


def of_precision(function: Callable, arguments: tuple) -> Callable:
    """Return `function`, or its copy with float32 constants where the arguments are of single precision.

    Parameters
    ----------
    function : plain Python function
    arguments : tuple of numba types
        Those that it is compiled for. They are of single precision if the first array is of float32; without an array,
        if there is a float32 among them and no float64.
    """
    if not _is_single(arguments):
        return function
    if function not in _copies:
        names = {name: single(value) for name, value in function.__globals__.items()}
        rest = function.__name__, function.__defaults__, function.__closure__
        _copies[function] = FunctionType(single_code(function.__code__), names, *rest)
    return _copies[function]


def single_code(code: CodeType, smallest: float = 0.0) -> CodeType:
    """Return a copy of `code` with float32 for each float among its constants.

    Parameters
    ----------
    code : byte code of a function
    smallest : float
        As for `single`.
    """
    return code.replace(co_consts=tuple(single(value, smallest) for value in code.co_consts))


def single(value: Any, smallest: float = 0.0) -> Any:
    """Return a float as float32, a tuple with each of its floats as float32, and anything else unchanged.

    Parameters
    ----------
    value : object
    smallest : float
        Positive floats below this one become this one. It keeps divisors such as max(x, 1e-300) off 0.
    """
    if type(value) is tuple:
        return tuple(single(part, smallest) for part in value)
    if type(value) is not float:
        return value
    return np.float32(smallest if 0.0 < value < smallest else value)


def global_names(code: CodeType) -> Iterator[str]:
    """Yield the names of globals and attributes in `code` and in the code within it.

    Parameters
    ----------
    code : byte code of a function
    """
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from global_names(constant)


def _is_single(arguments):
    """Return whether the first array is of float32, or without an array there is a float32 and no float64."""
    arrays = [kind.dtype for kind in arguments if isinstance(kind, types.Array)]
    if arrays:
        return arrays[0] == types.float32
    given = set()
    for kind in arguments:
        given.update(kind.types if isinstance(kind, types.BaseTuple) else [kind])
    return types.float32 in given and types.float64 not in given
