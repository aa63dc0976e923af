"""Batches of points: lines of one scratch array, copied from the rows of points and back, with their weights."""

import numpy as np

from . import point_lines as line
from .jit import kernel_part
from .lanes import get, load, prefetch, put, store, transposed
from .point_lines import BATCH
from .point_rows import INDEX_MASK, MASS, S1, S2, S3, S4, TILE_LAYER, TILE_ROW, X, Y, Z, stencil

# as floats, for products with floats
FLOAT_LAYER, FLOAT_ROW = float(TILE_LAYER), float(TILE_ROW)


@kernel_part
def weigh(scratch, integers):
    """Weights of each point of the batch, its offsets in cells, and the index of its first node in the tile."""
    for q in range(BATCH):
        i, fx, wx0, wx1, wx2 = stencil(get(scratch, line.X, q))
        j, fy, wy0, wy1, wy2 = stencil(get(scratch, line.Y, q))
        k, fz, wz0, wz1, wz2 = stencil(get(scratch, line.Z, q))
        put(integers, line.I_PLACE, q, np.int32(k * FLOAT_LAYER + j * FLOAT_ROW + i * 4.0))
        put(scratch, line.FX, q, fx)
        put(scratch, line.FY, q, fy)
        put(scratch, line.FZ, q, fz)
        put(scratch, line.WX0, q, wx0)
        put(scratch, line.WX1, q, wx1)
        put(scratch, line.WX2, q, wx2)
        put(scratch, line.WY0, q, wy0)
        put(scratch, line.WY1, q, wy1)
        put(scratch, line.WY2, q, wy2)
        put(scratch, line.WZ0, q, wz0)
        put(scratch, line.WZ1, q, wz1)
        put(scratch, line.WZ2, q, wz2)


@kernel_part
def _prefetch_batch(rows, order, first):
    """Prefetch the rows of the batch after the one that starts at `first`."""
    row = rows.shape[1]
    for q in range(first + BATCH, min(first + 2 * BATCH, order.size)):
        p = (order[q] & INDEX_MASK) * row
        prefetch(rows, p)
        prefetch(rows, p + 8)
        prefetch(rows, p + row - 1)


@kernel_part
def take_places(rows, order, first, count, scratch):
    """Copy the places of points order[first : first + count] into lines; the next batch is prefetched."""
    _prefetch_batch(rows, order, first)
    row = rows.shape[1]
    for q in range(count):
        p = (order[first + q] & INDEX_MASK) * row
        put(scratch, line.X, q, get(rows, p, X))
        put(scratch, line.Y, q, get(rows, p, Y))
        put(scratch, line.Z, q, get(rows, p, Z))


@kernel_part
def take_rows(rows, order, first, count, scratch):
    """Copy place, mass and state of points order[first : first + count] into lines; the next batch is prefetched."""
    _prefetch_batch(rows, order, first)
    row, last = rows.shape[1], count - 1
    for q in range(0, BATCH, 4):  # beyond `count` the last point again
        p0 = (order[first + min(q, last)] & INDEX_MASK) * row
        p1 = (order[first + min(q + 1, last)] & INDEX_MASK) * row
        p2 = (order[first + min(q + 2, last)] & INDEX_MASK) * row
        p3 = (order[first + min(q + 3, last)] & INDEX_MASK) * row
        x, y, z, s0 = transposed(load(rows, p0), load(rows, p1), load(rows, p2), load(rows, p3))
        store(scratch, line.X + q, x)
        store(scratch, line.Y + q, y)
        store(scratch, line.Z + q, z)
        store(scratch, line.S0 + q, s0)
        if row > S4:
            s4, s5, s6, s7 = transposed(
                load(rows, p0 + S4), load(rows, p1 + S4), load(rows, p2 + S4), load(rows, p3 + S4)
            )
            store(scratch, line.S4 + q, s4)
            store(scratch, line.S5 + q, s5)
            store(scratch, line.S6 + q, s6)
            store(scratch, line.S7 + q, s7)
    for q in range(BATCH):
        p = (order[first + min(q, last)] & INDEX_MASK) * row
        put(scratch, line.MASS, q, get(rows, p, MASS))
        put(scratch, line.S1, q, get(rows, p, S1))
        put(scratch, line.S2, q, get(rows, p, S2))
        put(scratch, line.S3, q, get(rows, p, S3))


@kernel_part
def give_rows(rows, order, first, count, scratch):
    """Copy the lines into the rows of points order[first : first + count]."""
    row, last = rows.shape[1], count - 1
    for q in range(0, count, 4):
        # beyond `count` the last point again; its own numbers are stored last
        p0 = (order[first + q] & INDEX_MASK) * row
        p1 = (order[first + min(q + 1, last)] & INDEX_MASK) * row
        p2 = (order[first + min(q + 2, last)] & INDEX_MASK) * row
        p3 = (order[first + min(q + 3, last)] & INDEX_MASK) * row
        for group in range(6 if row > S4 else 5):
            head, fourth = _lines_of_group(group)
            a, b, c, d = transposed(
                load(scratch, head + q), load(scratch, head + BATCH + q), load(scratch, head + 2 * BATCH + q),
                load(scratch, fourth + q),
            )  # fmt: skip
            store(rows, p3 + 4 * group, d)
            store(rows, p2 + 4 * group, c)
            store(rows, p1 + 4 * group, b)
            store(rows, p0 + 4 * group, a)


@kernel_part
def _lines_of_group(group):
    """Lines of the first three numbers and of the fourth of a group of four in a row."""
    head = line.X + group * 4 * BATCH
    fourth = line.MASS
    if group == 0:
        fourth = line.N0
    elif group == 2:
        fourth = line.N1
    elif group == 3:
        fourth = line.N2
    elif group == 4:
        fourth = line.N3
    elif group == 5:
        head, fourth = line.N4, line.N7
    return head, fourth
