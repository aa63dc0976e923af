"""Sorting by blocks: ranks of blocks, even division of work, reordering of rows; mass that left, by block."""

from .jit import jit, jit_inline, jit_parallel, prange

CHUNKS = 32  # pieces of work per loop; fixed, so that sums do not depend on the number of threads
REORDER_STEPS = 20  # rows are put into block order in memory this often
STRIP = 4  # numbers of each row that are moved at a time when rows are put in order
GONE = -1  # key of a particle that has left
LEFT_BLOCK = 8  # cells along the side of a block
WEST_EDGE, SOUTH_EDGE, EAST_EDGE, NORTH_EDGE, INTO_NODATA, WAYS = range(6)
LEFT_MASS, LEFT_X, LEFT_Y, LEFT_ENTRIES = range(4)  # mass [kg]; mass times place from the domain's corner [kg m]


@jit
def rank_blocks(histogram, pieces, size, slot, block, start):
    """Convert the counts of `histogram` int[pieces, size] to the first index of each piece and block.

    `slot[b]` is the active block at place b of the window or -1, `block[a]` its place, `start[a]` to `start[a + 1]` its
    particles. Returns (active blocks, particles).
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
def split_evenly(start, active, bounds):
    """Cut the active blocks into CHUNKS pieces of nearly equal numbers of particles: `bounds[c]`..`bounds[c + 1]`."""
    total, a = start[active], 0
    for c in range(CHUNKS):
        bounds[c] = a
        while a < active and start[a + 1] * CHUNKS <= total * (c + 1):
            a += 1
    bounds[CHUNKS] = active


@jit_parallel
def reorder(rows, ids, keys, order, alive, strip, names):
    """Put rows [n, k], ids and keys [n] into block order in memory; particles that have left are dropped.

    A few numbers of all rows at a time pass through `strip` [n, STRIP], which avoids a second copy of the rows; ids and
    keys pass through `names` int64[n, 2].
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
def book_left(left, shape, x, y, dx, mass):
    """Add `mass` [kg] that left to (x, y) [m] from the corner of the domain, which has `shape` cells of `dx` [m].

    `left` is float64[WAYS, blocks, blocks, LEFT_ENTRIES]; a place beyond the edge counts on the edge.
    """
    way, row, column, x, y = place_left(shape, x, y, dx)
    sums = left[way, row, column]
    sums[LEFT_MASS] += mass
    sums[LEFT_X] += mass * x
    sums[LEFT_Y] += mass * y


@jit_inline
def place_left(shape, x, y, dx):
    """(way, row and column of the block of cells, place [m] on the edge) of what left to (x, y) [m]."""
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
