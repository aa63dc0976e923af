"""Sort points by blocks, and by cells in a block, and find the blocks of nodes that they touch.

The blocks are those of `point_blocks.sort_by_block`, with the same points. Within a block the points are in the
order of their cells, those of a cell in that of their indices. Atomic additions count whole numbers only, and what they
leave in any order is ranked by index after them. Touched blocks are numbered in the order of their places in the
window.
"""

import numpy as np
from numba import cuda, int32, int64, uint32

from ...compiled.block_order import GONE, REORDER_STEPS
from ..points.point_blocks import EAST, NORTH, SOUTH, TALL, WEST, place_of
from ..points.point_loop import MOST_PLACES
from ..points.point_rows import BLOCK, X, Y, Z
from ..points.point_time_step import (
    ALIVE,
    ALL_LEFT,
    HITS,
    REACHED_TIME,
    ROWS,
    SCATTERED,
    SINCE_REORDER,
    STEP_NOW,
    TIME,
    WINDOW_FIRST,
)
from .device_functions import Kernel, in_double
from .device_point_steps import cell_of
from .launch import (
    ACTIVE,
    DEPTH,
    DT,
    END,
    HEIGHT,
    NEEDS_ROOM,
    REORDER,
    ROOM_ACTIVE,
    ROOM_DEPTH,
    ROOM_PLACES,
    ROOM_TOUCHED,
    SIZE,
    SORTED,
    SOUTH_NOW,
    STATUS,
    TOUCHED,
    UNTIL,
    WEST_NOW,
    WIDTH,
)

CELLS = BLOCK**3  # cells of a block
SCANNERS = 256  # threads of the scan over pieces
STRIP = 8  # numbers of each row that are moved at a time when rows are put in order


@in_double
def begin_step(run: np.ndarray, stage: np.ndarray, now: np.ndarray, clock: np.ndarray, counts: np.ndarray) -> None:
    """Note reasons to stop before a step, and set the window of blocks, length and end of the step; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
    now : float[NOW_ENTRIES]
        Length and end of the step in the precision of the points.
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    """
    if run[STATUS] != 0:
        return
    if clock[TIME] >= stage[UNTIL]:
        run[STATUS] = REACHED_TIME
        return
    if counts[ALIVE] == 0:
        run[STATUS] = ALL_LEFT
        return
    west, south = counts[WINDOW_FIRST + WEST], counts[WINDOW_FIRST + SOUTH]
    width, height = counts[WINDOW_FIRST + EAST] - west + 2, counts[WINDOW_FIRST + NORTH] - south + 2
    depth = counts[WINDOW_FIRST + TALL] + 2
    size = width * height * depth
    run[SIZE], run[WIDTH], run[HEIGHT], run[DEPTH] = size, width, height, depth
    run[WEST_NOW], run[SOUTH_NOW] = west, south
    if size > MOST_PLACES:
        run[STATUS] = SCATTERED
    elif size > run[ROOM_PLACES] or depth > run[ROOM_DEPTH]:
        run[STATUS] = NEEDS_ROOM
    stage[DT] = clock[STEP_NOW]
    stage[END] = stage[UNTIL] if clock[HITS] > 0.0 else clock[TIME] + clock[STEP_NOW]
    now[DT], now[END] = stage[DT], stage[END]


@Kernel
def clear_window(run: np.ndarray, histogram: np.ndarray, flags: np.ndarray) -> None:
    """Set the window to no points and no touched blocks.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    histogram : int[places]
    flags : int[places]
    """
    if run[STATUS] != 0:
        return
    for b in range(cuda.grid(1), run[SIZE], cuda.gridsize(1)):
        histogram[b] = 0
        flags[b] = 0


@Kernel
def count_points(
    run: np.ndarray, counts: np.ndarray, rows: np.ndarray, keys: np.ndarray, histogram: np.ndarray, cells: np.ndarray
) -> None:
    """Count the points in each place of the window, and find the cell of each point in its block.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    rows : float[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]
    histogram : int[places]
        Number of points in each place.
    cells : uint8[n]
    """
    if run[STATUS] != 0:
        return
    window = counts[WINDOW_FIRST:]
    for p in range(cuda.grid(1), counts[ROWS], cuda.gridsize(1)):
        if keys[p] != GONE:
            cuda.atomic.add(histogram, place_of(keys[p], window, run[WIDTH], run[DEPTH]), 1)
            cells[p] = cell_of(rows[p, X], rows[p, Y], rows[p, Z])


