"""Rows of numbers as text, a particle a row: columns by name, read by Arrow where it is installed, else by Python."""

import csv
from typing import NamedTuple

import numpy as np

from ...errors import FormatError, one_line
from .mapped import mapped

# bytes that Arrow takes at a time: further threads gain nothing for a text of that size, and a process that ends while
# they have only just begun may abort (apache/arrow#34314)
ONE_BLOCK = 1 << 20
# what Arrow takes for a number that is missing
NO_NUMBER = frozenset(
    {"", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND", "1.#QNAN", "N/A", "NA", "NULL"}
    | {"NaN", "n/a", "nan", "null"}
)
BLANK = " "  # a delimiter that stands for any number of blanks and tabs


class Form(NamedTuple):
    """How a table is written: names of its `columns`, `delimiter`, `decimal` sign, first byte of its rows."""

    columns: tuple
    delimiter: str
    decimal: str = "."
    start: int = 0


def read_rows(path, start, stop, form, names):
    """Name -> float64[n] of some columns of the rows from byte `start` to `stop` (None: the end) of a file.

    Raises
    ------
    FormatError
        A row with more or fewer columns, or something else than numbers in the columns `names`.
    """
    with mapped(path) as content:
        raw = content[start : len(content) if stop is None else stop]
    if form.delimiter == BLANK:
        raw = _even(raw)
    try:
        import pyarrow.csv  # brings a tenth of a second, which frames of mpmgis do without
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


def read_by_python(path, raw, form, names):
    """As `read_rows` for the bytes `raw` of the file at `path`, without Arrow: two seconds a million rows.

    Raises
    ------
    FormatError
        As of `read_rows`.
    """
    text = raw.decode("utf-8", "replace")
    places, width = [form.columns.index(name) for name in names], len(form.columns)
    values = []
    try:
        for row in csv.reader(text.splitlines(), delimiter=form.delimiter):
            if not row:
                continue
            if len(row) != width:
                raise ValueError(f"row {len(values) + 1} has {len(row)} columns, wanted {width}")
            values.append([_number(row[place], form.decimal) for place in places])
    except (ValueError, csv.Error) as error:
        raise FormatError(f"{path}: its rows: {one_line(error)[:120]}; it is damaged") from error
    columns = np.array(values, float).reshape(len(values), len(names)).T
    return {name: np.ascontiguousarray(column) for name, column in zip(names, columns, strict=True)}


def _number(text, decimal):
    """The number that `text` is, NaN where it is missing."""
    text = text.strip()
    if text in NO_NUMBER:
        return np.nan
    if "_" in text:
        raise ValueError(f"{text[:40]!r} is no number")
    return float(text if decimal == "." else text.replace(decimal, "."))


def _even(raw):
    """Rows with one blank between numbers and none at the ends of lines."""
    raw = raw.replace(b"\t", b" ").replace(b"\r\n", b"\n")
    while b"  " in raw:
        raw = raw.replace(b"  ", b" ")
    return raw.replace(b" \n", b"\n").replace(b"\n ", b"\n").strip(b" ")
