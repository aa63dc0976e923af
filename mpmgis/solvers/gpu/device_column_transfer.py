"""Transfers between columns and grid on the device.

What happens to a column is the code of the CPU's kernels, for a batch of one. Sums to nodes have no atomic additions.
The nine nodes that a column reaches have different remainders by three: each of nine threads owns the nodes of a tile
with the same remainders. It adds columns in a register as long as the next one has the same first node, as columns are
in the order of their cells, and then to a tile in shared memory, in which no other thread adds to that node.
"""

import numpy as np
from numba import cuda, float64, int32, int64, uint32

from ...compiled.block_order import LEFT_MASS, LEFT_X, LEFT_Y, place_left
from ..columns.column_blocks import BLOCK, TILE
from ..columns.column_motion import MotionLaws, SpeedBound, StepTimes
from ..columns.column_records import NodeFields, Settings
from ..columns.column_report import FASTEST2, OUT, REPORT, STIFF
from ..columns.column_rows import MASS, ROW, U, V, X, Y
from ..columns.column_time_step import BOUND_BED, BOUND_ENERGY, KICK_BEFORE, TOTAL_MASS
from ..columns.columns_to_grid import StressLaws, pressure_impulses
from ..columns.grid_to_columns import Batch, FlatGrid, clear_report, finish_report, move_batch
from .device_column_batch import LINES, QUAD, QUADS, WX, WY
from .device_column_sort import BEHIND, DT, KICK, LEFT, node_at, nodes_of
from .device_column_sort import STIFF as STIFF_NOW
from .device_functions import Kernel, Part, capped
from .launch import ACTIVE, HEIGHT, SORTED, SOUTH_NOW, STATUS, WEST_NOW, WIDEST, WIDTH

TILE_NODES = TILE * TILE
TILE_SIZE = 4 * TILE_NODES  # numbers of a tile
PIECE = 128  # columns staged at a time
# a staged column has OF_COLUMN numbers for each of three columns of nodes, then OF_ROW for each of three rows of nodes
WEIGHT = 0  # of both: weight
LIGHT = 1  # of a column of nodes: mass and energy
PUSHED = 3  # of a column of nodes: momentum east and north
OF_COLUMN = 5
ALONG = 1  # of a row of nodes: momentum east and north
OF_ROW = 3
ROWS_FROM = 3 * OF_COLUMN  # where the rows of nodes begin
SLOT = 25  # numbers of a staged column; odd: threads write the same number of theirs at a time, to different banks
STAGE = PIECE * SLOT
NONE = TILE_NODES  # no node
OWNERS = 9  # threads that own the nodes of a tile
GROUPS = 7  # groups of OWNERS that share the columns of a piece
HALF = 64  # place of a thread from which on it adds the momentum of its nodes, and before it mass and energy
LANES = 2 * HALF  # threads that add to nodes
SUMS = GROUPS * TILE_SIZE
ROOM = ROW + 1  # numbers for a row in shared memory; odd for the same reason as SLOT
ROOMS = WIDEST * ROOM
FASTEST_AT = REPORT  # entry of a report: place in the order of the column with the largest speed; -1: none
COLUMN_REPORT = REPORT + 1
SOME_MASS = 1e-200  # [kg] of a run that has lost its mass
MOST = 2.0**61  # whole numbers in which the mass of a run is counted where it leaves


