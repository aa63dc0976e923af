"""Sorting by blocks: ranks of blocks, even division of work, reordering of rows; mass that left, by block."""

import numpy as np

from .jit import jit, jit_inline, jit_parallel, prange

CHUNKS = 32  # pieces of work per loop; fixed, so that sums do not depend on the number of threads
REORDER_STEPS = 20  # [steps] between two times that rows are put into block order in memory
STRIP = 4  # numbers of each row that are moved at a time when rows are put in order
GONE = -1  # key of a particle that has left
LEFT_BLOCK = 8  # [cells] side of a block in which the mass that left is counted
# ways to leave, and their number: over an edge of the domain, or into ground without data
WEST_EDGE, SOUTH_EDGE, EAST_EDGE, NORTH_EDGE, INTO_NODATA, WAYS = range(6)
# sums of what left over a block
LEFT_MASS = 0  # [kg]
LEFT_X = 1  # [kg m] mass times distance from the western edge of the domain
LEFT_Y = 2  # [kg m] mass times distance from its southern edge
LEFT_ENTRIES = 3  # number of sums


@jit
def rank_blocks(
    histogram: np.ndarray, pieces: int, size: int, slot: np.ndarray, block: np.ndarray, start: np.ndarray
) -> tuple[int, int]:
    """Convert counts of rows to the first index of each piece and block, and number the active blocks.

    Parameters
    ----------
    histogram : int64[pieces, size]
        In: number of rows of each piece of work in each block. Out: their first index.
    pieces : int
        Number of pieces of work.
    size : int
        Number of blocks of the window.
    slot : int64[size], out
        Number of the active block at each place of the window; -1 where there is none.
    block : int64[size], out
        Place of each active block.
    start : int64[size + 1], out
        First particle of each active block.

    Returns
    -------
    active, total : int
        Number of active blocks and of particles.
    """
    total, active = 0, 0
    for b in range(size):
        first = total
        for c in range(pieces):
            count = histogram[c, b]
            histogram[c, b] = total
            total += count
        slot[b] = -1
        if total > first:
            slot[b] = active
            block[active] = b
            start[active] = first
            active += 1
    start[active] = total
    return active, total


@jit
def split_evenly(start: np.ndarray, active: int, bounds: np.ndarray) -> None:
    """Cut the active blocks into CHUNKS pieces of nearly equal numbers of particles.

    Parameters
    ----------
    start : int64[active + 1]
        First particle of each active block.
    active : int
        Number of active blocks.
    bounds : int64[CHUNKS + 1], out
        Piece c is the active blocks from `bounds[c]` to `bounds[c + 1]`.
    """
    total, a = start[active], 0
    for c in range(CHUNKS):
        bounds[c] = a
        while a < active and start[a + 1] * CHUNKS <= total * (c + 1):
            a += 1
    bounds[CHUNKS] = active


@jit_parallel
def reorder(
    rows: np.ndarray,
    ids: np.ndarray,
    keys: np.ndarray,
    order: np.ndarray,
    alive: int,
    strip: np.ndarray,
    names: np.ndarray,
) -> None:
    """Put rows, ids and keys into block order in memory; particles that have left are dropped.

    A few numbers of all rows at a time pass through `strip`, which avoids a second copy of the rows.

    Parameters
    ----------
    rows : float[n, k]
    ids : uint64[n]
    keys : int64[n]
        Key of each particle, from which its block follows; GONE where it has left.
    order : int64[alive]
        Rows in block order.
    alive : int
        Number of particles that have not left.
    strip : float[n, STRIP]
        Working space, in the precision of `rows`.
    names : int64[n, 2]
        Working space for ids and keys.
    """
    for first in range(0, rows.shape[1], STRIP):
        width = min(STRIP, rows.shape[1] - first)
        for c in prange(CHUNKS):
            for p in range(c * alive // CHUNKS, (c + 1) * alive // CHUNKS):
                q = order[p]
                for k in range(width):
                    strip[p, k] = rows[q, first + k]
                if first == 0:
                    names[p, 0], names[p, 1] = ids[q], keys[q]
        for c in prange(CHUNKS):
            for p in range(c * alive // CHUNKS, (c + 1) * alive // CHUNKS):
                for k in range(width):
                    rows[p, first + k] = strip[p, k]
                if first == 0:
                    ids[p], keys[p] = names[p, 0], names[p, 1]


@jit
def book_left(left: np.ndarray, shape: tuple[int, int], x: float, y: float, dx: float, mass: float) -> None:
    """Add the mass of a particle that left to the block of cells where it left.

    Parameters
    ----------
    left : float64[WAYS, blocks, blocks, LEFT_ENTRIES]
        Sums of what left; a place beyond the edge counts on the edge.
    shape : tuple of int
        Rows and columns of cells of the domain.
    x, y : float [m]
        Place from the corner of the domain.
    dx : float [m]
        Size of a cell.
    mass : float [kg]
    """
    way, row, column, x, y = place_left(shape, x, y, dx)
    sums = left[way, row, column]
    sums[LEFT_MASS] += mass
    sums[LEFT_X] += mass * x
    sums[LEFT_Y] += mass * y


@jit_inline
def place_left(shape: tuple[int, int], x: float, y: float, dx: float) -> tuple[int, int, int, float, float]:
    """Find the edge and the block of cells where a particle left.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns of cells of the domain.
    x, y : float [m]
        Place from the corner of the domain.
    dx : float [m]
        Size of a cell.

    Returns
    -------
    way, row, column, x, y : int, int, int, float, float
        WEST_EDGE to INTO_NODATA, block of cells, place [m] on the edge.
    """
    ny, nx = shape
    way = INTO_NODATA
    if x < 0.0:
        way = WEST_EDGE
    elif y < 0.0:
        way = SOUTH_EDGE
    elif x >= nx * dx:
        way = EAST_EDGE
    elif y >= ny * dx:
        way = NORTH_EDGE
    x, y = min(max(x, 0.0), nx * dx), min(max(y, 0.0), ny * dx)
    row, column = min(int(y / dx), ny - 1) // LEFT_BLOCK, min(int(x / dx), nx - 1) // LEFT_BLOCK
    return way, row, column, x, y
