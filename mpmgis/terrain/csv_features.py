"""Features in a text table: a column WKT with geometries, or two columns with coordinates of points."""

from pathlib import Path

import numpy as np
import pyproj
import shapely

from ..system.errors import FormatError, InputError, one_line
from ..system.text_tables import file_text, is_number, read_cells, with_point
from .georeference import crs_of_text
from .unread_surfaces import unread_kind, unread_line

GEOMETRY = ("wkt", "_wkt")  # names of the column with geometries, in lower case
PLACES = (("x", "y"), ("e", "n"), ("east", "north"), ("easting", "northing"), ("e_m", "n_m"))  # as above
LARGEST_CRS = 100_000  # [bytes] of a .prj


def read_csv_features(path: Path) -> tuple[dict[str, np.ndarray], np.ndarray, pyproj.CRS | None]:
    """Read the features in a table.

    Parameters
    ----------
    path : Path

    Returns
    -------
    columns : dict of str to array[n]
        float64 where all cells are numbers or empty, else text.
    geometry : object[n]
        None where a cell is empty.
    crs : pyproj.CRS or None
        Of the .prj beside the table.

    Raises
    ------
    FormatError
        No table, with the number of the wrong line; no geometry.
    InputError
        A geometry of a kind that is not read.
    """
    table = read_cells(path, "a table with a header and one row per feature")
    cells = np.array([cells for _, cells in table.rows], object).reshape(len(table.rows), len(table.names))
    columns = {name: _numbers(some, table.delimiter) for name, some in zip(table.names, cells.T, strict=True)}
    return columns, _geometry(path, columns, [line for line, _ in table.rows]), _crs_beside(path)


def _numbers(cells, delimiter):
    """float64[n] where all cells are numbers or empty, else the text."""
    words = [with_point(cell, delimiter) for cell in cells]
    if not any(words) or not all(word == "" or is_number(word) for word in words):
        return cells
    return np.array([np.nan if word == "" else float(word) for word in words])


def _geometry(path, columns, lines):
    by_name = {name.lower(): values for name, values in columns.items()}
    words = next((by_name[name] for name in GEOMETRY if name in by_name), None)
    if words is not None:
        made = []
        for number, (line, word) in enumerate(zip(lines, words, strict=True), 1):
            try:
                made.append(None if word == "" else shapely.from_wkt(word))
            except (shapely.errors.GEOSException, NotImplementedError, TypeError) as error:
                if kind := unread_kind(str(word)):
                    raise InputError(f"{path}: {unread_line(number, kind, path.name)}") from error
                raise FormatError(f"{path} line {line}: no geometry in WKT ({one_line(error)[:80]})") from error
        return np.array(made, object)
    for east, north in PLACES:
        if east in by_name and north in by_name:
            pair = by_name[east], by_name[north]
            if any(values.dtype == object for values in pair):
                raise FormatError(f"{path}: columns {east} and {north} contain text, expected coordinates")
            return shapely.points(*pair)
    raise FormatError(
        f"{path} contains no layer with geometry: it has {', '.join(columns)[:200]}; add a column WKT, or x and y"
    )


def _crs_beside(path):
    """The CRS of the .prj beside the table; None without one."""
    file = path.with_suffix(".prj")
    return crs_of_text(file_text(file, "a CRS", LARGEST_CRS).strip()) if file.is_file() else None
