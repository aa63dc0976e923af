"""Calls of the workflows from the Python functions of the verbs."""

import importlib
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from ..system.errors import InputError, MpmgisError
from .option import PathLike, Verb
from .option_values import request, with_names

Results = PathLike | Sequence[PathLike]


@contextmanager
def python_words(verb: Verb) -> Iterator[None]:
    """In errors of this block flags of the command are replaced by parameter names."""
    try:
        yield
    except MpmgisError as error:
        error.args = (with_names(str(error), verb),)
        raise


def workflow_of(verb: Verb) -> tuple[Callable[..., Any], Any]:
    """(function that does the work of a verb, class of its request)."""
    module, _, name = verb.workflow.partition(":")
    function = getattr(importlib.import_module(f"{__package__.rpartition('.')[0]}.{module}"), name)
    return function, inspect.signature(function).parameters["request"].annotation


def several(results: Results) -> tuple[PathLike, ...]:
    """One path or several as a tuple.

    Raises
    ------
    InputError
        None at all.
    """
    paths = tuple(results) if isinstance(results, Iterable) and not isinstance(results, str) else (results,)
    if not paths:
        raise InputError("no results are given, expected one path or several")
    return paths


def answer(verb: Verb, results: Results, output: PathLike | None, options: Mapping[str, Any]) -> Any:
    """The result of the workflow of `verb` for `results`."""
    return called(verb, {"frames": several(results), "output": output, **options})


def called(verb: Verb, values: Mapping[str, Any], **callbacks: Any) -> Any:
    """The result of the workflow of `verb` for options by name."""
    with python_words(verb):
        function, kind = workflow_of(verb)
        return function(request(verb, kind, values), **callbacks)
