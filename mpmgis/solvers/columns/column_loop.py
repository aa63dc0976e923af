"""Compiled loops of the depth-averaged MPM.

Particles are rows of consecutive floats. Each step sorts their indices by blocks of 8 x 8 nodes; a block sums its
particles into a private tile (particles to grid), the grid gathers the tiles that overlap a node in a fixed order, is
updated, and the block's particles read it back (grid to particles). Nothing is shared between loops and every sum has
a fixed order, so that results are bitwise the same for any number of threads. Only blocks that hold particles cost.

Nodes lie on cell corners: array index k + 1 is the node at k * dx from the domain's south-west corner, so that there
is one ghost node outside each edge. Weights are quadratic B-splines (Steffen et al. 2008).
"""

import numpy as np

from ...compiled.block_order import CHUNKS, GONE, REORDER_STEPS, STRIP, book_left, reorder, split_evenly
from ...compiled.jit import jit
from ...laws.effect_slots import ColumnEffects
from ...laws.internal_stress import largest_factor
from .column_areas import grid_areas, settle_areas
from .column_arrays import ColumnArrays
from .column_barriers import BARRIER_LOSS, collect_barriers, hold_at_barriers
from .column_blocks import (
    BLOCK,
    TILE,
    BlockWindow,
    SortedColumns,
    TouchedBlocks,
    initial_keys,
    rows_and_columns,
    sort_by_block,
    touched_blocks,
)
from .column_detrainment import detrain
from .column_forest import break_forest, clear_shares, collect_forest, find_shares
from .column_motion import SpeedBound, StepTimes
from .column_nodes import (
    ARMED,
    FOREST_LOSS,
    NODE_REPORT,
    REACHED,
    NodeArrays,
    accumulate_peaks,
    clear_ghosts,
    fold_walls,
    mirror_walls,
    regrade,
    update_nodes,
)
from .column_records import NodeFields, Settings
from .column_report import REPORT
from .column_rows import AREA, GX, GY, MASS, ROW, U, V, X, Y
from .column_time_step import (
    ALIVE,
    ALL_LEFT,
    BAD,
    BARRIER_TOTAL,
    BOUND_BED,
    BOUND_ENERGY,
    EAST,
    KICK_BEFORE,
    LAST_DT,
    NORTH,
    NOT_FINITE_STATE,
    REACHED_TIME,
    ROWS,
    RUNNING,
    SIGNAL,
    SINCE_REORDER,
    SOUTH,
    SPEED,
    STEP,
    TIME,
    TOO_FAST,
    TRIGGER_REACHED,
    WEST,
    WET,
    WILD_NOW,
    collect,
    note_deepest,
    note_fastest,
    stop_rule,
)
from .columns_to_grid import gather_tiles, particles_to_grid
from .grid_to_columns import grid_to_particles
from .spline_bed import beds_at

__all__ = [  # used by the solver through this module
    "AREA",
    "ARMED",
    "BLOCK",
    "GONE",
    "GX",
    "GY",
    "MASS",
    "REACHED",
    "ROW",
    "WET",
    "U",
    "V",
    "X",
    "Y",
    "advance",
    "beds_at",
    "grid_areas",
    "initial_keys",
    "rows_and_columns",
    "settle_areas",
]

MOST_GROWTH = 1.5  # [1] length of a step over that of the last one, at most
ROUNDING = 1e-12  # [1] of the time left: a step that ends so little before the end is the last one


@jit
def next_time_step(clock: np.ndarray, step: int, settings: Settings) -> float:
    """Compute the length [s] of the next step: C dx / max(|u| + sqrt(g h)), at most `move_limit` dx / |u|.

    It grows by at most MOST_GROWTH.

    Parameters
    ----------
    clock : float64[CLOCK]
    step : int
        Number of steps taken.
    settings : Settings
    """
    dt = min(
        settings.cfl * settings.dx / max(clock[SIGNAL], 1e-300),
        settings.move_limit * settings.dx / max(clock[SPEED], 1e-300),
        settings.fall_limit,
    )
    return dt if step == 0 else min(dt, MOST_GROWTH * clock[LAST_DT])


