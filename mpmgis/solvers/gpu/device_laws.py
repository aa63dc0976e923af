"""Make the methods of laws known to kernels on a CUDA device, as `law_methods` does for kernels on the processor.

Import this module before a kernel that calls a law is compiled. numba-cuda has its own register of methods and does not
see those that are registered with numba; the source of the laws is the same. A user's own law needs nothing else.
"""

from collections.abc import Callable

from numba import config, types

from ...compiled import law_methods
from ...compiled.float32_constants import of_precision
from ..points import point_rows

FUNCTIONS = (*law_methods.INLINED_FUNCTIONS, *law_methods.FUNCTIONS, point_rows.stencil)


def device_method(name: str) -> None:
    """Let kernels on the device call a method of any law, as `jit.law_method` does for the processor.

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


if not config.ENABLE_CUDASIM:  # the simulator calls them as plain Python
    for _name in (*law_methods.METHODS, *law_methods.INLINED_METHODS):
        device_method(_name)
    for _function in FUNCTIONS:
        device_function(_function)
