"""Share the amounts of the squares of one grid among the cells of another one, at any angle to it.

All places are in *cell coordinates* (u, v): a cell is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. A square of the other grid is a parallelogram there.
"""

import math

import numpy as np

from ...compiled.jit import jit, jit_inline
from .cell_places import ROUNDING

CORNERS = 8  # [1] at most, of a parallelogram that four half-planes cut


@jit
def share_squares(
    amount: np.ndarray, corner: np.ndarray, across: np.ndarray, along: np.ndarray, cells: np.ndarray
) -> None:
    """Give each cell the part of every square's amount that lies in it.

    The parts of a square that is inside the cells add up to its amount, to rounding.

    Parameters
    ----------
    amount : float64[rows, columns]
        Of each square, spread evenly over it.
    corner : float64[2]
        (u, v) of the first corner of square (0, 0).
    across, along : float64[2]
        Steps (u, v) to the next column and to the next row of squares.
    cells : float64[rows, columns], out
        The parts are added to it.
    """
    whole, strip, piece = np.empty((CORNERS, 2)), np.empty((CORNERS, 2)), np.empty((CORNERS, 2))
    work = np.empty((CORNERS, 2))
    near = ROUNDING * min(1.0, math.hypot(across[0], across[1]), math.hypot(along[0], along[1]))
    for i in range(amount.shape[0]):
        for j in range(amount.shape[1]):
            if amount[i, j] == 0.0:
                continue
            for k in range(4):
                column, row = j + (k == 1 or k == 2), i + (k >= 2)
                for axis in range(2):
                    whole[k, axis] = _snapped(corner[axis] + column * across[axis] + row * along[axis], near)
            per_area = amount[i, j] / _area(whole, 4)
            first_row, end_row = _range(whole, 4, 1, cells.shape[0])
            for r in range(first_row, end_row):
                n = _cut(whole, 4, 1, float(r), strip, work)
                first_column, end_column = _range(strip, n, 0, cells.shape[1])
                for c in range(first_column, end_column):
                    m = _cut(strip, n, 0, float(c), piece, work)
                    cells[r, c] += per_area * _area(piece, m)


@jit_inline
def _snapped(place, near):
    """`place`, or the border of cells that is closer than `near`: no slivers where squares end on borders."""
    border = math.floor(place + 0.5)
    return float(border) if abs(place - border) < near else place


@jit_inline
def _range(polygon, n, axis, cells):
    """First cell and cell after the last that `n` corners of a polygon reach along an axis, within `cells`."""
    if n == 0:
        return 0, 0
    low, high = polygon[0, axis], polygon[0, axis]
    for k in range(1, n):
        low, high = min(low, polygon[k, axis]), max(high, polygon[k, axis])
    return int(max(math.floor(low), 0.0)), int(min(math.ceil(high), float(cells)))


@jit_inline
def _cut(polygon, n, axis, low, out, work):
    """Write the part of a convex polygon of `n` corners in [low, low + 1] along an axis to `out`; its corners."""
    return _half(work, _half(polygon, n, axis, low, 1.0, work), axis, low + 1.0, -1.0, out)


@jit_inline
def _half(polygon, n, axis, border, side, out):
    """The part of a polygon where side * (place - border) >= 0 (Sutherland and Hodgman 1974); number of corners."""
    m = 0
    for k in range(n):
        after = k + 1 if k + 1 < n else 0
        here, there = side * (polygon[k, axis] - border), side * (polygon[after, axis] - border)
        if here >= 0.0:
            out[m, 0], out[m, 1] = polygon[k, 0], polygon[k, 1]
            m += 1
        if here * there < 0.0:
            f = here / (here - there)
            other = 1 - axis
            out[m, axis] = border
            out[m, other] = polygon[k, other] + f * (polygon[after, other] - polygon[k, other])
            m += 1
    return m


@jit_inline
def _area(polygon, n):
    """Area of a polygon of `n` corners."""
    double = 0.0
    for k in range(2, n):
        double += (polygon[k - 1, 0] - polygon[0, 0]) * (polygon[k, 1] - polygon[0, 1])
        double -= (polygon[k, 0] - polygon[0, 0]) * (polygon[k - 1, 1] - polygon[0, 1])
    return 0.5 * abs(double)
