"""Hydrographs read from CSV tables in the formats of common spreadsheets."""

import difflib
import math
from pathlib import Path

import numpy as np

from ..system.errors import FormatError
from ..system.text_tables import is_number, read_cells, with_point
from .inflow import COLUMNS, Hydrograph

_SIGNED = ("time", "velocity_east", "velocity_north")
# larger values are input errors, in the units of COLUMNS
_HIGHEST = {"discharge": 1e9, "thickness": 1e4, "speed": 1e3, "velocity_east": 1e3, "velocity_north": 1e3}
_LARGEST = 10_000_000  # [bytes] of a table


def read_hydrograph(path: str | Path) -> Hydrograph:
    """Read a Hydrograph from a CSV file: a header and one row per time, in any form of `text_tables`.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        With the number of the wrong line.
    """
    path = Path(path)
    content = read_cells(path, "a CSV with a header such as time,discharge and one row per time", _LARGEST)
    names = _names(path, content.names)
    if not content.rows:
        raise FormatError(f"{path} contains a header and no rows")
    numbers = [_numbers(path, line, names, cells, content.delimiter) for line, cells in content.rows]
    table = dict(zip(names, np.array(numbers).T, strict=True))
    _require_valid_series(path, table, [line for line, _ in content.rows])
    velocity = None
    if "velocity_east" in table:
        velocity = np.column_stack([table["velocity_east"], table["velocity_north"]])
    return Hydrograph(table["time"], table.get("discharge"), table.get("thickness"), table.get("speed"), velocity)


def _names(path: Path, cells: list[str]) -> list[str]:
    """Return the column names of the header; check that they are known, unique and complete."""
    takes = ", ".join(f"{name} [{unit}]" for name, unit in COLUMNS.items())
    names = [cell.lower() for cell in cells]
    for name in names:
        if name not in COLUMNS:
            close = difflib.get_close_matches(name, COLUMNS, 1)
            meant = f" (did you mean {close[0]!r}?)" if close else ""
            if is_number(name):
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


def _numbers(path: Path, line: int, names: list[str], cells: list[str], delimiter: str) -> list[float]:
    """Return the numbers of one row."""
    numbers = []
    for name, cell in zip(names, cells, strict=True):
        text = with_point(cell, delimiter)
        if not is_number(text):
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
