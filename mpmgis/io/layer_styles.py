"""Styles inside a GeoPackage: how QGIS shows a layer that is opened by itself."""

import sqlite3
from contextlib import closing

from ..errors import OutputError, one_line


def write_layer_styles(path, styles):
    """Add the table from which QGIS takes a layer's default style: `styles` has a style's text for each layer.

    Raises
    ------
    OutputError
        It cannot be written.
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
