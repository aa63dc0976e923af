"""Columns in memory: rows of numbers, their weights on the nodes, batches of them, blocks.

Columns are rows of consecutive floats. Nodes lie on cell corners: array index k + 1 is the node at k * dx from the
domain's south-west corner, so that there is one ghost node outside each edge. Weights are quadratic B-splines
(Steffen et al. 2008).
"""

from typing import NamedTuple

import numpy as np

from ...compiled import law_methods as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS, GONE, rank_blocks
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from ...compiled.lanes import load, prefetch, store, transposed

# columns of a particle's row
X, Y, U, V, CXX, CXY, CYX, CYY, MASS, AREA, GX, GY, ROW = range(13)
# entries of a node: mass [kg]; momentum, then velocity, east and north; the kinetic energy [J] that the columns bring,
# then the share of mass gained by erosion
NODE_MASS, NODE_X, NODE_Y, NODE_GAIN = range(4)
NODE_KINETIC = NODE_GAIN

BLOCK = 8  # nodes along a block's side
TILE = BLOCK + 2  # a particle of the block reaches two nodes further
INDEX_MASK = 0x3FFFFFFF  # shows the compiler that an index is not negative, which spares a test for each access
# Columns go through a transfer BATCH at a time: in loops over short arrays ("lines" of one scratch array), which the
# compiler vectorises; only nodes and rows are read and written column by column.
BATCH = 32
(
    L_X,
    L_Y,
    L_U,
    L_V,
    L_CXX,
    L_CXY,
    L_CYX,
    L_CYY,
    L_MASS,
    L_AREA,
    L_GX,
    L_GY,  # as in a row
    L_WX0,
    L_WX1,
    L_WX2,
    L_WY0,
    L_WY1,
    L_WY2,  # weights
    L_SX,
    L_MX,
    L_SY,
    L_MY,  # offset from the middle node, and factor of second differences in a moment
    L_GX0,
    L_GX1,
    L_GX2,
    L_GY0,
    L_GY1,
    L_GY2,  # slopes of weights
    L_SPEED2,
    L_HORIZONTAL2,
    L_SIGNAL2,
    L_BOUND,
    L_GAINED,
    L_WORK,
    L_TAKEN,
    L_BENT,
) = range(0, 36 * BATCH, BATCH)
LINES = 36 * BATCH
QUAD = 4 * BATCH  # groups of four numbers, one group a column
QUADS = 6 * QUAD
# groups of four: mean of the nodes' entries, their slopes and moments; the bed's rows under a column
Q_MEAN, Q_ALONG_X, Q_ALONG_Y, Q_MOMENT_X, Q_MOMENT_Y = range(0, 5 * QUAD, QUAD)
Q_BED, Q_BED_SLOPE = Q_MEAN, Q_ALONG_X
SORT_ROWS = 8192  # rows per piece of the sort, at most CHUNKS pieces


class BlockWindow(NamedTuple):
    """Window of the blocks with columns."""

    west: int  # block column of its first blocks
    south: int  # block row of its first blocks
    width: int  # [blocks]
    height: int  # [blocks]


class SortedColumns(NamedTuple):
    """Columns in the order of their blocks (see `sort_by_block`)."""

    order: np.ndarray  # int32[n]; indices of columns
    start: np.ndarray  # int64[blocks with columns + 1]; where the columns of each block begin in the order
    block: np.ndarray  # int32[blocks with columns]; place of each block in the window
    bounds: np.ndarray  # int64[CHUNKS + 1]; first block of each piece of work


class TouchedBlocks(NamedTuple):
    """Blocks of nodes that columns reach (see `touched_blocks`).

    The window is not a BlockWindow here, because numba passes no record within a record to a parallel loop.
    """

    places: np.ndarray  # int32[at least count]; in the window with one more column of blocks
    count: int
    west: int  # window of the blocks with columns
    south: int
    width: int
    height: int


@jit_inline
def first_node(touched, k):
    """Return the row and the column of the first node of touched block `k`."""
    row, column = touched.places[k] // (touched.width + 1), touched.places[k] % (touched.width + 1)
    return (row + touched.south) * BLOCK, (column + touched.west) * BLOCK


@jit_inline
def weights(position, inverse_dx):
    """Base index in the node array, offset in it, and the three quadratic B-spline weights of one axis."""
    s = position * inverse_dx
    base = int(s + 0.5) & INDEX_MASK  # to the letter as in the block keys, so that both round alike
    f = s + 1.0 - base
    return base, f, 0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2


