"""Call the functions that do the work of the verbs, from the verbs' Python functions."""

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
    """Replace flags of the command in errors of this block by parameter names.

    Parameters
    ----------
    verb : Verb
    """
    try:
        yield
    except MpmgisError as error:
        error.args = (with_names(str(error), verb),)
        raise


def workflow_of(verb: Verb) -> tuple[Callable[..., Any], Any]:
    """Return the function that does the work of a verb, and the class of its request.

    Parameters
    ----------
    verb : Verb

    Returns
    -------
    (callable, class)
    """
    module, _, name = verb.workflow.partition(":")
    function = getattr(importlib.import_module(f"{__package__.rpartition('.')[0]}.{module}"), name)
    return function, inspect.signature(function).parameters["request"].annotation


def several(results: Results) -> tuple[PathLike, ...]:
    """Return one path or several as a tuple.

    Parameters
    ----------
    results : path or sequence of path

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
    """Return the answer of a verb about results.

    Parameters
    ----------
    verb : Verb
    results : path or sequence of path
    output : path or None
    options : mapping of str to object
        The other options by name.

    Returns
    -------
    object
        What the function of the verb returns.
    """
    return called(verb, {"frames": several(results), "output": output, **options})


def called(verb: Verb, values: Mapping[str, Any], **callbacks: Any) -> Any:
    """Return what the function of a verb returns for options by name.

    Parameters
    ----------
    verb : Verb
    values : mapping of str to object
    **callbacks : keywords of the function

    Returns
    -------
    object
    """
    with python_words(verb):
        function, kind = workflow_of(verb)
        return function(request(verb, kind, values), **callbacks)
