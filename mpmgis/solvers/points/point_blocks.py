"""Points sorted by blocks of 4 x 4 x 4 nodes, and the neighbours of blocks.

Blocks are counted upwards from the ground below them: the window of blocks is as wide as the flow and as high as the
flow is above the ground, whatever the relief of the domain.
"""

import numpy as np

from ...compiled.block_order import GONE, rank_blocks
from ...compiled.jit import jit, jit_borrowing, jit_inline, jit_parallel, prange
from .point_rows import BLOCK, GHOSTS, X, Y, Z

SORT_PIECES = 8  # pieces of work of the sort; fixed, so that the order does not depend on the number of threads
# int64 entries of the window of blocks with points
(
    WEST,  # [blocks] first column
    SOUTH,  # [blocks] first row
    EAST,  # [blocks] last column
    NORTH,  # [blocks] last row
    TALL,  # [blocks] largest height above the lowest block of a column and its neighbours
    WINDOW,  # number of entries
) = range(6)


@jit_inline
def packed(row: int, column: int, level: int) -> int:
    """Pack row, column and level of a block into one number, its key.

    Parameters
    ----------
    row, column : int
    level : int
        Above the ground's lowest block there.
    """
    return (np.int64(row) << 42) | (np.int64(column) << 21) | np.int64(level)


@jit_inline
def key_row(key: int) -> int:
    """Return the block row of a key.

    Parameters
    ----------
    key : int
    """
    return key >> 42


@jit_inline
def key_column(key: int) -> int:
    """Return the block column of a key.

    Parameters
    ----------
    key : int
    """
    return (key >> 21) & 0x1FFFFF


@jit_inline
def key_level(key: int) -> int:
    """Return the level of a key.

    Parameters
    ----------
    key : int
    """
    return key & 0x1FFFFF


