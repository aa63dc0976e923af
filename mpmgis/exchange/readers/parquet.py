"""Parquet tables with one row per particle; a column of times separates several times in one file."""

from collections.abc import Iterable
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...system.errors import FormatError, one_line
from ...system.optional_libraries import needed_for
from .array_columns import plainly_named
from .reader_interface import Reader, ThirdPartyFrame, require_memory, require_readable
from .time_tables import frame_of_rows, frames_of_tables, require_few_times, require_rows, rows_of_time, time_column_of

MAGIC = b"PAR1"
OWN_NOTE = b"mpmgis"  # metadata key of seeds of mpmgis


def fits(path: Path, head: bytes) -> bool:
    """Return whether a file is Parquet.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    return head.startswith(MAGIC)


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
    try:
        with _opened(path) as file:
            return {"x", "y", "z", "vx", "vy", "vz"} <= set(plainly_named(dict.fromkeys(_columns(file), 1)))
    except FormatError:
        return False


@contextmanager
def _opened(path):
    with needed_for(f"{path}: Parquet", "parquet"):
        import pyarrow.parquet  # 0.2 s; not needed for frames of mpmgis

    require_readable(path)
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            yield file
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise FormatError(f"{path} is not a readable Parquet file ({one_line(error)[:100]}); it is damaged") from error


def _columns(file: Any) -> tuple[str, ...]:
    """Return the names of the columns of plain numbers."""
    import pyarrow

    kinds = pyarrow.types
    numbers = (kinds.is_integer, kinds.is_floating, kinds.is_boolean)
    return tuple(field.name for field in file.schema_arrow if any(is_kind(field.type) for is_kind in numbers))


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
        No Parquet, damaged, no rows, a time missing.
    """
    with _opened(path) as file:
        columns, count = _columns(file), file.metadata.num_rows
        if OWN_NOTE in (file.schema_arrow.metadata or {}):
            raise FormatError(f"{path} is a seed of columns by mpmgis; export its frame (.h5) instead")
    if count <= 0 or not columns:
        raise FormatError(f"{path}: contains no particle")
    column_map = plainly_named(dict.fromkeys(columns, 1))
    time_column = time_column_of(path, columns, column_map, time_column)
    parts = [(None, count)] if time_column is None else _parts(path, time_column, count)
    return [
        frame_of_rows(path, columns, column_map, time, rows, partial(_read, path, time_column, time, rows))
        for time, rows in parts
    ]


def _values(path: Path, names: Iterable[str], groups: Iterable[int] | None = None) -> dict[str, np.ndarray]:
    with _opened(path) as file:
        groups = range(file.num_row_groups) if groups is None else groups
        table = file.read_row_groups(list(groups), columns=list(names))
        return {name: table[name].cast("float64").to_numpy() for name in names}


def _parts(path: Path, time_column: str, count: int) -> list[tuple[float, int]]:
    """Return (time [s], rows) of every time."""
    require_memory(path, count, 32)
    times = _values(path, [time_column])[time_column]
    if len(times) != count or not np.isfinite(times).all():
        raise FormatError(f"{path}: a time in its column {time_column!r} is missing or infinite")
    found, counts = np.unique(times, return_counts=True)
    require_few_times(path, found)
    return list(zip(found.tolist(), counts.tolist(), strict=True))


def _groups_of(path: Path, time_column: str, time: float) -> list[int]:
    """Return the row groups that may contain a time, by their statistics."""
    with _opened(path) as file:
        paths = [file.metadata.schema.column(k).path for k in range(file.metadata.num_columns)]
        wanted = []
        for k in range(file.num_row_groups):
            statistics = file.metadata.row_group(k).column(paths.index(time_column)).statistics
            known = statistics is not None and statistics.has_min_max
            if not known or statistics.min <= time <= statistics.max:
                wanted.append(k)
        return wanted


def _read(
    path: Path, time_column: str | None, time: float | None, count: int, names: tuple[str, ...]
) -> dict[str, np.ndarray]:
    if time is None:
        found = _values(path, names)
    else:
        found = _values(path, dict.fromkeys((*names, time_column)), _groups_of(path, time_column, time))
    return require_rows(path, rows_of_time(found, time_column, time), names, count)


READER = Reader("parquet", recognises, frames_of_tables(open_file), fits)
