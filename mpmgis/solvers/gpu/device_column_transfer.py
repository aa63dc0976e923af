"""Transfers between columns and grid on the device.

What happens to a column is the code of the CPU's kernels, for a batch of one. Sums to nodes have no atomic additions.
The nine nodes that a column reaches have different remainders by three: each of nine threads owns the nodes of a tile
with the same remainders. It adds columns in a register as long as the next one has the same first node, as columns are
in the order of their cells, and then to a tile in shared memory, in which no other thread adds to that node.
"""

from numba import cuda, float64, int32, int64, uint32

from ...compiled.block_order import LEFT_MASS, LEFT_X, LEFT_Y, place_left
from ..columns.column_blocks import BLOCK, TILE
from ..columns.column_clock import BOUND_BED, BOUND_ENERGY, KICK_BEFORE, TOTAL_MASS
from ..columns.column_motion import SpeedBound, StepTimes
from ..columns.column_report import FASTEST2, OUT, REPORT, STIFF
from ..columns.column_rows import MASS, ROW, U, V, X, Y
from ..columns.columns_to_grid import pressure_impulses
from ..columns.grid_to_columns import Batch, clear_report, finish_report, move_batch
from .device_column_batch import LINES, QUAD, QUADS, WX, WY
from .device_column_sort import BEHIND, DT, KICK, LEFT, node_at, nodes_of
from .device_column_sort import STIFF as STIFF_NOW
from .device_functions import Kernel, Part, capped
from .launch import ACTIVE, HEIGHT, SORTED, SOUTH_NOW, STATUS, WEST_NOW, WIDEST, WIDTH

TILE_NODES = TILE * TILE
TILE_SIZE = 4 * TILE_NODES
PIECE = 128  # columns staged at a time
# numbers of a staged column: of each of three columns of nodes weight, mass, energy, momentum east and north; of each
# of three rows of nodes weight, momentum east and north
WEIGHT, LIGHT, PUSHED, OF_COLUMN = 0, 1, 3, 5
ALONG, OF_ROW, ROWS_FROM = 1, 3, 15
SLOT = 25  # an odd number: threads write the same number of their columns at the same time, to different banks
STAGE = PIECE * SLOT
NONE = TILE_NODES  # no node
OWNERS, GROUPS = 9, 7  # threads that own the nodes of a tile, and groups of them that share the columns of a piece
HALF = 64  # place of a thread from which on it adds the momentum of its nodes, and before it mass and energy
LANES = 2 * HALF
SUMS = GROUPS * TILE_SIZE
ROOM = ROW + 1  # as SLOT
ROOMS = WIDEST * ROOM
FASTEST_AT, COLUMN_REPORT = REPORT, REPORT + 1  # place in the order of the column with the largest speed; -1: none
SOME_MASS = 1e-200  # [kg], of a run that has lost its mass
MOST = 2.0**61  # whole numbers in which the mass of a run is counted where it leaves


@Part
def take_rows(staged, size, rows, order, first, count, thread, quarter):
    """Copy the rows of columns order[first : first + count] to places of `size` numbers in `staged`.

    Four threads read a row, 32 bytes of it at a time. A `thread` of four times `quarter` takes a part of four rows,
    of which those from `count` on are the last one again.
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
def give_rows(staged, size, rows, order, first, count, thread, quarter):
    """Copy to the rows what `take_rows` copied from them; each thread the numbers that it took."""
    e = uint32(thread) % uint32(4)
    for part in range(4):
        s = uint32(thread) // uint32(4) + uint32(part * quarter)
        if s < uint32(count):
            p, at = uint32(order[uint32(first) + s]), s * uint32(size) + e
            rows[p, e] = staged[at]
            rows[p, e + uint32(4)] = staged[at + uint32(4)]
            rows[p, e + uint32(8)] = staged[at + uint32(8)]


@Kernel
def columns_to_grid(run, stage, rows, order, start, block, tiles, fields, settings, laws):
    """Sum mass, momentum and impulse of each block's columns into its tile; see `columns_to_grid`."""
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
def add_share(sums, staged, bases, lane, count):
    """Add the share of a group of the `count` staged columns to the nodes that `lane` owns, two numbers of each."""
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
def gather_nodes(run, tiles, slot, touched, nodes):
    """Sum the up to four tiles that overlap a node, always in the same order."""
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < nodes.shape[0] and i < nodes.shape[1]:
            for k in range(4):
                nodes[j, i, k] = tile_sum(run, tiles, slot, j, i, k, 4)


@Part
def tile_sum(run, tiles, slot, j, i, k, numbers):
    """Sum of number `k` of the `numbers` of node [j, i] over the tiles that overlap it."""
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
def grid_to_columns(run, stage, clock, rows, keys, order, grid, left, reports, settings, laws, earth_pressure):
    """Read the new velocity field back and move the columns; see `grid_to_columns`.

    `grid` is a FlatGrid whose arrays that are read by flat index have one dimension; `left` int32[n] takes the columns
    that left, in any order. At most WIDEST threads in a block, a multiple of four.
    """
    rooms = cuda.shared.array(ROOMS, float64)
    marks = cuda.shared.array((WIDEST, OUT), float64)  # an odd number, as ROOM
    scratch, moved = cuda.local.array(LINES, float64), cuda.local.array(LINES, float64)
    quads = cuda.local.array(QUADS, float64)
    place, stays = cuda.local.array(1, int64), cuda.local.array(1, int64)
    batch = Batch(scratch, moved, quads, place, stays)
    thread, threads, fastest_at = int32(cuda.threadIdx.x), int32(cuda.blockDim.x), int32(-1)
    part, mine = marks[thread], reports[cuda.grid(1)]
    part[STIFF] = 0.0
    clear_report(part, mine)
    times = StepTimes(stage[DT], stage[BEHIND], clock[KICK_BEFORE])
    bound = SpeedBound(clock[BOUND_BED], clock[BOUND_ENERGY], earth_pressure.largest_factor())
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
def book_left(run, stage, clock, rows, left, inside, leaving, settings):
    """Add what left in this step to `leaving` int64[WAYS, blocks, blocks, LEFT_ENTRIES], in units of `left_unit`.

    They are whole numbers: their sum has no order.
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
def note_left(run, stage, clock, rows, left, inside, leaving, left_cells, settings):
    """Add the sums of `book_left` to `left_cells` and clear them; one of the columns that left at a block gets them."""
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), run[LEFT], cuda.gridsize(1)):
        way, row, column, _, _ = way_out(stage, rows, left[k], inside.shape, settings.dx)
        for entry in (LEFT_MASS, LEFT_X, LEFT_Y):
            total = cuda.atomic.exch(leaving, (way, row, column, entry), 0)
            if total != 0:
                left_cells[way, row, column, entry] += total * left_unit(entry, clock, inside.shape, settings.dx)


@Part
def left_unit(entry, clock, shape, dx):
    """Unit [kg or kg m] of number `entry` of what leaves: the mass of the run is MOST of them, at the far edge."""
    unit = max(clock[TOTAL_MASS], SOME_MASS) / MOST
    if entry == LEFT_MASS:
        return unit
    return unit * dx * (shape[1] if entry == LEFT_X else shape[0])


@Part
def way_out(stage, rows, p, shape, dx):
    """`place_left` of column `p`, whose row has its last place on the terrain."""
    return place_left(shape, rows[p, X] + stage[DT] * rows[p, U], rows[p, Y] + stage[DT] * rows[p, V], dx)
