"""Read the forms of the verbs from forms.json in the plugin's zip: fields, and arguments of the command."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass

OUTPUT = "OUTPUT"  # name of the field of the output
QGIS_MIN = "QGIS_MIN"  # its default is the running QGIS
LOAD = "LOAD"  # name of the field that only the plugin uses: whether results are opened
FORMS_FILE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "forms.json")

# Kinds of fields: widget in QGIS, and type of the value.
RASTER, POLYGONS, LINES, POINTS = "raster layer", "polygon layer", "line layer", "point layer"  # path of its file
FILE, FOLDER, FILES = "file", "folder", "files"  # existing path, or several
NEW_FILE, NEW_FOLDER = "new file", "new folder"  # path of an output
NUMBER, INTEGER, TEXT, CHOICE, SWITCH, CRS = "number", "integer", "text", "choice", "switch", "CRS"
TEXTS = "texts"  # on separate lines, or with semicolons
CHOICES = "choices"  # several of a list: names with commas
PLACE = "place"  # clicked on the map: path of a file with that point
COLUMN, ANY_COLUMN = "column", "any column"  # name of a column, numeric or any, of the layer in the field RELEASE
SCENARIOS = "scenarios"  # table of return periods and results
EXTENT = "extent"  # west, south, east, north in the CRS of the field DEM
KINDS = (
    *(RASTER, POLYGONS, LINES, POINTS, FILE, FOLDER, FILES, NEW_FILE, NEW_FOLDER),
    *(NUMBER, INTEGER, TEXT, CHOICE, SWITCH, CRS, TEXTS, PLACE, EXTENT, COLUMN, ANY_COLUMN),
    *(SCENARIOS, CHOICES),
)
SEVERAL = (FILES, TEXTS, SCENARIOS)  # the value is a list, and its option is repeated


@dataclass(frozen=True)
class Field:
    """A line of a form.

    `option` is the command's option, None for a positional argument, "" for a field that only the plugin uses.
    `optional` fields may be empty; `advanced` ones are in a folded group; `files` is the filter of a file dialog.
    """

    name: str
    kind: str
    label: str
    option: str | None = ""
    help: str = ""
    default: object = None
    choices: tuple[str, ...] = ()
    optional: bool = False
    advanced: bool = False
    least: float | None = None
    most: float | None = None
    files: str = ""


def arguments(fields: tuple[Field, ...], values: dict[str, object]) -> list[str]:
    """Return the command's arguments for the values of the fields of a form.

    Options are written as ``--option=value``, so that a value may begin with a minus. Defaults are left out.

    Parameters
    ----------
    fields : tuple of Field
    values : dict
        Name of a field -> value; None or "" for an empty field.

    Returns
    -------
    list of str
    """
    named, bare = [], []
    for field in fields:
        value = values.get(field.name)
        if field.option == "" or value in (None, "", field.default):
            continue
        if field.kind in SEVERAL:
            given = [text(one) for one in value]
            bare += given if field.option is None else []
            named += [] if field.option is None else [f"{field.option}={one}" for one in given]
        elif field.kind == CHOICES:
            named.append(f"{field.option}={','.join(value)}")
        elif field.option is None:
            bare.append(text(value))
        elif field.kind == SWITCH:
            named.append(field.option)
        else:
            named.append(f"{field.option}={text(value)}")
    return bare + named


def text(value: object) -> str:
    """Return a value as an argument: shortest form of a number, whole numbers without exponent.

    Parameters
    ----------
    value : object

    Returns
    -------
    str
    """
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    return str(value)


@dataclass(frozen=True)
class Verb:
    """A verb of the command as an algorithm of the toolbox.

    `says` verbs print text, the others the paths of their files. Exactly one of the fields in `one_of` must be given.
    `project` verbs write a folder with a QGIS project; of other verbs, files that end with one of `layers` are opened,
    rasters without a style with `palette` (value, colour, label) on their first band. `plots` verbs write a picture for
    QGIS' Results Viewer, and of `table` verbs the JSON is listed there as a table. Two forms of one verb have a `name`.
    """

    verb: str
    title: str
    group: str
    help: str
    fields: tuple[Field, ...]
    says: bool = False
    project: bool = False
    plots: bool = False
    table: bool = False
    layers: tuple[str, ...] = ()
    palette: tuple[tuple[int, str, str], ...] = ()
    one_of: tuple[str, ...] = ()
    name: str = ""

    @property
    def identifier(self) -> str:
        """Identifier of the algorithm: the verb without hyphens, or the name of the form."""
        return self.name or self.verb.replace("-", "")


def read_forms(path: str = FORMS_FILE) -> tuple[Verb, ...]:
    """Read the forms in a JSON file.

    Parameters
    ----------
    path : str

    Returns
    -------
    tuple of Verb
    """
    with open(path, encoding="utf-8") as file:
        return tuple(map(verb_of, json.load(file)["forms"]))


def read_scene_data(path: str = FORMS_FILE) -> dict[str, object]:
    """Read what the scene and its laws state for the form for a usual simulation.

    Parameters
    ----------
    path : str

    Returns
    -------
    dict
        `fields`: properties by name of a field; `friction_ranges`: text.
    """
    with open(path, encoding="utf-8") as file:
        return json.load(file)["scene"]


def verb_of(form: dict[str, object]) -> Verb:
    """Return the Verb of a form in JSON.

    Parameters
    ----------
    form : dict

    Returns
    -------
    Verb
    """
    fields = tuple(Field(**{**field, "choices": tuple(field.get("choices", ()))}) for field in form["fields"])
    lists = {name: tuple(form[name]) for name in ("layers", "one_of")}
    palette = tuple(map(tuple, form["palette"]))
    return Verb(**{**form, **lists, "fields": fields, "palette": palette})
