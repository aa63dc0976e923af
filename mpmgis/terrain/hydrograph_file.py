"""CSV tables: general rows, loads on barriers over time, and hydrographs in the formats of common spreadsheets."""

import codecs
import csv
import difflib
import io
import math
from pathlib import Path

import numpy as np

from ..system.errors import FormatError, one_line
from ..system.whole_files import whole_file
from ..system.zip_archives import require_file
from .inflow import COLUMNS, Hydrograph


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


# sum of a solver -> heading of its column
SUMS = {
    "normal_impulse": "normal impulse [N s]",
    "impulse_east": "impulse east [N s]",
    "impulse_north": "impulse north [N s]",
    "impulse_up": "impulse up [N s]",
    "moment_impulse_east": "angular impulse east [N m s]",
    "moment_impulse_north": "angular impulse north [N m s]",
    "moment_impulse_up": "angular impulse up [N m s]",
    "overtopped_mass": "overtopped mass [kg]",
    "peak_normal_force": "largest normal force of a step so far [N]",
}
# sums with a column of their mean rate since the previous frame; all but the first in 3D only
RATES = {
    "normal_impulse": "mean normal force [N]",
    "impulse_east": "mean force east [N]",
    "impulse_north": "mean force north [N]",
    "impulse_up": "mean force up [N]",
    "moment_impulse_east": "mean moment east [N m]",
    "moment_impulse_north": "mean moment north [N m]",
    "moment_impulse_up": "mean moment up [N m]",
}


class BarrierTable:
    """The file `path` with a row for each frame and barrier; rewritten atomically with every frame.

    The mean force is over the time since the previous frame; impulses, mass and the largest force of a single step
    are those of the run so far.

    Parameters
    ----------
    path : str or Path
    names : tuple of str
        Of the barriers.
    sums : tuple of str
        Keys of SUMS: the sums of the solver for each barrier.
    resumed : float, optional
        Time [s] of the frame from which a run continues: earlier rows of the file are kept.
    """

    def __init__(self, path, names, sums, resumed=None):
        self.path, self.names, self.sums = Path(path), tuple(names), tuple(sums)
        self._rated = [k for k, name in enumerate(sums) if name in (RATES if "impulse_up" in sums else list(RATES)[:1])]
        self._rows = [] if resumed is None else self._read(resumed)

    def add(self, time, sums):
        """Write the rows of one frame at `time` [s]; `sums` float64[barriers, k] in the order of `self.sums`."""
        before = {row[1]: (row[0], row[2 + len(self._rated) :]) for row in self._rows}
        for name, now in zip(self.names, sums.tolist(), strict=True):
            last_time, last = before.get(name, (time, now))
            passed = time - last_time
            rates = [(now[k] - last[k]) / passed if passed > 0 else 0.0 for k in self._rated]
            self._rows.append((time, name, *rates, *now))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        rated = [RATES[self.sums[k]] for k in self._rated]
        writer.writerow(["time [s]", "barrier", *rated, *(SUMS[name] for name in self.sums)])
        writer.writerows(self._rows)
        with whole_file(self.path) as part:
            part.write_text(text.getvalue(), encoding="utf-8", newline="\n")

    def _read(self, until):
        """Rows of the earlier part of the run, up to the time [s] of the restart."""
        if not self.path.is_file():
            return []
        try:
            with open(self.path, encoding="utf-8", newline="") as handle:
                lines = list(csv.reader(handle))[1:]
            rows = [(float(time), name, *map(float, values)) for time, name, *values in lines]
        except (OSError, ValueError) as error:
            raise FormatError(f"{self.path} cannot be read ({one_line(error)[:80]}); remove it to continue") from error
        return [row for row in rows if row[0] <= until * (1.0 + 1e-12)]


def read_barrier_table(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Name of a barrier -> heading of a column -> float64[frames], of a file that BarrierTable wrote.

    Raises
    ------
    FormatError
    """
    try:
        with open(path, encoding="utf-8", newline="") as handle:
            rows = list(csv.DictReader(handle))
        found = {}
        for name in dict.fromkeys(row["barrier"] for row in rows):
            mine = [row for row in rows if row["barrier"] == name]
            headings = [heading for heading in mine[0] if heading != "barrier"]
            found[name] = {heading: np.array([float(row[heading]) for row in mine]) for heading in headings}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{path} is not a table of barriers of a run ({one_line(error)[:80]})") from error
    return found


def append_rows(sink, columns, delimiter):
    """Append rows to a binary file.

    Parameters
    ----------
    sink : binary file
    columns : sequence of array[n]
        Floats or integers.
    delimiter : str
    """
    if not len(columns[0]):
        return
    try:
        import pyarrow
        import pyarrow.csv
    except ImportError:
        sink.write(as_text(columns, delimiter))
        return
    table = pyarrow.table({str(number): np.ascontiguousarray(values) for number, values in enumerate(columns)})
    pyarrow.csv.write_csv(table, sink, pyarrow.csv.WriteOptions(include_header=False, delimiter=delimiter))


def as_text(columns, delimiter):
    """The rows as bytes without Arrow: shortest decimals that give the same float64; 0.5 s per million numbers."""
    texts = [map(repr, np.asarray(values).tolist()) for values in columns]
    return ("\n".join(map(delimiter.join, zip(*texts, strict=True))) + "\n").encode()


_SIGNED = ("time", "velocity_east", "velocity_north")
# larger values are input errors, in the units of COLUMNS
_HIGHEST = {"discharge": 1e9, "thickness": 1e4, "speed": 1e3, "velocity_east": 1e3, "velocity_north": 1e3}
_DELIMITERS = ",;\t"
_LARGEST = 10_000_000  # [bytes] of a table


def read_hydrograph(path):
    """The Hydrograph in the CSV file at `path`: a header and one row per time, separated by comma, semicolon or tab.

    With semicolons or tabs, numbers may have a decimal comma. Empty lines and lines that start with # are skipped.

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


def _text(path):
    """The file's text: UTF-8 with or without a byte order mark, or UTF-16 with one."""
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


def _names(path, cells):
    """Column names of the header; checks that they are known, unique and complete."""
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


def _numbers(path, line, names, cells, decimal_comma):
    """The numbers of one row."""
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


def _require_valid_series(path, table, lines):
    """Check that times start at 0 or later and increase, and that there is inflow."""
    time = table["time"]
    if time[0] < 0:
        raise FormatError(f"{path} line {lines[0]}: time is {time[0]:g} s, expected 0 or later; runs start at 0")
    for k in np.flatnonzero(np.diff(time) <= 0):
        raise FormatError(
            f"{path} line {lines[k + 1]}: time {time[k + 1]:g} s is not after {time[k]:g} s; sort the rows"
        )
    if "discharge" in table and len(time) < 2:
        raise FormatError(
            f"{path} line {lines[0]}: only one time, expected at least two; discharge is linear between times"
        )
    amount = "discharge" if "discharge" in table else "thickness"
    if not table[amount].any():
        raise FormatError(f"{path}: {amount} is 0 at all times, there is no inflow")
