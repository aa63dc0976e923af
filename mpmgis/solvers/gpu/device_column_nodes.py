"""The grid of the columns on the device between the two transfers; what happens to a node is code of the CPU's kernels.

Each thread has a report of its own, that of `column_nodes`. Fields are `column_records.NodeFields`.
"""

import numpy as np
from numba import cuda

from ...compiled.block_order import CHUNKS
from ...laws.entrainment import Entrainment
from ..columns.column_barriers import BARRIER, BARRIER_LOSS, collect_barrier, hold_node, is_touched
from ..columns.column_forest import break_trees, find_share
from ..columns.column_nodes import (
    DEEPEST,
    NODE_REPORT,
    NodeLaws,
    fold_column,
    fold_row,
    mirror_column,
    mirror_row,
    note_node,
    note_thickness,
    update_node,
)
from ..columns.column_records import NodeFields, Settings
from ..columns.column_rows import NODE_MASS
from ..columns.column_time_step import TIME
from ..columns.spline_bed import bed_at
from .device_column_sort import DT, KICK, node_at, nodes_of, window_of
from .device_functions import Kernel, capped
from .launch import STATUS

# entries of a thread's report after those of the CPU's
(
    BROKEN_NOW,  # number of nodes where trees broke
    DEEPEST_AT,  # node with the largest thickness, in the order of touched blocks; -1: none
    THREAD_REPORT,
) = range(NODE_REPORT, NODE_REPORT + 3)
HELD = BARRIER_LOSS + 1  # sums of a node in a barrier


@Kernel
def clear_ghosts(run: np.ndarray, nodes: np.ndarray) -> None:
    """Zero the ghost ring (see `column_nodes.clear_ghosts`).

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    nodes : float64[ny + 3, nx + 3, 4]
    """
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
def fold_walls(run: np.ndarray, nodes: np.ndarray, along_columns: bool) -> None:
    """Mirror ghosts inwards, at southern and northern walls and after them at western and eastern ones.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    nodes : float64[ny + 3, nx + 3, 4]
    along_columns : bool
        Southern and northern walls.
    """
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), nodes.shape[1] if along_columns else nodes.shape[0], cuda.gridsize(1)):
        if along_columns:
            fold_column(nodes, k)
        else:
            fold_row(nodes, k)


@Kernel
def mirror_walls(run: np.ndarray, nodes: np.ndarray, along_columns: bool) -> None:
    """Give ghosts the mirrored state, beyond western and eastern walls and after them beyond the others.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    nodes : float64[ny + 3, nx + 3, 4]
    along_columns : bool
        Southern and northern walls.
    """
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), nodes.shape[1] if along_columns else nodes.shape[0], cuda.gridsize(1)):
        if along_columns:
            mirror_column(nodes, k)
        else:
            mirror_row(nodes, k)


@Kernel
def hold_at_barriers(
    run: np.ndarray,
    stage: np.ndarray,
    nodes: np.ndarray,
    slot: np.ndarray,
    fields: NodeFields,
    places: np.ndarray,
    held: np.ndarray,
    settings: Settings,
    metric: int,
) -> None:
    """Hold the flow at the nodes in walls (see `column_barriers.hold_at_barriers`).

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    nodes : float64[ny + 3, nx + 3, 4]
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    fields : NodeFields
    places : int32[n, 2]
        Row and column of these nodes.
    held : float64[n, HELD]
        Becomes their sums.
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).
    """
    if run[STATUS] != 0:
        return
    window = window_of(run)
    for k in range(cuda.grid(1), places.shape[0], cuda.gridsize(1)):
        j, i, mine = places[k, 0], places[k, 1], held[k]
        for e in range(HELD):
            mine[e] = 0.0
        if is_touched(slot, window, j, i) and nodes[j, i, NODE_MASS] > 0.0:
            hold_node(nodes, fields, slot, window, j, i, mine, stage[KICK], settings, metric)


