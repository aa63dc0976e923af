"""A batch of one column: how a thread of the device runs the batch loops of the kernels of columns.

On the processor a transfer works on lines of BATCH columns, which are vectorised (`lanes`). A thread moves one
column at a time: here every line has one entry, and four numbers of a node are a tuple. The functions of the kernels
are compiled with these in place of their own, from one source. Indices of nodes are unsigned: numba tests a signed one
for counting from the end.
"""

from numba import uint64

from ..columns import column_motion, column_rows, columns_to_grid, grid_to_columns
from .device_functions import Part, stand_in

LINES, QUADS = column_rows.LINES // column_rows.BATCH, column_rows.QUADS // column_rows.BATCH
QUAD = column_rows.QUAD // column_rows.BATCH
WX, WY = column_rows.L_WX0 // column_rows.BATCH, column_rows.L_WY0 // column_rows.BATCH


@Part
def get(array, line, index):
    """An entry of a line."""
    return array[line + index]


@Part
def put(array, line, index, value):
    """Set an entry of a line."""
    array[line + index] = value


@Part
def get_of_four(array, line, index, entry):
    """One of the four numbers of a group."""
    return array[line + 4 * index + entry]


@Part
def put_four(array, line, index, a, b, c, d):
    """Set the four numbers of a group."""
    at = line + 4 * index
    array[at], array[at + 1], array[at + 2], array[at + 3] = a, b, c, d


@Part
def lanes(a, b, c, d):
    """Four numbers."""
    return a, b, c, d


@Part
def load(array, index):
    """Four numbers of an array with one dimension."""
    n = uint64(index)
    return array[n], array[n + uint64(1)], array[n + uint64(2)], array[n + uint64(3)]


@Part
def store(array, index, value):
    """Set four numbers of an array with one dimension."""
    array[index], array[index + 1], array[index + 2], array[index + 3] = value


@Part
def multiply_add(factor, value, total):
    """factor * value + total, of four numbers."""
    return (
        factor * value[0] + total[0],
        factor * value[1] + total[1],
        factor * value[2] + total[2],
        factor * value[3] + total[3],
    )


_LINES = {
    name: value // column_rows.BATCH
    for name, value in vars(column_rows).items()
    if name in ("BATCH", "LINES", "QUAD", "QUADS") or (name[:2] in ("L_", "Q_") and isinstance(value, int))
}
_FUNCTIONS = {
    part.function.__name__: part for part in (get, put, get_of_four, put_four, lanes, load, store, multiply_add)
}
stand_in((column_motion, columns_to_grid, grid_to_columns), _LINES | _FUNCTIONS)
