"""What tables with a particle a row have in common: several times in one file, told apart by a column of times."""

from functools import partial
from pathlib import Path

import numpy as np

from ...errors import FormatError
from .file import ForeignFrame, number_of

MOST_TIMES = 100_000


def frames_of_tables(open_file):
    """`frames` of a ForeignReader of tables, whose `open_file(path, time_column)` gives the frames of one."""
    return partial(_frames, open_file)


def _frames(open_file, paths, terms):
    return [frame for path in paths for frame in open_file(Path(path), terms.column_for("time"))]


def time_column_of(path, columns, meant, asked=None):
    """The column of times of a table: the one `asked` for, else the one that is called so, else None.

    Raises
    ------
    FormatError
        The table has no such column.
    """
    found = asked or meant.get("time")
    if found is not None and found not in columns:
        raise FormatError(f"{path}: no column {found!r} of times, only {', '.join(columns)[:300]}")
    return found


def require_few_times(path, times):
    """Refuse more `times` than a series has: their column is another quantity's.

    Raises
    ------
    FormatError
    """
    if len(times) > MOST_TIMES:
        raise FormatError(
            f"{path} holds {len(times)} times, wanted at most {MOST_TIMES}; is its column of times right?"
        )


def frame_of_rows(path, columns, meant, time, count, read):
    """The ForeignFrame of the `count` rows of a `time` [s], or of all rows of a table without times (None)."""
    return ForeignFrame(
        path=path,
        count=count,
        columns=columns,
        read=read,
        meant=meant,
        number=number_of(path) if time is None else None,
        time=time,
    )


def rows_of_time(found, time_column, time):
    """Those of the rows in `found` (column -> float64[n]) that are of a `time` [s]; all where it is None."""
    if time is None:
        return found
    of_time = found[time_column] == time
    return found if np.all(of_time) else {name: values[of_time] for name, values in found.items()}


def require_rows(path, found, names, count):
    """Name -> float64[count] of the columns `names` that were read.

    Raises
    ------
    FormatError
        They are more or fewer rows than there were when the file was opened.
    """
    if names and len(found[names[0]]) != count:
        raise FormatError(f"{path} holds {len(found[names[0]])} rows, wanted {count}; it is damaged or has changed")
    return {name: found[name] for name in names}
