"""The grid of the columns on the device between the two transfers; what happens to a node is code of the CPU's kernels.

Each thread has a report of its own, that of `column_nodes`. Fields are `column_records.NodeFields`.
"""

import numpy as np
from numba import cuda

from ...compiled.block_order import CHUNKS
from ..columns.column_barriers import BARRIER, BARRIER_LOSS, collect_barrier, hold_node, is_touched
from ..columns.column_clock import TIME
from ..columns.column_forest import break_trees, find_share
from ..columns.column_nodes import (
    DEEPEST,
    NODE_REPORT,
    fold_column,
    fold_row,
    mirror_column,
    mirror_row,
    note_node,
    update_node,
)
from ..columns.column_rows import NODE_MASS
from ..columns.spline_bed import bed_at
from .device_column_sort import DT, KICK, node_at, nodes_of, window_of
from .device_functions import REGISTERS, Kernel, capped
from .launch import STATUS

# entries of a thread's report after those of the CPU's: nodes where trees broke, and the node with the largest
# thickness, in the order of touched blocks; -1: none
BROKEN_NOW, DEEPEST_AT, THREAD_REPORT = range(NODE_REPORT, NODE_REPORT + 3)
HELD = BARRIER_LOSS + 1  # sums of a node in a barrier


@Kernel
def clear_ghosts(run, nodes):
    """Zero the ghost ring (see `column_nodes.clear_ghosts`)."""
    if run[STATUS] != 0:
        return
    rows, columns = nodes.shape[0], nodes.shape[1]
    for k in range(cuda.grid(1), max(rows, columns), cuda.gridsize(1)):
        for e in range(4):
            if k < columns:
                nodes[0, k, e] = nodes[rows - 1, k, e] = 0.0
            if k < rows:
                nodes[k, 0, e] = nodes[k, columns - 1, e] = 0.0


@Kernel
def fold_walls(run, nodes, along_columns):
    """Mirror ghosts inwards: southern and northern walls (`along_columns`), and after them western and eastern ones."""
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), nodes.shape[1] if along_columns else nodes.shape[0], cuda.gridsize(1)):
        if along_columns:
            fold_column(nodes, k)
        else:
            fold_row(nodes, k)


@Kernel
def mirror_walls(run, nodes, along_columns):
    """Give ghosts the mirrored state: beyond western and eastern walls, and after them (`along_columns`) the others."""
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), nodes.shape[1] if along_columns else nodes.shape[0], cuda.gridsize(1)):
        if along_columns:
            mirror_column(nodes, k)
        else:
            mirror_row(nodes, k)


@Kernel
def hold_at_barriers(run, stage, nodes, slot, fields, places, held, settings, barrier, metric):
    """Hold the flow at the nodes in walls, `places` int32[n, 2] (row, column); their sums go to `held` [n, HELD]."""
    if run[STATUS] != 0:
        return
    window = window_of(run)
    for k in range(cuda.grid(1), places.shape[0], cuda.gridsize(1)):
        j, i, mine = places[k, 0], places[k, 1], held[k]
        for e in range(HELD):
            mine[e] = 0.0
        if is_touched(slot, window, j, i) and nodes[j, i, NODE_MASS] > 0.0:
            hold_node(nodes, fields, slot, window, j, i, mine, stage[KICK], settings, barrier, metric)


@Kernel
def sum_held(run, held, first, report):
    """Sum the nodes of each barrier, from `first[k]` to `first[k + 1]`, into CHUNKS parts of `report`."""
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), report.shape[0] * report.shape[1] * HELD, cuda.gridsize(1)):
        e, b, c = k % HELD, k // HELD % report.shape[1], k // HELD // report.shape[1]
        n, total = first[b + 1] - first[b], 0.0
        for node in range(first[b] + c * n // CHUNKS, first[b] + (c + 1) * n // CHUNKS):
            total += held[node, e]
        report[c, b, e] = total


@Kernel
def collect_held(run, stage, report, sums, lost):
    """Add the report to the sums of each barrier; the energy that it took [J] goes to `lost`."""
    if run[STATUS] != 0:
        return
    for b in range(cuda.grid(1), sums.shape[0], cuda.gridsize(1)):
        lost[b] = collect_barrier(report, sums, b, stage[KICK], 0.0)


@capped(double=REGISTERS)
def update_nodes(run, stage, nodes, touched, fields, wet, lowered, reports, settings, laws):
    """Momentum to velocity, friction, erosion, resistance of trees; all reports begin here.

    The bed is lowered after all nodes have read it: `lowered` is the mass eroded [kg m-2].
    """
    mine = reports[cuda.grid(1)]
    for k in range(THREAD_REPORT):
        mine[k] = 0.0
    mine[DEEPEST_AT] = -1.0
    if run[STATUS] != 0:
        return
    trees, state, forest, entrainment = fields.forest, fields.forest_state, laws.forest, laws.entrainment
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < nodes.shape[0] and i < nodes.shape[1]:
            if forest.forest_active():
                mine[BROKEN_NOW] += break_trees(
                    nodes, trees, state, fields.gradient, j, i, settings, forest, laws.metric
                )
            deepest = mine[DEEPEST]
            eroded = update_node(nodes, fields, wet, j, i, mine, stage[KICK], settings, laws)
            if mine[DEEPEST] > deepest:
                mine[DEEPEST_AT] = e
            if entrainment.bed_lowering() > 0.0:
                lowered[j, i] = eroded
            if forest.forest_active():
                find_share(
                    nodes,
                    trees,
                    state,
                    fields.forest_share,
                    fields.gradient,
                    j,
                    i,
                    stage[DT],
                    settings,
                    forest,
                    laws.metric,
                    entrainment,
                )


@Kernel
def lower_bed(run, touched, bed, lowered, entrainment):
    """Lower the bed by what was eroded."""
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < lowered.shape[0] and i < lowered.shape[1]:
            bed[j, i] -= lowered[j, i] * entrainment.bed_lowering()


@Kernel
def regrade(run, touched, bed, gradient, settings):
    """Recompute the gradients at the touched nodes after erosion has lowered the bed."""
    if run[STATUS] != 0:
        return
    rows, columns, dx = bed.shape[0], bed.shape[1], settings.dx
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j >= 1 and j < rows - 1 and i >= 1 and i < columns - 1:
            _, east, north = bed_at(bed, (i - 1) * dx, (j - 1) * dx, 1.0 / dx)
            gradient[j, i, 0], gradient[j, i, 1] = east, north


@Kernel
def note_peaks(run, stage, clock, nodes, touched, gradient, peaks, settings, metric, entrainment):
    """Running peaks at the touched nodes."""
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < nodes.shape[0] and i < nodes.shape[1]:
            time = clock[TIME] + stage[DT]
            note_node(peaks, nodes, gradient, j, i, time, settings, metric, entrainment)


def barrier_nodes(barriers, count):
    """(int32[n, 2] rows and columns of the nodes in `count` barriers, int64[count + 1] where those of each begin)."""
    numbers = barriers[..., BARRIER].astype(np.int64)
    j, i = numbers.nonzero()
    order = np.argsort(numbers[j, i], kind="stable")
    first = np.searchsorted(numbers[j, i][order], np.arange(1, count + 2))
    return np.stack([j, i], axis=1)[order].astype(np.int32), first.astype(np.int64)