@jit_inline
def bed_at(bed, x, y, inverse_dx):
    """Bed elevation [m] and its gradient at (x, y) [m]: b = sum b_i N_i, grad b = sum b_i grad N_i."""
    i0, fx, wx0, wx1, wx2 = weights(x, inverse_dx)
    j0, fy, wy0, wy1, wy2 = weights(y, inverse_dx)
    dx0, dx1, dx2 = fx - 1.5, 2.0 - 2.0 * fx, fx - 0.5
    dy0, dy1, dy2 = fy - 1.5, 2.0 - 2.0 * fy, fy - 0.5
    b00, b01, b02 = bed[j0, i0], bed[j0, i0 + 1], bed[j0, i0 + 2]
    b10, b11, b12 = bed[j0 + 1, i0], bed[j0 + 1, i0 + 1], bed[j0 + 1, i0 + 2]
    b20, b21, b22 = bed[j0 + 2, i0], bed[j0 + 2, i0 + 1], bed[j0 + 2, i0 + 2]
    r0 = wx0 * b00 + wx1 * b01 + wx2 * b02
    r1 = wx0 * b10 + wx1 * b11 + wx2 * b12
    r2 = wx0 * b20 + wx1 * b21 + wx2 * b22
    g0 = dx0 * b00 + dx1 * b01 + dx2 * b02
    g1 = dx0 * b10 + dx1 * b11 + dx2 * b12
    g2 = dx0 * b20 + dx1 * b21 + dx2 * b22
    value = wy0 * r0 + wy1 * r1 + wy2 * r2
    gradient_x = (wy0 * g0 + wy1 * g1 + wy2 * g2) * inverse_dx
    gradient_y = (dy0 * r0 + dy1 * r1 + dy2 * r2) * inverse_dx
    return value, gradient_x, gradient_y


@jit
def beds_at(bed, x, y, dx):
    """`bed_at` for arrays of points: elevation, gradient east, gradient north."""
    value, gradient_x, gradient_y = np.empty(x.size), np.empty(x.size), np.empty(x.size)
    for p in range(x.size):
        value[p], gradient_x[p], gradient_y[p] = bed_at(bed, x[p], y[p], 1.0 / dx)
    return value, gradient_x, gradient_y


@jit
def grid_areas(rows, shape, dx):
    """Area [m2] with which each column would have the thickness of the grid at its place: m / (rho h_g)."""
    mass = np.zeros(shape)
    share = np.zeros((2, 3))
    areas = np.empty(rows.shape[0])
    for reading in range(2):
        for p in range(rows.shape[0]):
            i0, _, share[0, 0], share[0, 1], share[0, 2] = weights(rows[p, X], 1.0 / dx)
            j0, _, share[1, 0], share[1, 1], share[1, 2] = weights(rows[p, Y], 1.0 / dx)
            here = 0.0
            for j in range(3):
                for i in range(3):
                    if reading:
                        here += share[0, i] * share[1, j] * mass[j0 + j, i0 + i]
                    else:
                        mass[j0 + j, i0 + i] += share[0, i] * share[1, j] * rows[p, MASS]
            if reading:
                areas[p] = rows[p, MASS] * dx * dx / here
    return areas


