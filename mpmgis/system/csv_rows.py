"""Tables written as CSV files, and the headings of their columns."""

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from .whole_files import whole_file


def write_records(path: str | Path, names: Sequence[str], rows: Iterable[Sequence[str | float]]) -> None:
    """Write rows of values with a header as CSV.

    Parameters
    ----------
    path : str or Path
    names : sequence of str
        Headings of the columns.
    rows : iterable of sequences of str or float
        A number that is not finite becomes an empty cell.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with whole_file(path) as part, open(part, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(names)
        table.writerows([_cell(value) for value in row] for row in rows)


def write_columns(path: str | Path, columns: Iterable[tuple[str, str]], rows: Iterable[Sequence[str | float]]) -> None:
    """Write rows of values as CSV, with the name and unit of each column as its heading.

    Parameters
    ----------
    path : str or Path
    columns : iterable of (str, str)
        Names and units.
    rows : iterable of sequences of str or float
        A number that is not finite becomes an empty cell.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    write_records(path, [column_name(*column) for column in columns], rows)


def column_name(name: str, unit: str) -> str:
    """Return the heading `name_unit` of a column, for example ``Ut_m_s``.

    Parameters
    ----------
    name : str
    unit : str
        As in `quantities`, for example ``m s-1``. With "" or "1" the heading is only the name.
    """
    return name if unit in ("", "1") else f"{name}_{unit.replace('-1', '').replace('-', '').replace(' ', '_')}"


def _cell(value):
    if isinstance(value, str):
        return value
    return f"{value:.10g}" if math.isfinite(value) else ""
