"""Kernels of seeding: exact cover of cells by polygons, rim pieces, counter-based random numbers, the fill.

Everything works in *lattice coordinates* (u, v): a cell of the lattice is a unit square, cell (row, column) is
[column, column + 1] x [row, row + 1]. An affine of six numbers ``(a, b, c, d, e, f)`` takes (u, v) to
``(a u + b v + c, d u + e v + f)``. Every loop that runs in parallel owns the rows that it writes.
"""

import math

import numpy as np

from .jit import jit, jit_inline, jit_parallel, prange

SLIVER = 0.05  # share of a sub-square below which a rim piece joins its neighbour (design notes 1.4)
JITTER = 0.5  # full width of a vertex's displacement over the sub-square's side; no more than 0.5 (design notes 1.4)
CENTRED, JITTERED, RANDOM, STAGGERED = 0, 1, 2, 3
_POSITIVE = 1 << 40  # added to cell indices, so that they can be taken as unsigned
_DITHER = 1 << 40  # the number by which a cell's random numbers decide its count
_ROUNDING = 1e-9
_NOTHING = 1e-13

# ------------------------------------------------------------------------------------------- counter-based numbers


@jit_inline
def _mix(word):
    """SplitMix64's finaliser: a bijection of 64-bit words that avalanches (Steele, Lea, Flood 2014)."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@jit_inline
def uniform(seed, i, j, k):
    """A number in [0, 1) that depends on nothing but (seed, i, j, k): the same for any number of threads (D16).

    Cells i and j may be negative, above -2^40; seed and k are not.
    """
    word = _mix(np.uint64(seed) ^ np.uint64(0x9E3779B97F4A7C15))
    word = _mix(word ^ (np.uint64(i + _POSITIVE) * np.uint64(0xD1B54A32D192ED03)))
    word = _mix(word ^ (np.uint64(j + _POSITIVE) * np.uint64(0xABC98388FB8FAC03)))
    word = _mix(word ^ (np.uint64(k) * np.uint64(0x8CB92BA72F3D8DD7)))
    return np.float64(word >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@jit
def halton(index):
    """Point (s, t) number `index` of Halton's sequence: van der Corput's sequences in the bases 2 and 3."""
    bits, s, half = np.uint64(index), 0.0, 0.5
    while bits > np.uint64(0):
        if bits & np.uint64(1):
            s += half
        bits >>= np.uint64(1)
        half *= 0.5
    digits, t, third = np.uint64(index), 0.0, 1.0 / 3.0
    while digits > np.uint64(0):
        rest = digits // np.uint64(3)
        t += third * np.float64(digits - np.uint64(3) * rest)
        digits = rest
        third *= 1.0 / 3.0
    return s, t


# ------------------------------------------------------------------------------------------------ values of rasters


@jit_inline
def linear_at(values, row, column):
    """Bilinear value at fractional (row, column), whole numbers being centres; extended linearly beyond the last."""
    rows, columns = values.shape
    i = min(max(math.floor(row), 0), rows - 2)
    j = min(max(math.floor(column), 0), columns - 2)
    fi, fj = row - i, column - j
    top = values[i, j] * (1 - fj) + values[i, j + 1] * fj
    bottom = values[i + 1, j] * (1 - fj) + values[i + 1, j + 1] * fj
    return top * (1 - fi) + bottom * fi


@jit_inline
def valid_at(values, row, column):
    """Bilinear value of the valid (not NaN) neighbours, weights renormalised (D10); 0 where none is valid."""
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
def valid_values(values, row, column):
    """float64[n]: `valid_at` at each fractional (row, column)."""
    result = np.empty(row.size)
    for n in prange(row.size):
        result[n] = valid_at(values, row[n], column[n])
    return result


# ------------------------------------------------------------------------------------- exact cover by polygon edges


@jit_inline
def _emit(n, row, column, sign, xa, ya, xb, yb, columns, key, terms):
    """One edge piece within cell (row, column): what lies to its right inside the cell, by Green's theorem."""
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
def cut_edges(edges, columns):
    """Cut polygon edges at the cells' borders.

    Parameters
    ----------
    edges : float64[n, 4]
        (u0, v0, u1, v1), all within 0 <= v and 0 <= u < columns.
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
def accumulate_cover(key, order, terms, columns, orientation):
    """Rim cells and full spans from cut edges, row by row from left to right.

    Returns
    -------
    rim_key : int64[m], ascending
    rim : float64[m, 4]
        Covered share of the cell, its centroid (u, v) within the cell, number of edge pieces in it.
    spans : int64[s, 3]
        (row, first column, column after the last) of cells without an edge and inside.
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
def row_starts(rows, count):
    """int64[count + 1]: where each row starts in ascending `rows`."""
    starts = np.zeros(count + 1, np.int64)
    for row in rows:
        starts[row + 1] += 1
    for i in range(count):
        starts[i + 1] += starts[i]
    return starts


