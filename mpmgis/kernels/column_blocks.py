"""Columns sorted by blocks of 8 x 8 nodes, always in the same order."""

from .block_order import CHUNKS, GONE, rank_blocks
from .column_rows import BLOCK, X, Y
from .jit import jit, jit_inline, jit_parallel, prange

SORT_ROWS = 8192  # rows per piece of the sort, at most CHUNKS pieces


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
def _count(keys, n, pieces, west, south, width, size, histogram):
    for c in prange(pieces):
        for b in range(size):
            histogram[c, b] = 0
        for p in range(c * n // pieces, (c + 1) * n // pieces):
            if keys[p] != GONE:
                histogram[c, ((keys[p] >> 16) - south) * width + (keys[p] & 0xFFFF) - west] += 1


@jit_parallel
def _scatter(keys, n, pieces, west, south, width, histogram, order):
    for c in prange(pieces):
        for p in range(c * n // pieces, (c + 1) * n // pieces):
            if keys[p] != GONE:
                b = ((keys[p] >> 16) - south) * width + (keys[p] & 0xFFFF) - west
                order[histogram[c, b]] = p
                histogram[c, b] += 1


@jit
def sort_by_block(keys, n, west, south, east, north, histogram, order, slot, block, start):
    """Stable counting sort of indices by block.

    Fills `order`; `slot[b]` is the active block at place b of the window or -1, `block[a]` its place,
    `start[a]`..`start[a + 1]` its particles. Answers (active blocks, particles alive).
    """
    width, height = east - west + 1, north - south + 1
    size = width * height
    pieces = min(CHUNKS, n // SORT_ROWS + 1)
    _count(keys, n, pieces, west, south, width, size, histogram)
    active, total = rank_blocks(histogram, pieces, size, slot, block, start)
    _scatter(keys, n, pieces, west, south, width, histogram, order)
    return active, total


@jit
def comes_near(touched, n_touched, west, south, width, watched):
    """Is one of the touched blocks marked in `watched` uint8[block rows, block columns]?"""
    for k in range(n_touched):
        row, column = touched[k] // (width + 1) + south, touched[k] % (width + 1) + west
        if row < watched.shape[0] and column < watched.shape[1] and watched[row, column] != 0:
            return True
    return False


@jit
def touched_blocks(slot, width, height, touched):
    """List the node blocks that active tiles reach (themselves and their east, north, north-east neighbours)."""
    count = 0
    for bj in range(height + 1):
        for bi in range(width + 1):
            hit = False
            for oj in range(bj - 1, bj + 1):
                for oi in range(bi - 1, bi + 1):
                    if 0 <= oi < width and 0 <= oj < height and slot[oj * width + oi] >= 0:
                        hit = True
            if hit:
                touched[count] = bj * (width + 1) + bi
                count += 1
    return count