@Part
def take_rows(
    staged: np.ndarray,
    size: int,
    rows: np.ndarray,
    order: np.ndarray,
    first: int,
    count: int,
    thread: int,
    quarter: int,
) -> None:
    """Copy the rows of columns order[first : first + count] to shared memory.

    Four threads read a row, 32 bytes of it at a time. A thread takes a part of four rows, of which those from `count`
    on are the last one again.

    Parameters
    ----------
    staged : float64[n]
        In shared memory.
    size : int
        Numbers for each row in `staged`.
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    first : int
        Place of the first of them in the order.
    count : int
        Number of columns.
    thread : int
        Below four times `quarter`.
    quarter : int
        A fourth of the threads that take part.
    """
    s, e, last = uint32(thread) // uint32(4), uint32(thread) % uint32(4), uint32(count - 1)
    s1, s2, s3 = s + uint32(quarter), s + uint32(2 * quarter), s + uint32(3 * quarter)
    n = uint32(first)
    p0, p1 = uint32(order[n + min(s, last)]), uint32(order[n + min(s1, last)])
    p2, p3 = uint32(order[n + min(s2, last)]), uint32(order[n + min(s3, last)])
    e4, e8 = e + uint32(4), e + uint32(8)
    a0, b0, c0 = rows[p0, e], rows[p0, e4], rows[p0, e8]
    a1, b1, c1 = rows[p1, e], rows[p1, e4], rows[p1, e8]
    a2, b2, c2 = rows[p2, e], rows[p2, e4], rows[p2, e8]
    a3, b3, c3 = rows[p3, e], rows[p3, e4], rows[p3, e8]
    at = s * uint32(size) + e
    staged[at], staged[at + uint32(4)], staged[at + uint32(8)] = a0, b0, c0
    at = s1 * uint32(size) + e
    staged[at], staged[at + uint32(4)], staged[at + uint32(8)] = a1, b1, c1
    at = s2 * uint32(size) + e
    staged[at], staged[at + uint32(4)], staged[at + uint32(8)] = a2, b2, c2
    at = s3 * uint32(size) + e
    staged[at], staged[at + uint32(4)], staged[at + uint32(8)] = a3, b3, c3


@Part
def give_rows(
    staged: np.ndarray,
    size: int,
    rows: np.ndarray,
    order: np.ndarray,
    first: int,
    count: int,
    thread: int,
    quarter: int,
) -> None:
    """Copy to the rows what `take_rows` copied from them; each thread the numbers that it took.

    Parameters
    ----------
    staged : float64[n]
        In shared memory.
    size : int
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    first : int
        Place of the first of them in the order.
    count : int
        Number of columns.
    thread, quarter : int
    """
    e = uint32(thread) % uint32(4)
    for part in range(4):
        s = uint32(thread) // uint32(4) + uint32(part * quarter)
        if s < uint32(count):
            p, at = uint32(order[uint32(first) + s]), s * uint32(size) + e
            rows[p, e] = staged[at]
            rows[p, e + uint32(4)] = staged[at + uint32(4)]
            rows[p, e + uint32(8)] = staged[at + uint32(8)]


