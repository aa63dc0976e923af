"""Read tables with results of other codes, for comparison with a study."""

import math
from pathlib import Path
from typing import NamedTuple

from ..system.errors import FormatError
from ..system.text_tables import read_cells, with_point
from .run_measures import NAMES, Errors
from .study_table import BESIDE, ERROR_COLUMNS

SECONDS = ("seconds", "seconds_min", "seconds_max")
_LARGEST = 10_000_000  # [bytes] of a table of results


class OtherRow(NamedTuple):
    """A row of a table of other codes.

    Parameters
    ----------
    code, setting : str
    seconds : (float, float, float) [s]
        Wall time: typical, min, max.
    errors : Errors
        NaN if unknown.
    thickness : Path or None
        Raster of the thickness at the end.
    """

    code: str
    setting: str
    seconds: tuple
    errors: Errors
    thickness: Path | None


def read_other_results(path: str | Path, measure: str) -> list[OtherRow]:
    """Read a table with results of other codes.

    Columns: setting and seconds; error_thickness, error_momentum, error_area, error_reach_m, or thickness (path,
    relative to the table, of a raster of the vertical thickness at the end [m]); optional code, seconds_min and
    seconds_max. Other columns are ignored, so the table of another study is valid.

    Parameters
    ----------
    path : str or Path
        CSV file.
    measure : str
        Error that must be there: one of `run_measures.NAMES`.

    Raises
    ------
    FormatError
        With the invalid row.
    """
    path, column = Path(path), ERROR_COLUMNS[measure]
    table = read_cells(path, "a CSV with the columns setting and seconds", _LARGEST)
    names = set(table.names)
    if not table.rows:
        raise FormatError(f"{path} has no rows, expected a header and one row per result")
    for wanted in ("setting", "seconds"):
        if wanted not in names:
            raise FormatError(f"{path} has no column {wanted!r}, expected setting, seconds, and {column} or thickness")
    if column not in names and not (measure == "thickness" and "thickness" in names):
        also = ", or thickness with rasters" if measure == "thickness" else ""
        raise FormatError(f"{path} has no column {column!r}; add it{also}")
    rows = ((line, dict(zip(table.names, cells, strict=True))) for line, cells in table.rows)
    return [_other_row(path, line, row, measure, table.delimiter) for line, row in rows if row.get("knob") != BESIDE]


def _other_row(path, line, row, measure, delimiter):
    where = f"{path} line {line}"
    if not row["setting"]:
        raise FormatError(f"{where}: setting is empty, expected a name of this result")
    raster = path.parent / row["thickness"] if row.get("thickness") else None
    row = row | {name: with_point(row.get(name, ""), delimiter) for name in (*ERROR_COLUMNS.values(), *SECONDS)}
    errors = Errors(*(_number(row, ERROR_COLUMNS[name], where, least=0.0) for name in NAMES))
    if raster is None and math.isnan(getattr(errors, measure)):
        raise FormatError(f"{where}: {ERROR_COLUMNS[measure]} is empty, expected a number")
    seconds = [_number(row, name, where, above=0.0) for name in SECONDS]
    if math.isnan(seconds[0]):
        raise FormatError(f"{where}: seconds is empty, expected the wall time of the time integration")
    seconds = (seconds[0], *(seconds[0] if math.isnan(value) else value for value in seconds[1:]))
    if not seconds[1] <= seconds[0] <= seconds[2]:
        raise FormatError(f"{where}: seconds = {seconds[0]:g} is not between seconds_min and seconds_max")
    return OtherRow(row.get("code") or path.stem, row["setting"], seconds, errors, raster)


def _number(row: dict, name: str, where: str, least: float = -math.inf, above: float = -math.inf) -> float:
    """Return the number in a column, or NaN."""
    text = row.get(name, "")
    if not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= least and value > above):
        expected = f"above {above:g}" if math.isfinite(above) else f"of at least {least:g}"
        raise FormatError(f"{where}: {name} = {text[:40]!r}, expected a number {expected}")
    return value
