"""Columns in memory: rows of numbers, entries of a node, and lines of a batch of columns."""

import numpy as np

from ...compiled.jit import jit, jit_inline
from ...compiled.simd_lanes import load, prefetch, store, transposed
from .spline_weights import INDEX_MASK

# numbers of a column's row
(
    X,  # [m] from the domain's south-west corner to the east
    Y,  # [m] to the north
    U,  # [m s-1] horizontal velocity to the east
    V,  # [m s-1] to the north
    CXX,  # [s-1] affine velocity du/dx
    CXY,  # [s-1] du/dy
    CYX,  # [s-1] dv/dx
    CYY,  # [s-1] dv/dy
    MASS,  # [kg]
    AREA,  # [m2] horizontal
    GX,  # [1] slope of the bed under the column to the east
    GY,  # [1] to the north
    ROW,
) = range(13)
# entries of a node
NODE_MASS = 0  # [kg]
NODE_X = 1  # momentum to the east [kg m s-1], after the update of the nodes velocity [m s-1]
NODE_Y = 2  # the same to the north
NODE_KINETIC = 3  # [J] kinetic energy that the columns bring, before the update
NODE_GAIN = 3  # [1] mass that erosion adds, over the mass before; after the update

# Columns go through a transfer BATCH at a time: in loops over short arrays ("lines" of one scratch array), which the
# compiler vectorises; only nodes and rows are read and written column by column.
BATCH = 32
AHEAD = BATCH  # [columns] from the one that is computed to the one that is prefetched; half of it costs 7 % of a step
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
    L_GY,  # up to here as in a row
    L_WX0,
    L_WX1,
    L_WX2,
    L_WY0,
    L_WY1,
    L_WY2,  # [1] weights of three nodes along x and along y
    L_SX,  # [cells] offset from the middle node
    L_MX,  # [cells] factor of second differences in a moment
    L_SY,
    L_MY,
    L_GX0,
    L_GX1,
    L_GX2,
    L_GY0,
    L_GY1,
    L_GY2,  # [1] slopes of weights per cell
    L_SPEED2,  # [m2 s-2] square of the speed
    L_HORIZONTAL2,  # [m2 s-2] square of the horizontal speed
    L_SIGNAL2,  # [m2 s-2] square of the horizontal speed and that of waves together
    L_BOUND,  # [m2 s-2] largest square of the speed that the drop in height allows
    L_GAINED,  # [kg] mass taken up from the bed
    L_WORK,  # [J] of weight and pressure
    L_TAKEN,  # [J] potential energy of the mass taken up
    L_BENT,  # [J] potential energy gained as the slope of the bed changes
) = range(0, 36 * BATCH, BATCH)
LINES = 36 * BATCH
# in the transfer to the grid, in place of offsets
L_PRESSED = L_SX  # [kg m] A rho h^2, by which columns push
L_DRIVEN = L_MX  # [kg] mass that is driven downhill
QUAD = 4 * BATCH  # groups of four numbers, one group a column
QUADS = 6 * QUAD
# groups of four
(
    Q_MEAN,  # mean of the four entries of the nodes
    Q_ALONG_X,  # slopes of these per cell
    Q_ALONG_Y,
    Q_MOMENT_X,  # their first moments about the column, in cells
    Q_MOMENT_Y,
) = range(0, 5 * QUAD, QUAD)
# Groups of three, in place of the nodes' means and slopes: of groups with a last number that a loop does not read, the
# compiler cannot vectorise the last ones.
Q_BED = Q_MEAN  # [m] rows of the bed under a column, summed with their weights
Q_BED_SLOPE = Q_ALONG_X  # [m] the same with the slopes of the weights


@jit_inline
def prefetch_row(rows: np.ndarray, order: np.ndarray, place: int) -> None:
    """Prefetch the row of the column at a place of the order that is AHEAD, if there is one.

    It is called from the longest loop over single columns. The processor fetches few rows at the same time: it would
    wait if all rows of a batch were prefetched at once.

    Parameters
    ----------
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    place : int
        In the order, of the column that is computed.
    """
    if place + AHEAD < order.size:
        p = (order[place + AHEAD] & INDEX_MASK) * ROW
        prefetch(rows, p)
        prefetch(rows, p + ROW - 1)


@jit
def take_rows(rows: np.ndarray, order: np.ndarray, first: int, count: int, scratch: np.ndarray, moved: bool) -> None:
    """Copy the rows of columns order[first : first + count] into the lines of `scratch`, four columns at a time.

    Parameters
    ----------
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    first : int
        Place of the first of them in the order.
    count : int
        Number of columns.
    scratch : float64[LINES]
    moved : bool
        With the affine velocity, which not every transfer needs.
    """
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