@jit
def choose_step(
    clock: np.ndarray, counts: np.ndarray, until: float, settings: Settings
) -> tuple[float, float, float, bool]:
    """Choose the length of a step; the clock keeps what the next step needs.

    Leapfrog: velocities are driven from the middle of the last step to the middle of this one, and up to its end where
    a frame is due; second order in time, also where steps change.

    Parameters
    ----------
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    until : float [s]
        Time of the next frame.
    settings : Settings

    Returns
    -------
    float [s]
        Length of the step.
    float [s]
        Time for which forces act in it.
    float [s]
        Time at the end of the last step for which its velocities have not been driven.
    bool
        It is the last step before the time `until`.
    """
    dt = settings.fixed_dt if settings.fixed_dt > 0.0 else next_time_step(clock, counts[STEP], settings)
    clock[LAST_DT] = dt
    left = until - clock[TIME]
    last = dt >= left * (1.0 - ROUNDING)
    if last:
        dt = left
    elif dt > 0.5 * left:  # two equal steps instead of one whole and one tiny
        dt = 0.5 * left
    behind = clock[KICK_BEFORE]
    kick = behind + (dt if last else 0.5 * dt)
    clock[KICK_BEFORE] = 0.0 if last else 0.5 * dt
    return dt, kick, behind, last


@jit
def book_columns_left(
    rows: np.ndarray,
    keys: np.ndarray,
    order: np.ndarray,
    alive: int,
    dt: float,
    dx: float,
    shape: tuple,
    left_cells: np.ndarray,
) -> None:
    """Add the columns that left in this step to `left_cells` at their new places (see `block_order.book_left`).

    Parameters
    ----------
    rows : float64[columns, ROW]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    order : int32[columns]
        Indices of columns in the order of blocks.
    alive : int
        Number of columns in the order.
    dt : float [s]
    dx : float [m]
    shape : (int, int)
        Of the cells.
    left_cells : float64[WAYS, blocks, blocks, LEFT_ENTRIES]
    """
    for q in range(alive):
        p = order[q]
        if keys[p] == GONE:
            x, y = rows[p, X] + dt * rows[p, U], rows[p, Y] + dt * rows[p, V]
            book_left(left_cells, shape, x, y, dx, rows[p, MASS])


