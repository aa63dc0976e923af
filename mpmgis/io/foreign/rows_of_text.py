"""Rows of numbers as text, a particle a row: columns by name, read by Arrow."""

from typing import NamedTuple

import numpy as np

from ...errors import FormatError, one_line
from .mapped import mapped

# bytes that Arrow takes at a time: further threads gain nothing for a text of that size, and a process that ends while
# they have only just begun may abort (apache/arrow#34314)
ONE_BLOCK = 1 << 20
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
    import pyarrow.csv  # brings a tenth of a second, which frames of mpmgis do without

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


def _even(raw):
    """Rows with one blank between numbers and none at the ends of lines."""
    raw = raw.replace(b"\t", b" ").replace(b"\r\n", b"\n")
    while b"  " in raw:
        raw = raw.replace(b"  ", b" ")
    return raw.replace(b" \n", b"\n").replace(b"\n ", b"\n").strip(b" ")
