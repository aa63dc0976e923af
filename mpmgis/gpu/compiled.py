"""Plain functions compiled for the device in the precision of a run, those of `mpmgis.kernels` among them.

numba compiles `0.5 * x` of a float32 x in double precision; functions of this package are therefore compiled from a
copy whose constants have the precision of the points. What the kernels of the CPU call (`plane_at`, `edge_at`) is
compiled from its Python source as it is: the work on nodes is done in double precision there too.
"""

from types import FunctionType, ModuleType

import numpy as np
from numba import cuda
from numba.core import config

SIMULATED = bool(config.ENABLE_CUDASIM)
if SIMULATED:
    from .simulator import repair

    repair()
KERNELS = "mpmgis.kernels."
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

    def of(self, precision):
        """What a kernel of `precision` (np.float32 or np.float64) calls."""
        return _device_function(self.function, precision, precision is np.float32)


class Kernel:
    """A kernel, compiled for each precision when it is needed; laws and arrays specialise it further."""

    def __init__(self, function, registers=None):
        self.function, self.registers = function, registers
        self.__doc__ = function.__doc__
        self._compiled = {}

    def python(self, precision):
        """The function that is compiled for `precision`; `cuda.compile_ptx` takes it without a driver."""
        return _of_precision(self.function, precision, precision is np.float32)

    def of(self, precision):
        """The kernel for points of `precision`, to be called as kernel[blocks, threads](...)."""
        if precision not in self._compiled:
            options = {} if SIMULATED or self.registers is None else {"max_registers": self.registers}
            self._compiled[precision] = cuda.jit(**options)(self.python(precision))
        return self._compiled[precision]


def capped(registers):
    """Decorator: a Kernel for which the assembler may use that many `registers`.

    For kernels that fit without spills, for which it would use more by itself, to load ahead. The tests' compile
    matrix finds spills.
    """
    return lambda function: Kernel(function, registers)


def _device_function(function, precision, single):
    """`function` for calls on the device; in the simulator a plain function."""
    known = function, precision
    if known not in _functions:
        plain = _of_precision(function, precision, single)
        _functions[known] = plain if SIMULATED else cuda.jit(device=True)(plain)
    return _functions[known]


def _of_precision(function, precision, single):
    """A copy of `function` whose functions are those of the device, with constants of single precision if `single`."""
    names, known = {}, function.__globals__ | _stand_ins.get(function.__module__, {})
    for name in _names(function.__code__):
        if name in known:
            names[name] = _on_device(known[name], precision, single)
    code = _with_constants(function.__code__) if single else function.__code__
    return FunctionType(
        code, function.__globals__ | names, function.__name__, function.__defaults__, function.__closure__
    )


def _names(code):
    """Names of globals in `code` and in the code within it."""
    yield from code.co_names
    for constant in code.co_consts:
        if hasattr(constant, "co_names"):
            yield from _names(constant)


def _on_device(value, precision, single):
    """What stands for the global `value` on the device."""
    if isinstance(value, Part):
        return value.of(precision)
    if value is real:
        return precision
    plain = getattr(value, "py_func", value)
    if isinstance(plain, FunctionType) and (plain is not value or plain.__module__.startswith(KERNELS)):
        return _device_function(plain, precision, False)
    if single and not isinstance(value, (ModuleType, type)):
        return _single(value)
    return value


def _with_constants(code):
    """`code` with float32 for each float among its constants."""
    return code.replace(co_consts=tuple(map(_single, code.co_consts)))


def _single(value):
    """The float, or the floats in the tuple, `value` as float32; anything else as it is."""
    if type(value) is tuple:
        return tuple(map(_single, value))
    return np.float32(value) if type(value) is float else value
