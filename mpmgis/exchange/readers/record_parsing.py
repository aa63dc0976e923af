"""Numbers in text, and rows of numbers with a delimiter."""

import csv
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...system.errors import FormatError, one_line
from ...system.text_tables import BLANK
from .mapped_files import mapped

# [bytes] block size of Arrow: more threads gain nothing for smaller texts, and a process that ends just after their
# start may abort (apache/arrow#34314)
ONE_BLOCK = 1 << 20
# texts that Arrow reads as a missing number
NO_NUMBER = frozenset(
    {"", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND", "1.#QNAN", "N/A", "NA", "NULL"}
    | {"NaN", "n/a", "nan", "null"}
)


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
