"""Columns sorted by blocks, and the blocks of nodes that they touch; what does not depend on columns is `point_sort`.

The result is that of `column_blocks.sort_by_block` and `touched_blocks`. The window has one more row and column
of blocks than hold columns, so that a touched block has the same number in it as on the processor.
"""

import numpy as np
from numba import cuda, int64

from ...compiled.block_order import GONE
from ..columns.column_blocks import BLOCK, BlockWindow
from ..columns.column_loop import choose_step as chosen_step
from ..columns.column_records import Settings
from ..columns.column_rows import X, Y
from ..columns.column_time_step import ALIVE, ALL_LEFT, EAST, NORTH, REACHED_TIME, ROWS, SOUTH, TIME, WEST
from . import launch
from .device_functions import Kernel, Part
from .launch import ACTIVE, HEIGHT, NEEDS_ROOM, ROOM_PLACES, SIZE, SORTED, SOUTH_NOW, STATUS, TOUCHED, WEST_NOW, WIDTH

# further int64 entries of a run
(
    LEFT,  # number of columns that left in this step
    FIRED,  # 1 if the flow released an area in this step
    STIFF,  # number of columns whose viscosity was limited
    STOPPING,  # number of columns that stop as a whole
    RUN_ENTRIES,
) = range(launch.RUN_ENTRIES, launch.RUN_ENTRIES + 5)
NEEDS_ROOM_LATE = 101  # status: the host enlarges arrays of the second sort and finishes the step
# float64 times of a step [s]
(
    UNTIL,  # time of the request
    DT,  # length of the step
    END,  # time at its end
    KICK,  # time for which forces act in it
    BEHIND,  # time at the end of the last step for which its velocities have not been driven
    STAGE_ENTRIES,
) = range(6)
NODES = BLOCK * BLOCK  # of a block


@Part
def note_window(run: np.ndarray, counts: np.ndarray, status: int) -> None:
    """Note the window of blocks, or that it does not fit.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    status : int
        Status of the run where the window does not fit.
    """
    run[WEST_NOW], run[SOUTH_NOW] = counts[WEST], counts[SOUTH]
    run[WIDTH], run[HEIGHT] = counts[EAST] - counts[WEST] + 2, counts[NORTH] - counts[SOUTH] + 2
    run[SIZE] = run[WIDTH] * run[HEIGHT]
    if run[SIZE] > run[ROOM_PLACES]:
        run[STATUS] = status


@Kernel
def begin_step(run: np.ndarray, stage: np.ndarray, clock: np.ndarray, counts: np.ndarray) -> None:
    """Find reasons to stop before a step, and the window of blocks; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
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
    note_window(run, counts, NEEDS_ROOM)


@Kernel
def begin_again(run: np.ndarray, again: np.ndarray, counts: np.ndarray) -> None:
    """Begin a second sort within a step, of the places after it: find its window; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    again : int64[RUN_ENTRIES]
        Of the second sort.
    counts : int64[COUNTS]
    """
    again[STATUS] = run[STATUS]
    if again[STATUS] == 0:
        again[STOPPING] = 0
        note_window(again, counts, NEEDS_ROOM)


@Kernel
def end_again(run: np.ndarray, again: np.ndarray) -> None:
    """Note whether arrays of the second sort have to grow; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    again : int64[RUN_ENTRIES]
        Of the second sort.
    """
    if run[STATUS] == 0 and again[STATUS] == NEEDS_ROOM:
        run[STATUS] = NEEDS_ROOM_LATE


@Part
def place_of(key: int, run: np.ndarray) -> int:
    """Return the place in the window of a block's key.

    Parameters
    ----------
    key : int
    run : int64[RUN_ENTRIES]
    """
    return ((key >> 16) - run[SOUTH_NOW]) * run[WIDTH] + (key & 0xFFFF) - run[WEST_NOW]


@Kernel
def clear_window(run: np.ndarray, histogram: np.ndarray, slot: np.ndarray) -> None:
    """Clear the window: no columns.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    histogram : int32[places of the window]
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    """
    if run[STATUS] != 0:
        return
    for b in range(cuda.grid(1), run[SIZE], cuda.gridsize(1)):
        histogram[b], slot[b] = 0, -1


@Kernel
def count_columns(
    run: np.ndarray,
    counts: np.ndarray,
    rows: np.ndarray,
    keys: np.ndarray,
    histogram: np.ndarray,
    cells: np.ndarray,
    settings: Settings,
) -> None:
    """Count the columns in each place of the window, and find the cell of each column in its block.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    rows : float64[columns, ROW]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    histogram : int32[places of the window]
    cells : uint8[columns]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    for p in range(cuda.grid(1), counts[ROWS], cuda.gridsize(1)):
        if keys[p] != GONE:
            cuda.atomic.add(histogram, place_of(keys[p], run), 1)
            j, i = node_of(rows[p, Y], settings.dx), node_of(rows[p, X], settings.dx)
            cells[p] = (j % BLOCK) * BLOCK + i % BLOCK


