"""Rows of values written as CSV."""

import csv
import math

from .whole_files import whole_file


def write_records(path, names, rows):
    """Write rows of values with a header as CSV; an empty cell where a number is not finite."""
    with whole_file(path) as part, open(part, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(names)
        table.writerows([_cell(value) for value in row] for row in rows)


def column_name(name, unit):
    """The heading `name_unit` of a column, for example ``Ut_m_s``; only the name for numbers without unit."""
    return name if unit in ("", "1") else f"{name}_{unit.replace('-1', '').replace('-', '').replace(' ', '_')}"


def _cell(value):
    if isinstance(value, str):
        return value
    return f"{value:.10g}" if math.isfinite(value) else ""
