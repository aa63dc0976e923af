"""What a form asks: one Field a line, as plain data that QGIS' parameters and the command's arguments are made of."""

from __future__ import annotations

from dataclasses import dataclass

# Kinds of fields: what QGIS shows, and what a value is.
RASTER, POLYGONS, LINES, POINTS = "raster layer", "polygon layer", "line layer", "point layer"  # path of its file
FILE, FOLDER, FILES = "file", "folder", "files"  # path of what is there, or several
NEW_FILE, NEW_FOLDER = "new file", "new folder"  # path of what will be written
NUMBER, INTEGER, TEXT, CHOICE, SWITCH, CRS = "number", "integer", "text", "choice", "switch", "CRS"
TEXTS = "texts"  # one a line, or with semicolons
PLACE = "place"  # clicked on the map: path of a file with that point
EXTENT = "extent"  # west, south, east, north in the CRS of the field DEM
KINDS = (
    *(RASTER, POLYGONS, LINES, POINTS, FILE, FOLDER, FILES, NEW_FILE, NEW_FOLDER),
    *(NUMBER, INTEGER, TEXT, CHOICE, SWITCH, CRS, TEXTS, PLACE, EXTENT),
)
SEVERAL = (FILES, TEXTS)  # the value is a list, and its option is given once for each


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
        if field.kind in SEVERAL:
            given = [text(one) for one in value]
            bare += given if field.option is None else []
            named += [] if field.option is None else [f"{field.option}={one}" for one in given]
        elif field.option is None:
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
