"""Kernels that a kernel calls, with the types of their arguments, found without compiling them.

Numba infers the types in a function before it makes code of it, and compiles every kernel that it calls meanwhile. Here
the called kernels are replaced by stand-ins which only note the types that they are called with. What they return is
known from their annotations, or by inference in the same way. Nothing depends on what a kernel contains, and no list of
signatures must be kept in step with it.
"""

from collections.abc import Iterator
from types import FunctionType
from typing import Any, get_args, get_origin

from numba import types
from numba.core import compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.typed_passes import NopythonTypeInference
from numba.core.typing import make_concrete_template, signature

_RETURNED = {None: types.none, bool: types.boolean, int: types.int64, float: types.float64}


def called_kernels(kernel: Dispatcher, given: tuple) -> list[tuple[Dispatcher, tuple]]:
    """Return the kernels that a kernel itself calls, each with the types of its arguments.

    Parameters
    ----------
    kernel : numba dispatcher
    given : tuple of numba types
        Of the arguments of `kernel`.
    """
    found, returned = [], {}
    with global_compiler_lock:
        _inferred(kernel, given, found, returned)
    return list(dict.fromkeys(found))


def argument_types(kernel: Dispatcher, arguments: tuple) -> tuple:
    """Return the numba types of the arguments of a call from Python.

    Parameters
    ----------
    kernel : numba dispatcher
    arguments : tuple of objects
    """
    return tuple(kernel.typeof_pyval(argument) for argument in arguments)


def functions_within(kernel: Dispatcher) -> Iterator[Dispatcher | FunctionType]:
    """Yield a kernel, and all kernels and plain functions of the package that it calls or that those call, each once.

    Parameters
    ----------
    kernel : numba dispatcher
    """
    left, seen = [kernel], set()
    while left:
        one = left.pop()
        if one not in seen:
            seen.add(one)
            yield one
            function = getattr(one, "py_func", one)
            called = map(function.__globals__.get, function.__code__.co_names)
            left += [value for value in called if isinstance(value, Dispatcher) or _is_ours(value)]


def _is_ours(value):
    return isinstance(value, FunctionType) and value.__module__.partition(".")[0] == __name__.partition(".")[0]


def _inferred(kernel, given, found, returned):
    """Infer the type that `kernel` returns; add (kernel, types) of each call of a kernel in it to the list `found`.

    `returned` are the types that kernels return, by kernel and types, as far as they are known.
    """
    function, compiling = kernel.py_func, kernel._compiler
    names = {
        name: _StandIn(value, found, returned) if isinstance(value, Dispatcher) else value
        for name, value in function.__globals__.items()
    }
    copy = FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)
    flags = compiler.Flags()
    compiling.targetdescr.options.parse_as_flags(flags, compiling.targetoptions)
    return compiler.compile_extra(
        kernel.typingctx, kernel.targetctx, copy, given, None, flags, compiling.locals, pipeline_class=_TypesOnly
    )


def _told(annotation, given):
    """Return the numba type of an annotation; None if it does not say it."""
    if get_origin(annotation) is tuple:
        parts = [_told(part, given) for part in get_args(annotation)]
        return None if None in parts else types.Tuple(parts)
    if annotation is float and "float32" in str(given):  # it may be either
        return None
    return _RETURNED.get(annotation)


class _StandIn:
    """In place of a kernel: numba takes it for one, and asks it for the type that it returns."""

    is_compiling = False

    def __init__(self, kernel, found, returned):
        self._kernel, self._found, self._returned = kernel, found, returned
        self._numba_type_ = types.Dispatcher(self)

    def get_call_template(self, args: tuple, kws: dict) -> tuple[Any, Any, tuple, dict]:
        """Note a call, and return its signature as numba's dispatchers do."""
        parameters, given = self._kernel._compiler.fold_argument_types(args, kws)
        call = self._kernel, tuple(given)
        self._found.append(call)
        if call not in self._returned:
            told = _told(self._kernel.py_func.__annotations__.get("return", ""), given)
            self._returned[call] = _inferred(*call, [], self._returned) if told is None else told
        name, whole = self._kernel.py_func.__name__, signature(self._returned[call], *given)
        return make_concrete_template(name, key=name, signatures=[whole]), parameters, given, {}


@register_pass(mutates_CFG=False, analysis_only=True)
class _End(AnalysisPass):
    """Ends the compilation once all types are known."""

    _name = "mpmgis_end_of_types"

    def __init__(self):
        AnalysisPass.__init__(self)

    def run_pass(self, state):
        raise compiler._EarlyPipelineCompletion(state.return_type)


class _TypesOnly(compiler.CompilerBase):
    """Numba's compiler up to the inference of types; it returns the type that the function returns."""

    def define_pipelines(self):
        passes = compiler.PassManager("types only")
        passes.passes.extend(compiler.DefaultPassBuilder.define_untyped_pipeline(self.state).passes)
        passes.add_pass(NopythonTypeInference, "infer types")
        passes.add_pass(_End, "end")
        passes.finalize()
        return [passes]
