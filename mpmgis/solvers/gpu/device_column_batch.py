"""A batch of one column: how a thread of the device runs the batch loops of the kernels of columns.

On the processor a transfer works on lines of BATCH columns, which are vectorised (`simd_lanes`). A thread moves one
column at a time: here every line has one entry, and four numbers of a node are a tuple. The functions of the kernels
are compiled with these in place of their own, from one source. Indices of nodes are unsigned: numba tests a signed one
for counting from the end.
"""

import numpy as np
from numba import uint64

from ..columns import column_motion, column_rows, columns_to_grid, grid_to_columns
from .device_functions import Part, stand_in

LINES, QUADS = column_rows.LINES // column_rows.BATCH, column_rows.QUADS // column_rows.BATCH
QUAD = column_rows.QUAD // column_rows.BATCH
WX, WY = column_rows.L_WX0 // column_rows.BATCH, column_rows.L_WY0 // column_rows.BATCH


@Part
def get(array: np.ndarray, line: int, index: int) -> float:
    """Return an entry of a line.

    Parameters
    ----------
    array : float64[n]
    line : int
        Place of the line in the array.
    index : int
    """
    return array[line + index]


@Part
def put(array: np.ndarray, line: int, index: int, value: float) -> None:
    """Set an entry of a line.

    Parameters
    ----------
    array : float64[n]
    line, index : int
    value : float
    """
    array[line + index] = value


@Part
def get_of_four(array: np.ndarray, line: int, index: int, entry: int) -> float:
    """Return one of the four numbers of a group.

    Parameters
    ----------
    array : float64[n]
    line : int
        Place of the groups in the array.
    index : int
        Of the group.
    entry : int
    """
    return array[line + 4 * index + entry]


@Part
def get_of_three(array: np.ndarray, line: int, index: int, entry: int) -> float:
    """Return one of the three numbers of a group.

    Parameters
    ----------
    array : float64[n]
    line : int
        Place of the groups in the array.
    index : int
        Of the group.
    entry : int
    """
    return array[line + 3 * index + entry]


@Part
def put_four(array: np.ndarray, line: int, index: int, a: float, b: float, c: float, d: float) -> None:
    """Set the four numbers of a group.

    Parameters
    ----------
    array : float64[n]
    line, index : int
    a, b, c, d : float
    """
    at = line + 4 * index
    array[at], array[at + 1], array[at + 2], array[at + 3] = a, b, c, d


@Part
def lanes(a: float, b: float, c: float, d: float) -> tuple[float, float, float, float]:
    """Return four numbers as a tuple.

    Parameters
    ----------
    a, b, c, d : float
    """
    return a, b, c, d


@Part
def load(array: np.ndarray, index: int) -> tuple[float, float, float, float]:
    """Return four numbers of an array with one dimension.

    Parameters
    ----------
    array : float64[n]
    index : int
        Of the first one.
    """
    n = uint64(index)
    return array[n], array[n + uint64(1)], array[n + uint64(2)], array[n + uint64(3)]


@Part
def store(array: np.ndarray, index: int, value: tuple) -> None:
    """Set four numbers of an array with one dimension.

    Parameters
    ----------
    array : float64[n]
    index : int
        Of the first one.
    value : (float, float, float, float)
    """
    array[index], array[index + 1], array[index + 2], array[index + 3] = value


@Part
def multiply_add(factor: float, value: tuple, total: tuple) -> tuple[float, float, float, float]:
    """Compute factor * value + total of four numbers.

    Parameters
    ----------
    factor : float
    value, total : (float, float, float, float)
    """
    return (
        factor * value[0] + total[0],
        factor * value[1] + total[1],
        factor * value[2] + total[2],
        factor * value[3] + total[3],
    )


@Part
def prefetch_row(rows: np.ndarray, order: np.ndarray, place: int) -> None:
    """Prefetch nothing: other threads of the device work while one waits for a row.

    Parameters
    ----------
    rows : float64[n]
    order : int32[columns]
    place : int
    """


_LINES = {
    name: value // column_rows.BATCH
    for name, value in vars(column_rows).items()
    if name in ("BATCH", "LINES", "QUAD", "QUADS") or (name[:2] in ("L_", "Q_") and isinstance(value, int))
}
_FUNCTIONS = {
    part.function.__name__: part
    for part in (get, put, get_of_four, get_of_three, put_four, lanes, load, store, multiply_add, prefetch_row)
}
stand_in((column_motion, columns_to_grid, grid_to_columns), _LINES | _FUNCTIONS)
