"""Friction by class of terrain, altitude, volume and return period, from a table that the user gives.

Guidelines publish friction in this form. A row of the CSV has conditions and parameters of a friction law::

    terrain,altitude_from,altitude_to,volume_from,volume_to,return_period,mu,xi
    open,1500,,60000,,300,0.155,3000
    channel,1500,,60000,,300,0.21,2000

An empty cell, or a column that is left out, is any value. Ranges contain their lower end and not their upper one. A
column `size` has the sizes of the law with sizes, in place of the parameter that they stand for.
"""

import math
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..laws.friction import (
    BY_VOLUME,
    LAWS,
    SIZE,
    SIZED_LAW,
    SIZES,
    Parameter,
    given_instead,
    parameters_to_give,
    replaced_by,
)
from ..system.errors import FormatError, InputError
from ..system.text_tables import is_number, read_cells, with_point
from .terrain_classes import CLASSES

RANGES = {"altitude": "m", "volume": "m3"}  # conditions with a lower and an upper end
ENDS = ("_from", "_to")
TERRAIN, PERIOD = "terrain", "return_period"
CONDITIONS = (TERRAIN, *(name + end for name in RANGES for end in ENDS), PERIOD)
EXPECTED = "a CSV with conditions (terrain, altitude_from, ...) and parameters of friction (mu, xi, ...)"


@dataclass(frozen=True)
class FrictionRow:
    """A row of the table.

    Parameters
    ----------
    line : int
        Of the file.
    terrain : str
        A name of CLASSES, "" for any.
    altitude, volume : (float, float) [m], [m3]
        Lower end, and upper end that does not belong to it.
    period : float or None [years]
        Return period; None for any.
    values : dict of str to float
        Parameters of the law.
    """

    line: int
    terrain: str
    altitude: tuple[float, float]
    volume: tuple[float, float]
    period: float | None
    values: dict[str, float]


def read_friction_table(path: str | Path, law: str) -> list[FrictionRow]:
    """Read a table of friction for a law.

    Parameters
    ----------
    path : str or Path
    law : str
        Name of a built-in law.

    Returns
    -------
    list of FrictionRow

    Raises
    ------
    FormatError
        An unknown column, a parameter that is missing or out of its range, a value that is no number, an empty range.
    """
    table = read_cells(path, EXPECTED)
    known = parameters_to_give(law)
    instead = _alternatives(law)
    for name in table.names:
        if name not in CONDITIONS and name not in known and name not in instead:
            raise FormatError(
                f"{path}: column {name!r} is neither a condition ({', '.join(CONDITIONS)}) nor a parameter of {law} "
                f"({', '.join(dict.fromkeys((*known, *instead)))})"
            )
        if table.names.count(name) > 1:
            raise FormatError(f"{path}: the column {name} occurs twice; remove one")
    _require_parameters(path, law, table.names)
    if not table.rows:
        raise FormatError(f"{path} contains a header and no rows")
    return [
        _row(
            path,
            line,
            dict(zip(table.names, (with_point(cell, table.delimiter) for cell in cells), strict=True)),
            known,
        )
        for line, cells in table.rows
    ]


def _alternatives(law: str) -> dict[str, str]:
    """Return the columns that may be in place of a parameter, with that parameter."""
    names = [*given_instead(law), *([SIZE] if law == SIZED_LAW else [])]
    return {name: replaced_by(name) for name in names}


def _require_parameters(path: str | Path, law: str, names: Sequence[str]) -> None:
    """Refuse a table without a parameter that has no default."""
    replaced = {own: name for name, own in _alternatives(law).items() if name in names}
    for name, parameter in LAWS[law][1].items():
        if name in names and name in replaced:
            raise FormatError(f"{path}: {replaced[name]} is in place of {name}, and both are columns; remove one")
        if parameter.default is None and name not in (*names, *replaced):
            raise FormatError(f"{path}: {law} needs a column {name} [{parameter.unit}] ({parameter.meaning})")


def _row(path: str | Path, line: int, cells: Mapping[str, str], known: Mapping[str, Parameter]) -> FrictionRow:
    where = f"{path} line {line}"
    terrain = cells.get(TERRAIN, "").lower()
    if terrain not in ("", *CLASSES):
        raise FormatError(f"{where}: terrain is {terrain!r}, expected one of {', '.join(CLASSES)}, or an empty cell")
    ranges = {name: _range(where, name, cells) for name in RANGES}
    period = _number(where, PERIOD, cells.get(PERIOD, ""), math.nan)
    values = {}
    for name in cells:
        if name in known:
            value, limits = _number(where, name, cells[name], math.nan), known[name]
            if not limits.smallest <= value <= limits.largest:
                got = f"{cells[name]!r}" if cells[name] else "empty"
                raise FormatError(
                    f"{where}: {name} is {got}, expected {limits.smallest:g} to {limits.largest:g} [{limits.unit}]"
                )
            values[name] = value
        elif name == SIZE:
            values[replaced_by(SIZE)] = _of_size(where, cells[name])
    return FrictionRow(
        line, terrain, ranges["altitude"], ranges["volume"], None if math.isnan(period) else period, values
    )


def _of_size(where: str, cell: str) -> float:
    """Return the value of the parameter that a size stands for."""
    if cell.lower() not in SIZES:
        rows = "; for a size by volume write a row for each (volume_from, volume_to)" if cell == BY_VOLUME else ""
        got = f"{cell!r}" if cell else "empty"
        raise FormatError(f"{where}: {SIZE} is {got}, expected {', '.join(SIZES)}{rows}")
    return SIZES[cell.lower()]


