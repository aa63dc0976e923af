"""Declare options as data, for the command line, the Python functions, the QGIS forms and the reference page.

A table of options is a TypedDict. Each key has the type of its value and an `Option`, for example
``cell_size: Annotated[float, Option("cell size", "M", unit="m", flag="--cs-e", above=0)]``. Functions take their
options as such a dictionary, with checked values and all keys; an option without
a default is None where it is not given.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_type_hints

PathLike = str | Path
Auto = Literal["auto"]


@dataclass(frozen=True)
class Option:
    """An option of a verb; its name and type are those of the TypedDict's key.

    Parameters
    ----------
    help : str
        Help text; unit and default are added.
    metavar : str
        Placeholder of the value in the help of the command.
    default : object
        None if there is none; `usual` describes the behaviour then.
    unit : str
    flag, short : str
        Of the command; default: ``--`` and the name. `turned_off`: the flag means False.
    positional : {"", "one", "many", "maybe", "any"}
        An argument without a flag, and its number of values.
    required, repeat : bool
        Must be given; may be given several times.
    exclusive : str
        At most one of the options with the same word here can be given.
    above, least, below, most : float or None
        Range of a number.
    check : callable, optional
        Returns what is expected of a value, "" for a valid one.
    keep_text : bool
        A path that remains text, because it can contain more than a path.
    label, kind, field, files : str
        Of the QGIS form: label, kind of the field (default: by the type), name of the field (default: the option's name
        in capitals), filter of a file dialog. An option without a label has no field; `no_form` gives the reason.
    folded : bool
        The field is one of the advanced ones.
    also : tuple of dict
        More fields that give the same option.
    """

    help: str
    metavar: str = ""
    default: Any = None
    usual: str = ""
    unit: str = ""
    flag: str = ""
    short: str = ""
    turned_off: bool = False
    positional: str = ""
    required: bool = False
    repeat: bool = False
    exclusive: str = ""
    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None
    check: Callable[[Any], str] | None = None
    keep_text: bool = False
    label: str = ""
    kind: str = ""
    field: str = ""
    files: str = ""
    folded: bool = True
    also: tuple[dict[str, Any], ...] = ()
    no_form: str = ""
    name: str = ""
    type: Any = None

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of the command; () of a positional argument."""
        if self.positional:
            return ()
        return (*((self.short,) if self.short else ()), self.flag or "--" + self.name.replace("_", "-"))

    @property
    def words(self) -> str:
        """Help with unit and default."""
        first, semicolon, rest = self.help.partition(";")
        unit = f" [{self.unit}]" if self.unit else ""
        usual = self.usual
        if not usual and self.default not in (None, ()) and not isinstance(self.default, bool):
            usual = _text(self.default)
        return f"{first}{unit}{semicolon}{rest}" + (f" (default: {usual})" if usual else "")


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return ",".join(_text(part) for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


@cache
def options_of(table: Any) -> dict[str, Option]:
    """Return the Options of a TypedDict by name, each with its name and type.

    Parameters
    ----------
    table : TypedDict

    Returns
    -------
    dict of str to Option
    """
    found = {}
    for name, hint in get_type_hints(table, include_extras=True).items():
        (option,) = hint.__metadata__
        found[name] = replace(option, name=name, type=hint.__origin__)
    return found
