"""Laws as the solver's compiler has them."""

import functools

import numba

from mpmgis.compiled import law_functions  # noqa: F401  (registers the functions)
from mpmgis.compiled.jit import FASTMATH


@functools.cache
def compiled_function(function):
    """Kernel that calls `function` of a law, with the arguments of that function."""
    names = ", ".join(function.__code__.co_varnames[: function.__code__.co_argcount])
    namespace = {"function": function}
    exec(f"def call({names}):\n    return function({names})", namespace)
    return numba.njit(fastmath=FASTMATH, error_model="numpy")(namespace["call"])
