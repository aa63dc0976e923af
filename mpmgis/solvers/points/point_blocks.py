"""Points sorted by blocks of 4 x 4 x 4 nodes, and the neighbours of blocks.

Blocks are counted upwards from the ground below them: the window of blocks is as wide as the flow and as high as the
flow is above the ground, whatever the relief of the domain.
"""

import numpy as np

from ...compiled.block_order import GONE, rank_blocks
from ...compiled.jit import jit, jit_borrowing, jit_inline, jit_parallel, prange
from .point_rows import BLOCK, GHOSTS, X, Y, Z

SORT_PIECES = 8  # of the sort; fixed, so that the order does not depend on the number of threads
# int64 window: blocks with points, and their largest height above the lowest block
WEST, SOUTH, EAST, NORTH, TALL, WINDOW = range(6)


@jit_inline
def packed(row, column, level):
    """One number of a block's row, column and level above the ground's lowest block there."""
    return (np.int64(row) << 42) | (np.int64(column) << 21) | np.int64(level)


@jit_inline
def key_row(key):
    """Block row of a key."""
    return key >> 42


@jit_inline
def key_column(key):
    """Block column of a key."""
    return (key >> 21) & 0x1FFFFF


@jit_inline
def key_level(key):
    """Level of a key."""
    return key & 0x1FFFFF


def rows_and_columns(keys):
    """(int[n], int[n]): block row and block column of `keys`."""
    return keys >> 42, (keys >> 21) & 0x1FFFFF


@jit_inline
def block_of(place):
    """Block, along one axis, of the first node that a point at `place` [cells] of the nodes' array touches."""
    return int(place - 0.5) // BLOCK


@jit
def no_window(window):
    """Set `window` to that of no points."""
    window[WEST] = window[SOUTH] = 1 << 40
    window[EAST] = window[NORTH] = window[TALL] = -1


@jit
def widen(window, key, lowest):
    """Extend `window` to the block of `key`, with the heights of its neighbours above their ground."""
    window[WEST], window[EAST] = min(window[WEST], key_column(key)), max(window[EAST], key_column(key))
    window[SOUTH], window[NORTH] = min(window[SOUTH], key_row(key)), max(window[NORTH], key_row(key))
    window[TALL] = max(window[TALL], key_level(key) + lowest[key_row(key), key_column(key), 1])


@jit
def set_places(rows, keys, places, inverse_dx, lowest):
    """Put points at `places` float64[n, 3] [m] from the domain's corner: fills int64 `keys`, and places in `rows`."""
    for p in range(rows.shape[0]):
        x, y = places[p, 0] * inverse_dx + GHOSTS, places[p, 1] * inverse_dx + GHOSTS
        z = places[p, 2] * inverse_dx + GHOSTS
        row, column = block_of(y), block_of(x)
        level = max(block_of(z) - lowest[row, column, 0], 0)
        keys[p] = packed(row, column, level)
        rows[p, X], rows[p, Y] = x - BLOCK * column, y - BLOCK * row
        rows[p, Z] = z - BLOCK * (level + lowest[row, column, 0])


@jit
def places_of(rows, keys, dx, lowest):
    """float64[n, 3] [m] from the domain's corner: where the points of `rows` in the blocks `keys` are."""
    places = np.empty((rows.shape[0], 3))
    for p in range(rows.shape[0]):
        row, column = key_row(keys[p]), key_column(keys[p])
        level = key_level(keys[p]) + lowest[row, column, 0]
        places[p, 0] = (float(rows[p, X]) + (BLOCK * column - GHOSTS)) * dx
        places[p, 1] = (float(rows[p, Y]) + (BLOCK * row - GHOSTS)) * dx
        places[p, 2] = (float(rows[p, Z]) + (BLOCK * level - GHOSTS)) * dx
    return places


@jit
def window_of(keys, lowest, window):
    """Set `window` to that of all `keys`."""
    no_window(window)
    for p in range(keys.size):
        widen(window, keys[p], lowest)


@jit_inline
def place_of(key, window, width, depth):
    """Index of a block in the arrays over the window, which have space for a neighbour behind, beside and above."""
    return ((key_row(key) - window[SOUTH]) * width + key_column(key) - window[WEST]) * depth + key_level(key)


