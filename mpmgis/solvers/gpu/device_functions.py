"""Plain functions compiled for the device in the precision of a run, those of `mpmgis.compiled` among them.

numba compiles `0.5 * x` of a float32 x in double precision; functions are therefore compiled from a copy whose
constants have the precision of the points, and in which `float` gives a number of that precision. This includes what
the kernels of the CPU call (`press_column`, `plane_at`), except in kernels of the clock and of sums (`in_double`).
"""

import os
from types import FunctionType, ModuleType

import numpy as np
from numba import cuda, types
from numba.core import config

from ...compiled import single_constants

SIMULATED = bool(config.ENABLE_CUDASIM)
if SIMULATED:
    from .cuda_simulator import plain_number, repair

    repair()
else:  # kernels of one thread, and those that add up, are small on purpose
    from numba.cuda.core import config as cuda_config

    os.environ.setdefault("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS", "0")  # numba reads it again when it compiles
    cuda_config.CUDA_LOW_OCCUPANCY_WARNINGS = int(os.environ["NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS"])
KERNELS = ("mpmgis.compiled.", "mpmgis.solvers.columns.", "mpmgis.solvers.points.")
SMALL = 1e-30  # for smaller constants, which keep divisors off 0: its inverse is finite in float32
REGISTERS = 96  # of a thread, with which 20 warps of 32 threads fit on a multiprocessor

_functions = {}  # (function, precision) -> what a kernel calls
_stand_ins = {}  # module of functions -> {name of a global: what stands for it on the device}


def stand_in(modules, names):
    """Let `names` (name -> value) stand for globals of functions of the `modules` of kernels on the device."""
    for module in modules:
        _stand_ins.setdefault(module.__name__, {}).update(names)


def real(value):
    """`value` in the precision of the points; replaced by np.float32 or np.float64 where a function is compiled."""
    raise NotImplementedError("only in functions compiled for the device")


class Part:
    """A function that kernels of this package call, compiled for each precision when it is needed."""

    def __init__(self, function):
        self.function = function
        self.__doc__ = function.__doc__

    def of(self, precision, double):
        """What a kernel of `precision` (np.float32 or np.float64) calls; `double` as of the kernel."""
        return _device_function(self.function, precision, double)


class Kernel:
    """A kernel, compiled for each precision when it is needed; laws and arrays specialise it further.

    `registers` are those that the assembler may use in a precision, where that is limited. With `double`, functions of
    `mpmgis.compiled` that it calls are compiled in double precision.
    """

    def __init__(self, function, registers=None, double=False):
        self.function, self.registers, self.double = function, registers or {}, double
        self.__doc__ = function.__doc__
        self._compiled = {}

    def python(self, precision):
        """The function that is compiled for `precision`; `cuda.compile_ptx` takes it without a driver."""
        return _of_precision(self.function, precision, self.double)

    def of(self, precision):
        """The kernel for points of `precision`, to be called as kernel[blocks, threads](...)."""
        if precision not in self._compiled:
            most = self.registers.get(precision)
            options = {} if SIMULATED or most is None else {"max_registers": most}
            self._compiled[precision] = cuda.jit(**options)(self.python(precision))
        return self._compiled[precision]


def capped(single=REGISTERS, double=None):
    """Decorator: a Kernel for which the assembler may use that many registers in `single` and in `double` precision.

    For kernels that fit without spills, for which it would use more by itself, to load ahead. The tests' compile
    matrix finds spills.
    """
    return lambda function: Kernel(function, {np.float32: single, np.float64: double})


def in_double(function):
    """Decorator: a Kernel that calls functions of `mpmgis.compiled` in double precision."""
    return Kernel(function, double=True)


def _device_function(function, precision, double):
    """`function` for calls on the device; in the simulator a plain function."""
    known = function, precision, double
    if known not in _functions:
        plain = _of_precision(function, precision, double)
        _functions[known] = plain if SIMULATED else cuda.jit(device=True)(plain)
    return _functions[known]


def _of_precision(function, precision, double):
    """A copy of `function` whose functions are those of the device, with constants of `precision`.

    If it is `double`, functions of `mpmgis.compiled` have constants of double precision.
    """
    single = precision is np.float32 and not (double and function.__module__.startswith(KERNELS))
    names, known = {}, function.__globals__ | _stand_ins.get(function.__module__, {})
    if precision is np.float32 and not double:
        known = known | {"float": precision}
    for name in single_constants.global_names(function.__code__):
        if name in known:
            names[name] = _on_device(known[name], precision, single, double)
    code = single_constants.single_code(function.__code__, SMALL) if single else function.__code__
    return FunctionType(
        code, function.__globals__ | names, function.__name__, function.__defaults__, function.__closure__
    )


def _on_device(value, precision, single, double):
    """What stands for the global `value` of a function on the device; a number is of single precision if `single`."""
    if isinstance(value, Part):
        return value.of(precision, double)
    if value is real:
        return precision
    if SIMULATED and isinstance(value, types.Number):
        return plain_number(value)
    plain = getattr(value, "py_func", value)
    if isinstance(plain, FunctionType) and (plain is not value or plain.__module__.startswith(KERNELS)):
        return _device_function(plain, precision, double)
    if single and not isinstance(value, (ModuleType, type)):
        return single_constants.single(value, SMALL)
    return value