def rows_and_columns(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return block row and block column of keys, int64[n] each.

    Parameters
    ----------
    keys : int64[n]
    """
    return keys >> 42, (keys >> 21) & 0x1FFFFF


@jit_inline
def block_of(place: float) -> int:
    """Return the block, along one axis, of the first node that a point touches.

    Parameters
    ----------
    place : float [cells]
        Of the point in the nodes' array.
    """
    return int(place - 0.5) // BLOCK


@jit
def no_window(window: np.ndarray) -> None:
    """Set a window of blocks to that of no points.

    Parameters
    ----------
    window : int64[WINDOW]
    """
    window[WEST] = window[SOUTH] = 1 << 40
    window[EAST] = window[NORTH] = window[TALL] = -1


@jit
def widen(window: np.ndarray, key: int, lowest: np.ndarray) -> None:
    """Extend a window to a block, with the heights of its neighbours above their ground.

    Parameters
    ----------
    window : int64[WINDOW]
    key : int
        Of the block.
    lowest : int32[block rows, block columns, 2]
        The result of `lowest_blocks`.
    """
    window[WEST], window[EAST] = min(window[WEST], key_column(key)), max(window[EAST], key_column(key))
    window[SOUTH], window[NORTH] = min(window[SOUTH], key_row(key)), max(window[NORTH], key_row(key))
    window[TALL] = max(window[TALL], key_level(key) + lowest[key_row(key), key_column(key), 1])


@jit
def set_places(rows: np.ndarray, keys: np.ndarray, places: np.ndarray, inverse_dx: float, lowest: np.ndarray) -> None:
    """Put points at their places: set their blocks, and their places within these.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]
    places : float64[n, 3] [m]
        From the domain's corner.
    inverse_dx : float [m-1]
    lowest : int32[block rows, block columns, 2]
        The result of `lowest_blocks`.
    """
    for p in range(rows.shape[0]):
        x, y = places[p, 0] * inverse_dx + GHOSTS, places[p, 1] * inverse_dx + GHOSTS
        z = places[p, 2] * inverse_dx + GHOSTS
        row, column = block_of(y), block_of(x)
        level = max(block_of(z) - lowest[row, column, 0], 0)
        keys[p] = packed(row, column, level)
        rows[p, X], rows[p, Y] = x - BLOCK * column, y - BLOCK * row
        rows[p, Z] = z - BLOCK * (level + lowest[row, column, 0])


@jit
def places_of(rows: np.ndarray, keys: np.ndarray, dx: float, lowest: np.ndarray) -> np.ndarray:
    """Compute the places of points from the domain's corner.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]
    dx : float [m]
    lowest : int32[block rows, block columns, 2]
        The result of `lowest_blocks`.

    Returns
    -------
    float64[n, 3] [m]
    """
    places = np.empty((rows.shape[0], 3))
    for p in range(rows.shape[0]):
        row, column = key_row(keys[p]), key_column(keys[p])
        level = key_level(keys[p]) + lowest[row, column, 0]
        places[p, 0] = (float(rows[p, X]) + (BLOCK * column - GHOSTS)) * dx
        places[p, 1] = (float(rows[p, Y]) + (BLOCK * row - GHOSTS)) * dx
        places[p, 2] = (float(rows[p, Z]) + (BLOCK * level - GHOSTS)) * dx
    return places


@jit
def window_of(keys: np.ndarray, lowest: np.ndarray, window: np.ndarray) -> None:
    """Set a window to that of all points.

    Parameters
    ----------
    keys : int64[n]
    lowest : int32[block rows, block columns, 2]
        The result of `lowest_blocks`.
    window : int64[WINDOW]
    """
    no_window(window)
    for p in range(keys.size):
        widen(window, keys[p], lowest)


@jit_inline
def place_of(key: int, window: np.ndarray, width: int, depth: int) -> int:
    """Return the index of a block in the arrays over the window.

    The arrays have space for a neighbour behind, beside and above.

    Parameters
    ----------
    key : int
        Of the block.
    window : int64[WINDOW]
    width, depth : int [blocks]
        Of the arrays.
    """
    return ((key_row(key) - window[SOUTH]) * width + key_column(key) - window[WEST]) * depth + key_level(key)


@jit_parallel
def _count(keys, n, window, width, depth, size, histogram):
    for c in prange(SORT_PIECES):
        histogram[c, :size] = 0
        _count_piece(keys, c * n // SORT_PIECES, (c + 1) * n // SORT_PIECES, window, width, depth, histogram, c)


@jit_borrowing
def _count_piece(keys, first, end, window, width, depth, histogram, c):
    """Count the points of a piece by block.

    Neighbours in memory mostly share a block: they are counted in a register until the block changes.
    """
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
def sort_by_block(
    keys: np.ndarray,
    n: int,
    window: np.ndarray,
    width: int,
    depth: int,
    size: int,
    histogram: np.ndarray,
    order: np.ndarray,
    slot: np.ndarray,
    block: np.ndarray,
    start: np.ndarray,
) -> tuple[int, int]:
    """Sort the indices of points by block, stably, by counting.

    Parameters
    ----------
    keys : int64[n]
    n : int
        Number of points.
    window : int64[WINDOW]
    width, depth, size : int [blocks]
        Of the arrays over the window.
    histogram : int[SORT_PIECES, size]
        Work array.
    order : int32[n]
        Set to the indices of the points, sorted by block.
    slot : int[size]
        Set to the number of the active block at each place of the window, or -1.
    block : int[active]
        Set to the place of each active block.
    start : int64[active + 1]
        Set so that `start[a]` to `start[a + 1]` are the points of active block a in `order`.

    Returns
    -------
    (int, int)
        Numbers of active blocks and of points on the terrain.
    """
    _count(keys, n, window, width, depth, size, histogram)
    active, total = rank_blocks(histogram, SORT_PIECES, size, slot, block, start)
    _scatter(keys, n, window, width, depth, histogram, order)
    return active, total


@jit
def link_blocks(
    block: np.ndarray,
    active: int,
    window: np.ndarray,
    width: int,
    depth: int,
    lowest: np.ndarray,
    touched_slot: np.ndarray,
    size: int,
    touched: np.ndarray,
    sources: np.ndarray,
    targets: np.ndarray,
) -> int:
    """Find the node blocks that active blocks reach: themselves and their neighbours behind, beside and above.

    The bits of the number o of a neighbour are x, y, z.

    Parameters
    ----------
    block : int[active]
        Place of each active block.
    active : int
        Number of active blocks.
    window : int64[WINDOW]
    width, depth : int [blocks]
        Of the arrays over the window.
    lowest : int32[block rows, block columns, 2]
        The result of `lowest_blocks`.
    touched_slot : int32[size]
        Set to the number of the touched block at each place of the window, or -1.
    size : int [blocks]
        Of the arrays over the window.
    touched : int32[n_touched, 3]
        Set to row, column and level above the domain's lowest of each touched block.
    sources : int32[n_touched, 8]
        Set to the active block whose neighbour o each touched block is, or -1.
    targets : int32[active, 8]
        Set to the number of neighbour o of each active block.

    Returns
    -------
    int
        Number of touched blocks.
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


def lowest_blocks(ground: np.ndarray, dx: float) -> np.ndarray:
    """Find the lowest block over each block column that points can touch.

    A point is never more than two cells below the ground; neighbouring columns are included, so that all nodes of a
    block exist.

    Parameters
    ----------
    ground : float64[rows, columns] [m]
        Elevation above the domain's lowest level at all nodes.
    dx : float [m]

    Returns
    -------
    int32[block rows, block columns, 2]
        The lowest block, and how many blocks deeper its neighbours behind and beside begin.
    """
    rows, columns = (-(-n // BLOCK) for n in ground.shape)
    padded = np.pad(ground, ((0, rows * BLOCK - ground.shape[0]), (0, columns * BLOCK - ground.shape[1])), mode="edge")
    least = _least_around(padded.reshape(rows, BLOCK, columns, BLOCK).min(axis=(1, 3)), (-2, -1, 0, 1, 2))
    lowest = np.maximum((np.floor(least / dx).astype(np.int64) + GHOSTS - 3) // BLOCK, 0)
    return np.stack([lowest, lowest - _least_around(lowest, (-1, 0))], axis=2).astype(np.int32)


def _least_around(values, shifts):
    """Compute the smallest of `values` shifted along both axes, rims continued."""
    around = np.pad(values, 2, mode="edge")
    for axis in (0, 1):
        around = np.minimum.reduce([np.roll(around, shift, axis) for shift in shifts])
    return around[2:-2, 2:-2]
