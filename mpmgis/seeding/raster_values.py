"""Bilinear values of rasters at fractional rows and columns."""

import math

import numpy as np

from ..compiled.jit import jit_inline, jit_parallel, prange


@jit_inline
def linear_at(values: np.ndarray, row: float, column: float) -> float:
    """Return the bilinear value of a raster at a point, extended linearly beyond the last pixel centres.

    Parameters
    ----------
    values : float64[rows, columns]
    row, column : float
        Fractional; whole numbers are pixel centres.
    """
    rows, columns = values.shape
    i = min(max(math.floor(row), 0), rows - 2)
    j = min(max(math.floor(column), 0), columns - 2)
    fi, fj = row - i, column - j
    top = values[i, j] * (1 - fj) + values[i, j + 1] * fj
    bottom = values[i + 1, j] * (1 - fj) + values[i + 1, j + 1] * fj
    return top * (1 - fi) + bottom * fi


@jit_inline
def valid_at(values: np.ndarray, row: float, column: float) -> float:
    """Return the bilinear value of the valid (not NaN) neighbours, weights renormalised; 0 where none is valid.

    Parameters
    ----------
    values : float64[rows, columns]
    row, column : float
        Fractional; whole numbers are pixel centres.
    """
    rows, columns = values.shape
    row = min(max(row, 0.0), rows - 1.0)
    column = min(max(column, 0.0), columns - 1.0)
    i, j = min(int(row), max(rows - 2, 0)), min(int(column), max(columns - 2, 0))
    i1, j1 = min(i + 1, rows - 1), min(j + 1, columns - 1)
    fi, fj = row - i, column - j
    top = values[i, j] * (1 - fj) + values[i, j1] * fj
    bottom = values[i1, j] * (1 - fj) + values[i1, j1] * fj
    mean = top * (1 - fi) + bottom * fi
    if mean == mean:
        return mean
    total, weight = 0.0, 0.0
    for r, wr in ((i, 1 - fi), (i1, fi)):
        for c, wc in ((j, 1 - fj), (j1, fj)):
            value = values[r, c]
            if value == value:
                total += wr * wc * value
                weight += wr * wc
    if weight <= 0.0:
        return 0.0
    return total / weight


@jit_parallel
def valid_values(values: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Compute `valid_at` at many points.

    Parameters
    ----------
    values : float64[rows, columns]
    row, column : float64[n]
        Fractional; whole numbers are pixel centres.

    Returns
    -------
    float64[n]
    """
    result = np.empty(row.size)
    for n in prange(row.size):
        result[n] = valid_at(values, row[n], column[n])
    return result
