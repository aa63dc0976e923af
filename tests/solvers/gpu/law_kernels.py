"""A kernel for the CUDA device for every function of laws that kernels call, compiled without a driver."""

import importlib
import importlib.util
import inspect
import types as python_types
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import get_args, get_origin

import numba
import numpy as np
from numba import types

from mpmgis.compiled.law_functions import FUNCTIONS, INLINED_FUNCTIONS, OWN_OR_BUILT_IN
from mpmgis.laws.friction import Friction, at_node, stress_parts

PRECISIONS = {"float64": np.float64, "float32": np.float32}
NUMBERS = {"state": 8, "gradient": 9}  # of arguments that are tuples
CAPABILITIES = {"sm_80": (8, 0), "sm_90": (9, 0)}


def compiler_lack():
    """Why kernels cannot be compiled for a device here; "" if they can."""
    if importlib.util.find_spec("numba_cuda") is None:
        return "numba-cuda is not installed (pip install 'mpmgis[gpu]')"
    if numba.config.ENABLE_CUDASIM:
        return "NUMBA_ENABLE_CUDASIM is set: the simulator compiles nothing"
    from cuda.pathfinder import DynamicLibNotFoundError, load_nvidia_dynamic_lib

    for library in ("nvvm", "nvrtc"):
        try:
            load_nvidia_dynamic_lib(library)
        except DynamicLibNotFoundError:
            return f"{library}, a part of CUDA's compiler, is not installed (pip install 'mpmgis[gpu]')"
    return ""


@cache
def assembler():
    """Path of CUDA's assembler, ptxas, in the wheel nvidia-cuda-nvcc; None without it.

    One on the path can be older than NVVM, and then does not read its assembly.
    """
    nvidia = importlib.util.find_spec("nvidia")
    folders = [] if nvidia is None else nvidia.submodule_search_locations
    wheel = (path for folder in folders for path in sorted(Path(folder).glob("*/bin/ptxas")))
    return next(wheel, None)


def functions():
    """All functions of laws that kernels call; not what `material_choice.stress_step` is made of."""
    of_points = {"hencky", "softening", "flow_layers", "solid_material", "fluid_material"}
    found = (*INLINED_FUNCTIONS, *FUNCTIONS, *OWN_OR_BUILT_IN)
    return [function for function in found if function.__module__.rpartition(".")[2] not in of_points]


def law_type(kind, real):
    """numba's type of a law with parameters of `real`; its number, if it has one, is an int."""
    kinds = inspect.get_annotations(kind)
    return numba.typeof(kind(*(1 if kinds[name] is int else real(1.0) for name in kind._fields)))


def type_of_annotation(name, annotation, real):
    """numba's type of an argument of a function; laws of friction are the built-in ones."""
    if annotation in (int, float, bool):
        return {int: types.int64, bool: types.boolean}.get(annotation, numba.from_dtype(np.dtype(real)))
    if name in NUMBERS:
        return types.UniTuple(numba.from_dtype(np.dtype(real)), NUMBERS[name])
    if get_origin(annotation) is tuple:
        return types.UniTuple(numba.from_dtype(np.dtype(real)), len(get_args(annotation)))
    if annotation == "np.ndarray":
        return types.Array(numba.from_dtype(np.dtype(real)), 3, "C")
    return law_type(Friction if annotation is tuple else annotation, real)


def kernel_of_function(function, real):
    """(kernel that stores the result of `function`, types of its arguments)."""
    given = {f"given_{name}": type_of_annotation(name, p.annotation, real) for name, p in signature(function).items()}
    namespace = {"store": store, "function": function}
    exec(f"def kernel(out, {', '.join(given)}):\n    store(out[0], function({', '.join(given)}))", namespace)
    number = numba.from_dtype(np.dtype(real))
    return namespace["kernel"], (types.Array(number, 2, "C"), *given.values())


def signature(function):
    """Name -> parameter of `function`."""
    return inspect.signature(function).parameters


def own_kernel(kind, real):
    """(kernel that stores what the solver calls of a user-defined law, types of its arguments)."""
    names = list(signature(stress_parts))[1:]
    namespace = {"store": store, "stress_parts": stress_parts, "at_node": at_node}
    call = f"stress_parts(at_node(law, values, 0, 0), {', '.join(names)})"
    exec(f"def kernel(law, values, out, {', '.join(names)}):\n    store(out[0], {call})", namespace)
    number = numba.from_dtype(np.dtype(real))
    arrays = types.Array(number, 3, "C"), types.Array(number, 2, "C")
    return namespace["kernel"], (law_type(kind, real), *arrays, *[number] * len(names))


def numbers_in(kind, name):
    """Expressions of all numbers in a value of numba's type `kind`, a number or a tuple, called `name`."""
    if not isinstance(kind, types.BaseTuple):
        return [name]
    return [number for k, part in enumerate(kind) for number in numbers_in(part, f"{name}[{k}]")]


def store(out, result):
    """Store a number, or all numbers of a tuple, in the array `out`."""


@cache
def register():
    """Let kernels on the device call the functions of laws, and `store`."""
    from numba.cuda.extending import overload

    importlib.import_module("mpmgis.solvers.gpu.device_laws")

    @overload(store)
    def stored(out, result):
        lines = [f"out[{k}] = {value}" for k, value in enumerate(numbers_in(result, "result"))] or ["pass"]
        namespace = {}
        exec("def body(out, result):\n" + "".join(f"    {line}\n" for line in lines), namespace)
        return namespace["body"]


@contextmanager
def without_driver(capability):
    """numba-cuda asks the driver for the device's capability even to compile for another one."""
    from numba.cuda import dispatcher

    asked = dispatcher.get_current_device
    dispatcher.get_current_device = lambda: python_types.SimpleNamespace(compute_capability=capability)
    try:
        yield
    finally:
        dispatcher.get_current_device = asked


def texts_of(function, arguments, capabilities=tuple(CAPABILITIES)):
    """Capability -> assembly of the kernel `function`, whose types are inferred once."""
    from numba.cuda.compiler import _compile_pyfunc_with_fixup

    register()
    first = next(iter(CAPABILITIES.values()))
    with without_driver(first):
        library, _ = _compile_pyfunc_with_fixup(function, tuple(arguments), device=False, abi="numba", cc=first)
        return {name: library.get_asm_str(cc=CAPABILITIES[name]) for name in capabilities}
