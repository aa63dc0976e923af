"""Styles of outlines and particles, and their storage inside a GeoPackage."""

import math
import sqlite3
from contextlib import closing
from pathlib import Path
from xml.etree.ElementTree import Element

from ...laws.quantities import BAND
from ...system.errors import OutputError, one_line
from ..averaging.exported_folder import ExportedRun
from .colours import colour_classes, look_of
from .xml_markup import filled, node, qgis_document

# Pens: colour (red, green, blue, opacity), width [mm], line style.
OUTLINE = ("10,10,10,255", 0.5, "solid")
ENVELOPE = ("10,10,10,255", 0.4, "dash")
RELEASE = ("0,70,200,255", 0.6, "solid")
SYMBOLS = ("dot_symbol.xml", "line_symbol.xml", "area_symbol.xml")  # by the number of QGIS for a geometry type


def outline_renderer(pen: tuple) -> Element:
    """Return the element `renderer-v2` of a polygon without fill.

    Parameters
    ----------
    pen : (str, float, str)
        Colour, width [mm] and line style.
    """
    colour, width, style = pen
    return next(filled("outline.qml", colour=colour, width=width, style=style).iter("renderer-v2"))


def speed_renderer(run: ExportedRun) -> Element:
    """Return the element `renderer-v2` of points by their attribute `speed`, in the classes and colours of the rasters.

    With rules, because a common project checker treats every `range` element as a time range.

    Parameters
    ----------
    run : ExportedRun
    """
    classes = colour_classes(look_of(BAND["Ut"], run.classes), run.typical.get("Ut", 0.0))
    lower, rules = None, []
    for k, entry in enumerate(classes):
        above = [] if lower is None else [f"speed > {lower:g}"]
        below = [] if math.isinf(entry.upper) else [f"speed <= {entry.upper:g}"]
        rules.append((" AND ".join(above + below), entry.label, _symbol("dot_symbol.xml", k, entry.colour)))
        lower = entry.upper
    return _rule_renderer("speed", rules)


def class_renderer(attribute: str, classes: list[tuple], geometry: int = 2) -> Element:
    """Return the element `renderer-v2` of polygons, lines or points by the integers of an attribute.

    Parameters
    ----------
    attribute : str
    classes : list of (int, str, str)
        Number, label, colour #rrggbb.
    geometry : int
        QGIS type number: 0 points, 1 lines, 2 polygons.
    """
    return _rule_renderer(
        attribute,
        [
            (f'"{attribute}" = {number}', label, _symbol(SYMBOLS[geometry], k, colour))
            for k, (number, label, colour) in enumerate(classes)
        ],
    )


def _rule_renderer(key, rules):
    """A renderer of rules (filter, label, symbol); symbols are named by number."""
    entries = [
        node("rule", {"key": f"{key}_{k}", "filter": condition, "symbol": k, "label": label})
        for k, (condition, label, _) in enumerate(rules)
    ]
    style = filled("rules.qml", key=key, rules=entries, symbols=[symbol for _, _, symbol in rules])
    return next(style.iter("renderer-v2"))


def _symbol(template, number, colour):
    rgb = ",".join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5))
    return filled(template, name=number, colour=rgb)


def feature_times() -> Element:
    """Return the element `temporal` of a vector layer with features visible from `t_qgis` to `t_qgis_end`."""
    return filled("feature_times.xml")


def vector_style_document(renderer: Element, geometry: int) -> str:
    """Return the text of a style for a vector layer.

    Parameters
    ----------
    renderer : Element
    geometry : int
        QGIS type number: 0 points, 1 lines, 2 polygons.
    """
    return qgis_document(
        node(
            "qgis",
            {"version": "3.22.0", "styleCategories": "AllStyleCategories"},
            renderer,
            node("blendMode", text=0),
            node("layerGeometryType", text=geometry),
        )
    )


def write_layer_styles(path: Path, styles: dict) -> None:
    """Add the table of default layer styles for QGIS to a GeoPackage.

    Parameters
    ----------
    path : Path
    styles : dict of str to str
        Style text of each layer.

    Raises
    ------
    OutputError
        The table cannot be written.
    """
    if not styles:
        return
    try:
        with closing(sqlite3.connect(path)) as database, database:
            _fill(database, styles)
    except sqlite3.Error as error:
        raise OutputError(f"{path}: styles cannot be written ({one_line(error)}); is the disk full?") from error


def _fill(database, styles):
    database.execute(
        "CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT, f_table_catalog TEXT(256), "
        "f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256), styleName TEXT(30), "
        "styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30), "
        "update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))"
    )
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) "
        "VALUES ('layer_styles', 'attributes', 'layer_styles', 0)"
    )
    for name, style in styles.items():
        database.execute(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
            "styleName, styleQML, styleSLD, useAsDefault, description, owner) "
            "VALUES ('', '', ?, 'geom', 'mpmgis', ?, '', 1, 'written by mpmgis', 'mpmgis')",
            (name, style),
        )