@Part
def node_of(place: float, dx: float) -> int:
    """Return the first of the three nodes around a place along an axis, as `spline_bed.weights`.

    Parameters
    ----------
    place, dx : float [m]
    """
    return int64(place * (1.0 / dx) + 0.5)


@Kernel
def scatter_columns(
    run: np.ndarray, counts: np.ndarray, keys: np.ndarray, histogram: np.ndarray, loose: np.ndarray
) -> None:
    """List the indices of the columns of each block, in any order.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    histogram : int32[places of the window]
    loose : int32[columns]
    """
    if run[STATUS] != 0:
        return
    for p in range(cuda.grid(1), counts[ROWS], cuda.gridsize(1)):
        if keys[p] != GONE:
            at = cuda.atomic.add(histogram, place_of(keys[p], run), 1)
            loose[at] = p


@Kernel
def fill_slots(run: np.ndarray, block: np.ndarray, slot: np.ndarray) -> None:
    """Number the blocks with columns at their places of the window.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    block : int32[blocks with columns]
        Their places in the window.
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    """
    if run[STATUS] != 0:
        return
    for a in range(cuda.grid(1), run[ACTIVE], cuda.gridsize(1)):
        slot[block[a]] = a


@Kernel
def mark_touched(run: np.ndarray, slot: np.ndarray, flags: np.ndarray) -> None:
    """Mark the places of the window whose nodes columns reach.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    flags : int32[places of the window]
    """
    if run[STATUS] != 0:
        return
    width = run[WIDTH]
    for b in range(cuda.grid(1), run[SIZE], cuda.gridsize(1)):
        inner, upper = b % width > 0, b >= width
        hit = slot[b] >= 0 or (inner and slot[b - 1] >= 0) or (upper and slot[b - width] >= 0)
        flags[b] = 1 if hit or (inner and upper and slot[b - width - 1] >= 0) else 0


@Kernel
def rank_touched(run: np.ndarray, flags: np.ndarray, pieces: np.ndarray, touched: np.ndarray) -> None:
    """Number the touched blocks; stop if there are no columns.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    flags : int32[places of the window]
    pieces : int64[threads, 2]
        Sums over the pieces of the window.
    touched : int32[touched blocks]
        Their places in the window.
    """
    if run[STATUS] != 0:
        return
    c, n, size = cuda.grid(1), cuda.gridsize(1), run[SIZE]
    t = pieces[c, 1]
    if c == 0 and run[SORTED] == 0:
        run[STATUS] = ALL_LEFT
    for b in range(c * size // n, (c + 1) * size // n):
        if flags[b] != 0:
            touched[t] = b
            t += 1


@Kernel
def choose_step(run: np.ndarray, stage: np.ndarray, clock: np.ndarray, counts: np.ndarray, settings: Settings) -> None:
    """Choose the length of the step; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    dt, kick, behind, last = chosen_step(clock, counts, stage[UNTIL], settings)
    stage[DT], stage[KICK], stage[BEHIND] = dt, kick, behind
    stage[END] = stage[UNTIL] if last else clock[TIME] + dt
    run[LEFT] = run[FIRED] = run[STIFF] = 0


@Part
def node_at(run: np.ndarray, touched: np.ndarray, e: int) -> tuple[int, int]:
    """Return the row and the column of node `e` of all touched blocks.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    touched : int32[touched blocks]
        Their places in the window.
    e : int
    """
    b, n = touched[e // NODES], e % NODES
    j = (b // run[WIDTH] + run[SOUTH_NOW]) * BLOCK + n // BLOCK
    return j, (b % run[WIDTH] + run[WEST_NOW]) * BLOCK + n % BLOCK


@Part
def nodes_of(run: np.ndarray) -> int:
    """Return the number of nodes of all touched blocks; some of the last ones are beyond the arrays.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    """
    return NODES * run[TOUCHED]


@Part
def window_of(run: np.ndarray) -> BlockWindow:
    """Return the window of blocks.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    """
    return BlockWindow(run[WEST_NOW], run[SOUTH_NOW], run[WIDTH], run[HEIGHT])
