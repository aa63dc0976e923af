"""Complete the options of verbs, and name them in messages as flags of the command or parameters of Python."""

import dataclasses
import importlib
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar, cast, get_type_hints, is_typeddict

from ..system.errors import InputError, MpmgisError
from ..system.option import Option, PathLike, options_of
from ..system.option_values import completed
from .verb import Asked, Verb, verb_of

Results = PathLike | Sequence[PathLike]
Request = TypeVar("Request")
_NAME = re.compile(r"`(\w+)(?:[= ]([^`]*))?`")  # an option of Python in a message, with or without a value
_FLAG = re.compile(r"(?<!FILE )(?<![\w-])(--[a-z][a-z-]*|-o)(?![\w-])")  # an option of the command in a message


def complete(verb: Verb[Asked], values: Mapping[str, Any]) -> Asked:
    """Return all options of a verb: the given values, checked, and the defaults of the others.

    Parameters
    ----------
    verb : Verb
    values : mapping of str to object

    Returns
    -------
    TypedDict
        `verb.arguments`; an option without a default is None where it is not given.

    Raises
    ------
    InputError
        An unknown name, or a value of a wrong type or range.
    """
    options = verb.named()
    known = options if verb.options is None else {**options_of(verb.options), **_parameters(options)}
    for name in values:
        if name not in options:
            raise InputError(f"{verb.name}: there is no option {name!r}; it takes {', '.join(sorted(known))}")
    return cast("Asked", completed(options, values))


def _parameters(options: dict[str, Option]) -> dict[str, Option]:
    return {
        name: option for name, option in options.items() if option.positional or option.required or name == "output"
    }


@contextmanager
def python_words(verb: Verb[Any]) -> Iterator[None]:
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


def workflow_of(verb: Verb[Any]) -> tuple[Callable[..., Any], Any]:
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


def answer(verb: Verb[Any], results: Results, output: PathLike | None, options: Mapping[str, Any]) -> Any:
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


def called(verb: Verb[Any], values: Mapping[str, Any], **callbacks: Any) -> Any:
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


def with_flags(text: str, verb: Verb[Any]) -> str:
    """Replace names of options in backticks in a message by flags: `cell_size=2` by --cs-e 2.

    Parameters
    ----------
    text : str
    verb : Verb

    Returns
    -------
    str
    """
    options = verb.named()

    def flag(found: re.Match[str]) -> str:
        if found[1] == "trust":
            return "--trust"
        option = options.get(found[1]) or verb_of("export-raster").named().get(found[1])
        if option is None or not option.flags:
            return found[0]
        flag = option.flags[0]
        return f"{flag} {found[2]}" if found[2] else flag

    return _NAME.sub(flag, text)


def with_names(text: str, verb: Verb[Any]) -> str:
    """Replace flags of the command in a message by the names of options in Python.

    Parameters
    ----------
    text : str
    verb : Verb

    Returns
    -------
    str
    """
    names = {flag: option.name for option in verb.named().values() for flag in option.flags}
    return _FLAG.sub(lambda found: f"`{names[found[1]]}`" if found[1] in names else found[0], text)


def request(verb: Verb[Any], kind: type[Request], values: Mapping[str, Any]) -> Request:
    """Return the request of class `kind` from options by name; missing ones have their defaults.

    Fields of `kind` that are dataclasses are made of the same options.

    Parameters
    ----------
    verb : Verb
    kind : class
        A dataclass.
    values : mapping of str to object

    Raises
    ------
    InputError
        An unknown name, or a value of a wrong type or range.
    """
    return made(kind, cast("dict[str, Any]", complete(verb, values)))


def made(kind: type[Request], values: Mapping[str, Any]) -> Request:
    """Return a dataclass from values by field name; fields that are dataclasses are made of the same values.

    Parameters
    ----------
    kind : class
    values : mapping of str to object
        Names that are no fields are ignored.
    """
    given = {}
    for name, hint in _hints(kind).items():
        if is_typeddict(hint):
            given[name] = {key: values[key] for key in hint.__annotations__ if key in values}
        elif dataclasses.is_dataclass(hint):
            given[name] = made(hint, values)
        elif name in values:
            given[name] = values[name]
    return kind(**given)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return {name: hint for name, hint in get_type_hints(kind).items() if name in kind.__dataclass_fields__}
