"""Make the functions of laws known to kernels on a CUDA device, as `law_functions` does for those on the processor.

Import this module before a kernel that calls a law is compiled. numba-cuda has its own register of functions and does
not see those that are registered with numba; the source of the laws is the same. A user's own law needs nothing else.
"""

from collections.abc import Callable

from numba import config, types

from ...compiled import law_functions
from ...compiled.float32_constants import of_precision
from ..points import point_rows

FUNCTIONS = (*law_functions.INLINED_FUNCTIONS, *law_functions.FUNCTIONS, point_rows.stencil)


def device_method(name: str) -> None:
    """Let kernels on the device call a method of user-defined laws, as `jit.own_law_method` does for the processor.

    Parameters
    ----------
    name : str
        Of the method.
    """
    from numba.cuda.extending import overload_method, register_jitable

    @overload_method(types.BaseNamedTuple, name)
    def specialise(law, *arguments):
        method = register_jitable(of_precision(getattr(law.instance_class, name), (law, *arguments)))
        return lambda law, *arguments: method(law, *arguments)


def device_function(function: Callable) -> None:
    """Let laws' methods and kernels on the device call a plain function, as `jit.law_function` does for the processor.

    Parameters
    ----------
    function : function
    """
    from numba.cuda.extending import overload

    @overload(function, strict=False)
    def specialise(*arguments):
        return of_precision(function, arguments)


def device_choice(function: Callable, record: type, built_in: Callable) -> None:
    """Let kernels on the device call a function of a law, as `jit.own_or_built_in` does for the processor.

    Parameters
    ----------
    function : function
    record : type
    built_in : function
    """
    from numba.cuda.extending import overload

    @overload(function, strict=False)
    def specialise(law, *arguments):
        is_built_in = law.instance_class is record
        chosen = built_in if is_built_in else getattr(law.instance_class, function.__name__)
        return of_precision(chosen, (law, *arguments))


if not config.ENABLE_CUDASIM:  # the simulator calls them as plain Python
    for _name in law_functions.OWN_METHODS:
        device_method(_name)
    for _function in FUNCTIONS:
        device_function(_function)
    for _function, (_record, _built_in) in law_functions.OWN_OR_BUILT_IN.items():
        device_choice(_function, _record, _built_in)
