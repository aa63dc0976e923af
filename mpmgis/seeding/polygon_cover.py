"""Exact cover of lattice cells by a polygon: area and centroid of each rim piece, rows of inner cells.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1].
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit, jit_inline
from .raster_values import valid_at

_ROUNDING = 1e-9  # [cells] a sum along a row this close to a whole number is one, up to rounding
_NOTHING = 1e-13  # [cells] covered area that is rounding


class Cover(NamedTuple):
    """Cells that a polygon covers: rim cells one by one, whole ones in spans of rows.

    Parameters
    ----------
    rows, columns : int
        Size of the window of the lattice.
    rim_key : int64[m]
        row * columns + column of each rim cell, ascending.
    rim : float64[m, 4]
        Covered share, its centroid (u, v) in the cell, number of edge pieces in the cell.
    rim_start : int64[rows + 1]
        Start of each row in `rim_key`.
    spans : int64[s, 3]
        Row, first column, column after the last.
    span_start : int64[rows + 1]
        Start of each row in `spans`.
    """

    rows: int
    columns: int
    rim_key: np.ndarray
    rim: np.ndarray
    rim_start: np.ndarray
    spans: np.ndarray
    span_start: np.ndarray

    @property
    def area(self) -> float:
        """Covered area [cells]."""
        return float(self.rim[:, 0].sum() + (self.spans[:, 2] - self.spans[:, 1]).sum())

    def cells(self) -> np.ndarray:
        """Return row and column of every cell that is covered in part or whole, int64[n, 2]."""
        rim = np.column_stack((self.rim_key // self.columns, self.rim_key % self.columns))
        lengths = self.spans[:, 2] - self.spans[:, 1]
        rows = np.repeat(self.spans[:, 0], lengths)
        first = np.repeat(self.spans[:, 1], lengths)
        within = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        return np.vstack((rim, np.column_stack((rows, first + within))))


@jit_inline
def _emit(n, row, column, sign, xa, ya, xb, yb, columns, key, terms):
    """Add one edge piece within cell (row, column): the area to its right inside the cell, by Green's theorem."""
    xa, xb = min(max(xa - column, 0.0), 1.0), min(max(xb - column, 0.0), 1.0)
    ya, yb = ya - row, yb - row
    dy = sign * (yb - ya)
    key[n] = row * columns + column
    terms[n, 0] = dy
    terms[n, 1] = dy * 0.5 * (ya + yb)
    terms[n, 2] = dy * (1.0 - 0.5 * (xa + xb))
    terms[n, 3] = dy * 0.5 * (1.0 - (xa * xa + xa * xb + xb * xb) / 3.0)
    terms[n, 4] = dy * (0.5 * (ya + yb) - (ya * (2.0 * xa + xb) + yb * (xa + 2.0 * xb)) / 6.0)
    return n + 1


@jit_inline
def _cut_in_row(n, row, sign, xa, ya, xb, yb, columns, key, terms):
    """Cut the piece (xa, ya)-(xb, yb) of one row at the columns' borders."""
    column, last = math.floor(xa), math.floor(xb)
    step = 1 if last > column else -1
    x, y = xa, ya
    while column != last:
        border = float(column + 1 if step > 0 else column)
        at = ya + (yb - ya) * (border - xa) / (xb - xa)
        at = min(max(at, y), yb)
        n = _emit(n, row, column, sign, x, y, border, at, columns, key, terms)
        x, y = border, at
        column += step
    return _emit(n, row, column, sign, x, y, xb, yb, columns, key, terms)