def _range(where: str, name: str, cells: Mapping[str, str]) -> tuple[float, float]:
    low, high = (
        _number(where, name + end, cells.get(name + end, ""), usual)
        for end, usual in zip(ENDS, (-math.inf, math.inf), strict=True)
    )
    if not low < high:
        raise FormatError(f"{where}: {name}_from = {low:g} is not below {name}_to = {high:g}")
    return low, high


def _number(where: str, name: str, cell: str, usual: float) -> float:
    if not cell:
        return usual
    if not is_number(cell) or not math.isfinite(float(cell)):
        raise FormatError(f"{where}: {name} is {cell!r}, expected a number or an empty cell")
    return float(cell)


def rows_of_event(
    rows: Iterable[FrictionRow], volume: float | None, period: float | None, path: str | Path
) -> list[FrictionRow]:
    """Return the rows for a volume and a return period.

    Parameters
    ----------
    rows : iterable of FrictionRow
    volume : float or None [m3]
        Of the release.
    period : float or None [years]
    path : str or Path
        Of the table, for messages.

    Raises
    ------
    InputError
        The table depends on one that is not given, or has no row for it.
    """
    rows = list(rows)
    periods = sorted({row.period for row in rows if row.period is not None})
    if periods and period is None:
        raise InputError(f"{path} has return periods of {_listed(periods)} years; choose one (`return_period`)")
    if period is not None and periods and period not in periods:
        raise InputError(f"{path} has no return period of {period:g} years; it has {_listed(periods)}")
    rows = [row for row in rows if row.period in (None, period)]
    if volume is None and any(row.volume != (-math.inf, math.inf) for row in rows):
        raise InputError(f"{path} depends on the volume of the release; give it (`volume`) [m3]")
    found = [row for row in rows if volume is None or row.volume[0] <= volume < row.volume[1]]
    if not found:
        raise InputError(f"{path} has no row for a volume of {volume:g} m3; add one")
    return found


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


class FrictionCells:
    """Which row of a table applies to each cell of a terrain, block by block.

    Gaps and overlaps of the table are collected: what is said about them does not depend on the blocks. Threads may
    work on different blocks.

    Parameters
    ----------
    rows : sequence of FrictionRow
        Of one event.
    path : str or Path
        Of the table, for messages.
    """

    def __init__(self, rows: Sequence[FrictionRow], path: str | Path):
        self.rows, self.path, self._lock = list(rows), path, threading.Lock()
        self._used: set[int] = set()
        self._gaps: dict[int, tuple[float, float]] = {}  # lowest and highest cell by class
        self._twice: dict[tuple[int, int, int], tuple[float, float]] = {}  # the same by two rows and class

    def chosen(self, classes: np.ndarray, elevation: np.ndarray) -> np.ndarray:
        """Return the place of the row that applies to each cell of a block.

        Parameters
        ----------
        classes : uint8[rows, columns]
            Of CLASSES.
        elevation : float64[rows, columns] [m]
            NaN where there is none.

        Returns
        -------
        int32[rows, columns]
            -1 where there is no elevation.
        """
        chosen = np.full(classes.shape, -1, np.int32)
        for number, row in enumerate(self.rows):
            fits = (elevation >= row.altitude[0]) & (elevation < row.altitude[1])
            if row.terrain:
                fits &= classes == CLASSES[row.terrain]
            twice = fits & (chosen >= 0)
            if twice.any():
                for other in np.unique(chosen[twice]).tolist():
                    self._widen(self._twice, (number, other), twice & (chosen == other), classes, elevation)
            chosen[fits] = number
        gap = (chosen < 0) & np.isfinite(elevation)
        if gap.any():
            self._widen(self._gaps, (), gap, classes, elevation)
        self._used.update(np.unique(chosen[chosen >= 0]).tolist())
        return chosen

    def _widen(self, ranges, key, cells, classes, elevation):
        """Extend the ranges of elevation, by key and class, by some cells."""
        for number in np.unique(classes[cells]).tolist():
            heights = elevation[cells & (classes == number)]
            lowest, highest = float(heights.min()), float(heights.max())
            with self._lock:
                low, high = ranges.get((*key, number), (lowest, highest))
                ranges[(*key, number)] = min(low, lowest), max(high, highest)

    def varying(self) -> list[str]:
        """Return the parameters that are not the same in all rows."""
        return [name for name in self.rows[0].values if len({row.values[name] for row in self.rows}) > 1]

    def values(self, name: str, chosen: np.ndarray) -> np.ndarray:
        """Return a parameter at each cell of a block.

        Parameters
        ----------
        name : str
        chosen : int32[rows, columns]
            As `chosen` returns it.

        Returns
        -------
        float64[rows, columns]
            NaN where there is no elevation.
        """
        return np.array([*(row.values[name] for row in self.rows), np.nan])[chosen]

    def found(self) -> dict[str, tuple[float, float]]:
        """Return the smallest and largest value of each parameter on the cells of all blocks so far.

        Raises
        ------
        InputError
            A cell for which the table has no row, or two.
        """
        if self._twice:
            number, other, _ = place = min(self._twice)
            raise InputError(
                f"{self.path} lines {self.rows[other].line} and {self.rows[number].line} both apply to "
                f"{_place(place, self._twice)}; make them exclusive"
            )
        if self._gaps:
            raise InputError(f"{self.path} has no row for {_place(min(self._gaps), self._gaps)}; add one")
        used = {name: [self.rows[number].values[name] for number in self._used] for name in self.rows[0].values}
        return {name: (min(values), max(values)) for name, values in used.items()}


def _place(key: tuple, ranges: Mapping) -> str:
    """Return the class at the end of a key and its elevations as text."""
    name = next(name for name, own in CLASSES.items() if own == key[-1])
    return f"{name} terrain at {ranges[key][0]:.0f} to {ranges[key][1]:.0f} m"