@Kernel
def columns_to_grid(
    run: np.ndarray,
    stage: np.ndarray,
    rows: np.ndarray,
    order: np.ndarray,
    start: np.ndarray,
    block: np.ndarray,
    tiles: np.ndarray,
    fields: NodeFields,
    settings: Settings,
    laws: StressLaws,
) -> None:
    """Sum mass, momentum and impulse of each block's columns into its tile (see `columns_to_grid.particles_to_grid`).

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    start : int64[blocks with columns + 1]
        Where the columns of each block begin in the order.
    block : int32[blocks with columns]
        Their places in the window.
    tiles : float64[blocks with columns, TILE_SIZE]
    fields : NodeFields
    settings : Settings
    laws : StressLaws
    """
    if run[STATUS] != 0:
        return
    staged = cuda.shared.array(STAGE, float64)
    sums = cuda.shared.array(SUMS, float64)
    bases = cuda.shared.array(PIECE, uint32)
    scratch, quads = cuda.local.array(LINES, float64), cuda.local.array(QUADS, float64)
    place = cuda.local.array(1, int64)
    thread, threads, capped = int32(cuda.threadIdx.x), int32(cuda.blockDim.x), int32(0)
    west, south, width = int32(run[WEST_NOW]), int32(run[SOUTH_NOW]), int32(run[WIDTH])
    for e in range(thread, int32(SUMS), threads):
        sums[uint32(e)] = 0.0
    for a in range(int32(cuda.blockIdx.x), int32(run[ACTIVE]), int32(cuda.gridDim.x)):
        b, begin, end = int32(block[uint32(a)]), int32(start[uint32(a)]), int32(start[uint32(a + 1)])
        i_block, j_block = (b % width + west) * int32(BLOCK), (b // width + south) * int32(BLOCK)
        for first in range(begin, end, int32(PIECE)):
            count = min(int32(PIECE), end - first)
            cuda.syncthreads()
            for s in range(thread, int32(PIECE), threads):
                take_rows(staged, SLOT, rows, order, first, count, s, PIECE // 4)
            cuda.syncthreads()
            for s in range(thread, count, threads):
                at = uint32(s) * uint32(SLOT)
                for e in range(ROW):
                    scratch[e] = staged[at + uint32(e)]
                capped += pressure_impulses(
                    scratch,
                    quads,
                    place,
                    1,
                    i_block,
                    j_block,
                    fields.bed,
                    fields.lake_level,
                    stage[KICK],
                    settings,
                    laws,
                )
                bases[uint32(s)] = uint32(place[0] >> 2)
                for k in range(3):
                    column, line = at + uint32(k * OF_COLUMN), at + uint32(ROWS_FROM + k * OF_ROW)
                    staged[column + uint32(WEIGHT)], staged[line + uint32(WEIGHT)] = scratch[WX + k], scratch[WY + k]
                    staged[column + uint32(LIGHT)] = quads[QUAD * k]
                    staged[column + uint32(LIGHT + 1)] = quads[QUAD * k + 3]
                    for e in range(2):
                        staged[column + uint32(PUSHED + e)] = quads[QUAD * k + 1 + e]
                        staged[line + uint32(ALONG + e)] = quads[QUAD * (3 + k) + 1 + e]
            cuda.syncthreads()
            for lane in range(thread, int32(LANES), threads):
                add_share(sums, staged, bases, uint32(lane), uint32(count))
        cuda.syncthreads()
        for e in range(uint32(thread), uint32(TILE_SIZE), uint32(threads)):
            total = 0.0
            for g in range(GROUPS):
                total += sums[e + uint32(g * TILE_SIZE)]
                sums[e + uint32(g * TILE_SIZE)] = 0.0
            tiles[uint32(a), e] = total
    if capped > 0:
        cuda.atomic.add(run, STIFF_NOW, int64(capped))


@Part
def add_share(sums: np.ndarray, staged: np.ndarray, bases: np.ndarray, lane: int, count: int) -> None:
    """Add the share of a group of staged columns to the nodes that `lane` owns, two numbers of each.

    Parameters
    ----------
    sums : float64[SUMS]
        In shared memory.
    staged : float64[STAGE]
        In shared memory.
    bases : uint32[PIECE]
        First node of each column in the tile.
    lane : int
    count : int
        Number of staged columns.
    """
    pushes, member = lane >= uint32(HALF), uint32(lane % uint32(HALF))
    group, owner = uint32(member // uint32(OWNERS)), uint32(member % uint32(OWNERS))
    if group >= uint32(GROUPS):
        return
    i_own, j_own = uint32(owner % uint32(3)), uint32(owner // uint32(3))
    q, end = (
        uint32(uint32(count * group) // uint32(GROUPS)),
        uint32(uint32(count * (group + uint32(1))) // uint32(GROUPS)),
    )
    at, known, node, a, b = uint32(q * uint32(SLOT)), uint32(NONE), uint32(0), 0.0, 0.0
    column = line = uint32(0)
    to_a, to_b = uint32(1 if pushes else 0), uint32(2 if pushes else 3)
    while q < end:
        here = bases[q]
        if here != known:
            if known != uint32(NONE):
                sums[uint32(node + to_a)] += a
                sums[uint32(node + to_b)] += b
                a = b = 0.0
            known = here
            j = uint32(here // uint32(TILE))
            i = uint32(here - j * uint32(TILE))
            i = uint32(uint32(i_own + uint32(12) - i) % uint32(3))
            j = uint32(uint32(j_own + uint32(12) - j) % uint32(3))
            node = uint32(group * uint32(TILE_SIZE) + uint32(4) * (here + j * uint32(TILE) + i))
            column, line = uint32(i * uint32(OF_COLUMN)), uint32(uint32(ROWS_FROM) + j * uint32(OF_ROW))
        of_column, of_row = uint32(at + column), uint32(at + line)
        wy = staged[of_row]
        if pushes:
            wx = staged[of_column]
            a += wy * staged[of_column + uint32(PUSHED)] + wx * staged[of_row + uint32(ALONG)]
            b += wy * staged[of_column + uint32(PUSHED + 1)] + wx * staged[of_row + uint32(ALONG + 1)]
        else:
            a += wy * staged[of_column + uint32(LIGHT)]
            b += wy * staged[of_column + uint32(LIGHT + 1)]
        at, q = uint32(at + uint32(SLOT)), uint32(q + uint32(1))
    if known != uint32(NONE):
        sums[uint32(node + to_a)] += a
        sums[uint32(node + to_b)] += b


@Kernel
def gather_nodes(run: np.ndarray, tiles: np.ndarray, slot: np.ndarray, touched: np.ndarray, nodes: np.ndarray) -> None:
    """Sum the up to four tiles that overlap a node, always in the same order.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    tiles : float64[blocks with columns, TILE_SIZE]
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    touched : int32[touched blocks]
        Their places in the window.
    nodes : float64[ny + 3, nx + 3, 4]
    """
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < nodes.shape[0] and i < nodes.shape[1]:
            for k in range(4):
                nodes[j, i, k] = tile_sum(run, tiles, slot, j, i, k, 4)


@Part
def tile_sum(run: np.ndarray, tiles: np.ndarray, slot: np.ndarray, j: int, i: int, k: int, numbers: int) -> float:
    """Sum one number of node [j, i] over the tiles that overlap it.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    tiles : float64[blocks with columns, n]
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    j, i : int
    k : int
        Which number.
    numbers : int
        Numbers of a node.
    """
    row, column, width, height, total = (
        j // BLOCK - run[SOUTH_NOW],
        i // BLOCK - run[WEST_NOW],
        run[WIDTH],
        run[HEIGHT],
        0.0,
    )
    for back_j in range(2):
        for back_i in range(2):
            bj, bi = row - back_j, column - back_i
            tile_j, tile_i = j % BLOCK + BLOCK * back_j, i % BLOCK + BLOCK * back_i
            if 0 <= bj < height and 0 <= bi < width and tile_j < TILE and tile_i < TILE:
                a = slot[bj * width + bi]
                if a >= 0:
                    total += tiles[a, (tile_j * TILE + tile_i) * numbers + k]
    return total


@capped(double=128)
def grid_to_columns(
    run: np.ndarray,
    stage: np.ndarray,
    clock: np.ndarray,
    rows: np.ndarray,
    keys: np.ndarray,
    order: np.ndarray,
    grid: FlatGrid,
    left: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    laws: MotionLaws,
    wave_factor: float,
) -> None:
    """Read the new velocity field back and move the columns (see `grid_to_columns.grid_to_particles`).

    At most WIDEST threads in a block, a multiple of four.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    clock : float64[CLOCK]
    rows : float64[columns, ROW]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    order : int32[columns]
        Indices of columns in the order of blocks.
    grid : FlatGrid
        Arrays that are read by flat index have one dimension.
    left : int32[columns]
        Becomes the columns that left, in any order.
    reports : float64[threads, COLUMN_REPORT]
    settings : Settings
    laws : MotionLaws
    wave_factor : float [1]
        Largest factor of earth pressure.
    """
    rooms = cuda.shared.array(ROOMS, float64)
    marks = cuda.shared.array((WIDEST, OUT), float64)  # an odd number, as ROOM
    scratch, moved = cuda.local.array(LINES, float64), cuda.local.array(LINES, float64)
    quads = cuda.local.array(QUADS, float64)
    place, stays = cuda.local.array(1, int64), cuda.local.array(1, int64)
    batch = Batch(rows, scratch, moved, quads, place, stays)
    thread, threads, fastest_at = int32(cuda.threadIdx.x), int32(cuda.blockDim.x), int32(-1)
    part, mine = marks[thread], reports[cuda.grid(1)]
    part[STIFF] = 0.0
    clear_report(part, mine)
    times = StepTimes(stage[DT], stage[BEHIND], clock[KICK_BEFORE])
    bound = SpeedBound(clock[BOUND_BED], clock[BOUND_ENERGY], wave_factor)
    end = int32(run[SORTED]) if run[STATUS] == 0 else int32(0)
    for first in range(int32(cuda.blockIdx.x) * threads, end, int32(cuda.gridDim.x) * threads):
        count = min(threads, end - first)
        take_rows(rooms, ROOM, rows, order, first, count, thread, threads // int32(4))
        cuda.syncthreads()
        if thread < count:
            at, fastest, q = uint32(thread) * uint32(ROOM), part[FASTEST2], uint32(first + thread)
            for e in range(ROW):
                scratch[e] = rooms[at + uint32(e)]
            move_batch(keys, order, q, 1, batch, grid, part, mine, times, bound, settings, laws)
            for e in range(ROW):
                rooms[at + uint32(e)] = moved[e]
            if part[FASTEST2] > fastest:
                fastest_at = first + thread
            if stays[0] == 0:
                left[cuda.atomic.add(run, LEFT, 1)] = order[q]
        cuda.syncthreads()
        give_rows(rooms, ROOM, rows, order, first, count, thread, threads // int32(4))
    finish_report(part)
    for k in range(OUT):
        mine[k] = part[k]
    mine[FASTEST_AT] = fastest_at


@Kernel
def book_left(
    run: np.ndarray,
    stage: np.ndarray,
    clock: np.ndarray,
    rows: np.ndarray,
    left: np.ndarray,
    inside: np.ndarray,
    leaving: np.ndarray,
    settings: Settings,
) -> None:
    """Add what left in this step to `leaving`, in whole numbers of `left_unit`: their sum has no order.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    clock : float64[CLOCK]
    rows : float64[columns, ROW]
    left : int32[columns]
        Columns that left.
    inside : uint8[ny, nx]
        1 where there is terrain.
    leaving : int64[WAYS, blocks, blocks, LEFT_ENTRIES]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), run[LEFT], cuda.gridsize(1)):
        p = left[k]
        way, row, column, x, y = way_out(stage, rows, p, inside.shape, settings.dx)
        for entry, value in ((LEFT_MASS, 1.0), (LEFT_X, x), (LEFT_Y, y)):
            unit = left_unit(entry, clock, inside.shape, settings.dx)
            cuda.atomic.add(leaving, (way, row, column, entry), int64(rows[p, MASS] * value / unit + 0.5))


@Kernel
def note_left(
    run: np.ndarray,
    stage: np.ndarray,
    clock: np.ndarray,
    rows: np.ndarray,
    left: np.ndarray,
    inside: np.ndarray,
    leaving: np.ndarray,
    left_cells: np.ndarray,
    settings: Settings,
) -> None:
    """Add the sums of `book_left` to `left_cells` and clear them; one of the columns that left at a block gets them.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    clock : float64[CLOCK]
    rows : float64[columns, ROW]
    left : int32[columns]
        Columns that left.
    inside : uint8[ny, nx]
        1 where there is terrain.
    leaving : int64[WAYS, blocks, blocks, LEFT_ENTRIES]
    left_cells : float64[WAYS, blocks, blocks, LEFT_ENTRIES]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), run[LEFT], cuda.gridsize(1)):
        way, row, column, _, _ = way_out(stage, rows, left[k], inside.shape, settings.dx)
        for entry in (LEFT_MASS, LEFT_X, LEFT_Y):
            total = cuda.atomic.exch(leaving, (way, row, column, entry), 0)
            if total != 0:
                left_cells[way, row, column, entry] += total * left_unit(entry, clock, inside.shape, settings.dx)


@Part
def left_unit(entry: int, clock: np.ndarray, shape: tuple, dx: float) -> float:
    """Return the unit [kg or kg m] of what leaves: the mass of the run is MOST of them, at the far edge.

    Parameters
    ----------
    entry : int
        Number of `block_order` of what leaves.
    clock : float64[CLOCK]
    shape : (int, int)
        Of the cells.
    dx : float [m]
    """
    unit = max(clock[TOTAL_MASS], SOME_MASS) / MOST
    if entry == LEFT_MASS:
        return unit
    return unit * dx * (shape[1] if entry == LEFT_X else shape[0])


@Part
def way_out(stage: np.ndarray, rows: np.ndarray, p: int, shape: tuple, dx: float) -> tuple[int, int, int, float, float]:
    """Return by which way a column left and where (see `block_order.place_left`).

    Its row has its last place on the terrain.

    Parameters
    ----------
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    rows : float64[columns, ROW]
    p : int
        Index of the column.
    shape : (int, int)
        Of the cells.
    dx : float [m]
    """
    return place_left(shape, rows[p, X] + stage[DT] * rows[p, U], rows[p, Y] + stage[DT] * rows[p, V], dx)
