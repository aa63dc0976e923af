"""Friction by class of terrain, altitude, volume and return period, from a table that the user gives.

Guidelines publish friction in this form. A row of the CSV has conditions and parameters of a friction law::

    terrain,altitude_from,altitude_to,volume_from,volume_to,return_period,mu,xi
    open,1500,,60000,,300,0.155,3000
    channel,1500,,60000,,300,0.21,2000

An empty cell, or a column that is left out, is any value. Ranges contain their lower end and not their upper one.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..laws.friction import LAWS, Parameter, given_instead
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
    known = table_parameters(law)
    for name in table.names:
        if name not in CONDITIONS and name not in known:
            raise FormatError(
                f"{path}: column {name!r} is neither a condition ({', '.join(CONDITIONS)}) nor a parameter of {law} "
                f"({', '.join(known)})"
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


def table_parameters(law: str) -> dict[str, Parameter]:
    """Return the parameters that a table can give for a law, and those in their place, by name.

    Parameters
    ----------
    law : str
        Name of a built-in law.
    """
    return LAWS[law][1] | {name: parameter for name, (_, parameter) in given_instead(law).items()}


def _require_parameters(path: str | Path, law: str, names: Sequence[str]) -> None:
    """Refuse a table without a parameter that has no default."""
    instead = given_instead(law)
    replaced = {instead[name][0] for name in names if name in instead}
    for name, parameter in LAWS[law][1].items():
        if name in names and name in replaced:
            other = next(key for key, (own, _) in instead.items() if own == name)
            raise FormatError(f"{path}: {other} is in place of {name}, and both are columns; remove one")
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
    return FrictionRow(
        line, terrain, ranges["altitude"], ranges["volume"], None if math.isnan(period) else period, values
    )


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


def friction_values(
    rows: Sequence[FrictionRow], classes: np.ndarray, elevation: np.ndarray, path: str | Path
) -> dict[str, np.ndarray | float]:
    """Return each parameter at every cell, as one number where it is the same everywhere.

    Parameters
    ----------
    rows : sequence of FrictionRow
        Of one event.
    classes : uint8[rows, columns]
        Of CLASSES.
    elevation : float64[rows, columns] [m]
        NaN where there is none.
    path : str or Path
        Of the table, for messages.

    Returns
    -------
    dict of str to (float64[rows, columns] or float)
        NaN where there is no elevation.

    Raises
    ------
    InputError
        A cell for which the table has no row, or two.
    """
    chosen = np.full(classes.shape, -1, np.int32)
    for number, row in enumerate(rows):
        fits = (elevation >= row.altitude[0]) & (elevation < row.altitude[1])
        if row.terrain:
            fits &= classes == CLASSES[row.terrain]
        twice = fits & (chosen >= 0)
        if twice.any():
            other = rows[int(chosen[twice][0])].line
            raise InputError(
                f"{path} lines {other} and {row.line} both apply to {_place(twice, classes, elevation)}; "
                "make them exclusive"
            )
        chosen[fits] = number
    gap = (chosen < 0) & np.isfinite(elevation)
    if gap.any():
        raise InputError(f"{path} has no row for {_place(gap, classes, elevation)}; add one")
    found: dict[str, np.ndarray | float] = {}
    for name in rows[0].values:
        numbers = np.array([row.values[name] for row in rows])
        used = numbers[np.unique(chosen[chosen >= 0])]
        same = len(used) > 0 and bool(np.all(used == used[0]))
        found[name] = float(used[0]) if same else np.where(chosen >= 0, numbers[chosen], np.nan)
    return found


def _place(cells: np.ndarray, classes: np.ndarray, elevation: np.ndarray) -> str:
    """Return the class and the elevations of the cells of the first class among some cells."""
    number = int(classes[cells].min())
    name = next(name for name, own in CLASSES.items() if own == number)
    heights = elevation[cells & (classes == number)]
    return f"{name} terrain at {heights.min():.0f} to {heights.max():.0f} m"
