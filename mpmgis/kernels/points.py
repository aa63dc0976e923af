"""Compiled loops of the 3D MPM (design notes 4; blocks as in design notes on kernels).

A point carries its momentum and, ready-made, what it gives to the nodes around it in the next step: its affine momentum
less the impulse of its stress. The next time step is therefore chosen before the points are moved, from the velocities
at the nodes, which no point exceeds.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import CHUNKS, GONE, REORDER_STEPS, STRIP, reorder, split_evenly
from .jit import jit
from .left_cells import LEFT_BLOCK, LEFT_ENTRIES, WAYS, book_left
from .point_barriers import (
    BLOCK_FLOW,
    COLUMN_FLOW,
    IMPULSE_X,
    IMPULSE_Z,
    POINT_BARRIER_ENTRIES,
    POINT_BARRIER_SUMS,
    SHARE,
    collect_point_barriers,
    weigh_flow,
)
from .point_blocks import EAST as BLOCKS_EAST
from .point_blocks import NORTH as BLOCKS_NORTH
from .point_blocks import (
    SORT_PIECES,
    comes_near,
    link_blocks,
    lowest_blocks,
    no_window,
    places_of,
    rows_and_columns,
    set_places,
    sort_by_block,
    window_of,
)
from .point_blocks import SOUTH as BLOCKS_SOUTH
from .point_blocks import TALL as BLOCKS_TALL
from .point_blocks import WEST as BLOCKS_WEST
from .point_blocks import WINDOW as BLOCKS_WINDOW
from .point_contact import LAYER, MOST_YIELD, YIELD, YIELD_ENTRIES, YIELD_STEP, press_on_ground
from .point_drag import BLOCK_COLUMNS, COLUMN_MASSES, clear_contact, spread_contact, weigh_contact
from .point_ground import EXACT_ENTRIES, FOLD_ENTRIES, GROUND_ENTRIES, Ground
from .point_layers import couple_layers
from .point_nodes import (
    BARRIER_WORK,
    FASTEST2,
    FRICTION_WORK,
    GROUND_WORK,
    GROUND_X,
    GROUND_Y,
    GROUND_Z,
    LAYER_WORK,
    NODE_REPORT,
    WALL_X,
    WALL_Y,
    gather_nodes,
    hold_nodes,
    move_nodes,
)
from .point_peaks import COLUMN_SUMS, LONE_SHARE, accumulate_point_peaks
from .point_rows import (
    AXX,
    AXY,
    AXZ,
    BLOCK,
    BLOCK_SIZE,
    GHOSTS,
    MASS,
    PX,
    PY,
    PZ,
    ROW_LONG,
    ROW_SHORT,
    S0,
    S1,
    S2,
    S3,
    S4,
    STATE,
    TILE_SIZE,
    X,
    Y,
    Z,
)
from .point_transfer import (
    AT_TIP,
    BAD_X,
    BAD_Y,
    BLOCK_EAST,
    BLOCK_NORTH,
    BLOCK_SOUTH,
    BLOCK_TALL,
    BLOCK_WEST,
    EDGES,
    FAR,
    HELD_STRETCH,
    HELD_WALL,
    LIMITED,
    LIMITED_ENERGY,
    NOT_FINITE,
    OUT,
    OUT_ENTRIES,
    PLASTIC,
    REPORT,
    SHEAR_MAX,
    SPEED2_MAX,
    UNDER,
    UNDER_ENERGY,
    UNDER_POINTS,
    UNDER_X,
    UNDER_Y,
    UNDER_Z,
    grid_to_points,
    points_to_grid,
)

__all__ = [  # what the solver needs beside its own
    "AXX",
    "AXY",
    "AXZ",
    "BLOCK",
    "EXACT_ENTRIES",
    "FOLD_ENTRIES",
    "GHOSTS",
    "GONE",
    "GROUND_ENTRIES",
    "IMPULSE_X",
    "IMPULSE_Z",
    "LAYER",
    "LEFT_BLOCK",
    "LEFT_ENTRIES",
    "LONE_SHARE",
    "MASS",
    "MOST_YIELD",
    "POINT_BARRIER_ENTRIES",
    "POINT_BARRIER_SUMS",
    "PX",
    "PZ",
    "ROW_LONG",
    "ROW_SHORT",
    "STATE",
    "WAYS",
    "YIELD",
    "YIELD_ENTRIES",
    "YIELD_STEP",
    "Ground",
    "X",
    "Z",
    "advance",
    "lowest_blocks",
    "places_of",
    "rows_and_columns",
    "set_places",
    "stored_energy",
    "volume_ratios",
    "window_of",
]

# why `advance` came back
RUNNING, REACHED_TIME, ALL_LEFT, NOT_FINITE_STATE, LEAKED, SCATTERED, WATCHED_REACHED = range(7)
MOST_PLACES = 1 << 25  # of blocks in the window over all points; a gigabyte of counters
# float64 clock: what one step hands to the next, and what a restart needs
(
    TIME,
    STEP_NOW,  # time step [s] of the step to come, which the points' impulses are made for
    HITS,  # 1 if that step ends exactly at the time asked for
    LAST_DT,  # last time step not cut by a frame time [s]
    FASTEST,  # largest speed at a node [m s-1]
    SHEAR,  # largest |C| of a point [s-1]
    SPEED_NOW,  # largest speed of a point [m s-1]
    SPEED_WORST,
    TIP_TOTAL,  # point-steps without tension
    FAR_TOTAL,  # point-steps whose strain left the series
    LIFTED_MASS,  # mass laid back onto the ground, counted each time [kg]
    TOTAL_MASS,  # [kg]
    MASS_NOW,  # on the terrain [kg]
    BAD_AT_X,
    BAD_AT_Y,
    IMPULSE_GROUND_X,  # what the ground has given [N s]
    IMPULSE_GROUND_Y,
    IMPULSE_GROUND_Z,
    IMPULSE_WALL_X,
    IMPULSE_WALL_Y,
    IMPULSE_GRAVITY,  # downwards [N s]
    GROUND_LOSS,  # work done against the ground's friction and drag [J]
    BARRIER_LOSS,  # and against that of barriers [J]
    PLASTIC_LOSS,  # work done in yielding [J]
    LIFTED_ENERGY,  # potential energy given to what was laid back onto the ground [J]
    FASTEST_X,  # where and when SPEED_WORST was [m, m, m, s]
    FASTEST_Y,
    FASTEST_Z,
    FASTEST_TIME,
    HIGHEST,  # place of any point at the start [m]
    START_SPEED,  # largest of any point at the start [m s-1]
    DEEPEST,  # largest thickness of the flow that a look saw [m], where and when it was [m, m, s]
    DEEPEST_X,
    DEEPEST_Y,
    DEEPEST_TIME,
    POINT_STEPS,  # points that there were, summed over the steps; then those of them that a clip acted on
    LIFTED_TOTAL,
    STRETCH_TOTAL,
    WALL_TOTAL,
    LIMITED_TOTAL,
    LIMIT_LOSS,  # kinetic energy taken by the limit of affine velocities [J]
    SPEED_P999,  # largest speed at a look that 0.1 % of the mass exceeds [m s-1], and when it was [s]
    SPEED_P999_TIME,
    LAYER_LOSS,  # energy that layers of a flow with drag lost to each other [J]
    FRICTION_LOSS,  # of GROUND_LOSS what friction along the ground took [J]
    CLOCK,
) = range(46)
# int64 counts; then the window of blocks
ROWS, ALIVE, STEP, SINCE_REORDER, BAD, WINDOW_FIRST = range(6)
COUNTS = WINDOW_FIRST + BLOCKS_WINDOW


class Settings(NamedTuple):
    """What does not change while the points march."""

    dx: float  # [m]
    density: float  # [kg m-3]
    gravity: float  # [m s-2]
    cfl: float
    signal_speed: float  # of pressure waves [m s-1]
    viscous_limit: float  # [s], infinite without viscosity
    fixed_dt: float  # [s]; 0: by the Courant number
    clearance: float  # height above the ground at which a node touches it [m]
    cells_x: int
    cells_y: int
    leak_stop: float  # share of the mass under the ground in one step
    wall: bool
    holes: bool  # the terrain has cells without elevation
    keep_peaks: bool
    arrival_thickness: float  # of peaks of speed and pressure, and of arrivals [m]
    lone_thickness: float  # that a single point makes at a node at most [m]
    slack: float  # 1: layers bear mu p of each other, 0: the material does


@jit
def largest_time_step(fastest, shear, settings):
    """C min(dx / (c_p + v), 0.2 / |C|, sqrt(dx / g), rho dx^2 / (6 eta)) (design notes 4.2)."""
    return settings.cfl * min(
        min(settings.dx / (settings.signal_speed + fastest), 0.2 / max(shear, 1e-300)),
        min(sqrt(settings.dx / max(settings.gravity, 1e-300)), settings.viscous_limit),
    )


@jit
def set_next_step(clock, counts, time, until, after, settings):
    """Choose the time step that follows `time` so that `until`, and then `after`, are met exactly."""
    limit = settings.fixed_dt
    if limit <= 0.0:
        limit = largest_time_step(clock[FASTEST], clock[SHEAR], settings)
        if counts[STEP] > 0:
            limit = min(limit, 1.2 * clock[LAST_DT])
    clock[LAST_DT] = limit
    left = (until if time < until else after) - time
    clock[HITS] = 0.0
    if limit >= left * (1.0 - 1e-12):
        clock[STEP_NOW], clock[HITS] = left, 1.0
    elif limit > 0.5 * left:  # two equal steps rather than one whole and one tiny
        clock[STEP_NOW] = 0.5 * left
    else:
        clock[STEP_NOW] = limit


@jit
def book_points_left(rows, keys, order, start, active, blocks, dt, dx, shape, left_cells):
    """Add the points that left in this step of `dt` [s] to `left_cells`, where they came to (see `book_left`)."""
    for a in range(active):
        east, north = (blocks[a, 0] * BLOCK - GHOSTS) * dx, (blocks[a, 1] * BLOCK - GHOSTS) * dx
        for q in range(start[a], start[a + 1]):
            p = order[q]
            if keys[p] == GONE:
                mass = float(rows[p, MASS])
                x = east + rows[p, X] * dx + dt * rows[p, PX] / mass
                y = north + rows[p, Y] * dx + dt * rows[p, PY] / mass
                book_left(left_cells, shape, x, y, dx, mass)


@jit
def collect(report, ledger, clock, counts, window):
    """Reduce the chunks' reports in their order into clock, counts, ledger and window."""
    clock[SPEED_NOW] = clock[SHEAR] = 0.0
    clock[POINT_STEPS] += counts[ALIVE]
    no_window(window)
    lifted = 0.0
    for c in range(CHUNKS):
        mine = report[c]
        clock[SPEED_NOW] = max(clock[SPEED_NOW], sqrt(mine[SPEED2_MAX]))
        clock[SHEAR] = max(clock[SHEAR], sqrt(mine[SHEAR_MAX]))
        clock[TIP_TOTAL] += mine[AT_TIP]
        clock[FAR_TOTAL] += mine[FAR]
        clock[PLASTIC_LOSS] += mine[PLASTIC]
        clock[LIMITED_TOTAL] += mine[LIMITED]
        clock[LIMIT_LOSS] += mine[LIMITED_ENERGY]
        lifted += mine[UNDER]
        clock[LIFTED_TOTAL] += mine[UNDER_POINTS]
        clock[STRETCH_TOTAL] += mine[HELD_STRETCH]
        clock[WALL_TOTAL] += mine[HELD_WALL]
        clock[LIFTED_ENERGY] += mine[UNDER_ENERGY]
        clock[IMPULSE_GROUND_X] += mine[UNDER_X]
        clock[IMPULSE_GROUND_Y] += mine[UNDER_Y]
        clock[IMPULSE_GROUND_Z] += mine[UNDER_Z]
        if mine[NOT_FINITE] > 0.0:
            counts[BAD] += int(mine[NOT_FINITE])
            clock[BAD_AT_X], clock[BAD_AT_Y] = mine[BAD_X], mine[BAD_Y]
        window[BLOCKS_WEST] = min(window[BLOCKS_WEST], int(mine[BLOCK_WEST]))
        window[BLOCKS_SOUTH] = min(window[BLOCKS_SOUTH], int(mine[BLOCK_SOUTH]))
        window[BLOCKS_EAST] = max(window[BLOCKS_EAST], int(mine[BLOCK_EAST]))
        window[BLOCKS_NORTH] = max(window[BLOCKS_NORTH], int(mine[BLOCK_NORTH]))
        window[BLOCKS_TALL] = max(window[BLOCKS_TALL], int(mine[BLOCK_TALL]))
        for edge in range(EDGES):
            clock[MASS_NOW] -= mine[OUT + edge * OUT_ENTRIES]
            for entry in range(OUT_ENTRIES):
                ledger[edge, entry] += mine[OUT + edge * OUT_ENTRIES + entry]
            counts[ALIVE] -= int(mine[OUT + edge * OUT_ENTRIES + 6])
    clock[LIFTED_MASS] += lifted
    clock[SPEED_WORST] = max(clock[SPEED_WORST], clock[SPEED_NOW])
    return lifted


