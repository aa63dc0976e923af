"""Mass of columns that stops behind trees, on the device: after a second sort, by the places at the end of the step.

What a column loses is the code of the CPU's kernels. Nodes get it as they get the mass of columns: a thread owns a node
of the tile of a block.
"""

from numba import cuda

from ...compiled.block_order import GONE
from ..columns.column_blocks import BLOCK, TILE
from ..columns.column_clock import ALIVE, KICK_BEFORE, WORK_TOTAL
from ..columns.column_detrainment import kept_mass, nodes_around, stopping_share, taken_energy
from ..columns.column_forest import DETRAINED, KINETIC, POTENTIAL, STOPPED, STOPPED_COLUMNS
from ..columns.column_rows import AREA, MASS, X, Y
from ..columns.spline_bed import weights
from .device_column_sort import STOPPING, node_at, nodes_of
from .device_column_transfer import TILE_NODES, tile_sum
from .device_functions import Kernel, Part
from .launch import ACTIVE, SORTED, SOUTH_NOW, STATUS, WEST_NOW, WIDTH

STOPS, KEPT, LOST, LOSSES = range(4)  # of a column: share that stops [1], mass that it keeps, mass that it gives [kg]
MASS_LOST, KINETIC_LOST, POTENTIAL_LOST, WORK_LOST, WHOLE, STOP_REPORT = range(6)  # sums of a thread


@Kernel
def find_losses(again, rows, order, fields, losses, settings):
    """Share of each column that stops and what it keeps, and the number of columns that stop as a whole.

    The last column of all does not count: it keeps its mass if all others stop, because frames need one.
    """
    if again[STATUS] != 0:
        return
    share = fields.forest_share
    for q in range(cuda.grid(1), again[SORTED], cuda.gridsize(1)):
        p = order[q]
        around = nodes_around(rows[p, X], rows[p, Y], share.shape, settings)
        stops = stopping_share(share, around)
        losses[q, STOPS], losses[q, KEPT], losses[q, LOST] = stops, rows[p, MASS], 0.0
        if stops > 0.0:
            losses[q, KEPT] = kept_mass(rows[p, MASS], rows[p, AREA], stops, settings)
            if losses[q, KEPT] == 0.0 and q < again[SORTED] - 1:
                cuda.atomic.add(again, STOPPING, 1)


@Kernel
def take_losses(again, clock, rows, keys, order, fields, losses, reports, settings, metric):
    """Take the losses from the columns; all reports begin here."""
    mine = reports[cuda.grid(1)]
    for k in range(STOP_REPORT):
        mine[k] = 0.0
    if again[STATUS] != 0:
        return
    last = again[SORTED] - 1
    for q in range(cuda.grid(1), again[SORTED], cuda.gridsize(1)):
        p = order[q]
        if losses[q, STOPS] <= 0.0 or (q == last and again[STOPPING] == last):
            continue
        mass, kept = rows[p, MASS], losses[q, KEPT]
        losses[q, LOST] = mass - kept
        taken, work = taken_energy(rows[p], mass, kept, fields.bed, clock[KICK_BEFORE], settings, metric)
        mine[MASS_LOST] += mass - kept
        mine[KINETIC_LOST] += taken[0]
        mine[POTENTIAL_LOST] += taken[1]
        mine[WORK_LOST] += work
        if kept == 0.0:
            keys[p] = GONE
            mine[WHOLE] += 1.0
        else:
            rows[p, MASS] = kept


@Kernel
def losses_to_grid(again, rows, order, start, block, losses, tiles, fields, settings):
    """Sum the losses of each block's columns into its tile, one number a node."""
    if again[STATUS] != 0:
        return
    share = fields.forest_share
    for a in range(cuda.blockIdx.x, again[ACTIVE], cuda.gridDim.x):
        i_block = (block[a] % again[WIDTH] + again[WEST_NOW]) * BLOCK
        j_block = (block[a] // again[WIDTH] + again[SOUTH_NOW]) * BLOCK
        for n in range(cuda.threadIdx.x, TILE_NODES, cuda.blockDim.x):
            total = 0.0
            for q in range(start[a], start[a + 1]):
                if losses[q, LOST] > 0.0:
                    p = order[q]
                    i0, j0 = weights(rows[p, X], 1.0 / settings.dx)[0], weights(rows[p, Y], 1.0 / settings.dx)[0]
                    i, j = n % TILE + i_block - i0, n // TILE + j_block - j0
                    if i >= 0 and i < 3 and j >= 0 and j < 3:
                        wx, wy, at_x, at_y = nodes_around(rows[p, X], rows[p, Y], share.shape, settings)
                        part = wy[j] * wx[i] * share[at_y[j], at_x[i]] / losses[q, STOPS]
                        total += losses[q, LOST] * part
            tiles[a, n] = total


@Kernel
def add_losses(again, tiles, slot, touched, fields, settings):
    """Give the nodes what stopped there; ghosts beyond a wall give theirs to the nodes that they mirror."""
    if again[STATUS] != 0:
        return
    state = fields.forest_state
    rows, columns = state.shape[0], state.shape[1]
    for e in range(cuda.grid(1), nodes_of(again), cuda.gridsize(1)):
        j, i = node_at(again, touched, e)
        if j >= rows or i >= columns:
            continue
        total = 0.0
        for j_image in images(j, rows, settings.wall):
            for i_image in images(i, columns, settings.wall):
                if j_image >= 0 and i_image >= 0:
                    total += tile_sum(again, tiles, slot, j_image, i_image, 0, 1)
        if total > 0.0:
            state[j, i, STOPPED] += total


@Part
def images(k, size, wall):
    """The indices whose sums node `k` of `size` gets along an axis: its own, and those of ghosts; -1: none."""
    if not wall:
        return k, -1, -1
    if k == 0 or k == size - 1:
        return -1, -1, -1
    return k, 0 if k == 2 else -1, size - 1 if k == size - 3 else -1


@Kernel
def collect_losses(run, again, clock, counts, sums, report):
    """Add the losses of a step to clock, counts and sums; one thread. The report has one row."""
    if run[STATUS] != 0 or again[STATUS] != 0:
        return
    sums[DETRAINED] += report[0, MASS_LOST]
    sums[KINETIC] += report[0, KINETIC_LOST]
    sums[POTENTIAL] += report[0, POTENTIAL_LOST]
    clock[WORK_TOTAL] -= report[0, WORK_LOST]
    if report[0, WHOLE] > 0.0:
        sums[STOPPED_COLUMNS] += report[0, WHOLE]
        counts[ALIVE] -= int(report[0, WHOLE])


@Kernel
def clear_shares(run, touched, share):
    """Zero the shares of the nodes that this step touched."""
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < share.shape[0] and i < share.shape[1]:
            share[j, i] = 0.0