@jit
def cut_edges(edges: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygon edges at the cells' borders.

    Parameters
    ----------
    edges : float64[n, 4]
        u0, v0, u1, v1, all within 0 <= v and 0 <= u < columns.
    columns : int

    Returns
    -------
    key : int64[m]
        row * columns + column of each piece.
    terms : float64[m, 5]
        Height, height times mean v, and area, u- and v-moment of what lies right of the piece in its cell.
    """
    size = 0
    for e in range(edges.shape[0]):
        size += abs(math.floor(edges[e, 2]) - math.floor(edges[e, 0]))
        size += 2 * abs(math.floor(edges[e, 3]) - math.floor(edges[e, 1])) + 4
    key, terms = np.empty(size, np.int64), np.zeros((size, 5))
    n = 0
    for e in range(edges.shape[0]):
        x0, y0, x1, y1, sign = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3], 1.0
        if y1 < y0:
            x0, y0, x1, y1, sign = x1, y1, x0, y0, -1.0
        first, last = math.floor(y0), math.floor(y1)
        if y0 == y1:  # adds no area, but marks the cells that it crosses as rim
            for column in range(math.floor(min(x0, x1)), math.floor(max(x0, x1)) + 1):
                key[n] = first * columns + column
                n += 1
            continue
        xa, ya = x0, y0
        for row in range(first, last + 1):
            yb = min(y1, row + 1.0)
            if yb <= ya:
                continue
            xb = x1 if yb == y1 else x0 + (x1 - x0) * ((yb - y0) / (y1 - y0))
            n = _cut_in_row(n, row, sign, xa, ya, xb, yb, columns, key, terms)
            xa, ya = xb, yb
    return key[:n], terms[:n]


@jit
def accumulate_cover(
    key: np.ndarray, order: np.ndarray, terms: np.ndarray, columns: int, orientation: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute rim cells and whole spans from cut edges, row by row from left to right.

    Parameters
    ----------
    key : int64[n]
        From `cut_edges`.
    order : int64[n]
        Order of ascending `key`.
    terms : float64[n, 5]
        From `cut_edges`.
    columns : int
    orientation : float
        1 or -1, so that the covered area is positive.

    Returns
    -------
    rim_key : int64[m]
        Ascending.
    rim : float64[m, 4]
        Covered share of the cell, its centroid (u, v) within the cell, number of edge pieces in it.
    spans : int64[s, 3]
        Row, first column, column after the last of cells without an edge and inside.
    """
    n = key.size
    rim_key, rim = np.empty(n, np.int64), np.empty((n, 4))
    spans = np.empty((n, 3), np.int64)
    m, s, i = 0, 0, 0
    cover, cover_y, row_before, column_before = 0.0, 0.0, np.int64(-1), np.int64(-1)
    while i < n:
        k = key[order[i]]
        row, column = k // columns, k % columns
        if row != row_before:
            cover, cover_y = 0.0, 0.0
        elif cover > 0.5 and column > column_before + 1:
            spans[s, 0], spans[s, 1], spans[s, 2] = row, column_before + 1, column
            s += 1
        area, mu, mv, dy, ydy, pieces = cover, 0.5 * cover, cover_y, 0.0, 0.0, 0
        while i < n and key[order[i]] == k:
            t = terms[order[i]]
            dy += orientation * t[0]
            ydy += orientation * t[1]
            area += orientation * t[2]
            mu += orientation * t[3]
            mv += orientation * t[4]
            pieces += 1
            i += 1
        cover, cover_y = cover + dy, cover_y + ydy
        if abs(cover - round(cover)) < _ROUNDING:  # exactly in or out again: no rounding is carried along the row
            cover = float(round(cover))
            cover_y = 0.5 * cover
        row_before, column_before = row, column
        if area <= _NOTHING:
            continue
        rim_key[m] = k
        if area > 1.0 - 1e-12:
            rim[m, 0], rim[m, 1], rim[m, 2] = 1.0, 0.5, 0.5
        else:
            rim[m, 0] = area
            rim[m, 1] = min(max(mu / area, 0.0), 1.0)
            rim[m, 2] = min(max(mv / area, 0.0), 1.0)
        rim[m, 3] = pieces
        m += 1
    return rim_key[:m], rim[:m], spans[:s]


@jit
def row_starts(rows: np.ndarray, count: int) -> np.ndarray:
    """Return where each row starts in an ascending array of rows.

    Parameters
    ----------
    rows : int64[n]
        Ascending.
    count : int
        Number of rows.

    Returns
    -------
    int64[count + 1]
    """
    starts = np.zeros(count + 1, np.int64)
    for row in rows:
        starts[row + 1] += 1
    for i in range(count):
        starts[i + 1] += starts[i]
    return starts


@jit_inline
def _mark(status: np.ndarray, row: int, cover: Cover, share: np.ndarray, sliver: np.ndarray) -> None:
    """Set the status of the cells of `row`: 0 outside, 1 whole, 2 rim, 3 rim with a sliver in it."""
    status[:] = 0
    if row < 0 or row >= cover.rows:
        return
    for s in range(cover.span_start[row], cover.span_start[row + 1]):
        status[cover.spans[s, 1] : cover.spans[s, 2]] = 1
    for i in range(cover.rim_start[row], cover.rim_start[row + 1]):
        status[cover.rim_key[i] - row * cover.columns] = 3 if sliver[i] else 2 if share[i] < 1.0 else 1


@jit
def split_cells(cover: Cover, share: np.ndarray, sliver: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split the covered cells into spans of whole ones and cells at or near the rim.

    Cells beside one with a sliver are cut into pieces like rim cells, because the sliver may join them.

    Parameters
    ----------
    cover : Cover
    share : float64[m]
        Covered share of each rim cell.
    sliver : bool[m]
        Whether there is a sliver in a rim cell.

    Returns
    -------
    inner : int64[s, 3]
        Row, first column, column after the last.
    near : int64[m, 2]
        Row and column, ascending.
    """
    rows, columns = cover.rows, cover.columns
    inner = np.empty((cover.spans.shape[0] + 9 * cover.rim_key.size + 1, 3), np.int64)
    near = np.empty((9 * cover.rim_key.size + 1, 2), np.int64)
    below, here, above = np.zeros(columns, np.uint8), np.zeros(columns, np.uint8), np.zeros(columns, np.uint8)
    _mark(here, 0, cover, share, sliver)
    _mark(above, 1, cover, share, sliver)
    s, m = 0, 0
    for row in range(rows):
        start = -1
        for column in range(columns):
            if here[column] == 0:
                rim = True
            else:
                rim = here[column] >= 2
                for c in range(max(column - 1, 0), min(column + 2, columns)):
                    rim |= below[c] == 3 or here[c] == 3 or above[c] == 3
                if rim:
                    near[m, 0], near[m, 1] = row, column
                    m += 1
            if not rim and start < 0:
                start = column
            if rim and start >= 0:
                inner[s, 0], inner[s, 1], inner[s, 2] = row, start, column
                s += 1
                start = -1
        if start >= 0:
            inner[s, 0], inner[s, 1], inner[s, 2] = row, start, columns
            s += 1
        below, here, above = here, above, below
        _mark(above, row + 2, cover, share, sliver)
    return inner[:s], near[:m]


@jit_inline
def find_key(keys: np.ndarray, first: int, last: int, key: int) -> int:
    """Return the index of a key in a part of ascending keys, or -1.

    Parameters
    ----------
    keys : int64[n]
    first, last : int
        The part is keys[first:last].
    key : int
    """
    while first < last:
        middle = (first + last) // 2
        if keys[middle] < key:
            first = middle + 1
        elif keys[middle] > key:
            last = middle
        else:
            return middle
    return -1


@jit_inline
def in_span(spans: np.ndarray, first: int, last: int, column: int) -> bool:
    """Return whether one of the spans of a row contains a column.

    Parameters
    ----------
    spans : int64[s, 3]
        Row, first column, column after the last.
    first, last : int
        The spans of the row are first <= s < last.
    column : int
    """
    while first < last:
        middle = (first + last) // 2
        if spans[middle, 2] <= column:
            first = middle + 1
        elif spans[middle, 1] > column:
            last = middle
        else:
            return True
    return False


@jit
def integrate_cover(
    values: np.ndarray, rim_key: np.ndarray, rim: np.ndarray, spans: np.ndarray, columns: int, row0: int, column0: int
) -> tuple[float, float, float]:
    """Integrate pixel values h over an exact cover.

    A whole pixel counts with its value, a cut one with the value at the centroid of what is left of it.

    Parameters
    ----------
    values : float64[rows, columns]
    rim_key : int64[m]
    rim : float64[m, 4]
    spans : int64[s, 3]
    columns : int
        As in Cover.
    row0, column0 : int
        Pixel (0, 0) of `values` is cell (-row0, -column0) of the cover's window.

    Returns
    -------
    total, square, area : float
        Sum of h, sum of h^2, covered area, in cells.
    """
    total, square, area = 0.0, 0.0, 0.0
    for s in range(spans.shape[0]):
        row_total, row_square = 0.0, 0.0
        for column in range(spans[s, 1], spans[s, 2]):
            value = values[spans[s, 0] + row0, column + column0]
            row_total += value
            row_square += value * value
        total += row_total
        square += row_square
        area += spans[s, 2] - spans[s, 1]
    for i in range(rim_key.size):
        row, column = rim_key[i] // columns, rim_key[i] % columns
        value = valid_at(values, row + row0 + rim[i, 2] - 0.5, column + column0 + rim[i, 1] - 0.5)
        total += value * rim[i, 0]
        square += value * value * rim[i, 0]
        area += rim[i, 0]
    return total, square, area
