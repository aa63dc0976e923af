"""Blocks of 8 x 8 nodes: columns in the order of their blocks, and the blocks of nodes that they reach."""

from typing import NamedTuple

import numpy as np

from ...compiled.block_order import CHUNKS, GONE, rank_blocks
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from .column_rows import X, Y
from .spline_weights import INDEX_MASK

BLOCK = 8  # nodes along a block's side
TILE = BLOCK + 2  # a column of the block reaches two nodes further
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
def first_node(touched: TouchedBlocks, k: int) -> tuple[int, int]:
    """Return the row and the column of the first node of touched block `k`.

    Parameters
    ----------
    touched : TouchedBlocks
    k : int
    """
    row, column = touched.places[k] // (touched.width + 1), touched.places[k] % (touched.width + 1)
    return (row + touched.south) * BLOCK, (column + touched.west) * BLOCK


@jit_inline
def block_key(x: float, y: float, inverse_dx: float) -> int:
    """Return the block of a column, its row in the high and its column in the low 16 bits.

    Parameters
    ----------
    x, y : float [m]
    inverse_dx : float [m-1]
    """
    return ((int(y * inverse_dx + 0.5) // BLOCK) << 16) | (int(x * inverse_dx + 0.5) // BLOCK)


def rows_and_columns(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the block rows and the block columns of `keys`.

    Parameters
    ----------
    keys : int32[n]
    """
    return keys >> 16, keys & 0xFFFF


@jit
def initial_keys(rows: np.ndarray, keys: np.ndarray, dx: float) -> tuple[int, int, int, int]:
    """Fill `keys` for all `rows`; return the window of blocks (west, south, east, north).

    Parameters
    ----------
    rows : float64[columns, ROW]
    keys : int32[columns]
    dx : float [m]
    """
    west, south, east, north = 1 << 16, 1 << 16, -1, -1
    for p in range(rows.shape[0]):
        key = block_key(rows[p, X], rows[p, Y], 1.0 / dx)
        keys[p] = key
        west, east = min(west, key & 0xFFFF), max(east, key & 0xFFFF)
        south, north = min(south, key >> 16), max(north, key >> 16)
    return west, south, east, north


@jit_inline
def _place_in_window(key, west, south, width):
    """Place of a block in the window of blocks with columns."""
    return (((key >> 16) - south) * width + (key & 0xFFFF) - west) & INDEX_MASK


@jit_parallel
def _count(keys, n, pieces, window, size, histogram):
    west, south, width = window.west, window.south, window.width
    for c in prange(pieces):
        for b in range(size):
            histogram[c, b] = 0
        key, same = GONE, 0  # a sum in memory waits for the one before: columns in a row with one key are added at once
        for p in range(c * n // pieces, (c + 1) * n // pieces):
            if keys[p] == key:
                same += 1
                continue
            if key != GONE:
                histogram[c, _place_in_window(key, west, south, width)] += same
            key, same = keys[p], 1
        if key != GONE:
            histogram[c, _place_in_window(key, west, south, width)] += same


@jit_parallel
def _scatter(keys, n, pieces, window, histogram, order):
    west, south, width = window.west, window.south, window.width
    for c in prange(pieces):
        key, b, q = GONE, 0, 0  # as in `_count`; q: next free place of that key's block
        for p in range(c * n // pieces, (c + 1) * n // pieces):
            if keys[p] != key:
                if key != GONE:
                    histogram[c, b] = q
                key = keys[p]
                if key != GONE:
                    b = _place_in_window(key, west, south, width)
                    q = histogram[c, b]
            if key != GONE:
                order[q & INDEX_MASK] = p
                q += 1


@jit
def sort_by_block(
    keys: np.ndarray,
    n: int,
    window: BlockWindow,
    histogram: np.ndarray,
    slot: np.ndarray,
    sorted_columns: SortedColumns,
) -> tuple[int, int]:
    """Sort the indices of columns by block: a stable counting sort.

    Parameters
    ----------
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    n : int
        Number of columns in memory.
    window : BlockWindow
    histogram : int32[CHUNKS, places of the window]
        Work array.
    slot : int32[places of the window]
        Becomes the number of the block with columns at each place of the window, -1 where there are none.
    sorted_columns : SortedColumns
        `order`, `block` and `start` are filled.

    Returns
    -------
    (int, int)
        Number of blocks with columns, and of columns in them.
    """
    size = window.width * window.height
    pieces = min(CHUNKS, n // SORT_ROWS + 1)
    _count(keys, n, pieces, window, size, histogram)
    active, total = rank_blocks(histogram, pieces, size, slot, sorted_columns.block, sorted_columns.start)
    _scatter(keys, n, pieces, window, histogram, sorted_columns.order)
    return active, total


@jit
def touched_blocks(slot: np.ndarray, window: BlockWindow, places: np.ndarray) -> int:
    """List the node blocks that active tiles reach: themselves and their east, north and north-east neighbours.

    Parameters
    ----------
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    window : BlockWindow
    places : int32[n]
        Becomes the places of these blocks in the window with one more row and column of blocks.

    Returns
    -------
    int
        Number of these blocks.
    """
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
