"""Values of chosen cells at chosen times, as the export averages them."""

import numpy as np

from .frame_values import average_frame
from .table import PRODUCTS

NOWHERE = -1  # the number of a cell that a grid does not have


def cells_of(grid, x, y):
    """int64[n]: flat number of the cell of `grid` that holds each map point [m], NOWHERE off the grid."""
    row, column = (np.floor(place + 0.5).astype(np.int64) for place in grid.rowcol(x, y))
    rows, columns = grid.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return np.where(inside, row * columns + column, NOWHERE)


def pick(index, values, empty, cells):
    """Values of `cells` out of those that are known.

    Parameters
    ----------
    index : int64[k]
        Flat numbers of the cells with a value, ascending.
    values : float[k]
    empty : float
        Value of the grid's other cells.
    cells : int64[n]
        NOWHERE has no value.

    Returns
    -------
    float64[n]
        NaN off the grid.
    """
    result = np.where(cells == NOWHERE, np.nan, empty)
    if len(index):
        at = np.minimum(np.searchsorted(index, cells), len(index) - 1)
        known = index[at] == cells
        result[known] = values[at[known]]
    return result


def frame_at_cells(frame, averaging, cells):
    """Product -> float64[n] of `cells` of `averaging.grid`, one frame averaged as for the export's rasters."""
    found = average_frame(frame, averaging)
    return {name: pick(found.index, found.values[name], PRODUCTS[name].empty, cells) for name in averaging.names}


def nearest_times(times, wanted):
    """Numbers of the frames nearest to the `wanted` times [s], each once, in their order; of two equally near the
    earlier."""
    gaps = np.abs(np.asarray(times, float)[None, :] - np.asarray(wanted, float)[:, None])
    return sorted({int(k) for k in np.argmin(gaps, axis=1)})
