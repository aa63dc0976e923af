"""What a form asks: one Field a line, as plain data that QGIS' parameters and the command's arguments are made of."""

from __future__ import annotations

from dataclasses import dataclass

# Kinds of fields: what QGIS shows, and what a value is.
RASTER, POLYGONS, LINES, POINTS = "raster layer", "polygon layer", "line layer", "point layer"  # path of its file
FILE, FOLDER = "file", "folder"  # path of what is there
NEW_FILE, NEW_FOLDER = "new file", "new folder"  # path of what will be written
NUMBER, INTEGER, TEXT, CHOICE, SWITCH, CRS = "number", "integer", "text", "choice", "switch", "CRS"
KINDS = (
    RASTER,
    POLYGONS,
    LINES,
    POINTS,
    FILE,
    FOLDER,
    NEW_FILE,
    NEW_FOLDER,
    NUMBER,
    INTEGER,
    TEXT,
    CHOICE,
    SWITCH,
    CRS,
)


@dataclass(frozen=True)
class Field:
    """A line of a form.

    `option` is the command's option, None for an argument without a name, and "" for what the plugin itself uses.
    `optional` fields may be left empty; `advanced` ones are folded away; `files` is QGIS' filter of a file dialog.
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
    files: str = ""


def arguments(fields, values):
    """List of text: the command's arguments for `values` (name -> value; None or "" where nothing was given).

    Options are written as ``--option=value``, so that a value may begin with a minus. What is as the command has it
    anyway is left out.
    """
    named, bare = [], []
    for field in fields:
        value = values.get(field.name)
        if field.option == "" or value in (None, "", field.default):
            continue
        if field.option is None:
            bare.append(text(value))
        elif field.kind == SWITCH:
            named.append(field.option)
        else:
            named.append(f"{field.option}={text(value)}")
    return bare + named


def text(value):
    """A value as an argument: numbers as short as they are, without an exponent for whole ones."""
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    return str(value)
