"""Tables with one row per particle and maybe a column of times: a frame for each time."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ...system.errors import FormatError
from ..declarations import Declarations
from .reader_interface import ThirdPartyFrame, number_of

MOST_TIMES = 100_000  # of a table; more are another quantity


def frames_of_tables(open_file: Callable) -> Callable:
    """Make `frames` of a Reader of tables.

    Parameters
    ----------
    open_file : callable
        `open_file(path, time_column)` returns the frames of one table.
    """
    return partial(_frames, open_file)


def _frames(open_file: Callable, paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    return [frame for path in paths for frame in open_file(Path(path), terms.column_for("time"))]


def time_column_of(
    path: Path, columns: Sequence[str], column_map: dict[str, str], asked: str | None = None
) -> str | None:
    """Return the column of times of a table: `asked`, else the column named time, else None.

    Parameters
    ----------
    path : Path
    columns : sequence of str
    column_map : dict of str to str
    asked : str, optional

    Raises
    ------
    FormatError
        The table has no such column.
    """
    found = asked or column_map.get("time")
    if found is not None and found not in columns:
        raise FormatError(f"{path}: no column {found!r} of times, only {', '.join(columns)[:300]}")
    return found


def require_few_times(path: Path, times: np.ndarray) -> None:
    """Refuse more than MOST_TIMES times: the column is of another quantity.

    Parameters
    ----------
    path : Path
    times : float64[n] [s]

    Raises
    ------
    FormatError
    """
    if len(times) > MOST_TIMES:
        raise FormatError(
            f"{path} contains {len(times)} times, expected at most {MOST_TIMES}; check the column of times"
        )


def frame_of_rows(
    path: Path, columns: tuple[str, ...], column_map: dict[str, str], time: float | None, count: int, read: Callable
) -> ThirdPartyFrame:
    """Describe the frame of the rows of one time, or of all rows of a table without times.

    Parameters
    ----------
    path : Path
    columns : tuple of str
    column_map : dict of str to str
    time : float or None [s]
        None without times.
    count : int
        Number of rows.
    read : callable
        As of ThirdPartyFrame.
    """
    return ThirdPartyFrame(
        path=path,
        count=count,
        columns=columns,
        read=read,
        column_map=column_map,
        number=number_of(path) if time is None else None,
        time=time,
    )


def rows_of_time(found: dict[str, np.ndarray], time_column: str | None, time: float | None) -> dict[str, np.ndarray]:
    """Return the rows of one time.

    Parameters
    ----------
    found : dict of str to float64[n]
    time_column : str or None
    time : float or None [s]
        None for all rows.
    """
    if time is None:
        return found
    of_time = found[time_column] == time
    return found if np.all(of_time) else {name: values[of_time] for name, values in found.items()}


def require_rows(path: Path, found: dict[str, np.ndarray], names: Sequence[str], count: int) -> dict[str, np.ndarray]:
    """Return some columns; refuse another number of rows than expected.

    Parameters
    ----------
    path : Path
    found : dict of str to float64[n]
    names : sequence of str
    count : int

    Raises
    ------
    FormatError
        The number of rows has changed since the file was opened.
    """
    if names and len(found[names[0]]) != count:
        raise FormatError(f"{path} has {len(found[names[0]])} rows, expected {count}; it is damaged or has changed")
    return {name: found[name] for name in names}