@jit_inline
def _mark(status, row, rows, columns, rim_key, share, sliver, rim_start, spans, span_start):
    """Status of the cells of `row`: 0 outside, 1 whole, 2 rim, 3 rim with a sliver in it."""
    status[:] = 0
    if row < 0 or row >= rows:
        return
    for s in range(span_start[row], span_start[row + 1]):
        status[spans[s, 1] : spans[s, 2]] = 1
    for i in range(rim_start[row], rim_start[row + 1]):
        status[rim_key[i] - row * columns] = 3 if sliver[i] else 2 if share[i] < 1.0 else 1


@jit
def split_cells(rows, columns, rim_key, share, sliver, rim_start, spans, span_start):
    """Part the covered cells into spans that need no care and cells at or near the rim.

    Cells beside one with a sliver are cut into pieces like rim cells, because the sliver may join them. `share` and
    `sliver` say of each rim cell how much of it is covered, and whether there is a sliver in it.

    Returns
    -------
    inner : int64[s, 3]
        (row, first column, column after the last).
    near : int64[m, 2]
        (row, column), ascending.
    """
    inner = np.empty((spans.shape[0] + 9 * rim_key.size + 1, 3), np.int64)
    near = np.empty((9 * rim_key.size + 1, 2), np.int64)
    below, here, above = np.zeros(columns, np.uint8), np.zeros(columns, np.uint8), np.zeros(columns, np.uint8)
    _mark(here, 0, rows, columns, rim_key, share, sliver, rim_start, spans, span_start)
    _mark(above, 1, rows, columns, rim_key, share, sliver, rim_start, spans, span_start)
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
        _mark(above, row + 2, rows, columns, rim_key, share, sliver, rim_start, spans, span_start)
    return inner[:s], near[:m]