@jit
def settle_areas(rows, keys, gone, marked, first_row, first_column, mirrors, dx, density, least, tilted):
    """Set the area of the columns in marked cells to m / (rho h_g): as thick as the grid sees all of them together.

    Overlapping columns are each too thin and push too little (the push is the sum of A h^2).

    Parameters
    ----------
    rows, keys : float64[n, :], int32[n]
        A column with the key `gone` has left.
    marked : uint8[a, b]
        A window of cells from [first_row, first_column] on.
    mirrors : int64[4]
        Indices of the ghost nodes behind walls, west, south, east, north; far outside where the edge is open.
    dx : float [m]
    density : float [kg m-3]
    least : float
        Only columns that become at least so many times as thick; 0 for all.
    tilted : bool
        Thickness is normal to the bed: the middle of a column is c^2 h / 2 above the bed, not h / 2.

    Returns
    -------
    (float, float, float)
        The thickest of these columns [m], its |u| [m s-1] at most, and the sum of m c^2 (h after - h before) [kg m].
    """
    height, width = marked.shape[0] + 8, marked.shape[1] + 8
    south, west = first_row - 2, first_column - 2  # nodes, and base nodes of columns, that affect the window
    mass = np.zeros((height, width))
    share = np.zeros((2, 3))
    thickest, fastest, lifted = 0.0, 0.0, 0.0
    for reading in range(2):
        for p in range(rows.shape[0]):
            if keys[p] == gone:
                continue
            i0, _, share[0, 0], share[0, 1], share[0, 2] = weights(rows[p, X], 1.0 / dx)
            j0, _, share[1, 0], share[1, 1], share[1, 2] = weights(rows[p, Y], 1.0 / dx)
            i0, j0 = i0 - west, j0 - south
            if i0 < 0 or j0 < 0 or i0 + 2 >= width or j0 + 2 >= height:
                continue
            if not reading:
                for j in range(3):
                    for i in range(3):
                        mass[j0 + j, i0 + i] += share[0, i] * share[1, j] * rows[p, MASS]
                continue
            cell_row, cell_column = int(rows[p, Y] / dx) - first_row, int(rows[p, X] / dx) - first_column
            if cell_row < 0 or cell_column < 0 or cell_row >= marked.shape[0] or cell_column >= marked.shape[1]:
                continue
            if marked[cell_row, cell_column]:
                here = 0.0
                for j in range(3):
                    for i in range(3):
                        here += share[0, i] * share[1, j] * mass[j0 + j, i0 + i]
                before, after = rows[p, MASS] / (density * rows[p, AREA]), here / (density * dx * dx)
                if after >= least * before:
                    rows[p, AREA] = rows[p, MASS] / (density * after)
                    steep = rows[p, GX] ** 2 + rows[p, GY] ** 2 if tilted else 0.0
                    lifted += rows[p, MASS] * (after - before) / (1.0 + steep)
                    thickest = max(thickest, after)
                    fastest = max(fastest, np.hypot(rows[p, U], rows[p, V]))
        if not reading:
            _mirror_mass(mass.T, mirrors[0] - west, 1)
            _mirror_mass(mass, mirrors[1] - south, 1)
            _mirror_mass(mass.T, mirrors[2] - west, -1)
            _mirror_mass(mass, mirrors[3] - south, -1)
    return thickest, fastest, lifted


@jit
def _mirror_mass(lines, ghost, inwards):
    """Fold the mass of one wall's ghost nodes inwards and mirror it, as the grid does at walls each step."""
    if min(ghost, ghost + 2 * inwards) >= 0 and max(ghost, ghost + 2 * inwards) < lines.shape[0]:
        for k in range(lines.shape[1]):
            lines[ghost + inwards, k] *= 2.0
            lines[ghost + 2 * inwards, k] += lines[ghost, k]
            lines[ghost, k] = lines[ghost + 2 * inwards, k]


@jit_inline
def bending_at(bed, j, i, inverse_dx):
    """Hessian (xx, xy, yy) [m-1] of the spline bed at node (j, i), as its nine coefficients give it."""
    south, north = max(j - 1, 0), min(j + 1, bed.shape[0] - 1)
    west, east = max(i - 1, 0), min(i + 1, bed.shape[1] - 1)
    square = inverse_dx * inverse_dx
    xx_south = bed[south, west] - 2.0 * bed[south, i] + bed[south, east]
    xx_here = bed[j, west] - 2.0 * bed[j, i] + bed[j, east]
    xx_north = bed[north, west] - 2.0 * bed[north, i] + bed[north, east]
    yy_west = bed[south, west] - 2.0 * bed[j, west] + bed[north, west]
    yy_here = bed[south, i] - 2.0 * bed[j, i] + bed[north, i]
    yy_east = bed[south, east] - 2.0 * bed[j, east] + bed[north, east]
    xy = 0.25 * (bed[north, east] - bed[north, west] - bed[south, east] + bed[south, west])
    xx = 0.125 * (xx_south + xx_north) + 0.75 * xx_here
    yy = 0.125 * (yy_west + yy_east) + 0.75 * yy_here
    return xx * square, xy * square, yy * square


@jit
def node_gradients(bed, dx):
    """float64[ny, nx, 2]: gradient of the spline bed at the nodes themselves (zero on the outermost ring)."""
    gradient = np.zeros((bed.shape[0], bed.shape[1], 2))
    for j in range(1, bed.shape[0] - 1):
        for i in range(1, bed.shape[1] - 1):
            _, gradient[j, i, 0], gradient[j, i, 1] = bed_at(bed, (i - 1) * dx, (j - 1) * dx, 1.0 / dx)
    return gradient


