"""Numbers as text, any white space between them."""

import warnings

import numpy as np

from ...errors import FormatError
from .arrays import require_whole


def text_numbers(text, count, path, what, more=False):
    """float64[count] of `text` (bytes); with `more` further numbers may follow.

    Raises
    ------
    FormatError
        Something else than numbers, or not as many.
    """
    if len(text) < 2 * count - 1:  # a digit and a blank each; so that no count makes room for what is not there
        require_whole(path, what, f"at most {(len(text) + 1) // 2}", count)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how NumPy says that it came upon something else
        try:
            values = np.fromstring(text, np.float64, sep=" ")  # given a count it hands out memory that it never filled
        except (DeprecationWarning, ValueError):
            raise FormatError(f"{path}: {what} holds something else than numbers; it is damaged") from None
    values = values[:count] if more else values
    require_whole(path, what, len(values), count)
    return values
