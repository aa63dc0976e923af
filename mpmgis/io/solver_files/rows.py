"""Rows of numbers as text that gives every digit back, fast."""

import numpy as np

from ..number_rows import append_rows


def write_rows(sink, *columns):
    """Append rows of numbers with blanks between them to a binary file: `columns` are arrays [n] or [n, k]."""
    flat = []
    for values in columns:
        flat += [values] if values.ndim == 1 else list(values.T)
    append_rows(sink, flat, " ")


def read_rows(text, width):
    """float64[n, width] of such text (bytes)."""
    return np.fromstring(text, dtype=float, sep=" ").reshape(-1, width)
