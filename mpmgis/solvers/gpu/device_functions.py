"""Compile plain functions for the device in the precision of a run, those of `mpmgis.compiled` among them.

numba compiles `0.5 * x` of a float32 x in double precision; functions are therefore compiled from a copy whose
constants have the precision of the points, and in which `float` gives a number of that precision. This includes what
the kernels of the CPU call (`press_column`, `plane_at`), except in kernels of the clock and of sums (`in_double`).
"""

import os
from collections.abc import Callable, Iterable
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import cuda, types
from numba.core import config

from ...compiled import float32_constants

SIMULATED = bool(config.ENABLE_CUDASIM)
if SIMULATED:
    from .cuda_simulator import plain_number, repair

    repair()
else:  # kernels of one thread, and those that add up, are small on purpose
    from numba.cuda.core import config as cuda_config

    os.environ.setdefault("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS", "0")  # numba reads it again when it compiles
    cuda_config.CUDA_LOW_OCCUPANCY_WARNINGS = int(os.environ["NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS"])
# modules of functions that kernels of the CPU call
KERNELS = ("mpmgis.compiled.", "mpmgis.solvers.columns.", "mpmgis.solvers.points.")
SMALL = 1e-30  # replaces smaller constants, which keep divisors off 0: its inverse is finite in float32
REGISTERS = 96  # registers of a thread with which 20 warps of 32 threads fit on a multiprocessor

_functions = {}  # (function, precision) -> what a kernel calls
_stand_ins = {}  # module of functions -> {name of a global: what replaces it on the device}


def stand_in(modules: Iterable[ModuleType], names: dict[str, Any]) -> None:
    """Replace globals of functions of modules of kernels on the device.

    Parameters
    ----------
    modules : iterable of module
    names : dict
        Name of a global -> what replaces it on the device.
    """
    for module in modules:
        _stand_ins.setdefault(module.__name__, {}).update(names)


def real(value: float) -> float:
    """Convert a number to the precision of the points.

    The function is replaced by np.float32 or np.float64 where a function that calls it is compiled.

    Parameters
    ----------
    value : float
    """
    raise NotImplementedError("only in functions compiled for the device")


class Part:
    """A function that kernels of this package call, compiled for each precision when it is needed.

    Parameters
    ----------
    function : function
    """

    def __init__(self, function: FunctionType) -> None:
        self.function = function
        self.__doc__ = function.__doc__

    def of(self, precision: type, double: bool) -> Callable:
        """Return what a kernel of a precision calls.

        Parameters
        ----------
        precision : type
            np.float32 or np.float64.
        double : bool
            That of the `Kernel`.
        """
        return _device_function(self.function, precision, double)


class Kernel:
    """A kernel, compiled for each precision when it is needed; laws and arrays specialise it further.

    Parameters
    ----------
    function : function
    registers : dict, optional
        Precision -> number of registers that the assembler may use, where that is limited.
    double : bool
        Whether functions of `mpmgis.compiled` that it calls are compiled in double precision.
    """

    def __init__(
        self, function: FunctionType, registers: dict[type, int | None] | None = None, double: bool = False
    ) -> None:
        self.function, self.registers, self.double = function, registers or {}, double
        self.__doc__ = function.__doc__
        self._compiled = {}

    def python(self, precision: type) -> FunctionType:
        """Return the function that is compiled for a precision; `cuda.compile_ptx` takes it without a driver.

        Parameters
        ----------
        precision : type
            np.float32 or np.float64.
        """
        return _of_precision(self.function, precision, self.double)

    def of(self, precision: type) -> Any:
        """Return the kernel for points of a precision, to be called as kernel[blocks, threads](...).

        Parameters
        ----------
        precision : type
            np.float32 or np.float64.
        """
        if precision not in self._compiled:
            most = self.registers.get(precision)
            options = {} if SIMULATED or most is None else {"max_registers": most}
            self._compiled[precision] = cuda.jit(**options)(self.python(precision))
        return self._compiled[precision]


def capped(single: int = REGISTERS, double: int | None = None) -> Callable[[FunctionType], Kernel]:
    """Make a decorator for kernels with a limited number of registers.

    It is for kernels that fit without spills, for which the assembler would use more by itself, to load ahead. The
    tests' compile matrix finds spills.

    Parameters
    ----------
    single, double : int, optional
        Registers that the assembler may use in single and in double precision; None: no limit.
    """
    return lambda function: Kernel(function, {np.float32: single, np.float64: double})


def in_double(function: FunctionType) -> Kernel:
    """Make a Kernel that calls functions of `mpmgis.compiled` in double precision; a decorator.

    Parameters
    ----------
    function : function
    """
    return Kernel(function, double=True)


def _device_function(function, precision, double):
    """Return `function` for calls on the device; in the simulator a plain function."""
    known = function, precision, double
    if known not in _functions:
        plain = _of_precision(function, precision, double)
        _functions[known] = plain if SIMULATED else cuda.jit(device=True)(plain)
    return _functions[known]


def _of_precision(function, precision, double):
    """Return a copy of `function` whose functions are those of the device, with constants of `precision`.

    If it is `double`, functions of `mpmgis.compiled` have constants of double precision.
    """
    single = precision is np.float32 and not (double and function.__module__.startswith(KERNELS))
    names, known = {}, function.__globals__ | _stand_ins.get(function.__module__, {})
    if precision is np.float32 and not double:
        known = known | {"float": precision}
    for name in float32_constants.global_names(function.__code__):
        if name in known:
            names[name] = _on_device(known[name], precision, single, double)
    code = float32_constants.single_code(function.__code__, SMALL) if single else function.__code__
    return FunctionType(
        code, function.__globals__ | names, function.__name__, function.__defaults__, function.__closure__
    )


def _on_device(value, precision, single, double):
    """Return what replaces the global `value` of a function on the device, a number in single precision if `single`."""
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
        return float32_constants.single(value, SMALL)
    return value
