"""Transfers between columns and grid on the device.

What happens to a column is the code of the CPU's kernels, for a batch of one. Sums to nodes have no atomic additions:
a thread owns a node of the tile of a block, and adds the columns of the block in their order.
"""

from numba import cuda, float64, int32, int64

from ..kernels.block_order import LEFT_MASS, LEFT_X, LEFT_Y, place_left
from ..kernels.column_clock import BOUND_BED, BOUND_ENERGY, KICK_BEFORE
from ..kernels.column_report import FASTEST2, REPORT, STIFF
from ..kernels.column_rows import BLOCK, MASS, ROW, TILE, U, V, X, Y
from ..kernels.columns_to_grid import _impulses
from ..kernels.grid_to_columns import clear_report, finish_report, move_batch
from .column_lines import LINES, QUAD, QUADS, WX, WY
from .column_sort import BEHIND, DT, KICK, LEFT, node_at, nodes_of
from .column_sort import STIFF as STIFF_NOW
from .compiled import Kernel, Part
from .launch import ACTIVE, HEIGHT, SORTED, SOUTH_NOW, STATUS, WEST_NOW, WIDTH

TILE_NODES = TILE * TILE
TILE_SIZE = 4 * TILE_NODES
PIECE = 64  # columns staged at a time
STAGED = 30  # numbers of a column that are staged: weights of both axes, groups of four
FIRST_QUAD = 6
STAGE = PIECE * STAGED
FASTEST_AT, COLUMN_REPORT = REPORT, REPORT + 1  # place in the order of the column with the largest speed; -1: none