@jit_inline
def _find(keys, first, last, key):
    """Index of `key` in ascending keys[first:last], or -1."""
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
def _in_span(spans, first, last, column):
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
def cells_with_slivers(cell_key, columns, rim_key, share, across, down):
    """bool[m]: which cells of ascending `cell_key` hold a sub-square that is covered by less than 5 %.

    `rim_key`, `share` are the rim of the lattice with every cell of `columns` cut into across x down sub-squares.
    """
    sliver = np.zeros(cell_key.size, np.bool_)
    for i in range(rim_key.size):
        if share[i] < SLIVER:
            row, column = rim_key[i] // (columns * across), rim_key[i] % (columns * across)
            at = _find(cell_key, 0, cell_key.size, (row // down) * columns + column // across)
            if at >= 0:
                sliver[at] = True
    return sliver


@jit
def gather_pieces(cells, across, down, columns, rim_key, rim, rim_start, spans, span_start):
    """The pieces of polygon in the across x down sub-squares of each cell.

    Parameters
    ----------
    cells : int64[m, 2]
        (row, column); `columns` of the sub-lattice, whose cover the other arguments hold.

    Returns
    -------
    owner : int64[n]
        Index into `cells`.
    pieces : float64[n, 5]
        Centroid (u, v) and area in cell units, area of a whole sub-square, number of edge pieces (0 = whole).
    """
    n = 0
    owner = np.empty(cells.shape[0] * across * down, np.int64)
    pieces = np.empty((owner.size, 5))
    unit = 1.0 / (across * down)
    for m in range(cells.shape[0]):
        for sy in range(down):
            row = cells[m, 0] * down + sy
            for sx in range(across):
                column = cells[m, 1] * across + sx
                at = _find(rim_key, rim_start[row], rim_start[row + 1], row * columns + column)
                if at >= 0:
                    share, cu, cv, edges = rim[at, 0], rim[at, 1], rim[at, 2], rim[at, 3]
                elif _in_span(spans, span_start[row], span_start[row + 1], column):
                    share, cu, cv, edges = 1.0, 0.5, 0.5, 0.0
                else:
                    continue
                owner[n] = m
                pieces[n, 0], pieces[n, 1] = (column + cu) / across, (row + cv) / down
                pieces[n, 2], pieces[n, 3], pieces[n, 4] = share * unit, unit, edges
                n += 1
    return owner[:n], pieces[:n]


@jit
def merge_slivers(pieces, starts, cells, columns, order, forced):
    """Join slivers (below 5 % of their sub-square) to the nearest piece, area and first moment kept.

    Parameters
    ----------
    pieces : float64[n, 5], changed in place
        As from `gather_pieces`, sorted by cell; `starts` int64[m + 1] says where each cell's pieces begin.
    cells : int64[m, 2], ascending
    order : int64[n]
        Pieces from small to large.
    forced : int
        So many of the smallest are joined whatever their size.

    Returns
    -------
    alive : bool[n]
    """
    alive = np.ones(pieces.shape[0], np.bool_)
    key = cells[:, 0] * columns + cells[:, 1]
    owner = np.empty(pieces.shape[0], np.int64)
    for m in range(cells.shape[0]):
        owner[starts[m] : starts[m + 1]] = m
    done = 0
    for i in order:
        small = pieces[i, 2] < SLIVER * pieces[i, 3]
        if not small and done >= forced:
            continue
        j = np.int64(-1)
        for large in (True, False):
            if j < 0:
                j = _nearest(i, pieces, starts, cells, key, columns, owner[i], alive, large)
        if j < 0:
            continue
        area = pieces[i, 2] + pieces[j, 2]
        for axis in range(2):
            pieces[j, axis] = (pieces[i, axis] * pieces[i, 2] + pieces[j, axis] * pieces[j, 2]) / area
        pieces[j, 2] = area
        pieces[j, 4] = 99.0  # no longer known to be convex
        alive[i] = False
        done += 1
    return alive


@jit_inline
def _nearest(i, pieces, starts, cells, key, columns, home, alive, large):
    """The nearest other piece alive in the 3 x 3 cells around, or -1; `large`: no sliver."""
    best, distance = np.int64(-1), np.inf
    for dr in range(-1, 2):
        for dc in range(-1, 2):
            m = _find(key, 0, key.size, (cells[home, 0] + dr) * columns + cells[home, 1] + dc)
            if m < 0:
                continue
            for j in range(starts[m], starts[m + 1]):
                if j == i or not alive[j] or (large and pieces[j, 2] < SLIVER * pieces[j, 3]):
                    continue
                du, dv = pieces[i, 0] - pieces[j, 0], pieces[i, 1] - pieces[j, 1]
                if du * du + dv * dv < distance:
                    best, distance = np.int64(j), du * du + dv * dv
    return best


# ----------------------------------------------------------------------------------------------- inside a polygon


@jit
def edges_by_row(edges, rows):
    """(starts int64[rows + 1], index int64[m]): the edges that each row of cells meets."""
    starts = np.zeros(rows + 1, np.int64)
    for e in range(edges.shape[0]):
        low, high = min(edges[e, 1], edges[e, 3]), max(edges[e, 1], edges[e, 3])
        for row in range(math.floor(low), min(math.floor(high), rows - 1) + 1):
            starts[row + 1] += 1
    for row in range(rows):
        starts[row + 1] += starts[row]
    index, at = np.empty(starts[rows], np.int64), starts[:-1].copy()
    for e in range(edges.shape[0]):
        low, high = min(edges[e, 1], edges[e, 3]), max(edges[e, 1], edges[e, 3])
        for row in range(math.floor(low), min(math.floor(high), rows - 1) + 1):
            index[at[row]] = e
            at[row] += 1
    return starts, index


@jit_inline
def is_inside(u, v, edges, starts, index):
    """Even-odd rule with half-open edges: a point on a vertex has one owner."""
    row = math.floor(v)
    if row < 0 or row >= starts.size - 1:
        return False
    odd = False
    for i in range(starts[row], starts[row + 1]):
        e = index[i]
        u0, v0, u1, v1 = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        if (v0 > v) != (v1 > v) and u < u0 + (u1 - u0) * ((v - v0) / (v1 - v0)):
            odd = not odd
    return odd


@jit
def inside(points, edges, starts, index):
    """bool[n]: which of the points float64[n, 2] lie inside the polygon of `edges`."""
    result = np.empty(points.shape[0], np.bool_)
    for n in range(points.shape[0]):
        result[n] = is_inside(points[n, 0], points[n, 1], edges, starts, index)
    return result


@jit
def points_in_squares(corners, sizes, edges, starts, index):
    """float64[n, 2]: a point of the polygon in each square, the middle of the longest stretch on seven lines across it.

    `corners` float64[n, 2] are the squares' lower corners, `sizes` float64[n, 2] their sides; NaN where none is found.
    """
    points = np.full((corners.shape[0], 2), np.nan)
    for n in range(corners.shape[0]):
        low, high, longest = corners[n, 0], corners[n, 0] + sizes[n, 0], 0.0
        row = math.floor(corners[n, 1] + 0.5 * sizes[n, 1])
        if row < 0 or row >= starts.size - 1:
            continue
        crossings = np.empty(starts[row + 1] - starts[row])
        for line in range(1, 8):
            v = corners[n, 1] + 0.125 * line * sizes[n, 1]
            m = 0
            for i in range(starts[row], starts[row + 1]):
                e = index[i]
                if (edges[e, 1] > v) != (edges[e, 3] > v):
                    along = (v - edges[e, 1]) / (edges[e, 3] - edges[e, 1])
                    crossings[m] = edges[e, 0] + (edges[e, 2] - edges[e, 0]) * along
                    m += 1
            crossings[:m].sort()
            for k in range(0, m - 1, 2):
                u0, u1 = max(crossings[k], low), min(crossings[k + 1], high)
                if u1 - u0 > longest:
                    longest = u1 - u0
                    points[n, 0], points[n, 1] = 0.5 * (u0 + u1), v
    return points


@jit
def scatter_in_pieces(points, width, height, keys, seed, edges, starts, index):
    """Move each rim point to a random place of its sub-square that lies inside the polygon; it stays if 32 tries fail.

    `points` float64[n, 2] is changed in place; the squares of `width` x `height` [cells] hold them; `keys` int64[n, 3]
    are (cell column, cell row, number) for the random numbers.
    """
    for n in range(points.shape[0]):
        u0, v0 = math.floor(points[n, 0] / width[n]) * width[n], math.floor(points[n, 1] / height[n]) * height[n]
        for attempt in range(32):
            counter = (keys[n, 2] + 1) * 1024 + attempt * 2
            u = u0 + width[n] * uniform(seed, keys[n, 0], keys[n, 1], counter)
            v = v0 + height[n] * uniform(seed, keys[n, 0], keys[n, 1], counter + 1)
            if is_inside(u, v, edges, starts, index):
                points[n, 0], points[n, 1] = u, v
                break


# ------------------------------------------------------------------------------------------------------- the fill


@jit_inline
def cell_count(n0, beta, slope, slope_map, row, column, seed, row0, column0, largest):
    """Particles of a whole cell: n0 (1 + beta min(tan slope, 1)) (D14), its fraction decided by chance per cell."""
    if beta == 0.0:
        return int(n0)
    u, v = column + 0.5, row + 0.5
    i = slope_map[0] * u + slope_map[1] * v + slope_map[2]
    j = slope_map[3] * u + slope_map[4] * v + slope_map[5]
    wanted = n0 * (1.0 + beta * min(valid_at(slope, i, j), 1.0))
    count = math.floor(wanted + uniform(seed, column + column0, row + row0, _DITHER))
    return min(max(count, 1), largest)


@jit
def cell_counts(cells, n0, beta, slope, slope_map, seed, row0, column0, largest):
    """int64[m]: `cell_count` of each cell (row, column)."""
    counts = np.empty(cells.shape[0], np.int64)
    for m in range(cells.shape[0]):
        counts[m] = cell_count(n0, beta, slope, slope_map, cells[m, 0], cells[m, 1], seed, row0, column0, largest)
    return counts


@jit
def count_rows(rows, inner, inner_start, n0, beta, slope, slope_map, seed, row0, column0, largest):
    """int64[rows]: particles in the inner cells of each row."""
    counts = np.zeros(rows, np.int64)
    for row in range(rows):
        for s in range(inner_start[row], inner_start[row + 1]):
            if beta == 0.0:
                counts[row] += (inner[s, 2] - inner[s, 1]) * int(n0)
                continue
            for column in range(inner[s, 1], inner[s, 2]):
                counts[row] += cell_count(n0, beta, slope, slope_map, row, column, seed, row0, column0, largest)
    return counts


@jit
def displaced_corners(corners, seed, i, j, across, down):
    """Fill corners float64[:, 2] with the corners of a cell's sub-squares, displaced: those on its border slide on it.

    The quads between them still tile the cell exactly, whatever its neighbours do.
    """
    n = 0
    for sy in range(down + 1):
        for sx in range(across + 1):
            moved_u = JITTER / across if 0 < sx < across else 0.0
            moved_v = JITTER / down if 0 < sy < down else 0.0
            corners[n, 0] = sx / across + moved_u * (uniform(seed, i, j, 2 * n) - 0.5)
            corners[n, 1] = sy / down + moved_v * (uniform(seed, i, j, 2 * n + 1) - 0.5)
            n += 1


@jit_inline
def _quad(corners, first, second):
    """(centroid u, v, area) of the quad with lower corners first, first + 1 and upper corners second, second + 1."""
    x0, y0, x1, y1 = corners[first, 0], corners[first, 1], corners[first + 1, 0], corners[first + 1, 1]
    x3, y3, x2, y2 = corners[second, 0], corners[second, 1], corners[second + 1, 0], corners[second + 1, 1]
    lower = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    upper = (x2 - x0) * (y3 - y0) - (x3 - x0) * (y2 - y0)
    area = 0.5 * (lower + upper)
    u = (lower * (x0 + x1 + x2) + upper * (x0 + x2 + x3)) / (6.0 * area)
    v = (lower * (y0 + y1 + y2) + upper * (y0 + y2 + y3)) / (6.0 * area)
    return u, v, area


@jit_inline
def _at(affine, u, v):
    return affine[0] * u + affine[1] * v + affine[2], affine[3] * u + affine[4] * v + affine[5]


@jit
def evaluate(points, count, n, write, place, bed, bed_map, thick, thick_map, law, position, columns, sums):
    """Evaluate columns at `count` points float64[:, 3] (u, v, area [m2]); write them to the rows from n on if asked.

    `law` is (closure factor, density, volume of every column or 0 where mass follows thickness); `columns` is
    float64[4, n]: thickness, area, volume, mass. `sums` float64[3] takes sum, smallest and largest of thickness times
    area [m3] before closure.
    """
    for k in range(count):
        u, v, area = points[k, 0], points[k, 1], points[k, 2]
        i, j = _at(thick_map, u, v)
        thickness = valid_at(thick, i, j)
        volume = thickness * area
        sums[0] += volume
        sums[1], sums[2] = min(sums[1], volume), max(sums[2], volume)
        if write:
            x, y = _at(place, u, v)
            i, j = _at(bed_map, u, v)
            position[n + k, 0], position[n + k, 1], position[n + k, 2] = x, y, linear_at(bed, i, j)
            if law[2] > 0.0:
                thickness, area, volume = thickness, law[2] / thickness, law[2]
            else:
                thickness = law[0] * thickness
                volume = thickness * area
            columns[0, n + k], columns[1, n + k], columns[2, n + k] = thickness, area, volume
            columns[3, n + k] = law[1] * volume


@jit
def cell_points(points, corners, row, column, count, down, kind, seed, row0, column0, cell_area):
    """Fill points float64[:, 3] (u, v, area [m2]) with the `count` particles of a whole cell.

    The cell is cut into `down` rows that share `count` as evenly as whole numbers allow; every tile has the area
    cell / count and its particle at its centre (`kind` CENTRED), or is displaced (JITTERED), or the particle lies
    anywhere in the cell (RANDOM). STAGGERED particles lie in their tiles so that no two of a cell share u or v: the
    canonical arrangement of Chiu, Shirley and Wang (1994), whose sums stay even when the flow stretches it.
    """
    i, j, across = column + column0, row + row0, count // down
    if kind == JITTERED:
        displaced_corners(corners, seed, i, j, across, down)
    for sy in range(down):
        k0, k1 = (sy * count) // down, ((sy + 1) * count) // down
        for k in range(k0, k1):
            u, v, share = (k - k0 + 0.5) / (k1 - k0), 0.5 * (k0 + k1) / count, 1.0 / count
            if kind == JITTERED:
                corner = sy * (across + 1) + k - k0
                u, v, share = _quad(corners, corner, corner + across + 1)
            elif kind == RANDOM:
                u, v = uniform(seed, i, j, 2 * k), uniform(seed, i, j, 2 * k + 1)
            elif kind == STAGGERED:
                u, v = (k - k0 + (sy + 0.5) / down) / (k1 - k0), (k1 - (k - k0 + 0.5)) / count
            points[k, 0], points[k, 1], points[k, 2] = column + u, row + v, share * cell_area


@jit
def fill_row(
    row, n, write, inner, first_span, last_span, piece, first_piece, last_piece, kind, n0, beta, tile_rows, slope,
    slope_map, seed, row0, column0, cell_area, place, bed, bed_map, thick, thick_map, law, position, columns, sums,
):  # fmt: skip
    """Particles of one row of the lattice, written from n on: whole cells tiled, rim pieces as they are."""
    largest = tile_rows.size - 1
    points = np.empty((max(largest, last_piece - first_piece), 3))
    corners = np.empty((2 * largest + 2 if kind == JITTERED else 0, 2))
    for s in range(first_span, last_span):
        for column in range(inner[s, 1], inner[s, 2]):
            count = cell_count(n0, beta, slope, slope_map, row, column, seed, row0, column0, largest)
            cell_points(points, corners, row, column, count, tile_rows[count], kind, seed, row0, column0, cell_area)
            evaluate(points, count, n, write, place, bed, bed_map, thick, thick_map, law, position, columns, sums)
            n += count
    count = last_piece - first_piece
    for p in range(count):
        points[p, 0], points[p, 1] = piece[first_piece + p, 0], piece[first_piece + p, 1]
        points[p, 2] = piece[first_piece + p, 2] * cell_area
    evaluate(points, count, n, write, place, bed, bed_map, thick, thick_map, law, position, columns, sums)


@jit_parallel
def fill_rows(
    first, last, write, offsets, inner, inner_start, piece, piece_start, kind, n0, beta, tile_rows, slope, slope_map,
    seed, row0, column0, cell_area, place, bed, bed_map, thick, thick_map, law, position, columns,
):  # fmt: skip
    """`fill_row` of the lattice rows first <= row < last; a whole cell of K particles has ``tile_rows[K]`` rows.

    Returns
    -------
    float64[last - first, 3]
        Sum, smallest and largest of thickness times area [m3] before closure, a row.
    """
    sums = np.zeros((last - first, 3))
    sums[:, 1] = np.inf
    for r in prange(last - first):
        row = first + r
        fill_row(
            row, offsets[r], write, inner, inner_start[row], inner_start[row + 1], piece, piece_start[row],
            piece_start[row + 1], kind, n0, beta, tile_rows, slope, slope_map, seed, row0, column0, cell_area, place,
            bed, bed_map, thick, thick_map, law, position, columns, sums[r],
        )  # fmt: skip
    return sums


@jit
def integrate_cover(values, rim_key, rim, spans, columns, row0, column0):
    """(sum of h, sum of h^2, covered area), in cells, of pixel `values` over an exact cover (D13).

    A whole pixel counts with its value, a cut one with the value at the centroid of what is left of it. Pixel
    (0, 0) of `values` is cell (-row0, -column0) of the cover's window.
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


# ------------------------------------------------------------------------------------------------ Halton's points


@jit_inline
def _in_whole_cell(u, v, columns, spans, span_start):
    """Is (u, v) in a cell that the polygon covers whole?"""
    row, column = math.floor(v), math.floor(u)
    if row < 0 or row >= span_start.size - 1 or column < 0 or column >= columns:
        return False
    return _in_span(spans, span_start[row], span_start[row + 1], column)


@jit
def covered(u, v, columns, rim_key, rim_start, spans, span_start, edges, edge_start, edge_index):
    """Is (u, v) inside the polygon? Whole cells are known; only in rim cells are edges asked.

    Kernels ask `_in_whole_cell` first: a call with so many arrays costs more than that answer.
    """
    if _in_whole_cell(u, v, columns, spans, span_start):
        return True
    row, column = math.floor(v), math.floor(u)
    if row < 0 or row >= rim_start.size - 1 or column < 0 or column >= columns:
        return False
    if _find(rim_key, rim_start[row], rim_start[row + 1], row * columns + column) < 0:
        return False
    return is_inside(u, v, edges, edge_start, edge_index)


@jit
def halton_chunk(
    index, size, quota, shift, box, columns, rim_key, rim_start, spans, span_start, edges, edge_start, edge_index, beta,
    slope, slope_map, seed, area, points,
):  # fmt: skip
    """Fill points float64[:, 3] (u, v, area [m2]) with those of `size` Halton points from `index` on that lie inside.

    Returns
    -------
    taken, weights : int, float
        Their number (at most `quota`) and sum of weights.
    """
    taken, weights = 0, 0.0
    for k in range(index, index + size):
        if taken >= quota:
            break
        s, t = halton(k)
        s, t = s + shift[0], t + shift[1]
        u, v = box[0] + box[2] * (s - math.floor(s)), box[1] + box[3] * (t - math.floor(t))
        if not _in_whole_cell(u, v, columns, spans, span_start) and not covered(
            u, v, columns, rim_key, rim_start, spans, span_start, edges, edge_start, edge_index
        ):
            continue
        weight = 1.0
        if beta > 0.0:
            i, j = _at(slope_map, u, v)
            density = 1.0 + beta * min(valid_at(slope, i, j), 1.0)
            if uniform(seed, k, 7, 7) * (1.0 + beta) >= density:
                continue
            weight = 1.0 / density
        points[taken, 0], points[taken, 1], points[taken, 2] = u, v, weight * area
        taken += 1
        weights += weight
    return taken, weights


@jit_parallel
def halton_chunks(
    first, last, size, quota, write, offsets, shift, box, columns, rim_key, rim_start, spans, span_start, edges,
    edge_start, edge_index, beta, slope, slope_map, seed, area, place, bed, bed_map, thick, thick_map, law, position,
    out,
):  # fmt: skip
    """Points of Halton's sequence (bases 2 and 3, shifted) inside a polygon; chunks of `size` indices.

    With `beta` a point survives with the probability (1 + beta min(tan slope, 1)) / (1 + beta) and stands for an area
    in inverse proportion (design note D14). `area` [m2] is that of a point of weight 1; `quota` int64[chunks] the most
    points that a chunk gives; `box` is (u0, v0, width, height).

    Returns
    -------
    float64[last - first, 5]
        Sum, smallest and largest of thickness times area [m3] of a chunk, its points, sum of their weights.
    """
    sums = np.zeros((last - first, 5))
    sums[:, 1] = np.inf
    for c in prange(last - first):
        points = np.empty((size, 3))
        taken, weights = halton_chunk(
            (first + c) * size + 1, size, quota[first + c], shift, box, columns, rim_key, rim_start, spans, span_start,
            edges, edge_start, edge_index, beta, slope, slope_map, seed, area, points,
        )  # fmt: skip
        evaluate(points, taken, offsets[c], write, place, bed, bed_map, thick, thick_map, law, position, out, sums[c])
        sums[c, 3], sums[c, 4] = taken, weights
    return sums


# ----------------------------------------------------------------------------------------------------- equal mass


@jit
def cover_row_sum(row, columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map, sums):
    """Fill sums float64[2]: sum of thickness times covered share, and of covered share, of a row of cells."""
    for s in range(span_start[row], span_start[row + 1]):
        for column in range(spans[s, 1], spans[s, 2]):
            i, j = _at(thick_map, column + 0.5, row + 0.5)
            sums[0] += valid_at(thick, i, j)
            sums[1] += 1.0
    for m in range(rim_start[row], rim_start[row + 1]):
        i, j = _at(thick_map, rim_key[m] - row * columns + rim[m, 1], row + rim[m, 2])
        sums[0] += valid_at(thick, i, j) * rim[m, 0]
        sums[1] += rim[m, 0]


@jit_parallel
def cover_row_sums(rows, columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map):
    """float64[rows, 2]: `cover_row_sum` of every row of cells."""
    sums = np.zeros((rows, 2))
    for row in prange(rows):
        cover_row_sum(np.int64(row), columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map, sums[row])
    return sums


@jit_inline
def _add_cell(sums, column, u, v, mass):
    sums[0, column] += mass
    sums[1, column] += mass * u
    sums[2, column] += mass * v


@jit
def strip_columns(v0, v1, columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map):
    """float64[3, columns]: thickness times area, and its u- and v-moment, of each column of cells of a strip."""
    sums = np.zeros((3, columns))
    for row in range(math.floor(v0), math.ceil(v1)):
        low, high = max(v0, row), min(v1, row + 1.0)
        share = high - low
        if share <= 0.0:
            continue
        middle = 0.5 * (low + high)
        for s in range(span_start[row], span_start[row + 1]):
            for column in range(spans[s, 1], spans[s, 2]):
                i, j = _at(thick_map, column + 0.5, row + 0.5)
                _add_cell(sums, column, column + 0.5, middle, share * valid_at(thick, i, j))
        for m in range(rim_start[row], rim_start[row + 1]):
            column = rim_key[m] - row * columns
            u = column + rim[m, 1]
            i, j = _at(thick_map, u, row + rim[m, 2])
            v = min(max(middle + rim[m, 2] - 0.5, low), high)
            _add_cell(sums, column, u, v, share * rim[m, 0] * valid_at(thick, i, j))
    return sums


@jit_inline
def _thickest(column, v0, v1, columns, rim_key, rim, rim_start, spans, span_start):
    """A point inside the polygon in the cell of `column` that the strip covers most."""
    best, u, v = -1.0, 0.0, 0.0
    for row in range(math.floor(v0), math.ceil(v1)):
        share = min(v1, row + 1.0) - max(v0, row)
        at = _find(rim_key, rim_start[row], rim_start[row + 1], row * columns + column)
        if at >= 0 and share * rim[at, 0] > best:
            best, u, v = share * rim[at, 0], column + rim[at, 1], row + rim[at, 2]
        elif at < 0 and share > best and _in_span(spans, span_start[row], span_start[row + 1], column):
            best, u, v = share, column + 0.5, row + 0.5
    return u, v


@jit
def cut_equal(sums, count, quantile):
    """Cut a strip's columns into `count` pieces of equal mass, from left to right.

    Returns
    -------
    float64[count, 4]
        Centroid (u, v), the u below which `quantile[i]` of the piece's mass lies, the column at its median.
    """
    columns = sums.shape[1]
    pieces = np.zeros((count, 4))
    each = sums[0].sum() / count
    i, filled = 0, 0.0
    for column in range(columns):
        mass = sums[0, column]
        if mass <= 0.0:
            continue
        inverse = 1.0 / mass
        u, v, used = sums[1, column] * inverse, sums[2, column] * inverse, 0.0
        half = min(u - column, column + 1.0 - u)
        scale = 2.0 * half * inverse
        while used < mass and i < count:
            part = mass - used
            if filled + part > each and i < count - 1:
                part = each - filled
            low, high = u - half + scale * used, u - half + scale * (used + part)
            pieces[i, 0] += part * 0.5 * (low + high)
            pieces[i, 1] += part * v
            if filled <= quantile[i] * each:
                share = min(max((quantile[i] * each - filled) / part, 0.0), 1.0) if part > 0.0 else 0.0
                pieces[i, 2] = low + share * (high - low)
            if filled <= 0.5 * each:
                pieces[i, 3] = column
            filled += part
            used += part
            if filled >= each and i < count - 1:
                pieces[i, 0] /= filled
                pieces[i, 1] /= filled
                i += 1
                filled = 0.0
            elif part <= 0.0:
                break
    if filled > 0.0:
        pieces[i, 0] /= filled
        pieces[i, 1] /= filled
    return pieces


@jit
def strip_points(
    strip, v0, v1, count, start, spread, sequence, seed, shift, columns, rim_key, rim, rim_start, spans, span_start,
    edges, edge_start, edge_index, thick, thick_map,
):  # fmt: skip
    """float64[count, 3]: (u, v, 0) of a strip's columns of equal mass; see `fill_strips`."""
    across, up = np.full(count, 0.5), np.full(count, 0.5)
    if spread > 0.0:
        for k in range(count):
            if sequence:
                a, b = halton(start + k + 1)
                a, b = a + shift[0], b + shift[1]
                a, b = a - math.floor(a), b - math.floor(b)
            else:
                a, b = uniform(seed, strip, k, 0), uniform(seed, strip, k, 1)
            across[k], up[k] = 0.5 + spread * (a - 0.5), 0.5 + spread * (b - 0.5)
    sums = strip_columns(v0, v1, columns, rim_key, rim, rim_start, spans, span_start, thick, thick_map)
    pieces = cut_equal(sums, count, across)
    points = np.zeros((count, 3))
    for k in range(count):
        u, v = pieces[k, 0], pieces[k, 1]
        if spread > 0.0:
            u, v = pieces[k, 2], v0 + up[k] * (v1 - v0)
        if not _in_whole_cell(u, v, columns, spans, span_start) and not covered(
            u, v, columns, rim_key, rim_start, spans, span_start, edges, edge_start, edge_index
        ):
            u, v = _thickest(np.int64(pieces[k, 3]), v0, v1, columns, rim_key, rim, rim_start, spans, span_start)
        points[k, 0], points[k, 1] = u, v
    return points


@jit_parallel
def fill_strips(
    first, last, write, borders, counts, offsets, start, spread, sequence, seed, shift, columns, rim_key, rim,
    rim_start, spans, span_start, edges, edge_start, edge_index, place, bed, bed_map, thick, thick_map,
    law, position, out,
):  # fmt: skip
    """Columns of equal mass: every strip borders[s] <= v < borders[s + 1] is cut into counts[s] pieces.

    With `spread` 0 a column lies at its piece's centroid; otherwise at a place of the piece: random numbers (or
    Halton's, if `sequence`) pick the quantile of mass along the strip and the height in it, over the middle `spread` of
    both. What would fall outside the polygon goes to the thickest cell at the piece's median.
    """
    sums = np.zeros((last - first, 3))
    for c in prange(last - first):
        s = first + c
        points = strip_points(
            s, borders[s], borders[s + 1], counts[s], start[s], spread, sequence, seed, shift, columns, rim_key, rim,
            rim_start, spans, span_start, edges, edge_start, edge_index, thick, thick_map,
        )  # fmt: skip
        evaluate(
            points, counts[s], offsets[c], write, place, bed, bed_map, thick, thick_map, law, position, out, sums[c]
        )
