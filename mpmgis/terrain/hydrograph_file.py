"""Hydrographs read from CSV tables in the formats of common spreadsheets."""

import codecs
import csv
import difflib
import math
from pathlib import Path

import numpy as np

from ..system.errors import FormatError
from ..system.trusted_files import require_file
from .inflow import COLUMNS, Hydrograph

_SIGNED = ("time", "velocity_east", "velocity_north")
# larger values are input errors, in the units of COLUMNS
_HIGHEST = {"discharge": 1e9, "thickness": 1e4, "speed": 1e3, "velocity_east": 1e3, "velocity_north": 1e3}
_DELIMITERS = ",;\t"
_LARGEST = 10_000_000  # [bytes] of a table


def read_hydrograph(path: str | Path) -> Hydrograph:
    """Read a Hydrograph from a CSV file: a header and one row per time, separated by comma, semicolon or tab.

    With semicolons or tabs, numbers may have a decimal comma. Empty lines and lines that start with # are skipped.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        With the number of the wrong line.
    """
    path = Path(path)
    lines = [(k, line) for k, line in enumerate(_text(path).splitlines(), 1)]
    lines = [(k, line) for k, line in lines if line.strip(f" {_DELIMITERS}") and not line.lstrip().startswith("#")]
    if not lines:
        raise FormatError(f"{path} is empty, expected a header such as time,discharge and one row per time")
    delimiter = max(_DELIMITERS, key=lines[0][1].count)
    rows = [(k, [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]) for k, line in lines]
    names = _names(path, rows[0][1])
    if len(rows) == 1:
        raise FormatError(f"{path} contains a header and no rows")
    numbers = [_numbers(path, k, names, cells, delimiter != ",") for k, cells in rows[1:]]
    table = dict(zip(names, np.array(numbers).T, strict=True))
    _require_valid_series(path, table, [k for k, _ in rows[1:]])
    velocity = None
    if "velocity_east" in table:
        velocity = np.column_stack([table["velocity_east"], table["velocity_north"]])
    return Hydrograph(table["time"], table.get("discharge"), table.get("thickness"), table.get("speed"), velocity)


def _text(path: Path) -> str:
    """Read the file's text: UTF-8 with or without a byte order mark, or UTF-16 with one."""
    require_file(path)
    try:
        if path.stat().st_size > _LARGEST:
            raise FormatError(f"{path} has {path.stat().st_size / 1e6:.0f} MB, expected a table of times below 10 MB")
        raw = path.read_bytes()
        utf16 = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        return raw.decode("utf-16" if utf16 else "utf-8-sig")
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file, expected a CSV with the columns time and discharge") from error
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path} is not readable text, expected a CSV; save it as CSV UTF-8") from error


def _names(path: Path, cells: list[str]) -> list[str]:
    """Return the column names of the header; check that they are known, unique and complete."""
    takes = ", ".join(f"{name} [{unit}]" for name, unit in COLUMNS.items())
    names = [cell.lower() for cell in cells]
    for name in names:
        if name not in COLUMNS:
            close = difflib.get_close_matches(name, COLUMNS, 1)
            meant = f" (did you mean {close[0]!r}?)" if close else ""
            if _is_number(name):
                meant = "; the first line must name the columns"
            raise FormatError(f"{path}: unknown column {name!r}{meant}; it takes {takes}")
        if names.count(name) > 1:
            raise FormatError(f"{path}: the column {name} occurs twice; remove one")
    if "time" not in names:
        raise FormatError(f"{path}: the column time [s] is missing; it has {', '.join(names)}")
    if ("discharge" in names) == ("thickness" in names):
        got = "both" if "discharge" in names else "none"
        raise FormatError(f"{path}: expected a column discharge [m3 s-1] or a column thickness [m], got {got}")
    if ("velocity_east" in names) != ("velocity_north" in names):
        raise FormatError(f"{path}: velocity_east and velocity_north require each other; give both, or speed instead")
    if "speed" in names and "velocity_east" in names:
        raise FormatError(f"{path}: speed and velocity_east, velocity_north exclude each other; remove one")
    return names


def _numbers(path: Path, line: int, names: list[str], cells: list[str], decimal_comma: bool) -> list[float]:
    """Return the numbers of one row."""
    while len(cells) > len(names) and cells[-1] == "":  # spreadsheets end lines with empty cells
        cells = cells[:-1]
    if len(cells) != len(names):
        fix = "; use decimal points, or semicolons between the columns" if len(cells) == 2 * len(names) else ""
        raise FormatError(f"{path} line {line}: {len(cells)} values for {len(names)} columns{fix}")
    numbers = []
    for name, cell in zip(names, cells, strict=True):
        text = cell.replace(",", ".") if decimal_comma and cell.count(",") == 1 and "." not in cell else cell
        if not _is_number(text):
            raise FormatError(f"{path} line {line}: {name} is {cell!r}, expected a number [{COLUMNS[name]}]")
        value = float(text)
        if not math.isfinite(value):
            raise FormatError(f"{path} line {line}: {name} is {cell}, expected a finite number [{COLUMNS[name]}]")
        if value < 0 and name not in _SIGNED:
            raise FormatError(f"{path} line {line}: {name} is {cell}, expected 0 or more; outflow is not possible")
        if abs(value) > _HIGHEST.get(name, math.inf):
            raise FormatError(
                f"{path} line {line}: {name} is {cell}, expected at most {_HIGHEST[name]:g} {COLUMNS[name]}"
            )
        numbers.append(value)
    return numbers


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def _require_valid_series(path: Path, table: dict[str, np.ndarray], lines: list[int]) -> None:
    """Check that times start at 0 or later and increase, and that there is inflow."""
    time = table["time"]
    if time[0] < 0:
        raise FormatError(f"{path} line {lines[0]}: time is {time[0]:g} s, expected 0 or later; runs start at 0")
    for k in np.flatnonzero(np.diff(time) <= 0):
        fix = "add 0.001 s to the second for a step" if time[k + 1] == time[k] else "sort the rows"
        raise FormatError(f"{path} line {lines[k + 1]}: time {time[k + 1]:g} s is not after {time[k]:g} s; {fix}")
    if "discharge" in table and len(time) < 2:
        raise FormatError(
            f"{path} line {lines[0]}: only one time, expected at least two; discharge is linear between times"
        )
    amount = "discharge" if "discharge" in table else "thickness"
    if not table[amount].any():
        raise FormatError(f"{path}: {amount} is 0 at all times, there is no inflow")
