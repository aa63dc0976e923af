"""Check values of options, from text of the command or from Python, and complete them by the defaults."""

import dataclasses
import math
from collections.abc import Mapping
from numbers import Integral, Real
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin

from .errors import InputError
from .option import Option, PathLike, options_of

Table = TypeVar("Table")  # a TypedDict of options
_COUNTS = {1: "one", 2: "two", 3: "three", 4: "four"}  # numbers in words


def value_of_text(text: str, option: Option) -> Any:
    """Return the value of an option from text of the command.

    Parameters
    ----------
    text : str
    option : Option

    Returns
    -------
    object

    Raises
    ------
    ValueError
        The message contains the given and the expected value.
    """
    kind = _item(option) if option.repeat else option.type
    try:
        _require_name(text, kind)
        value = _from_text(text, kind, option)
        return checked(value, dataclasses.replace(option, type=kind))
    except ValueError as error:
        raise ValueError(f"got {text!r}, expected {str(error) or expected(option)}") from None


def _require_name(value: Any, kind: Any) -> None:
    """Refuse an empty text for a path: as a path it would be the current folder."""
    if value == "" and (kind == PathLike or Path in get_args(kind)):
        raise ValueError("a number or a name" if float in get_args(kind) else "a file name")


def _item(option: Option) -> Any:
    """Type of a single value of an option that can be repeated."""
    parts = (option.type, *get_args(option.type))
    return next(get_args(part)[0] for part in parts if get_origin(part) is tuple)


def _from_text(text: str, kind: Any, option: Option) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if kind == PathLike:
        return text if option.keep_text else Path(text)
    if origin in (Union, UnionType):
        for part in sorted(parts, key=lambda part: get_origin(part) is not Literal):
            try:
                return _from_text(text, part, option)
            except ValueError:
                continue
        raise ValueError
    if origin is Literal:
        if text not in parts:
            raise ValueError
        return text
    if origin is tuple:
        return _tuple_from_text(text, parts, option)
    if kind is float:
        return _number(text)
    if kind is int:
        return int(text) if text.isascii() and text.isdigit() else _whole(_number(text))
    if kind is str:
        return text
    raise ValueError


def _tuple_from_text(text: str, parts: Any, option: Option) -> tuple[Any, ...]:
    if get_origin(parts[0]) is tuple:  # pairs NAME=VALUE
        pairs = tuple(tuple(word.strip() for word in part.split("=", 1)) for part in text.split(","))
        if not all(len(pair) == 2 and all(pair) for pair in pairs):
            raise ValueError
        return pairs
    words = [word.strip() for word in text.split(",")]
    if not all(words) or (parts[-1] is not Ellipsis and len(words) != len(parts)):
        raise ValueError
    return tuple(_from_text(word, parts[0], option) for word in words)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError from None
    if not math.isfinite(value):
        raise ValueError("a finite number")
    return value


def _whole(value: float) -> int:
    if value != int(value):
        raise ValueError
    return int(value)


def checked(value: Any, option: Option) -> Any:
    """Return a value as functions take it: paths as Path, numbers as float, lists as tuples.

    Parameters
    ----------
    value : object
    option : Option

    Raises
    ------
    ValueError
        Not of the option's type or range.
    """
    value = _normal(value, option.type, option)
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, Real) and not _in_range(number, option):
            raise ValueError
    if option.check is not None and (wrong := option.check(value)):
        raise ValueError(wrong)
    return value


def _normal(value: Any, kind: Any, option: Option) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    _require_name(value, kind)
    if kind == PathLike:
        if not isinstance(value, (str, Path)):
            raise ValueError
        return value if option.keep_text else Path(value)
    if origin in (Union, UnionType):
        return _first_that_fits(value, parts, option)
    if origin is Literal and isinstance(value, str) and value in parts:
        return value
    if origin is tuple and isinstance(value, (tuple, list)):
        if parts[-1] is not Ellipsis and len(value) != len(parts):
            raise ValueError
        return tuple(_normal(part, parts[0], option) for part in value)
    if origin is dict and isinstance(value, Mapping):
        return dict(value)
    if kind is bool and isinstance(value, bool):
        return value
    if kind is float and isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    if kind is int and isinstance(value, Integral) and not isinstance(value, bool):
        return int(value)
    if kind in (str, Path) and isinstance(value, kind):
        return value
    raise ValueError


def _first_that_fits(value: Any, kinds: tuple[Any, ...], option: Option) -> Any:
    for kind in kinds:
        try:
            return _normal(value, kind, option)
        except ValueError:
            continue
    raise ValueError


def _in_range(value: Real, option: Option) -> bool:
    return (
        (option.above is None or value > option.above)
        and (option.least is None or value >= option.least)
        and (option.below is None or value < option.below)
        and (option.most is None or value <= option.most)
    )


def expected(option: Option) -> str:
    """Return the description of a valid value.

    Parameters
    ----------
    option : Option

    Returns
    -------
    str
    """
    kind = _item(option) if option.repeat else option.type
    return _words(kind, option)


def _words(kind: Any, option: Option) -> str:
    origin, parts = get_origin(kind), get_args(kind)
    limits = _range_words(option)
    simple = {
        float: f"a number{limits}",
        int: f"a whole number{limits}",
        bool: "True or False",
        str: "text",
        Path: "a path",
    }
    if kind == PathLike:
        return "a path"
    if kind in simple:
        return simple[kind]
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_words(part, option) for part in parts))
    if origin is Literal:
        return " or ".join(parts)
    if origin is dict:
        return "a mapping"
    if option.positional:
        return "one path or several"
    one = "names" if parts[0] is str else "numbers" if parts[0] in (float, int) else "values"
    count = "" if parts[-1] is Ellipsis else f"{_COUNTS[len(parts)]} "
    return f"{count}{one}{f' {option.metavar}' if option.metavar else ''} with commas between them{limits}"


def _range_words(option: Option) -> str:
    bounds = (("above", option.above), ("of at least", option.least), ("below", option.below), ("up to", option.most))
    return " and".join(f" {word} {bound:g}" for word, bound in bounds if bound is not None)


def completed(options: Mapping[str, Option], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a value for each option by name: the given one, checked, or the default.

    Parameters
    ----------
    options : mapping of str to Option
    values : mapping of str to object
        Other names are ignored.

    Returns
    -------
    dict of str to object

    Raises
    ------
    InputError
        A value of a wrong type or range.
    """
    found = {}
    for name, option in options.items():
        value = values.get(name)
        if value is None or (isinstance(value, tuple) and not value and option.default in (None, ())):
            found[name] = option.default
            continue
        try:
            found[name] = checked(value, option)
        except ValueError as error:
            raise InputError(f"`{name}` is {value!r}, expected {str(error) or expected(option)}") from None
    return found


def defaults_of(table: type[Table]) -> Table:
    """Return a table of options with the default of each.

    Parameters
    ----------
    table : TypedDict

    Returns
    -------
    dict of str to object
    """
    return cast("Table", completed(options_of(table), {}))
