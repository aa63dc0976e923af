"""Functions for readers: vector components, numbers in text, memory-mapped files, rows, tables with times."""

import csv
import mmap
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...system.errors import FormatError, one_line
from ..declarations import COMPONENTS, VECTORS
from .reader_interface import ThirdPartyFrame, number_of, require_memory, require_readable

SYNONYMS = {  # column names in lower case, for general formats
    "position": ("position", "positions", "pos", "coordinates", "coords", "points", "x"),
    "velocity": ("velocity", "velocities", "vel", "v", "u"),
    "id": ("id", "ids", "particle_id", "particleid", "particleids"),
    "mass": ("mass", "masses"),
    "volume": ("volume", "volumes"),
    **{name: (name,) for name in ("radius", "diameter", "active", "time")},
}
GZIP = b"\x1f\x8b\x08"
AT_ONCE = 4_000_000  # [bytes] of a .gz decompressed at a time
# [bytes] block size of Arrow: more threads gain nothing for smaller texts, and a process that ends just after their
# start may abort (apache/arrow#34314)
ONE_BLOCK = 1 << 20
# texts that Arrow reads as a missing number
NO_NUMBER = frozenset(
    {"", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND", "1.#QNAN", "N/A", "NA", "NULL"}
    | {"NaN", "n/a", "nan", "null"}
)
BLANK = " "  # delimiter for any number of blanks and tabs
MOST_TIMES = 100_000


def column_names(name: str, components: int) -> tuple[str, ...]:
    """Return the columns of an array.

    A single component has the name of the array, three have .x, .y, .z, another number has .0, .1, ..

    Parameters
    ----------
    name : str
    components : int
    """
    if components == 1:
        return (name,)
    return tuple(f"{name}.{word}" for word in (COMPONENTS if components == 3 else range(components)))


def columns_of(arrays: dict[str, int]) -> dict[str, tuple[str, int]]:
    """Return the columns of arrays.

    Parameters
    ----------
    arrays : dict of str to int
        Name -> number of components.

    Returns
    -------
    dict of str to (str, int)
        Column -> (array, component).
    """
    return {
        column: (name, k)
        for name, components in arrays.items()
        for k, column in enumerate(column_names(name, components))
    }


def picked(
    read_array: Callable[[str], np.ndarray], arrays: dict[str, int], names: Iterable[str]
) -> dict[str, np.ndarray]:
    """Read some columns by name, each array once.

    Parameters
    ----------
    read_array : callable
        `read_array(name)` returns float64[n, components].
    arrays : dict of str to int
        Name -> number of components.
    names : iterable of str
        Of the columns.

    Returns
    -------
    dict of str to float64[n]
    """
    places, whole, found = columns_of(arrays), {}, {}
    for column in names:
        name, component = places[column]
        if name not in whole:
            whole[name] = read_array(name)
        found[column] = whole[name][:, component]
    return found


def plainly_named(arrays: dict[str, int]) -> dict[str, str]:
    """Return the names of mpmgis and columns for arrays with names of SYNONYMS, in any case.

    Parameters
    ----------
    arrays : dict of str to int
        Name -> number of components.

    Returns
    -------
    dict of str to str
    """
    found = candidates_named(arrays)
    return {name: column for places in found.values() for name, column in places[0].items()}


def candidates_named(arrays: dict[str, int]) -> dict[str, list[dict[str, str]]]:
    """Return the quantities of mpmgis and their candidates, each as names and columns, the most likely first.

    Names are matched with SYNONYMS, in any case. A position or a velocity is a vector, or its components by name.

    Parameters
    ----------
    arrays : dict of str to int
        Name -> number of components.

    Returns
    -------
    dict of str to list of dict of str to str
    """
    small = {}
    for name, components in arrays.items():
        small.setdefault((name.lower(), components), []).append(name)
    found = {}
    for ours, words in SYNONYMS.items():
        letters = VECTORS.get(ours, (ours,))
        width = len(letters)
        named = [name for word in words for name in small.get((word, width), ())]
        places = [dict(zip(letters, column_names(name, width), strict=True)) for name in named]
        if width > 1:
            single = {letter: small[letter, 1][0] for letter in letters if (letter, 1) in small}
            places += [single] if single else []
        if places:
            found[ours] = places
    return found


def require_whole(path: str | Path, what: str, got: int | str, wanted: int) -> None:
    """Refuse an array with another number of values than expected.

    Parameters
    ----------
    path : str or Path
    what : str
        Name of the array in the message.
    got : int or str
    wanted : int

    Raises
    ------
    FormatError
    """
    if got != wanted:
        raise FormatError(f"{path}: {what} has {got} numbers, expected {wanted}; it is truncated or damaged")


def text_numbers(text: bytes, count: int, path: str | Path, what: str, more: bool = False) -> np.ndarray:
    """Read the numbers in a text.

    Parameters
    ----------
    text : bytes
    count : int
    path, what : str or Path, str
        File and name of the array in messages.
    more : bool
        Further numbers may follow.

    Returns
    -------
    float64[count]

    Raises
    ------
    FormatError
        Other content than numbers, or another count.
    """
    if len(text) < 2 * count - 1:  # one digit and one blank each; no memory for missing numbers
        require_whole(path, what, f"at most {(len(text) + 1) // 2}", count)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy's report of other content
        try:
            values = np.fromstring(text, np.float64, sep=" ")  # with a count it would return uninitialised memory
        except (DeprecationWarning, ValueError):
            raise FormatError(f"{path}: {what} contains something else than numbers; it is damaged") from None
    values = values[:count] if more else values
    require_whole(path, what, len(values), count)
    return values


@contextmanager
def mapped(path: str | Path) -> Iterator[mmap.mmap | bytes]:
    """Open the bytes of a file: a read-only mmap, from which data must be copied; bytes of a .gz.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        Missing, empty or not readable; a .gz that is damaged, or too large when decompressed.
    """
    require_readable(path)
    with open(path, "rb") as file:
        if file.read(len(GZIP)) == GZIP:
            about = Path(path).stat()
            yield _unpacked(str(path), about.st_size, about.st_mtime_ns)
            return
        try:
            content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise FormatError(f"{path}: {one_line(error)}") from error
        with content:
            yield content


@lru_cache(maxsize=1)  # the frames of a file are read one after the other
def _unpacked(path: str, size: int, changed: int) -> bytes:
    """Return all bytes in a .gz; `size` and `changed` identify the version of the file."""
    parts, total = [], 0
    for part in _parts(path):
        total += len(part)
        require_memory(path, 2 * total, 1)
        parts.append(part)
    if total == 0:
        raise FormatError(f"{path} is empty when decompressed")
    return b"".join(parts)


def _parts(path: str) -> Iterator[bytes]:
    """Yield the bytes in a .gz, in parts; it may contain several streams, as by programs that append."""
    stream = zlib.decompressobj(wbits=31)
    with open(path, "rb") as file:
        packed = file.read(AT_ONCE)
        while packed:
            try:
                yield stream.decompress(packed, AT_ONCE)
            except zlib.error as error:
                raise FormatError(f"{path} cannot be decompressed ({one_line(error)[:60]}); it is damaged") from error
            packed = stream.unused_data if stream.eof else stream.unconsumed_tail
            packed = packed or file.read(AT_ONCE)
            if stream.eof and packed:
                stream = zlib.decompressobj(wbits=31)
    if not stream.eof:
        raise FormatError(f"{path} ends within its compressed data; it is truncated")


def unpacked_head(head: bytes, size: int) -> bytes:
    """Return the first bytes of a file; a .gz is decompressed as far as possible.

    Parameters
    ----------
    head : bytes
        First bytes as stored.
    size : int [bytes]
    """
    if not head.startswith(GZIP):
        return head
    stream, found = zlib.decompressobj(wbits=31), b""
    for at in range(0, len(head), 16):
        try:
            found += stream.decompress(head[at : at + 16])
        except zlib.error:
            break
        if len(found) >= size:
            break
    return found[:size]


class Form(NamedTuple):
    """Format of a table.

    Attributes
    ----------
    columns : tuple of str
    delimiter : str
    decimal : str
        Decimal sign.
    start : int [bytes]
        Of the rows.
    """

    columns: tuple
    delimiter: str
    decimal: str = "."
    start: int = 0


def read_rows(
    path: str | Path, start: int, stop: int | None, form: Form, names: Sequence[str]
) -> dict[str, np.ndarray]:
    """Read some columns of the rows of a file.

    Parameters
    ----------
    path : str or Path
    start, stop : int, int or None [bytes]
        Of the rows; None is the end of the file.
    form : Form
    names : sequence of str

    Returns
    -------
    dict of str to float64[n]

    Raises
    ------
    FormatError
        A row with another number of columns, or other content than numbers in the columns `names`.
    """
    with mapped(path) as content:
        raw = content[start : len(content) if stop is None else stop]
    if form.delimiter == BLANK:
        raw = _single_spaced(raw)
    try:
        import pyarrow.csv  # 0.1 s; not needed for frames of mpmgis
    except ImportError:
        return read_by_python(path, raw, form, names)
    try:
        table = pyarrow.csv.read_csv(
            pyarrow.BufferReader(raw),
            pyarrow.csv.ReadOptions(use_threads=len(raw) > ONE_BLOCK, column_names=list(form.columns), encoding="utf8"),
            pyarrow.csv.ParseOptions(delimiter=form.delimiter),
            pyarrow.csv.ConvertOptions(
                include_columns=list(names),
                column_types={name: pyarrow.float64() for name in names},
                decimal_point=form.decimal,
                check_utf8=False,
            ),
        )
    except (pyarrow.ArrowException, ValueError, OSError) as error:
        raise FormatError(f"{path}: its rows: {one_line(error)[:120]}; it is damaged") from error
    return {name: table[name].to_numpy().astype(np.float64, copy=False) for name in names}


def read_by_python(path: str | Path, raw: bytes, form: Form, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Read some columns of rows, without Arrow: 2 s per million rows.

    Parameters
    ----------
    path : str or Path
        File of the rows.
    raw : bytes
        The rows.
    form : Form
    names : sequence of str

    Returns
    -------
    dict of str to float64[n]

    Raises
    ------
    FormatError
        As `read_rows`.
    """
    text = raw.decode("utf-8", "replace")
    places, width = [form.columns.index(name) for name in names], len(form.columns)
    values = []
    try:
        for row in csv.reader(text.splitlines(), delimiter=form.delimiter):
            if not row:
                continue
            if len(row) != width:
                raise ValueError(f"row {len(values) + 1} has {len(row)} columns, expected {width}")
            values.append([_number(row[place], form.decimal) for place in places])
    except (ValueError, csv.Error) as error:
        raise FormatError(f"{path}: its rows: {one_line(error)[:120]}; it is damaged") from error
    columns = np.array(values, float).reshape(len(values), len(names)).T
    return {name: np.ascontiguousarray(column) for name, column in zip(names, columns, strict=True)}


def _number(text: str, decimal: str) -> float:
    """Return the number in `text`, NaN where it is missing."""
    text = text.strip()
    if text in NO_NUMBER:
        return np.nan
    if "_" in text:
        raise ValueError(f"{text[:40]!r} is not a number")
    return float(text if decimal == "." else text.replace(decimal, "."))


def _single_spaced(raw: bytes) -> bytes:
    """Return rows with one blank between numbers and none at the ends of lines."""
    raw = raw.replace(b"\t", b" ").replace(b"\r\n", b"\n")
    while b"  " in raw:
        raw = raw.replace(b"  ", b" ")
    return raw.replace(b" \n", b"\n").replace(b"\n ", b"\n").strip(b" ")


def frames_of_tables(open_file: Callable) -> Callable:
    """Make `frames` of a Reader of tables.

    Parameters
    ----------
    open_file : callable
        `open_file(path, time_column)` returns the frames of one table.
    """
    return partial(_frames, open_file)


def _frames(open_file, paths, terms):
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
