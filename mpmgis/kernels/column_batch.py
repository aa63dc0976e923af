"""Batches of columns: lines of one scratch array, which the compiler turns into vector instructions."""

from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .column_rows import INDEX_MASK, ROW
from .jit import jit
from .lanes import load, prefetch, store, transposed

# Columns go through a transfer BATCH at a time: in loops over short arrays ("lines" of one scratch array), which the
# compiler vectorises; only nodes and rows are read and written column by column.
BATCH = 32
(
    L_X, L_Y, L_U, L_V, L_CXX, L_CXY, L_CYX, L_CYY, L_MASS, L_AREA, L_GX, L_GY,  # as in a row
    L_WX0, L_WX1, L_WX2, L_WY0, L_WY1, L_WY2,  # weights
    L_SX, L_MX, L_SY, L_MY,  # offset from the middle node, and factor of second differences in a moment
    L_GX0, L_GX1, L_GX2, L_GY0, L_GY1, L_GY2,  # slopes of weights
    L_SPEED2, L_HORIZONTAL2, L_SIGNAL2, L_BOUND, L_GAINED, L_WORK, L_TAKEN, L_BENT,
) = range(0, 36 * BATCH, BATCH)  # fmt: skip
LINES = 36 * BATCH
QUAD = 4 * BATCH  # groups of four numbers, one group a column
QUADS = 6 * QUAD


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


# groups of four: mean of the nodes' entries, their slopes and moments; the bed's rows under a column
Q_MEAN, Q_ALONG_X, Q_ALONG_Y, Q_MOMENT_X, Q_MOMENT_Y = range(0, 5 * QUAD, QUAD)
Q_BED, Q_BED_SLOPE = Q_MEAN, Q_ALONG_X