@Kernel
def columns_to_grid(
    run, stage, rows, order, start, block, tiles, bed, lake_level, settings, metric, lake, earth_pressure, viscosity
):
    """Sum mass, momentum and impulse of each block's columns into its tile; see `kernels.columns_to_grid`."""
    if run[STATUS] != 0:
        return
    staged = cuda.shared.array(STAGE, float64)
    places = cuda.shared.array((PIECE, 2), int32)
    scratch, quads = cuda.local.array(LINES, float64), cuda.local.array(QUADS, float64)
    place = cuda.local.array(1, int64)
    thread, threads, capped = cuda.threadIdx.x, cuda.blockDim.x, int64(0)
    for a in range(int32(cuda.blockIdx.x), int32(run[ACTIVE]), int32(cuda.gridDim.x)):
        i_block = (block[a] % run[WIDTH] + run[WEST_NOW]) * BLOCK
        j_block = (block[a] // run[WIDTH] + run[SOUTH_NOW]) * BLOCK
        for n in range(thread, TILE_NODES, threads):
            for e in range(4):
                tiles[a, 4 * n + e] = 0.0
        for first in range(int32(start[a]), int32(start[a + 1]), int32(PIECE)):
            count = min(int32(PIECE), int32(start[a + 1]) - first)
            cuda.syncthreads()
            for s in range(thread, count, threads):
                for e in range(ROW):
                    scratch[e] = rows[order[first + s], e]
                capped += _impulses(
                    scratch, quads, place, 1, i_block, j_block, bed, lake_level, settings.dx, stage[KICK],
                    settings.density, settings.gravity, metric, lake, earth_pressure, viscosity,
                )  # fmt: skip
                places[s, 0], places[s, 1] = place[0] // 4 // TILE, place[0] // 4 % TILE
                for k in range(3):
                    staged[s * STAGED + k], staged[s * STAGED + 3 + k] = scratch[WX + k], scratch[WY + k]
                for k in range(QUADS):
                    staged[s * STAGED + FIRST_QUAD + k] = quads[k]
            cuda.syncthreads()
            for n in range(thread, TILE_NODES, threads):
                add_piece(tiles[a], n, staged, places, count)
    if capped > 0:
        cuda.atomic.add(run, STIFF_NOW, capped)


@Part
def add_piece(tile, n, staged, places, count):
    """Add the staged columns that reach node `n` of a tile to it."""
    row, column, t = n // TILE, n % TILE, 4 * n
    mass, x, y, kinetic = tile[t], tile[t + 1], tile[t + 2], tile[t + 3]
    for s in range(count):
        j, i = row - places[s, 0], column - places[s, 1]
        if j >= 0 and j < 3 and i >= 0 and i < 3:
            at = s * STAGED
            wx, wy = staged[at + i], staged[at + 3 + j]
            node, line = at + FIRST_QUAD + QUAD * i, at + FIRST_QUAD + QUAD * (3 + j)
            mass += wy * staged[node]
            x += wy * staged[node + 1] + wx * staged[line + 1]
            y += wy * staged[node + 2] + wx * staged[line + 2]
            kinetic += wy * staged[node + 3]
    tile[t], tile[t + 1], tile[t + 2], tile[t + 3] = mass, x, y, kinetic


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


@Kernel
def grid_to_columns(
    run, stage, clock, rows, keys, order, nodes, flat_bed, bed, inside, left, reports, settings, metric, curvature,
    earth_pressure, entrainment,
):  # fmt: skip
    """Read the new velocity field back and move the columns; see `kernels.grid_to_columns`.

    `nodes` and `flat_bed`, the elevations of `bed`, have one dimension; `left` takes the places in the order of the
    columns that left.
    """
    mine = reports[cuda.grid(1)]
    clear_report(mine)
    mine[STIFF], mine[FASTEST_AT] = 0.0, -1.0
    if run[STATUS] != 0:
        return
    scratch, moved = cuda.local.array(LINES, float64), cuda.local.array(LINES, float64)
    quads = cuda.local.array(QUADS, float64)
    place, stays = cuda.local.array(1, int64), cuda.local.array(1, int64)
    times = stage[DT], stage[BEHIND], clock[KICK_BEFORE]
    limits = clock[BOUND_BED], clock[BOUND_ENERGY], earth_pressure.largest_factor()
    for q in range(int32(cuda.grid(1)), int32(run[SORTED]), int32(cuda.gridsize(1))):
        p, fastest = order[q], mine[FASTEST2]
        for e in range(ROW):
            scratch[e] = rows[p, e]
        move_batch(
            keys, order, q, 1, scratch, moved, quads, place, stays, nodes, flat_bed, bed, inside, mine, times,
            settings, limits, metric, curvature, entrainment,
        )  # fmt: skip
        for e in range(ROW):
            rows[p, e] = moved[e]
        if mine[FASTEST2] > fastest:
            mine[FASTEST_AT] = q
        if stays[0] == 0:
            left[cuda.atomic.add(run, LEFT, 1)] = q
    finish_report(mine)


@Kernel
def book_left(run, stage, rows, order, left, inside, left_cells, settings):
    """Add the columns that left to `left_cells`; of those at one block of cells the first one adds all, in order.

    `left` are their places in the order, ascending.
    """
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), run[LEFT], cuda.gridsize(1)):
        way, row, column, _, _ = way_out(stage, rows, order[left[k]], inside.shape, settings.dx)
        first = True
        for other in range(run[LEFT]):
            p = order[left[other]]
            there, other_row, other_column, x, y = way_out(stage, rows, p, inside.shape, settings.dx)
            if there != way or other_row != row or other_column != column:
                continue
            if other < k:
                first = False
                break
            if first:
                left_cells[way, row, column, LEFT_MASS] += rows[p, MASS]
                left_cells[way, row, column, LEFT_X] += rows[p, MASS] * x
                left_cells[way, row, column, LEFT_Y] += rows[p, MASS] * y


@Part
def way_out(stage, rows, p, shape, dx):
    """`place_left` of column `p`, whose row has its last place on the terrain."""
    return place_left(shape, rows[p, X] + stage[DT] * rows[p, U], rows[p, Y] + stage[DT] * rows[p, V], dx)