@jit
def note_fastest(report, clock, rows, keys, order, start, bounds, dx, lowest):
    """Where and when a point is faster than any before: looked for among the points of the chunk that has it."""
    most, chunk = clock[SPEED_WORST] ** 2, -1
    for c in range(CHUNKS):
        if report[c, SPEED2_MAX] > most:
            most, chunk = report[c, SPEED2_MAX], c
    if chunk < 0:
        return
    fastest2, fastest = -1.0, -1
    for k in range(start[bounds[chunk]], start[bounds[chunk + 1]]):
        p = order[k]
        if keys[p] == GONE:
            continue
        momentum2 = float(rows[p, PX]) ** 2 + float(rows[p, PX + 1]) ** 2 + float(rows[p, PZ]) ** 2
        if momentum2 > fastest2 * float(rows[p, MASS]) ** 2:
            fastest2, fastest = momentum2 / float(rows[p, MASS]) ** 2, p
    if fastest >= 0:
        place = places_of(rows[fastest : fastest + 1], keys[fastest : fastest + 1], dx, lowest)
        clock[FASTEST_X], clock[FASTEST_Y], clock[FASTEST_Z] = place[0, 0], place[0, 1], place[0, 2]
        clock[FASTEST_TIME] = clock[TIME]


@jit
def collect_nodes(node_report, clock):
    """Reduce the node loop's reports: the largest speed, and the impulses of ground and walls."""
    fastest2 = 0.0
    for c in range(CHUNKS):
        mine = node_report[c]
        fastest2 = max(fastest2, mine[FASTEST2])
        clock[IMPULSE_GROUND_X] += mine[GROUND_X]
        clock[IMPULSE_GROUND_Y] += mine[GROUND_Y]
        clock[IMPULSE_GROUND_Z] += mine[GROUND_Z]
        clock[IMPULSE_WALL_X] += mine[WALL_X]
        clock[IMPULSE_WALL_Y] += mine[WALL_Y]
        clock[GROUND_LOSS] += mine[GROUND_WORK]
        clock[FRICTION_LOSS] += mine[FRICTION_WORK]
        clock[BARRIER_LOSS] += mine[BARRIER_WORK]
        clock[LAYER_LOSS] += mine[LAYER_WORK]
    clock[FASTEST] = sqrt(fastest2)