@Kernel
def sum_pieces(run: np.ndarray, histogram: np.ndarray, pieces: np.ndarray) -> None:
    """Compute sum and number of the entries above zero of the histogram, in the piece of the window of each thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    histogram : int[places]
    pieces : int64[threads, 2]
    """
    if run[STATUS] != 0:
        return
    c, n, size = cuda.grid(1), cuda.gridsize(1), run[SIZE]
    total, filled = int64(0), int64(0)
    for b in range(c * size // n, (c + 1) * size // n):
        total += histogram[b]
        filled += 1 if histogram[b] > 0 else 0
    pieces[c, 0], pieces[c, 1] = total, filled


@Kernel
def scan_pieces(run: np.ndarray, pieces: np.ndarray, points: bool) -> None:
    """Replace the sums of each piece by those of all pieces before it; one block of SCANNERS threads.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    pieces : int64[threads, 2]
    points : bool
        Whether the histogram is that of the points; else of touched blocks.
    """
    if run[STATUS] != 0:
        return
    sums = cuda.shared.array((SCANNERS, 2), int64)
    c, count, n = cuda.threadIdx.x, pieces.shape[0], cuda.blockDim.x
    total, filled = int64(0), int64(0)
    for k in range(c * count // n, (c + 1) * count // n):
        total += pieces[k, 0]
        filled += pieces[k, 1]
    sums[c, 0], sums[c, 1] = total, filled
    own, own_filled = total, filled
    cuda.syncthreads()
    reach = 1
    while reach < n:  # sums of the last `reach` threads become those of twice as many
        if c >= reach:
            total += sums[c - reach, 0]
            filled += sums[c - reach, 1]
        cuda.syncthreads()
        sums[c, 0], sums[c, 1] = total, filled
        cuda.syncthreads()
        reach *= 2
    if c == n - 1:
        if points:
            run[ACTIVE], run[SORTED] = filled, total
        else:
            run[TOUCHED] = filled
        if filled > (run[ROOM_ACTIVE] if points else run[ROOM_TOUCHED]):
            run[STATUS] = NEEDS_ROOM
    total, filled = total - own, filled - own_filled
    for k in range(c * count // n, (c + 1) * count // n):
        own, own_filled = pieces[k, 0], pieces[k, 1]
        pieces[k, 0], pieces[k, 1] = total, filled
        total += own
        filled += own_filled


@Kernel
def rank_places(
    run: np.ndarray, histogram: np.ndarray, pieces: np.ndarray, block: np.ndarray, start: np.ndarray
) -> None:
    """Number the blocks with points, and turn their counts into the index of their first point.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    histogram : int[places]
    pieces : int64[threads, 2]
    block : int[active]
        Place of each block with points.
    start : int[active + 1]
        First point of each block.
    """
    if run[STATUS] != 0:
        return
    c, n, size = cuda.grid(1), cuda.gridsize(1), run[SIZE]
    first, active = pieces[c, 0], pieces[c, 1]
    for b in range(c * size // n, (c + 1) * size // n):
        count = histogram[b]
        if count > 0:
            block[active], start[active] = b, first
            active += 1
        histogram[b] = first
        first += count
    if c == 0:
        start[run[ACTIVE]] = run[SORTED]


@Kernel
def scatter_points(
    run: np.ndarray, counts: np.ndarray, keys: np.ndarray, histogram: np.ndarray, loose: np.ndarray
) -> None:
    """Collect the indices of the points of each block, in any order.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    keys : int64[n]
    histogram : int[places]
        First free index of each place.
    loose : int32[n]
        The indices.
    """
    if run[STATUS] != 0:
        return
    window = counts[WINDOW_FIRST:]
    for p in range(cuda.grid(1), counts[ROWS], cuda.gridsize(1)):
        if keys[p] != GONE:
            at = cuda.atomic.add(histogram, place_of(keys[p], window, run[WIDTH], run[DEPTH]), 1)
            loose[at] = p


@Kernel
def rank_points(
    run: np.ndarray, start: np.ndarray, loose: np.ndarray, cells: np.ndarray, mixed: np.ndarray, order: np.ndarray
) -> None:
    """Put the indices of the points of each block in the order of their cells, those of a cell in ascending order.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    start : int[active + 1]
        First point of each block.
    loose : int32[n]
        The indices by block, in any order.
    cells : uint8[n]
        Cell of each point, of the CELLS of a block.
    mixed : int32[n]
        Work array: the indices in the order of cells.
    order : int32[n]
        The indices in order.
    """
    if run[STATUS] != 0:
        return
    numbers = cuda.shared.array(CELLS, int32)
    ends = cuda.shared.array(CELLS, int32)
    thread, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    for a in range(int32(cuda.blockIdx.x), int32(run[ACTIVE]), int32(cuda.gridDim.x)):
        first, end = int32(start[uint32(a)]), int32(start[uint32(a + 1)])
        for e in range(thread, int32(CELLS), threads):
            numbers[uint32(e)] = 0
        cuda.syncthreads()
        for s in range(first + thread, end, threads):
            cuda.atomic.add(numbers, uint32(cells[uint32(loose[uint32(s)])]), 1)
        cuda.syncthreads()
        for e in range(thread, int32(CELLS), threads):
            before = first
            for k in range(e):
                before += numbers[uint32(k)]
            ends[uint32(e)] = before
        cuda.syncthreads()
        for s in range(first + thread, end, threads):
            p = loose[uint32(s)]
            mixed[uint32(cuda.atomic.add(ends, uint32(cells[uint32(p)]), 1))] = p
        cuda.syncthreads()
        for s in range(first + thread, end, threads):
            p = loose[uint32(s)]
            cell = uint32(cells[uint32(p)])
            begin = ends[cell] - numbers[cell]
            rank = begin
            for k in range(begin, ends[cell]):
                rank += int32(1) if mixed[uint32(k)] < p else int32(0)
            order[uint32(rank)] = p
        cuda.syncthreads()


@Kernel
def mark_touched(run: np.ndarray, block: np.ndarray, lowest: np.ndarray, flags: np.ndarray) -> None:
    """Mark the places of the window whose nodes the points of a block reach.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    block : int[active]
        Place of each block with points.
    lowest : int32[block rows, block columns, 2]
        The result of `point_blocks.lowest_blocks`.
    flags : int[places]
        1 at these places.
    """
    if run[STATUS] != 0:
        return
    width, depth, west, south = run[WIDTH], run[DEPTH], run[WEST_NOW], run[SOUTH_NOW]
    for k in range(cuda.grid(1), 8 * run[ACTIVE], cuda.gridsize(1)):
        b, o = block[k // 8], k % 8
        column, row = (b // depth) % width + west, b // depth // width + south
        level = b % depth + lowest[row, column, 0] + (o >> 2)
        column, row = column + (o & 1), row + ((o >> 1) & 1)
        flags[((row - south) * width + column - west) * depth + level - lowest[row, column, 0]] = 1


@Kernel
def rank_touched(
    run: np.ndarray,
    flags: np.ndarray,
    pieces: np.ndarray,
    lowest: np.ndarray,
    slots: np.ndarray,
    touched: np.ndarray,
    sources: np.ndarray,
) -> None:
    """Number the touched blocks.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    flags : int[places]
        1 at touched blocks.
    pieces : int64[threads, 2]
    lowest : int32[block rows, block columns, 2]
        The result of `point_blocks.lowest_blocks`.
    slots : int32[places]
        Touched block at each place, or -1.
    touched : int32[n_touched, 3]
        Row, column and level of each touched block.
    sources : int32[n_touched, 8]
        Set to -1.
    """
    if run[STATUS] != 0:
        return
    c, n, size = cuda.grid(1), cuda.gridsize(1), run[SIZE]
    width, depth, t = run[WIDTH], run[DEPTH], pieces[c, 1]
    for b in range(c * size // n, (c + 1) * size // n):
        slots[b] = -1
        if flags[b] == 0:
            continue
        slots[b] = t
        column, row = (b // depth) % width + run[WEST_NOW], b // depth // width + run[SOUTH_NOW]
        touched[t, 0], touched[t, 1], touched[t, 2] = row, column, b % depth + lowest[row, column, 0]
        for o in range(8):
            sources[t, o] = -1
        t += 1


@Kernel
def link_blocks(
    run: np.ndarray,
    block: np.ndarray,
    lowest: np.ndarray,
    slots: np.ndarray,
    sources: np.ndarray,
    targets: np.ndarray,
    places: np.ndarray,
) -> None:
    """Link blocks with points and touched blocks, and find the places of the former (see `point_blocks.link_blocks`).

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    block : int[active]
        Place of each block with points.
    lowest : int32[block rows, block columns, 2]
        The result of `point_blocks.lowest_blocks`.
    slots : int32[places]
        Touched block at each place, or -1.
    sources : int32[n_touched, 8]
    targets : int32[active, 8]
    places : int32[active, 3]
        x, y, z of each block with points.
    """
    if run[STATUS] != 0:
        return
    width, depth, west, south = run[WIDTH], run[DEPTH], run[WEST_NOW], run[SOUTH_NOW]
    for k in range(cuda.grid(1), 8 * run[ACTIVE], cuda.gridsize(1)):
        a, o = k // 8, k % 8
        b = block[a]
        column, row = (b // depth) % width + west, b // depth // width + south
        level = b % depth + lowest[row, column, 0]
        if o == 0:
            places[a, 0], places[a, 1], places[a, 2] = column, row, level
        column, row, level = column + (o & 1), row + ((o >> 1) & 1), level + (o >> 2)
        t = slots[((row - south) * width + column - west) * depth + level - lowest[row, column, 0]]
        targets[a, o] = t
        sources[t, o] = a


@Kernel
def decide_order(run: np.ndarray, counts: np.ndarray) -> None:
    """Decide whether rows are put in order in this step; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    """
    if run[STATUS] != 0:
        return
    run[REORDER] = 0
    if counts[SINCE_REORDER] >= REORDER_STEPS:
        run[REORDER], counts[SINCE_REORDER] = 1, 0
    counts[SINCE_REORDER] += 1


@Kernel
def take_strip(
    run: np.ndarray,
    rows: np.ndarray,
    ids: np.ndarray,
    keys: np.ndarray,
    order: np.ndarray,
    strip: np.ndarray,
    names: np.ndarray,
    first: int,
) -> None:
    """Copy STRIP numbers of each row in the order of blocks; with the first ones ids and keys.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    rows : float[n, ROW_SHORT or ROW_LONG]
    ids : uint64[n]
    keys : int64[n]
    order : int32[n]
    strip : float[n, STRIP]
        Work array.
    names : int64[n, 2]
        Work array for ids and keys.
    first : int
        First of the numbers.
    """
    if run[STATUS] != 0 or run[REORDER] == 0:
        return
    width = min(STRIP, rows.shape[1] - first)
    for e in range(cuda.grid(1), STRIP * run[SORTED], cuda.gridsize(1)):
        p, k = e // STRIP, e % STRIP
        q = order[p]
        if k < width:
            strip[p, k] = rows[q, first + k]
        if first == 0 and k == 0:
            names[p, 0], names[p, 1] = ids[q], keys[q]


@Kernel
def give_strip(
    run: np.ndarray,
    rows: np.ndarray,
    ids: np.ndarray,
    keys: np.ndarray,
    strip: np.ndarray,
    names: np.ndarray,
    first: int,
) -> None:
    """Copy what `take_strip` took to its new rows.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    rows : float[n, ROW_SHORT or ROW_LONG]
    ids : uint64[n]
    keys : int64[n]
    strip : float[n, STRIP]
    names : int64[n, 2]
    first : int
        First of the numbers.
    """
    if run[STATUS] != 0 or run[REORDER] == 0:
        return
    width = min(STRIP, rows.shape[1] - first)
    for e in range(cuda.grid(1), STRIP * run[SORTED], cuda.gridsize(1)):
        p, k = e // STRIP, e % STRIP
        if k < width:
            rows[p, first + k] = strip[p, k]
        if first == 0 and k == 0:
            ids[p], keys[p] = names[p, 0], names[p, 1]


@Kernel
def note_order(run: np.ndarray, counts: np.ndarray, order: np.ndarray) -> None:
    """Set the order of rows that were put in order: each is its own index, and those that had left are dropped.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    order : int32[n]
    """
    if run[STATUS] != 0 or run[REORDER] == 0:
        return
    for p in range(cuda.grid(1), run[SORTED], cuda.gridsize(1)):
        order[p] = p
        if p == 0:
            counts[ROWS] = run[SORTED]