@jit_parallel
def _count(keys, n, window, width, depth, size, histogram):
    for c in prange(SORT_PIECES):
        histogram[c, :size] = 0
        _count_piece(keys, c * n // SORT_PIECES, (c + 1) * n // SORT_PIECES, window, width, depth, histogram, c)


@jit_borrowing
def _count_piece(keys, first, end, window, width, depth, histogram, c):
    """Neighbours in memory mostly share a block: they are counted in a register until the block changes."""
    p = first
    while p < end:
        key, begun = keys[p], p
        p += 1
        while p < end and keys[p] == key:
            p += 1
        if key != GONE:
            histogram[c, place_of(key, window, width, depth)] += p - begun


@jit_parallel
def _scatter(keys, n, window, width, depth, histogram, order):
    for c in prange(SORT_PIECES):
        first, end = c * n // SORT_PIECES, (c + 1) * n // SORT_PIECES
        _scatter_piece(keys, first, end, window, width, depth, histogram, c, order)


@jit_borrowing
def _scatter_piece(keys, first, end, window, width, depth, histogram, c, order):
    p = first
    while p < end:
        key = keys[p]
        if key == GONE:
            p += 1
            continue
        b = place_of(key, window, width, depth)
        at = histogram[c, b]
        while p < end and keys[p] == key:
            order[at] = p
            at += 1
            p += 1
        histogram[c, b] = at


@jit
def sort_by_block(keys, n, window, width, depth, size, histogram, order, slot, block, start):
    """Stable counting sort of indices by block.

    Fills `order`; `slot[b]` is the active block at place b of the window or -1, `block[a]` its place, `start[a]` to
    `start[a + 1]` its points. Returns (active blocks, points alive).
    """
    _count(keys, n, window, width, depth, size, histogram)
    active, total = rank_blocks(histogram, SORT_PIECES, size, slot, block, start)
    _scatter(keys, n, window, width, depth, histogram, order)
    return active, total


@jit
def link_blocks(block, active, window, width, depth, lowest, touched_slot, size, touched, sources, targets):
    """Find the node blocks that active blocks reach: themselves and their neighbours behind, beside and above.

    `touched` int32[., 3] are their row, column and level above the domain's lowest; `targets[a, o]` is the number of
    neighbour o of active block a, `sources[t, o]` the active block whose neighbour o it is, or -1. The bits of o are
    x, y, z. Returns their number.
    """
    touched_slot[:size] = -1
    count = 0
    for a in range(active):
        level = block[a] % depth
        column = (block[a] // depth) % width + window[WEST]
        row = block[a] // depth // width + window[SOUTH]
        level += lowest[row, column, 0]
        for o in range(8):
            i, j, k = column + (o & 1), row + ((o >> 1) & 1), level + (o >> 2)
            b = ((j - window[SOUTH]) * width + i - window[WEST]) * depth + k - lowest[j, i, 0]
            t = touched_slot[b]
            if t < 0:
                t = count
                touched_slot[b] = t
                touched[t, 0], touched[t, 1], touched[t, 2] = j, i, k
                for other in range(8):
                    sources[t, other] = -1
                count += 1
            sources[t, o] = a
            targets[a, o] = t
    return count


@jit
def comes_near(touched, n_touched, watched):
    """Whether a touched block is above a block column that is marked in `watched` uint8[block rows, block columns]."""
    for k in range(n_touched):
        row, column = touched[k, 0], touched[k, 1]
        if row < watched.shape[0] and column < watched.shape[1] and watched[row, column] != 0:
            return True
    return False


def lowest_blocks(ground, dx):
    """int32[block rows, block columns, 2]: the lowest block over each block column that points can touch, and how many
    blocks deeper its neighbours behind and beside begin.

    `ground` float64[rows, columns] [m] is the elevation above the domain's lowest level at all nodes. A point is never
    more than two cells below the ground; neighbouring columns are included, so that all nodes of a block exist.
    """
    rows, columns = (-(-n // BLOCK) for n in ground.shape)
    padded = np.pad(ground, ((0, rows * BLOCK - ground.shape[0]), (0, columns * BLOCK - ground.shape[1])), mode="edge")
    least = _least_around(padded.reshape(rows, BLOCK, columns, BLOCK).min(axis=(1, 3)), (-2, -1, 0, 1, 2))
    lowest = np.maximum((np.floor(least / dx).astype(np.int64) + GHOSTS - 3) // BLOCK, 0)
    return np.stack([lowest, lowest - _least_around(lowest, (-1, 0))], axis=2).astype(np.int32)


def _least_around(values, shifts):
    """Smallest of `values` shifted along both axes, rims continued."""
    around = np.pad(values, 2, mode="edge")
    for axis in (0, 1):
        around = np.minimum.reduce([np.roll(around, shift, axis) for shift in shifts])
    return around[2:-2, 2:-2]