@jit
def volume_ratios(rows, material):
    """float64[n]: volume of each point over that free of stress [1]."""
    ratios = np.empty(rows.shape[0])
    for p in range(rows.shape[0]):
        s4, s5, s6, s7 = _more_state(rows, p)
        ratios[p] = material.volume_ratio(rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3], s4, s5, s6, s7)
    return ratios


@jit
def stored_energy(rows, density, material):
    """Elastic energy of all points [J]."""
    total = 0.0
    for p in range(rows.shape[0]):
        s4, s5, s6, s7 = _more_state(rows, p)
        total += (
            rows[p, MASS]
            / density
            * material.stored_energy(rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3], s4, s5, s6, s7)
        )
    return total


@jit
def _more_state(rows, p):
    """The numbers of state that short rows have not."""
    if rows.shape[1] > S4:
        return rows[p, S4], rows[p, S4 + 1], rows[p, S4 + 2], rows[p, S4 + 3]
    return 0.0, 0.0, 0.0, 0.0


@jit
def has_openings(barriers):
    """Is any node column of `barriers` partly open?"""
    for j in range(barriers.shape[0]):
        for i in range(barriers.shape[1]):
            if barriers[j, i, SHARE] > 0.0:
                return True
    return False


@jit
def advance(
    rows, ids, keys, order, clock, counts, ledger, left_cells, barrier_sums, peaks, ground, lowest,
    inside, zone_values, barriers, yields, until, after, max_steps, settings, effects, watched,
):  # fmt: skip
    """March until time `until` [s] or for `max_steps`; the whole loop is compiled, whatever the number of points.

    It comes back before a step that would touch a block over those marked in `watched` uint8[block rows, block
    columns], which is empty where nothing is watched.

    `after` is the time that will be asked for next. Everything that changes lives in the arrays (clock, counts,
    rows...), so that a call goes on exactly where the last one ended. Answers why it came back.
    """
    dx, gravity, real = settings.dx, settings.gravity, rows.dtype
    window = counts[WINDOW_FIRST:]
    report = np.zeros((CHUNKS, REPORT))
    node_report = np.zeros((CHUNKS, NODE_REPORT))
    barrier_report = np.zeros((CHUNKS, barrier_sums.shape[0], POINT_BARRIER_SUMS))
    bounds = np.zeros(CHUNKS + 1, np.int64)
    column_sums = np.zeros((CHUNKS, COLUMN_SUMS))
    histogram = np.zeros((SORT_PIECES, 16), np.int32)
    slot, touched_slot, block = np.zeros(16, np.int32), np.zeros(16, np.int32), np.zeros(16, np.int32)
    start = np.zeros(17, np.int64)
    room = 64
    tiles = np.zeros((room, TILE_SIZE), real)
    blocks, targets = np.zeros((room, 3), np.int32), np.zeros((room, 8), np.int32)
    node_room = 256
    nodes = np.zeros((node_room, BLOCK_SIZE), real)
    sources, touched = np.zeros((node_room, 8), np.int32), np.zeros((node_room, 3), np.int32)
    free = np.zeros(node_room, np.uint8)
    drags = effects.contact.drag_active()
    rows_of_ground, columns_of_ground = ground.nodes.shape[0], ground.nodes.shape[1]
    column_mass = np.zeros((rows_of_ground if drags else 1, columns_of_ground if drags else 1, COLUMN_MASSES))
    block_mass = np.zeros((node_room if drags else 1, BLOCK_COLUMNS))
    opens = effects.barrier.barrier_active() and has_openings(barriers)
    flow = np.zeros((rows_of_ground if opens else 1, columns_of_ground if opens else 1, COLUMN_FLOW))
    block_flow = np.zeros((node_room if opens else 1, BLOCK_FLOW))
    strip, names = np.empty((counts[ROWS], STRIP), real), np.empty((counts[ROWS], 2), np.int64)
    for _ in range(max_steps):
        if clock[TIME] >= until:
            return REACHED_TIME
        if counts[ALIVE] == 0:
            return ALL_LEFT
        n = counts[ROWS]
        width = window[BLOCKS_EAST] - window[BLOCKS_WEST] + 2
        depth = window[BLOCKS_TALL] + 2
        size = width * (window[BLOCKS_NORTH] - window[BLOCKS_SOUTH] + 2) * depth
        if size > MOST_PLACES:
            return SCATTERED
        if size > slot.size:
            wide = size + size // 2
            histogram = np.zeros((SORT_PIECES, wide), np.int32)
            slot, touched_slot = np.zeros(wide, np.int32), np.zeros(wide, np.int32)
            block, start = np.zeros(wide, np.int32), np.zeros(wide + 1, np.int64)
        active, alive = sort_by_block(keys, n, window, width, depth, size, histogram, order, slot, block, start)
        if active > room:
            room = active + active // 2
            tiles = np.zeros((room, TILE_SIZE), real)
            blocks, targets = np.zeros((room, 3), np.int32), np.zeros((room, 8), np.int32)
        if 8 * active > touched.shape[0]:
            sources, touched = np.zeros((8 * room, 8), np.int32), np.zeros((8 * room, 3), np.int32)
        split_evenly(start, active, bounds)
        n_touched = link_blocks(
            block, active, window, width, depth, lowest, touched_slot, size, touched, sources, targets
        )
        if watched.size > 0 and comes_near(touched, n_touched, watched):
            return WATCHED_REACHED
        if counts[SINCE_REORDER] >= REORDER_STEPS:
            reorder(rows, ids, keys, order, alive, strip, names)
            counts[ROWS], counts[SINCE_REORDER] = alive, 0
            for p in range(alive):
                order[p] = p
        counts[SINCE_REORDER] += 1
        if n_touched > nodes.shape[0]:
            nodes = np.zeros((n_touched + n_touched // 2, BLOCK_SIZE), real)
            free = np.zeros(nodes.shape[0], np.uint8)
            block_mass = np.zeros((nodes.shape[0] if drags else 1, BLOCK_COLUMNS))
            block_flow = np.zeros((nodes.shape[0] if opens else 1, BLOCK_FLOW))
        for a in range(active):
            own = targets[a, 0]
            blocks[a, 0], blocks[a, 1], blocks[a, 2] = touched[own, 1], touched[own, 0], touched[own, 2]

        dt, hits = clock[STEP_NOW], clock[HITS] > 0.0
        end = until if hits else clock[TIME] + dt
        points_to_grid(rows, order, start, bounds, tiles)
        if drags or opens:
            gather_nodes(nodes, tiles, sources, n_touched)
        if drags:
            weigh_contact(nodes, touched, n_touched, ground, dx, settings.clearance, block_mass)
            spread_contact(block_mass, touched, n_touched, column_mass)
        if opens:
            weigh_flow(nodes, touched, n_touched, block_flow)
            spread_contact(block_flow, touched, n_touched, flow)
        move_nodes(
            nodes, tiles, sources, touched, n_touched, drags or opens, free, ground, barriers, node_report, dx, dt,
            gravity, settings.wall, settings.cells_x, settings.cells_y, effects.barrier.barrier_active(),
        )  # fmt: skip
        if drags:
            couple_layers(
                nodes, touched, n_touched, touched_slot, window[BLOCKS_WEST], window[BLOCKS_SOUTH], width, depth,
                lowest, ground, zone_values, barriers, column_mass, node_report, dx, dt, settings.density, gravity,
                settings.slack, effects.contact, effects.zones, effects.barrier,
            )  # fmt: skip
        press_on_ground(
            nodes, touched, n_touched, free, touched_slot, window[BLOCKS_WEST], window[BLOCKS_SOUTH], width, depth,
            lowest, ground, zone_values, barriers, yields, counts[STEP] + 1, node_report, dx, dt, settings.density,
            settings.signal_speed, gravity, settings.wall, settings.cells_x, settings.cells_y, effects.contact,
            effects.zones, effects.barrier,
        )  # fmt: skip
        hold_nodes(
            nodes, touched, n_touched, free, ground, zone_values, barriers, column_mass, flow, node_report,
            barrier_report, dx, dt, settings.density, gravity, settings.clearance, settings.wall, settings.cells_x,
            settings.cells_y, effects.contact, effects.zones, effects.barrier,
        )  # fmt: skip
        if drags:
            clear_contact(touched, n_touched, column_mass)
        if opens:
            clear_contact(touched, n_touched, flow)
        if settings.keep_peaks:
            accumulate_point_peaks(
                peaks, column_sums, nodes, touched, n_touched, touched_slot, window[BLOCKS_WEST], window[BLOCKS_SOUTH],
                width, window[BLOCKS_NORTH] - window[BLOCKS_SOUTH] + 2, depth, lowest, ground.nodes, dx,
                settings.density, end, settings.arrival_thickness, settings.lone_thickness, settings.wall,
                settings.cells_x, settings.cells_y,
            )  # fmt: skip
        collect_nodes(node_report, clock)
        if effects.barrier.barrier_active():
            collect_point_barriers(barrier_report, barrier_sums, dt)
        clock[IMPULSE_GRAVITY] += dt * gravity * clock[MASS_NOW]
        set_next_step(clock, counts, end, until, after, settings)
        grid_to_points(
            rows, keys, order, start, bounds, blocks, targets, nodes, tiles, ground.nodes, lowest, inside, report,
            dx, dt, clock[STEP_NOW], settings.density, settings.signal_speed, gravity, settings.wall, settings.holes,
            settings.cells_x, settings.cells_y, effects.material, effects.softening, effects.transfer,
        )  # fmt: skip
        counts[STEP] += 1
        clock[TIME] = end
        before = counts[ALIVE]
        note_fastest(report, clock, rows, keys, order, start, bounds, dx, lowest)
        lifted = collect(report, ledger, clock, counts, window)
        if counts[BAD] > 0:
            return NOT_FINITE_STATE
        if lifted > settings.leak_stop * clock[TOTAL_MASS]:
            return LEAKED
        if counts[ALIVE] < before:
            book_points_left(rows, keys, order, start, active, blocks, dt, dx, inside.shape, left_cells)
            counts[SINCE_REORDER] = REORDER_STEPS  # drop them from memory at the next step
    return REACHED_TIME if clock[TIME] >= until else RUNNING