@Kernel
def sum_held(run: np.ndarray, held: np.ndarray, first: np.ndarray, report: np.ndarray) -> None:
    """Sum the nodes of each barrier into CHUNKS parts.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    held : float64[n, HELD]
    first : int64[barriers + 1]
        Where the nodes of each barrier begin.
    report : float64[CHUNKS, barriers, HELD]
    """
    if run[STATUS] != 0:
        return
    for k in range(cuda.grid(1), report.shape[0] * report.shape[1] * HELD, cuda.gridsize(1)):
        e, b, c = k % HELD, k // HELD % report.shape[1], k // HELD // report.shape[1]
        n, total = first[b + 1] - first[b], 0.0
        for node in range(first[b] + c * n // CHUNKS, first[b] + (c + 1) * n // CHUNKS):
            total += held[node, e]
        report[c, b, e] = total


@Kernel
def collect_held(run: np.ndarray, stage: np.ndarray, report: np.ndarray, sums: np.ndarray, lost: np.ndarray) -> None:
    """Add the report to the sums of each barrier.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    report : float64[CHUNKS, barriers, HELD]
    sums : float64[barriers, BARRIER_SUMS + 1]
    lost : float64[barriers] [J]
        Becomes the energy that each barrier took.
    """
    if run[STATUS] != 0:
        return
    for b in range(cuda.grid(1), sums.shape[0], cuda.gridsize(1)):
        lost[b] = collect_barrier(report, sums, b, stage[KICK], 0.0)


@capped(double=128)
def update_nodes(
    run: np.ndarray,
    stage: np.ndarray,
    nodes: np.ndarray,
    touched: np.ndarray,
    fields: NodeFields,
    wet: np.ndarray,
    lowered: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    laws: NodeLaws,
) -> None:
    """Turn momentum into velocity: friction, erosion, resistance of trees; all reports begin here.

    The bed is lowered after all nodes have read it.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    nodes : float64[ny + 3, nx + 3, 4]
    touched : int32[touched blocks]
        Their places in the window.
    fields : NodeFields
    wet : uint8[ny + 3, nx + 3]
    lowered : float64[ny + 3, nx + 3] [kg m-2]
        Becomes the mass eroded.
    reports : float64[threads, THREAD_REPORT]
    settings : Settings
    laws : NodeLaws
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
            if forest:
                mine[BROKEN_NOW] += break_trees(nodes, trees, state, fields.gradient, j, i, settings, laws.metric)
            deepest = mine[DEEPEST]
            eroded = update_node(nodes, fields, wet, j, i, mine, stage[KICK], settings, laws)
            if mine[DEEPEST] > deepest:
                mine[DEEPEST_AT] = e
            if entrainment.lowering > 0.0:
                lowered[j, i] = eroded
            if forest:
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
                    laws.metric,
                    entrainment,
                )


@Kernel
def lower_bed(run: np.ndarray, touched: np.ndarray, bed: np.ndarray, lowered: np.ndarray, lowering: float) -> None:
    """Lower the bed by what was eroded.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    touched : int32[touched blocks]
        Their places in the window.
    bed : float64[ny + 3, nx + 3] [m]
    lowered : float64[ny + 3, nx + 3] [kg m-2]
    lowering : float [m3 kg-1]
        Of the `Entrainment`.
    """
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < lowered.shape[0] and i < lowered.shape[1]:
            bed[j, i] -= lowered[j, i] * lowering


@Kernel
def regrade(run: np.ndarray, touched: np.ndarray, bed: np.ndarray, gradient: np.ndarray, settings: Settings) -> None:
    """Recompute the gradients at the touched nodes after erosion has lowered the bed.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    touched : int32[touched blocks]
        Their places in the window.
    bed : float64[ny + 3, nx + 3] [m]
    gradient : float64[ny + 3, nx + 3, 2]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    rows, columns, dx = bed.shape[0], bed.shape[1], settings.dx
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j >= 1 and j < rows - 1 and i >= 1 and i < columns - 1:
            _, east, north = bed_at(bed, (i - 1) * dx, (j - 1) * dx, 1.0 / dx)
            gradient[j, i, 0], gradient[j, i, 1] = east, north


@Kernel
def note_peaks(
    run: np.ndarray,
    stage: np.ndarray,
    clock: np.ndarray,
    nodes: np.ndarray,
    touched: np.ndarray,
    gradient: np.ndarray,
    peaks: np.ndarray,
    settings: Settings,
    metric: int,
    entrainment: Entrainment,
) -> None:
    """Update the largest thickness at the touched nodes, and the other running peaks (see `accumulate_peaks`).

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES]
        Times of the step.
    clock : float64[CLOCK]
    nodes : float64[ny + 3, nx + 3, 4]
    touched : int32[touched blocks]
        Their places in the window.
    gradient : float64[ny + 3, nx + 3, 2]
    peaks : float64[ny + 3, nx + 3, entries]
    settings : Settings
    metric, entrainment
        Slots of these names (`ColumnEffects`).
    """
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), nodes_of(run), cuda.gridsize(1)):
        j, i = node_at(run, touched, e)
        if j < nodes.shape[0] and i < nodes.shape[1]:
            note_thickness(peaks, nodes, j, i, settings)
            if settings.keep_peaks:
                time = clock[TIME] + stage[DT]
                note_node(peaks, nodes, gradient, j, i, time, settings, metric, entrainment)


def barrier_nodes(barriers: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes in barriers, those of a barrier after those of the one before.

    Parameters
    ----------
    barriers : float64[ny + 3, nx + 3, BARRIER_ENTRIES]
    count : int
        Number of barriers.

    Returns
    -------
    int32[n, 2]
        Row and column of each node.
    int64[count + 1]
        Where the nodes of each barrier begin.
    """
    numbers = barriers[..., BARRIER].astype(np.int64)
    j, i = numbers.nonzero()
    order = np.argsort(numbers[j, i], kind="stable")
    first = np.searchsorted(numbers[j, i][order], np.arange(1, count + 2))
    return np.stack([j, i], axis=1)[order].astype(np.int32), first.astype(np.int64)
