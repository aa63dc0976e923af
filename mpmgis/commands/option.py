"""Declare options of a verb as data, for the command line, the Python function, the QGIS form and the reference page.

A verb's options are the keys of a TypedDict. Each key has the type of its value and an `Option`, for example
``cell_size: Annotated[float, Option("cell size", "M", unit="m", flag="--cs-e", above=0)]``.
"""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

PathLike = str | Path
_INFRASTRUCTURE = (  # modules that are not verbs
    *(
        "demo_site",
        "forms",
        "option",
        "option_values",
        "plugin_forms",
        "results_api",
        "shared_options",
        "shell",
        "verb_calls",
    ),
)
# of verbs; the tens digit of Verb.place
GROUPS = ("from a terrain to a map", "answers from results", "many runs", "information")


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


@dataclass(frozen=True)
class Form:
    """The form of a verb in QGIS.

    `prints` verbs print text, the others the paths of their files. Exactly one of the fields in `one_of` must be given.
    `project` verbs write a folder with a QGIS project; of other verbs, files that end with one of `layers` are opened,
    rasters without a style with `palette` (value, colour, label). `plots` verbs write a picture. `table` verbs print
    JSON that is shown as a table. `load` names the files that can be opened. Two forms of one verb have a `name`, and
    omit the options `without` or have `only` some; `changes` are changed properties of fields by option name.
    """

    title: str
    group: str
    text: str
    prints: bool = False
    project: bool = False
    plots: bool = False
    table: bool = False
    layers: tuple[str, ...] = ()
    palette: tuple[tuple[int, str, str], ...] = ()
    one_of: tuple[str, ...] = ()
    load: str = ""
    name: str = ""
    without: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    changes: tuple[tuple[str, dict[str, Any]], ...] = ()


@dataclass(frozen=True)
class Verb:
    """A verb of the command.

    Parameters
    ----------
    name : str
    place : int
        In the list of verbs; the tens digit is the group of GROUPS.
    line : str
        Its purpose.
    arguments : TypedDict
        All options of the command.
    example, description : str
    options : TypedDict, optional
        Keywords of the Python function.
    groups : tuple of (str, TypedDict)
        Titles of groups in the help, with the options in each.
    forms : tuple of Form
        For QGIS; for a verb without one `no_form` gives the reason.
    trust : bool
        It has --trust.
    workflow : str
        Its function as "folder.module:function"; "" where `shell` has a function for it.
    """

    name: str
    place: int
    line: str
    arguments: Any
    example: str
    description: str = ""
    options: Any = None
    groups: tuple[tuple[str, Any], ...] = ()
    forms: tuple[Form, ...] = ()
    no_form: str = ""
    trust: bool = False
    workflow: str = ""

    def named(self) -> dict[str, Option]:
        """Return the options of the command by name, each with its name and type."""
        return options_of(self.arguments)


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


def verb_names() -> list[str]:
    """Return the names of all verbs, unordered."""
    package = importlib.import_module(__package__)
    modules = (module.name for module in pkgutil.iter_modules(package.__path__))
    return [name.replace("_", "-") for name in modules if name not in _INFRASTRUCTURE]


def verb_of(name: str) -> Verb:
    """Return the Verb of a name.

    Parameters
    ----------
    name : str
    """
    return importlib.import_module(f"{__package__}.{name.replace('-', '_')}").VERB


def all_verbs() -> list[Verb]:
    """Return all verbs in their order."""
    return sorted(map(verb_of, verb_names()), key=lambda verb: verb.place)
