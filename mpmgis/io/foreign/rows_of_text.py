"""Rows of numbers as text, a particle a row: columns by name, read by Arrow."""

import re
from typing import NamedTuple

import numpy as np
import pyarrow
import pyarrow.csv

from ...errors import FormatError, one_line
from .mapped import mapped

BLANK = " "  # a delimiter that stands for any number of blanks and tabs
_BLANKS = re.compile(rb"[ \t]+")
_MARGINS = re.compile(rb"^ | (?=\r?$)", re.MULTILINE)


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
    if form.delimiter == BLANK and _is_ragged(raw):
        raw = _MARGINS.sub(b"", _BLANKS.sub(b" ", raw))
    try:
        table = pyarrow.csv.read_csv(
            pyarrow.BufferReader(raw),
            pyarrow.csv.ReadOptions(column_names=list(form.columns), encoding="utf8"),
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


def _is_ragged(raw):
    """Whether other than single blanks stand between numbers, or any at the ends of lines."""
    first = raw[: raw.find(b"\n") + 1] or raw
    return b"  " in raw or b"\t" in raw or first.startswith(b" ") or first.rstrip(b"\r\n").endswith(b" ")