@jit
def take_rows(rows, order, first, count, end, scratch, moved):
    """Copy the rows of columns order[first : first + count] into the lines of `scratch`, four columns at a time.

    Without the affine velocity if `moved` is False. The rows of the next batch, up to place `end` in the order, are
    prefetched while this one is computed.
    """
    for q in range(first + BATCH, min(first + 2 * BATCH, end)):
        p = (order[q] & INDEX_MASK) * ROW
        prefetch(rows, p)
        prefetch(rows, p + ROW - 1)
    for k in range(0, count, 4):  # beyond `count` the last column again, which is not used
        last = count - 1
        p0 = (order[first + k] & INDEX_MASK) * ROW
        p1 = (order[first + min(k + 1, last)] & INDEX_MASK) * ROW
        p2 = (order[first + min(k + 2, last)] & INDEX_MASK) * ROW
        p3 = (order[first + min(k + 3, last)] & INDEX_MASK) * ROW
        for e in range(0, ROW, 4 if moved else 8):
            a, b, c, d = transposed(load(rows, p0 + e), load(rows, p1 + e), load(rows, p2 + e), load(rows, p3 + e))
            line = e * BATCH + k
            store(scratch, line, a)
            store(scratch, line + BATCH, b)
            store(scratch, line + 2 * BATCH, c)
            store(scratch, line + 3 * BATCH, d)


@jit_inline
def block_key(x, y, inverse_dx):
    """Block of a particle, its row in the high and its column in the low 16 bits."""
    return ((int(y * inverse_dx + 0.5) // BLOCK) << 16) | (int(x * inverse_dx + 0.5) // BLOCK)


def rows_and_columns(keys):
    """(int[n], int[n]): block row and block column of `keys`."""
    return keys >> 16, keys & 0xFFFF


@jit
def initial_keys(rows, keys, dx):
    """Fill `keys` for all `rows`; returns the window of blocks (west, south, east, north)."""
    west, south, east, north = 1 << 16, 1 << 16, -1, -1
    for p in range(rows.shape[0]):
        key = block_key(rows[p, X], rows[p, Y], 1.0 / dx)
        keys[p] = key
        west, east = min(west, key & 0xFFFF), max(east, key & 0xFFFF)
        south, north = min(south, key >> 16), max(north, key >> 16)
    return west, south, east, north


@jit_parallel
def _count(keys, n, pieces, window, size, histogram):
    west, south, width = window.west, window.south, window.width
    for c in prange(pieces):
        for b in range(size):
            histogram[c, b] = 0
        for p in range(c * n // pieces, (c + 1) * n // pieces):
            if keys[p] != GONE:
                histogram[c, ((keys[p] >> 16) - south) * width + (keys[p] & 0xFFFF) - west] += 1


@jit_parallel
def _scatter(keys, n, pieces, window, histogram, order):
    west, south, width = window.west, window.south, window.width
    for c in prange(pieces):
        for p in range(c * n // pieces, (c + 1) * n // pieces):
            if keys[p] != GONE:
                b = ((keys[p] >> 16) - south) * width + (keys[p] & 0xFFFF) - west
                order[histogram[c, b]] = p
                histogram[c, b] += 1


@jit
def sort_by_block(keys, n, window, histogram, slot, sorted_columns):
    """Stable counting sort of indices by block.

    Fills `order`; `slot[b]` is the active block at place b of the window or -1, `block[a]` its place,
    `start[a]`..`start[a + 1]` its particles. Answers (active blocks, particles alive).
    """
    size = window.width * window.height
    pieces = min(CHUNKS, n // SORT_ROWS + 1)
    _count(keys, n, pieces, window, size, histogram)
    active, total = rank_blocks(histogram, pieces, size, slot, sorted_columns.block, sorted_columns.start)
    _scatter(keys, n, pieces, window, histogram, sorted_columns.order)
    return active, total


@jit
def comes_near(touched, watched):
    """Is one of the touched blocks marked in `watched` uint8[block rows, block columns]?"""
    for k in range(touched.count):
        j, i = first_node(touched, k)
        row, column = j // BLOCK, i // BLOCK
        if row < watched.shape[0] and column < watched.shape[1] and watched[row, column] != 0:
            return True
    return False


@jit
def touched_blocks(slot, window, places):
    """List the node blocks that active tiles reach (themselves and their east, north, north-east neighbours)."""
    width, height = window.width, window.height
    count = 0
    for bj in range(height + 1):
        for bi in range(width + 1):
            hit = False
            for oj in range(bj - 1, bj + 1):
                for oi in range(bi - 1, bi + 1):
                    if 0 <= oi < width and 0 <= oj < height and slot[oj * width + oi] >= 0:
                        hit = True
            if hit:
                places[count] = bj * (width + 1) + bi
                count += 1
    return count
