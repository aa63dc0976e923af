"""Rows of numbers appended to text files."""

import numpy as np


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