@jit
def advance(
    state: ColumnArrays,
    order: np.ndarray,
    nodes: np.ndarray,
    until: float,
    max_steps: int,
    settings: Settings,
    fields: NodeFields,
    effects: ColumnEffects,
) -> int:
    """Advance to a time or by a number of steps; the whole loop is compiled, for any number of columns.

    Everything that changes is in the arrays (clock, counts, rows...): a call continues exactly where the last one
    ended.

    Parameters
    ----------
    state : ColumnArrays
    order : int32[columns]
        Work array.
    nodes : float64[ny + 3, nx + 3, 4]
        Work array.
    until : float [s]
    max_steps : int
    settings : Settings
    fields : NodeFields
    effects : ColumnEffects

    Returns
    -------
    int
        Reason to stop (`column_time_step`).
    """
    rows, ids, keys, clock, counts = state.rows, state.ids, state.keys, state.clock, state.counts
    wall, metric, entrainment = settings.wall, effects.metric, effects.entrainment
    report = np.zeros((CHUNKS, REPORT))
    node_report = np.zeros((CHUNKS, NODE_REPORT))
    barrier_report = np.zeros((CHUNKS, state.barrier_sums.shape[0], BARRIER_LOSS + 1))
    broken = np.zeros(CHUNKS)
    bounds = np.zeros(CHUNKS + 1, np.int64)
    histogram = np.zeros((CHUNKS, 16), np.int32)
    slot = np.zeros(16, np.int32)
    block = np.zeros(16, np.int32)
    start = np.zeros(17, np.int64)
    places = np.zeros(64, np.int32)
    tiles, lowered = np.zeros((16, TILE * TILE * 4)), np.zeros((1, BLOCK * BLOCK))
    strip, names = np.empty((counts[ROWS], STRIP)), np.empty((counts[ROWS], 2), np.int64)
    for _ in range(max_steps):
        if clock[TIME] >= until:
            return REACHED_TIME
        if counts[ALIVE] == 0:
            return ALL_LEFT
        west, south, east, north = counts[WEST], counts[SOUTH], counts[EAST], counts[NORTH]
        window = BlockWindow(west, south, east - west + 1, north - south + 1)
        if window.width * window.height > slot.size:
            size = 2 * window.width * window.height
            histogram = np.zeros((CHUNKS, size), np.int32)
            slot, block, start = np.zeros(size, np.int32), np.zeros(size, np.int32), np.zeros(size + 1, np.int64)
            places = np.zeros(2 * size + 2 * (window.width + window.height) + 64, np.int32)
        sorted_columns = SortedColumns(order, start, block, bounds)
        active, alive = sort_by_block(keys, counts[ROWS], window, histogram, slot, sorted_columns)
        if alive == 0:
            return ALL_LEFT
        n_touched = touched_blocks(slot, window, places)
        touched = TouchedBlocks(places, n_touched, window.west, window.south, window.width, window.height)
        if counts[SINCE_REORDER] >= REORDER_STEPS:
            reorder(rows, ids, keys, order, alive, strip, names)
            counts[ROWS], counts[SINCE_REORDER] = alive, 0
            for p in range(alive):
                order[p] = p
        counts[SINCE_REORDER] += 1
        if active > tiles.shape[0]:
            tiles = np.zeros((active + active // 2, TILE * TILE * 4))
        if entrainment.lowering > 0.0 and n_touched > lowered.shape[0]:
            lowered = np.zeros((n_touched + n_touched // 2, BLOCK * BLOCK))
        split_evenly(start, active, bounds)

        dt, kick, behind, last = choose_step(clock, counts, until, settings)
        particles_to_grid(
            rows,
            sorted_columns,
            window,
            tiles,
            fields,
            report,
            kick,
            settings,
            metric,
            effects.still_water,
            effects.earth_pressure,
            effects.viscosity,
        )
        if wall:
            clear_ghosts(nodes)
        gather_tiles(nodes, tiles, slot, touched)
        if wall:
            fold_walls(nodes)
        if effects.barrier:
            hold_at_barriers(nodes, fields, slot, touched, barrier_report, kick, settings, metric)
        if effects.forest:
            break_forest(nodes, fields, touched, broken, settings, metric)
        update_nodes(
            NodeArrays(nodes, state.wet, lowered, node_report, state.peaks),
            fields,
            touched,
            kick,
            settings,
            effects.friction,
            effects.zones,
            effects.cohesion,
            metric,
            effects.curvature,
            entrainment,
            effects.forest,
        )
        if effects.forest:
            find_shares(nodes, fields, touched, dt, settings, metric, entrainment)
            collect_forest(broken, node_report, FOREST_LOSS, fields.forest_sums)
        if entrainment.lowering > 0.0:
            regrade(fields.bed, fields.gradient, touched, settings.dx, lowered, entrainment.lowering)
        if settings.keep_peaks:
            accumulate_peaks(
                state.peaks, nodes, fields.gradient, touched, clock[TIME] + dt, settings, metric, entrainment
            )
        if wall:
            mirror_walls(nodes)
        grid_to_particles(
            rows,
            keys,
            sorted_columns,
            nodes,
            fields,
            report,
            StepTimes(dt, behind, clock[KICK_BEFORE]),
            SpeedBound(clock[BOUND_BED], clock[BOUND_ENERGY], largest_factor(effects.earth_pressure)),
            settings,
            metric,
            effects.curvature,
            entrainment,
        )

        counts[STEP] += 1
        clock[TIME] = until if last else clock[TIME] + dt
        note_deepest(node_report, clock, nodes, touched, settings.dx)
        note_fastest(report, clock, rows, keys, sorted_columns, metric)
        gone, triggered = collect(report, node_report, state.ledger, clock, counts)
        if effects.barrier:
            clock[BARRIER_TOTAL] += collect_barriers(barrier_report, state.barrier_sums, kick)
        if counts[BAD] > 0:
            return NOT_FINITE_STATE
        if gone > 0:
            book_columns_left(rows, keys, order, alive, dt, settings.dx, fields.inside.shape, state.left_cells)
        if effects.forest:
            detrain(rows, keys, order, alive, fields, clock, counts, clock[KICK_BEFORE], settings, metric)
            clear_shares(fields.forest_share, touched)
        if clock[WILD_NOW] > settings.wild_stop:
            return TOO_FAST
        if counts[ALIVE] == 0:
            return ALL_LEFT
        if triggered:
            return TRIGGER_REACHED
        if settings.stop_at_rest:
            reason = stop_rule(clock, counts)
            if reason != RUNNING:
                return reason
    return REACHED_TIME if clock[TIME] >= until else RUNNING
