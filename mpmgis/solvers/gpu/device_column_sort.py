"""Columns sorted by blocks, and the blocks of nodes that they touch; what does not depend on columns is `point_sort`.

The result is that of `column_blocks.sort_by_block` and `touched_blocks`. The window has one more row and column
of blocks than hold columns, so that a touched block has the same number in it as on the processor.
"""

from numba import cuda, int64

from ...compiled.block_order import GONE
from ..columns.column_blocks import BLOCK, BlockWindow
from ..columns.column_clock import ALIVE, ALL_LEFT, EAST, NORTH, REACHED_TIME, ROWS, SOUTH, TIME, WATCHED_REACHED, WEST
from ..columns.column_loop import choose_step as chosen_step
from ..columns.column_rows import X, Y
from . import launch
from .device_functions import Kernel, Part
from .launch import ACTIVE, HEIGHT, NEEDS_ROOM, ROOM_PLACES, SIZE, SORTED, SOUTH_NOW, STATUS, TOUCHED, WEST_NOW, WIDTH

# further int64 entries of a run: columns that left in this step, areas that the flow fired, columns whose viscosity was
# limited, columns that stop as a whole
LEFT, FIRED, STIFF, STOPPING, RUN_ENTRIES = range(launch.RUN_ENTRIES, launch.RUN_ENTRIES + 5)
NEEDS_ROOM_LATE = 101  # status: the host enlarges arrays of the second sort and finishes the step
# float64 entries: time of the request, length of this step, time at its end, of its kick, and of the last step before
# it that is not driven yet [s]
UNTIL, DT, END, KICK, BEHIND, STAGE_ENTRIES = range(6)
NODES = BLOCK * BLOCK


@Part
def note_window(run, counts, status):
    """The window of blocks; `status` where it does not fit."""
    run[WEST_NOW], run[SOUTH_NOW] = counts[WEST], counts[SOUTH]
    run[WIDTH], run[HEIGHT] = counts[EAST] - counts[WEST] + 2, counts[NORTH] - counts[SOUTH] + 2
    run[SIZE] = run[WIDTH] * run[HEIGHT]
    if run[SIZE] > run[ROOM_PLACES]:
        run[STATUS] = status


@Kernel
def begin_step(run, stage, clock, counts):
    """Reasons to stop before a step, and the window of blocks; one thread."""
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
def begin_again(run, again, counts):
    """The window of a second sort within a step, of the places after it; one thread. `again` is as `run`."""
    again[STATUS] = run[STATUS]
    if again[STATUS] == 0:
        again[STOPPING] = 0
        note_window(again, counts, NEEDS_ROOM)


@Kernel
def end_again(run, again):
    """Whether arrays of the second sort have to grow; one thread."""
    if run[STATUS] == 0 and again[STATUS] == NEEDS_ROOM:
        run[STATUS] = NEEDS_ROOM_LATE


@Part
def place_of(key, run):
    """Place in the window of a block's key."""
    return ((key >> 16) - run[SOUTH_NOW]) * run[WIDTH] + (key & 0xFFFF) - run[WEST_NOW]


@Kernel
def clear_window(run, histogram, slot):
    """No columns in the window."""
    if run[STATUS] != 0:
        return
    for b in range(cuda.grid(1), run[SIZE], cuda.gridsize(1)):
        histogram[b], slot[b] = 0, -1


@Kernel
def count_columns(run, counts, rows, keys, histogram, cells, settings):
    """Number of columns in each place of the window; and the cell of each column in its block."""
    if run[STATUS] != 0:
        return
    for p in range(cuda.grid(1), counts[ROWS], cuda.gridsize(1)):
        if keys[p] != GONE:
            cuda.atomic.add(histogram, place_of(keys[p], run), 1)
            j, i = node_of(rows[p, Y], settings.dx), node_of(rows[p, X], settings.dx)
            cells[p] = (j % BLOCK) * BLOCK + i % BLOCK


@Part
def node_of(place, dx):
    """First of the three nodes around a `place` [m] along an axis, as `spline_bed.weights`."""
    return int64(place * (1.0 / dx) + 0.5)


@Kernel
def scatter_columns(run, counts, keys, histogram, loose):
    """Indices of the columns of each block, in any order."""
    if run[STATUS] != 0:
        return
    for p in range(cuda.grid(1), counts[ROWS], cuda.gridsize(1)):
        if keys[p] != GONE:
            at = cuda.atomic.add(histogram, place_of(keys[p], run), 1)
            loose[at] = p


@Kernel
def fill_slots(run, block, slot):
    """Number of the block with columns at each place of the window."""
    if run[STATUS] != 0:
        return
    for a in range(cuda.grid(1), run[ACTIVE], cuda.gridsize(1)):
        slot[block[a]] = a


@Kernel
def mark_touched(run, slot, flags):
    """Mark the places of the window whose nodes columns reach."""
    if run[STATUS] != 0:
        return
    width = run[WIDTH]
    for b in range(cuda.grid(1), run[SIZE], cuda.gridsize(1)):
        inner, upper = b % width > 0, b >= width
        hit = slot[b] >= 0 or (inner and slot[b - 1] >= 0) or (upper and slot[b - width] >= 0)
        flags[b] = 1 if hit or (inner and upper and slot[b - width - 1] >= 0) else 0


@Kernel
def rank_touched(run, flags, pieces, watched, touched):
    """Number the touched blocks; stop if one is marked in `watched`, or if there are no columns."""
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
            row, column = b // run[WIDTH] + run[SOUTH_NOW], b % run[WIDTH] + run[WEST_NOW]
            if row < watched.shape[0] and column < watched.shape[1] and watched[row, column] != 0:
                run[STATUS] = WATCHED_REACHED


@Kernel
def choose_step(run, stage, clock, counts, settings):
    """Length of the step; one thread."""
    if run[STATUS] != 0:
        return
    dt, kick, behind, last = chosen_step(clock, counts, stage[UNTIL], settings)
    stage[DT], stage[KICK], stage[BEHIND] = dt, kick, behind
    stage[END] = stage[UNTIL] if last else clock[TIME] + dt
    run[LEFT] = run[FIRED] = run[STIFF] = 0


@Part
def node_at(run, touched, e):
    """(row, column) of node `e` of all touched blocks."""
    b, n = touched[e // NODES], e % NODES
    j = (b // run[WIDTH] + run[SOUTH_NOW]) * BLOCK + n // BLOCK
    return j, (b % run[WIDTH] + run[WEST_NOW]) * BLOCK + n % BLOCK


@Part
def nodes_of(run):
    """Number of nodes of all touched blocks; some of the last ones are beyond the arrays."""
    return NODES * run[TOUCHED]


@Part
def window_of(run):
    """The BlockWindow of the run."""
    return BlockWindow(run[WEST_NOW], run[SOUTH_NOW], run[WIDTH], run[HEIGHT])
