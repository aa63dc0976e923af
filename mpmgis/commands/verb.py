"""Describe a verb of the command: its purpose, its table of options, its forms in QGIS."""

import importlib
import pkgutil
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from ..system.option import Option, options_of

# modules that are not verbs
_INFRASTRUCTURE = ("demo_site", "plugin_forms", "results_api", "shared_options", "shell", "verb", "verb_calls")
# of verbs; the tens digit of Verb.place
GROUPS = ("from a terrain to a map", "answers from results", "many runs", "information")
Asked = TypeVar("Asked")  # TypedDict of the options of a verb


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
class Verb(Generic[Asked]):
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
    counted : str
        What its progress counts.
    """

    name: str
    place: int
    line: str
    arguments: type[Asked]
    example: str
    description: str = ""
    options: Any = None
    groups: tuple[tuple[str, Any], ...] = ()
    forms: tuple[Form, ...] = ()
    no_form: str = ""
    trust: bool = False
    counted: str = "frame"

    def named(self) -> dict[str, Option]:
        """Return the options of the command by name, each with its name and type."""
        return options_of(self.arguments)


def verb_names() -> list[str]:
    """Return the names of all verbs, unordered."""
    package = importlib.import_module(__package__)
    modules = (module.name for module in pkgutil.iter_modules(package.__path__))
    return [name.replace("_", "-") for name in modules if name not in _INFRASTRUCTURE]


def module_of(name: str) -> Any:
    """Return the module of a verb: `VERB`, `work` and the functions of Python.

    Parameters
    ----------
    name : str
    """
    return importlib.import_module(f"{__package__}.{name.replace('-', '_')}")


def verb_of(name: str) -> Verb[Any]:
    """Return the Verb of a name.

    Parameters
    ----------
    name : str
    """
    verb: Verb[Any] = module_of(name).VERB
    return verb


def all_verbs() -> list[Verb[Any]]:
    """Return all verbs in their order."""
    return sorted(map(verb_of, verb_names()), key=lambda verb: verb.place)
