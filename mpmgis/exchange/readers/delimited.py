"""Text tables with a header and one row per particle, in any form of `text_tables`.

A column of times (`time`, or --columns time=COLUMN) separates several times in one file.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...system.errors import FormatError
from ...system.text_tables import (
    BLANK,
    DELIMITERS,
    cells_of,
    delimiter_of,
    header_cells,
    is_number,
    separator_line,
    with_point,
    wrong_count,
)
from .array_columns import plainly_named
from .mapped_files import mapped
from .reader_interface import Reader, ThirdPartyFrame
from .record_parsing import Form, read_rows
from .time_tables import frame_of_rows, frames_of_tables, require_few_times, require_rows, rows_of_time, time_column_of

SUFFIXES = (".csv", ".tsv", ".txt", ".dat")
LONGEST_HEADER = 1 << 16  # [bytes]
AT_ONCE = 1 << 24  # [bytes] of a table searched at once
OWN_COLUMNS = {"z_bed", "z_surface"}  # of a seed that mpmgis wrote


def header_of(head: bytes) -> Form:
    """Return the format of a table by its first bytes.

    Lines before the header begin with #; the header may begin with # too.

    Parameters
    ----------
    head : bytes

    Raises
    ------
    ValueError
        There is no header.
    """
    at, names, named = 0, None, None
    while True:
        stop = head.find(b"\n", at)
        if stop < 0:
            raise ValueError("no header followed by numbers")
        line = head[at:stop].decode("utf-8-sig" if at == 0 else "utf-8").strip("\r")
        if at == 0 and (named := separator_line(line)) is not None:
            line = ""
        line = line.strip()
        if line and not line.startswith("#") and is_number(_first_number(line)):
            break  # numbers: the header was the last comment line
        if line:
            names = line
            if not line.startswith("#"):
                at = stop + 1
                break
        at = stop + 1
    if names is None:
        raise ValueError("no header before the numbers")
    delimiter = named or delimiter_of(names.lstrip("# "))
    if delimiter not in (*DELIMITERS, BLANK):
        raise ValueError(f"its columns are separated by {delimiter!r}, expected a comma, semicolon, tab or blanks")
    cells = header_cells(names.lstrip("# "), delimiter)
    row = _first_row(head, at)
    for k in range(len(cells), len(cells_of(row, delimiter)) if row.endswith(delimiter) else 0):
        cells.append(f"column {k + 1}")  # spreadsheets end lines with empty cells
    if len(set(cells)) != len(cells):
        raise ValueError("a column name occurs twice")
    return Form(tuple(cells), delimiter, _decimal(head, at, delimiter), at)


def _first_row(head, start):
    """The first row that the first bytes contain wholly; "" without one."""
    rows = head[start : max(head.rfind(b"\n"), start)].split(b"\n")
    return next((row.decode("utf-8", "replace").strip("\r") for row in rows if row.strip()), "")


def _first_number(line):
    delimiter = delimiter_of(line)
    return with_point(cells_of(line, delimiter)[0], ";")


def _decimal(content: Any, start: int, delimiter: str) -> str:
    """Return the decimal sign of the rows: a comma where one stands between digits and does not separate columns."""
    at = content.find(b",", start) if delimiter != "," else -1
    while at >= 0:
        if content[at - 1 : at].isdigit() and content[at + 1 : at + 2].isdigit():
            return ","
        at = content.find(b",", at + 1)
    return "."


def fits(path: str | Path, head: bytes) -> bool:
    """Return whether a file is a text table with a header, by its suffix and its first lines.

    Parameters
    ----------
    path : str or Path
    head : bytes
        First bytes of the file.
    """
    if Path(path).suffix.lower() not in SUFFIXES or b"\0" in head:
        return False
    try:
        return len(header_of(head).columns) >= 3
    except ValueError:
        return False


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is a table with columns of position and velocity.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    if not fits(path, head):
        return False
    names = header_of(head).columns
    return {"x", "y", "z", "vx", "vy", "vz"} <= set(plainly_named(dict.fromkeys(names, 1)))


def open_file(path: Path, time_column: str | None = None) -> list[ThirdPartyFrame]:
    """Describe the frames in one table, one for each time.

    Parameters
    ----------
    path : Path
    time_column : str, optional
        Column of times; without it a column named time, if there is one.

    Raises
    ------
    FormatError
        No table, a row of another length, invalid numbers in the column of times.
    """
    with mapped(path) as content:
        try:
            form = header_of(content[:LONGEST_HEADER])
        except ValueError as error:
            raise FormatError(f"{path} is not a table with a header ({error})") from None
        row = _first_row(content[: 2 * LONGEST_HEADER], form.start)
        width = len(cells_of(row, form.delimiter)) if row else len(form.columns)
        if width != len(form.columns):
            raise FormatError(f"{path}: its first row has {wrong_count(width, len(form.columns), form.delimiter)}")
        form = form._replace(decimal=_decimal(content, form.start, form.delimiter))
    columns, column_map = form.columns, plainly_named(dict.fromkeys(form.columns, 1))
    if set(columns) >= OWN_COLUMNS:
        raise FormatError(f"{path} is a seed of columns by mpmgis; export its frame (.h5) instead")
    time_column = time_column_of(path, columns, column_map, time_column)
    parts = _whole(path, form) if time_column is None else _parts(path, form, time_column)
    if not parts or parts[0][1] == 0:
        raise FormatError(f"{path}: contains no particle")
    reads = (partial(_read, path, first, last, form, time_column, time, count) for time, count, first, last in parts)
    return [
        frame_of_rows(path, columns, column_map, time, count, read)
        for (time, count, *_), read in zip(parts, reads, strict=True)
    ]


def _whole(path: Path, form: Form) -> list[tuple]:
    """Return all rows as one part, as `_parts`."""
    count, last = 0, b"\n"
    with mapped(path) as content:
        for at in range(form.start, len(content), AT_ONCE):
            values = np.frombuffer(last + content[at : at + AT_ONCE].replace(b"\r", b""), np.uint8)
            count += int(np.count_nonzero((values[1:] != 10) & (values[:-1] == 10)))
            last = b"\n" if values[-1] == 10 else b"x"
        return [(None, count, form.start, len(content))]


def _parts(path: Path, form: Form, time_column: str) -> list[tuple]:
    """Return (time [s], rows, first byte, last byte) of every time; rows in between may belong to other times."""
    times = read_rows(path, form.start, None, form, (time_column,))[time_column]
    if not np.isfinite(times).all():
        raise FormatError(f"{path}: a time in row {int(np.flatnonzero(~np.isfinite(times))[0])} is missing or infinite")
    found, first, counts = np.unique(times, return_index=True, return_counts=True)
    require_few_times(path, found)
    last = len(times) - 1 - np.unique(times[::-1], return_index=True)[1]
    rows = np.concatenate([first, last + 1])
    with mapped(path) as content:
        bounds = _bytes_of_rows(content, form.start, len(times), rows) if len(times) else rows
    n = len(found)
    return [(float(found[k]), int(counts[k]), int(bounds[k]), int(bounds[n + k])) for k in range(n)]


def _bytes_of_rows(content: Any, start: int, count: int, rows: np.ndarray) -> np.ndarray:
    """Return the first byte of some rows; the whole table where blank lines prevent counting rows by lines."""
    wanted, found, lines = np.sort(np.unique(rows)), {}, 0
    for at in range(start, len(content), AT_ONCE):
        ends = np.flatnonzero(np.frombuffer(content[at : at + AT_ONCE], np.uint8) == 10)
        for row in wanted[
            np.searchsorted(wanted, lines + 1) : np.searchsorted(wanted, lines + len(ends), side="right")
        ]:
            found[int(row)] = at + int(ends[row - lines - 1]) + 1
        lines += len(ends)
    found[0] = start
    found.setdefault(count, len(content))
    if not count - 1 <= lines <= count or content[start : start + 2].strip() == b"":
        return np.where(rows < rows.max(), start, len(content))
    return np.array([found[int(row)] for row in rows])


def _read(path, start, stop, form, time_column, time, count, names):
    wanted = tuple(dict.fromkeys((*names, *([time_column] if time is not None else []))))
    found = read_rows(path, start, stop, form, wanted)
    return require_rows(path, rows_of_time(found, time_column, time), names, count)


READER = Reader("csv", recognises, frames_of_tables(open_file), fits)
