"""Mass of columns that stops behind trees, on the device: after a second sort, by the places at the end of the step.

What a column loses is the code of the CPU's kernels. Nodes get it as they get the mass of columns: a thread owns a node
of the tile of a block.
"""

import numpy as np
from numba import cuda

from ...compiled.block_order import GONE
from ..columns.column_blocks import BLOCK, TILE
from ..columns.column_detrainment import kept_mass, nodes_around, stopping_share, taken_energy
from ..columns.column_forest import DETRAINED, KINETIC, POTENTIAL, STOPPED, STOPPED_COLUMNS
from ..columns.column_records import NodeFields, Settings
from ..columns.column_rows import AREA, MASS, X, Y
from ..columns.column_time_step import ALIVE, KICK_BEFORE, WORK_TOTAL
from ..columns.spline_weights import weights
from .device_column_sort import STOPPING, node_at, nodes_of
from .device_column_transfer import TILE_NODES, tile_sum
from .device_functions import Kernel, Part
from .launch import ACTIVE, SORTED, SOUTH_NOW, STATUS, WEST_NOW, WIDTH

# losses of a column
(
    STOPS,  # [1] share of its mass that stops
    KEPT,  # [kg] mass that it keeps
    LOST,  # [kg] mass that it gives to nodes
    LOSSES,
) = range(4)
# sums of a thread
(
    MASS_LOST,  # [kg]
    KINETIC_LOST,  # [J] kinetic energy of that mass
    POTENTIAL_LOST,  # [J] its potential energy, from elevation 0
    WORK_LOST,  # [J] work of the weight on it
    WHOLE,  # number of columns that stop as a whole
    STOP_REPORT,
) = range(6)


@Kernel
def find_losses(
    again: np.ndarray, rows: np.ndarray, order: np.ndarray, fields: NodeFields, losses: np.ndarray, settings: Settings
) -> None:
    """Find the share of each column that stops and what it keeps, and the number of columns that stop as a whole.

    The last column of all does not count: it keeps its mass if all others stop, because frames need one.

    Parameters
    ----------
    again : int64[RUN_ENTRIES]
        Of the second sort.
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    fields : NodeFields
    losses : float64[columns, LOSSES]
    settings : Settings
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
def take_losses(
    again: np.ndarray,
    clock: np.ndarray,
    rows: np.ndarray,
    keys: np.ndarray,
    order: np.ndarray,
    fields: NodeFields,
    losses: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    metric: int,
) -> None:
    """Take the losses from the columns; all reports begin here.

    Parameters
    ----------
    again : int64[RUN_ENTRIES]
        Of the second sort.
    clock : float64[CLOCK]
    rows : float64[columns, ROW]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    order : int32[columns]
        Indices of columns in the order of blocks.
    fields : NodeFields
    losses : float64[columns, LOSSES]
    reports : float64[threads, STOP_REPORT]
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).
    """
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
def losses_to_grid(
    again: np.ndarray,
    rows: np.ndarray,
    order: np.ndarray,
    start: np.ndarray,
    block: np.ndarray,
    losses: np.ndarray,
    tiles: np.ndarray,
    fields: NodeFields,
    settings: Settings,
) -> None:
    """Sum the losses of each block's columns into its tile, one number a node.

    Parameters
    ----------
    again : int64[RUN_ENTRIES]
        Of the second sort.
    rows : float64[columns, ROW]
    order : int32[columns]
        Indices of columns in the order of blocks.
    start : int64[blocks with columns + 1]
        Where the columns of each block begin in the order.
    block : int32[blocks with columns]
        Their places in the window.
    losses : float64[columns, LOSSES]
    tiles : float64[blocks with columns, TILE_NODES]
    fields : NodeFields
    settings : Settings
    """
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
def add_losses(
    again: np.ndarray, tiles: np.ndarray, slot: np.ndarray, touched: np.ndarray, fields: NodeFields, settings: Settings
) -> None:
    """Give the nodes what stopped there; ghosts beyond a wall give theirs to the nodes that they mirror.

    Parameters
    ----------
    again : int64[RUN_ENTRIES]
        Of the second sort.
    tiles : float64[blocks with columns, TILE_NODES]
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    touched : int32[touched blocks]
        Their places in the window.
    fields : NodeFields
    settings : Settings
    """
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
def images(k: int, size: int, wall: bool) -> tuple[int, int, int]:
    """Return the indices whose sums node `k` gets along an axis: its own, and those of ghosts; -1: none.

    Parameters
    ----------
    k : int
    size : int
        Number of nodes along the axis.
    wall : bool
        The edges are walls.
    """
    if not wall:
        return k, -1, -1
    if k == 0 or k == size - 1:
        return -1, -1, -1
    return k, 0 if k == 2 else -1, size - 1 if k == size - 3 else -1


@Kernel
def collect_losses(
    run: np.ndarray, again: np.ndarray, clock: np.ndarray, counts: np.ndarray, sums: np.ndarray, report: np.ndarray
) -> None:
    """Add the losses of a step to clock, counts and sums; one thread.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    again : int64[RUN_ENTRIES]
        Of the second sort.
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    sums : float64[FOREST_SUMS]
    report : float64[1, STOP_REPORT]
    """
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
def clear_shares(run: np.ndarray, touched: np.ndarray, share: np.ndarray) -> None:
    """Zero the shares of the nodes that this step touched.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    touched : int32[touched blocks]
        Their places in the window.
    share : float64[ny + 3, nx + 3] [1]
    """
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < share.shape[0] and i < share.shape[1]:
            share[j, i] = 0.0
