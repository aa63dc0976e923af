"""Compiled loops of the depth-averaged MPM (design notes 3; blocks as in design notes on kernels).

Particles are rows of consecutive floats. Each step sorts their indices by blocks of 8 x 8 nodes; a block sums its
particles into a private tile (particles to grid), the grid gathers the tiles that overlap a node in a fixed order, is
updated, and the block's particles read it back (grid to particles). Nothing is shared between loops and every sum has
a fixed order, so that results are bitwise the same for any number of threads. Only blocks that hold particles cost.

Nodes lie on cell corners: array index k + 1 is the node at k * dx from the domain's south-west corner, so that there
is one ghost node outside each edge. Weights are quadratic B-splines (Steffen et al. 2008).
"""

from typing import NamedTuple

import numpy as np

from .block_order import CHUNKS, GONE, REORDER_STEPS, STRIP, reorder, split_evenly
from .column_barriers import BARRIER_ENTRIES, BARRIER_LOSS, BARRIER_SUMS, collect_barriers, hold_at_barriers
from .column_blocks import block_key, comes_near, initial_keys, rows_and_columns, sort_by_block, touched_blocks
from .column_nodes import (
    AIRBORNE_MASS,
    ARMED,
    DEEPEST,
    FRICTION_LOSS,
    GREEDY_MASS,
    LOWERING_LOSS,
    MERGING_LOSS,
    NODE_REPORT,
    REACHED,
    THIN_MASS,
    TRIGGERED,
    WET_NEW,
    accumulate_peaks,
    clear_ghosts,
    fold_walls,
    mirror_walls,
    regrade,
    update_nodes,
)
from .column_rows import (
    AREA,
    BLOCK,
    GX,
    GY,
    MASS,
    NODE_MASS,
    ROW,
    TILE,
    U,
    V,
    X,
    Y,
    beds_at,
    grid_areas,
    node_gradients,
    settle_areas,
    weights,
)
from .column_transfer import (
    BENT,
    BLOCK_EAST,
    BLOCK_NORTH,
    BLOCK_SOUTH,
    BLOCK_WEST,
    BOUND_RATIO,
    BOUND_X,
    BOUND_Y,
    CLAMPED,
    EDGES,
    ENTRAINED,
    ENTRAINED_POTENTIAL,
    FASTEST2,
    FLOWING,
    HELD_SPEED,
    HELD_STRETCH,
    HELD_THIN,
    HELD_WALL,
    KINETIC,
    LIMITED,
    LIMITED_LOSS,
    MOVING,
    NOT_FINITE,
    OUT,
    OUT_ENTRIES,
    REPORT,
    SIGNAL_MAX,
    SPEED_MAX,
    STIFF,
    WILD,
    WORK,
    gather_tiles,
    grid_to_particles,
    particles_to_grid,
)
from .jit import jit
from .left_cells import LEFT_BLOCK, LEFT_ENTRIES, WAYS, book_left

__all__ = [  # what the solver needs beside its own
    "AREA",
    "ARMED",
    "BARRIER_ENTRIES",
    "BARRIER_SUMS",
    "BLOCK",
    "GONE",
    "GX",
    "GY",
    "LEFT_BLOCK",
    "LEFT_ENTRIES",
    "MASS",
    "REACHED",
    "ROW",
    "WAYS",
    "U",
    "V",
    "X",
    "Y",
    "advance",
    "beds_at",
    "block_key",
    "grid_areas",
    "initial_keys",
    "node_gradients",
    "rows_and_columns",
    "settle_areas",
    "weights",
]

# why `advance` came back
(
    RUNNING,
    REACHED_TIME,
    STOPPED_MOVING,
    STOPPED_ENERGY,
    STOPPED_FOOTPRINT,
    ALL_LEFT,
    NOT_FINITE_STATE,
    TOO_FAST,
    TRIGGER_REACHED,
    WATCHED_REACHED,
) = range(10)
# float64 clock: what one step hands to the next, and what a restart needs
(
    TIME,
    LAST_DT,  # last time step not cut by a frame time [s]
    KICK_BEFORE,  # [s] of the last step for which velocities have not been driven yet
    SIGNAL,  # max |u| + sqrt(g h) [m s-1]
    SPEED,  # max |u| [m s-1]
    KINETIC_NOW,
    KINETIC_PEAK,
    KINETIC_LOW_SINCE,  # [s], -1 while the energy is not low
    MOVING_SHARE,
    MOVING_PEAK,
    FLOWING_SHARE,
    FOOTPRINT_MARK_TIME,
    FOOTPRINT_MARK,
    BOUND_WORST,  # over the run
    BOUND_NOW,
    BOUND_NOW_X,
    BOUND_NOW_Y,
    LIMITED_NOW,
    LIMITED_WORST,
    WILD_NOW,
    DEPTH_NOW,
    DEPTH_WORST,
    AIRBORNE_NOW,
    AIRBORNE_WORST,
    CLAMPED_TOTAL,
    STIFF_WORST,  # largest share of the columns whose apparent viscosity was cut
    TOTAL_MASS,  # all that ever was in the scene: released and taken up from the bed [kg]
    ENTRAINED_TOTAL,  # [kg]
    BOUND_BED,  # highest bed of any release [m]
    BOUND_ENERGY,  # 4 g h_max and the square of the initial speed [m2 s-2]
    FRICTION_TOTAL,  # energy lost to friction on the bed [J], and what follows, to mass taken up from the bed
    MERGING_TOTAL,
    BARRIER_TOTAL,  # to barriers
    LIMITED_TOTAL,  # to the bound of the speed
    WORK_TOTAL,  # work of weight and pressure [J]
    BENT_TOTAL,  # potential energy that came of changes of the bed's slope [J]
    ENTRAINED_POTENTIAL_TOTAL,  # what the mass taken up adds to the potential energy, from elevation 0 [J]
    DEEPEST_X,  # where and when DEPTH_WORST was [m, m, s]
    DEEPEST_Y,
    DEEPEST_TIME,
    FASTEST,  # largest |U| over the run [m s-1], where and when it was
    FASTEST_X,
    FASTEST_Y,
    FASTEST_TIME,
    COLUMN_STEPS,  # columns that there were, summed over the steps; then those of them that a clip acted on
    STRETCH_TOTAL,
    THIN_AREA_TOTAL,
    SPEED_TOTAL,
    WALL_TOTAL,
    STIFF_TOTAL,
    THIN_TOTAL,  # of what nodes did to mass: as many columns as hold that share of all mass
    GREEDY_TOTAL,
    AIRBORNE_TOTAL,
    CLOCK,
) = range(54)
# int64 counts
ROWS, ALIVE, STEP, SINCE_REORDER, WET, WEST, SOUTH, EAST, NORTH, BAD, COUNTS = range(11)


class Settings(NamedTuple):
    """What does not change while the columns march."""

    dx: float  # [m]
    density: float  # [kg m-3]
    gravity: float  # [m s-2]
    cfl: float
    fixed_dt: float  # [s]; 0: by the Courant number
    move_limit: float  # largest share of a cell that a column moves in a step
    fall_limit: float  # [s] C times the time in which the steepest ground moves a resting column by a cell
    clamp: float
    thickness_floor: float  # [m]
    wet_thickness: float  # [m]
    arrival_thickness: float  # [m]
    wild_stop: float  # share of the mass
    wall: bool
    holes: bool  # the terrain has cells without elevation
    stop_at_rest: bool
    keep_peaks: bool


class NodeFields(NamedTuple):
    """What is known by place, at the nodes [ny + 3, nx + 3] or in the cells [ny, nx]; one entry where not in use."""

    bed: np.ndarray  # [m]
    gradient: np.ndarray  # [..., 2]
    inside: np.ndarray  # cells; 1 where there is terrain
    zone_values: np.ndarray  # [..., parameters of the friction law]
    erodible: np.ndarray  # [kg m-2] that can still be taken up
    barriers: np.ndarray  # [..., BARRIER_ENTRIES]
    lake_level: np.ndarray  # cells; [m]
    trigger_thickness: np.ndarray  # [areas that the flow releases]; [m] that has to reach each


@jit
def next_time_step(clock, step, settings):
    """C dx / max(|u| + sqrt(g h)), at most `move_limit` dx / |u|, growing by at most 1.5 (design notes 3.7)."""
    dt = min(
        settings.cfl * settings.dx / max(clock[SIGNAL], 1e-300),
        settings.move_limit * settings.dx / max(clock[SPEED], 1e-300),
        settings.fall_limit,
    )
    return dt if step == 0 else min(dt, 1.5 * clock[LAST_DT])


@jit
def book_columns_left(rows, keys, order, alive, dt, dx, shape, left_cells):
    """Add the columns that left in this step of `dt` [s] to `left_cells`, where they came to (see `book_left`)."""
    for q in range(alive):
        p = order[q]
        if keys[p] == GONE:
            x, y = rows[p, X] + dt * rows[p, U], rows[p, Y] + dt * rows[p, V]
            book_left(left_cells, shape, x, y, dx, rows[p, MASS])


@jit
def collect(report, node_report, ledger, clock, counts):
    """Reduce the chunks' reports in their order into clock, counts and ledger."""
    clock[SIGNAL] = clock[SPEED] = clock[KINETIC_NOW] = clock[DEPTH_NOW] = clock[BOUND_NOW] = 0.0
    moving, flowing, airborne, limited, wild, alive_before = 0.0, 0.0, 0.0, 0.0, 0.0, counts[ALIVE]
    stiff, triggered, thin, greedy = 0.0, 0.0, 0.0, 0.0
    west, south, east, north = 1 << 16, 1 << 16, -1, -1
    for c in range(CHUNKS):
        mine = report[c]
        stiff += mine[STIFF]
        clock[ENTRAINED_TOTAL] += mine[ENTRAINED]
        clock[TOTAL_MASS] += mine[ENTRAINED]
        clock[ENTRAINED_POTENTIAL_TOTAL] += mine[ENTRAINED_POTENTIAL] - node_report[c, LOWERING_LOSS]
        clock[WORK_TOTAL] += mine[WORK]
        clock[BENT_TOTAL] += mine[BENT]
        clock[LIMITED_TOTAL] += mine[LIMITED_LOSS]
        clock[FRICTION_TOTAL] += node_report[c, FRICTION_LOSS]
        clock[MERGING_TOTAL] += node_report[c, MERGING_LOSS]
        triggered += node_report[c, TRIGGERED]
        clock[SIGNAL] = max(clock[SIGNAL], mine[SIGNAL_MAX])
        clock[SPEED] = max(clock[SPEED], mine[SPEED_MAX])
        clock[KINETIC_NOW] += mine[KINETIC]
        clock[CLAMPED_TOTAL] += mine[CLAMPED]
        clock[STRETCH_TOTAL] += mine[HELD_STRETCH]
        clock[THIN_AREA_TOTAL] += mine[HELD_THIN]
        clock[SPEED_TOTAL] += mine[HELD_SPEED]
        clock[WALL_TOTAL] += mine[HELD_WALL]
        thin += node_report[c, THIN_MASS]
        greedy += node_report[c, GREEDY_MASS]
        moving += mine[MOVING]
        flowing += mine[FLOWING]
        limited += mine[LIMITED]
        wild += mine[WILD]
        if mine[BOUND_RATIO] > clock[BOUND_NOW]:
            clock[BOUND_NOW], clock[BOUND_NOW_X], clock[BOUND_NOW_Y] = mine[BOUND_RATIO], mine[BOUND_X], mine[BOUND_Y]
        if mine[NOT_FINITE] > 0.0:
            counts[BAD] += int(mine[NOT_FINITE])
            clock[BOUND_NOW_X], clock[BOUND_NOW_Y] = mine[BOUND_X], mine[BOUND_Y]
        west, east = min(west, int(mine[BLOCK_WEST])), max(east, int(mine[BLOCK_EAST]))
        south, north = min(south, int(mine[BLOCK_SOUTH])), max(north, int(mine[BLOCK_NORTH]))
        for edge in range(EDGES):
            for entry in range(OUT_ENTRIES):
                ledger[edge, entry] += mine[OUT + edge * OUT_ENTRIES + entry]
            counts[ALIVE] -= int(mine[OUT + edge * OUT_ENTRIES + 5])
        counts[WET] += int(node_report[c, WET_NEW])
        airborne += node_report[c, AIRBORNE_MASS]
        clock[DEPTH_NOW] = max(clock[DEPTH_NOW], node_report[c, DEEPEST])
    total_mass = clock[TOTAL_MASS]
    clock[STIFF_WORST] = max(clock[STIFF_WORST], stiff / max(alive_before, 1))
    clock[COLUMN_STEPS] += alive_before
    clock[STIFF_TOTAL] += stiff
    for entry, mass in ((THIN_TOTAL, thin), (GREEDY_TOTAL, greedy), (AIRBORNE_TOTAL, airborne)):
        clock[entry] += alive_before * mass / total_mass
    counts[WEST], counts[SOUTH], counts[EAST], counts[NORTH] = west, south, east, north
    clock[LIMITED_NOW], clock[WILD_NOW] = limited / total_mass, wild / total_mass
    clock[LIMITED_WORST] = max(clock[LIMITED_WORST], clock[LIMITED_NOW])
    clock[AIRBORNE_NOW] = airborne / total_mass
    clock[AIRBORNE_WORST] = max(clock[AIRBORNE_WORST], clock[AIRBORNE_NOW])
    clock[BOUND_WORST] = max(clock[BOUND_WORST], clock[BOUND_NOW])
    clock[DEPTH_WORST] = max(clock[DEPTH_WORST], clock[DEPTH_NOW])
    clock[KINETIC_PEAK] = max(clock[KINETIC_PEAK], clock[KINETIC_NOW])
    clock[MOVING_SHARE] = moving / total_mass
    clock[FLOWING_SHARE] = flowing / total_mass
    clock[MOVING_PEAK] = max(clock[MOVING_PEAK], clock[MOVING_SHARE])
    return alive_before - counts[ALIVE], triggered > 0.0


@jit
def note_deepest(node_report, clock, nodes, touched, n_touched, west, south, width, dx):
    """Where and when the flow at a node is thicker than at any before: looked for in the chunk that has it."""
    most, chunk = clock[DEPTH_WORST], -1
    for c in range(CHUNKS):
        if node_report[c, DEEPEST] > most:
            most, chunk = node_report[c, DEEPEST], c
    if chunk < 0:
        return
    heaviest = 0.0
    for k in range(chunk * n_touched // CHUNKS, (chunk + 1) * n_touched // CHUNKS):
        j_first = (touched[k] // (width + 1) + south) * BLOCK
        i_first = (touched[k] % (width + 1) + west) * BLOCK
        for j in range(j_first, min(j_first + BLOCK, nodes.shape[0])):
            for i in range(i_first, min(i_first + BLOCK, nodes.shape[1])):
                if nodes[j, i, NODE_MASS] > heaviest:
                    heaviest = nodes[j, i, NODE_MASS]
                    clock[DEEPEST_X], clock[DEEPEST_Y] = (i - 1) * dx, (j - 1) * dx
    clock[DEEPEST_TIME] = clock[TIME]


@jit
def note_fastest(report, clock, rows, keys, order, start, bounds, metric):
    """The largest speed so far, where and when: looked for among the columns of the chunk that has it."""
    most, chunk = clock[FASTEST] ** 2, -1
    for c in range(CHUNKS):
        if report[c, FASTEST2] > most:
            most, chunk = report[c, FASTEST2], c
    if chunk < 0:
        return
    fastest2 = -1.0
    for k in range(start[bounds[chunk]], start[bounds[chunk + 1]]):
        p = order[k]
        if keys[p] == GONE:
            continue
        mx, my = metric.metric_gradient(rows[p, GX], rows[p, GY])
        w = rows[p, U] * mx + rows[p, V] * my
        speed2 = rows[p, U] ** 2 + rows[p, V] ** 2 + w * w
        if speed2 > fastest2:
            fastest2 = speed2
            clock[FASTEST_X], clock[FASTEST_Y] = rows[p, X], rows[p, Y]
    clock[FASTEST], clock[FASTEST_TIME] = np.sqrt(most), clock[TIME]


@jit
def stop_rule(clock, counts):
    """Has the flow come to rest? (design notes 3.9) Answers the reason or RUNNING."""
    time = clock[TIME]
    if clock[MOVING_PEAK] > 0.0 and clock[MOVING_SHARE] < 0.01 * clock[MOVING_PEAK]:
        return STOPPED_MOVING
    if clock[KINETIC_PEAK] > 0.0 and clock[KINETIC_NOW] < 0.01 * clock[KINETIC_PEAK]:
        if clock[KINETIC_LOW_SINCE] < 0.0:
            clock[KINETIC_LOW_SINCE] = time
        elif time - clock[KINETIC_LOW_SINCE] >= 2.0:
            return STOPPED_ENERGY
    else:
        clock[KINETIC_LOW_SINCE] = -1.0
    if time - clock[FOOTPRINT_MARK_TIME] >= 10.0:
        grown = counts[WET] - clock[FOOTPRINT_MARK]
        clock[FOOTPRINT_MARK_TIME], clock[FOOTPRINT_MARK] = time, float(counts[WET])
        slowing = clock[KINETIC_NOW] <= 0.5 * clock[KINETIC_PEAK]
        if slowing and grown < 0.001 * counts[WET] and clock[FLOWING_SHARE] < 0.05:
            return STOPPED_FOOTPRINT
    return RUNNING


@jit
def advance(
    rows, ids, keys, order, nodes, wet, clock, counts, ledger, peaks, barrier_sums,
    left_cells, until, max_steps, settings, fields, effects, watched,
):  # fmt: skip
    """March until time `until` [s] or for `max_steps`; the whole loop is compiled, whatever the number of particles.

    It comes back before a step that would touch a block marked in `watched` uint8[block rows, block columns], which is
    empty where nothing is watched.

    Everything that changes lives in the arrays (clock, counts, rows...), so that a call goes on exactly where the
    last one ended. Answers why it came back.
    """
    dx, density, gravity, wall = settings.dx, settings.density, settings.gravity, settings.wall
    report = np.zeros((CHUNKS, REPORT))
    node_report = np.zeros((CHUNKS, NODE_REPORT))
    barrier_report = np.zeros((CHUNKS, barrier_sums.shape[0], BARRIER_LOSS + 1))
    bounds = np.zeros(CHUNKS + 1, np.int64)
    histogram = np.zeros((CHUNKS, 16), np.int32)
    slot = np.zeros(16, np.int32)
    block = np.zeros(16, np.int32)
    start = np.zeros(17, np.int64)
    touched = np.zeros(64, np.int32)
    tiles = np.zeros((16, TILE * TILE * 4))
    strip, names = np.empty((counts[ROWS], STRIP)), np.empty((counts[ROWS], 2), np.int64)
    for _ in range(max_steps):
        if clock[TIME] >= until:
            return REACHED_TIME
        if counts[ALIVE] == 0:
            return ALL_LEFT
        n = counts[ROWS]
        west, south, east, north = counts[WEST], counts[SOUTH], counts[EAST], counts[NORTH]
        width, height = east - west + 1, north - south + 1
        if width * height > slot.size:
            size = 2 * width * height
            histogram = np.zeros((CHUNKS, size), np.int32)
            slot, block, start = np.zeros(size, np.int32), np.zeros(size, np.int32), np.zeros(size + 1, np.int64)
            touched = np.zeros(2 * size + 2 * (width + height) + 64, np.int32)
        active, alive = sort_by_block(keys, n, west, south, east, north, histogram, order, slot, block, start)
        if alive == 0:
            return ALL_LEFT
        n_touched = touched_blocks(slot, width, height, touched)
        if watched.size > 0 and comes_near(touched, n_touched, west, south, width, watched):
            return WATCHED_REACHED
        if counts[SINCE_REORDER] >= REORDER_STEPS:
            reorder(rows, ids, keys, order, alive, strip, names)
            counts[ROWS], counts[SINCE_REORDER] = alive, 0
            for p in range(alive):
                order[p] = p
        counts[SINCE_REORDER] += 1
        if active > tiles.shape[0]:
            tiles = np.zeros((active + active // 2, TILE * TILE * 4))
        split_evenly(start, active, bounds)

        dt = settings.fixed_dt if settings.fixed_dt > 0.0 else next_time_step(clock, counts[STEP], settings)
        clock[LAST_DT] = dt
        left = until - clock[TIME]
        last = dt >= left * (1.0 - 1e-12)
        if last:
            dt = left
        elif dt > 0.5 * left:  # two equal steps rather than one whole and one tiny
            dt = 0.5 * left
        # leapfrog: velocities are driven from the middle of the last step to the middle of this one, and up to its end
        # where a frame is due; second order in time, also where steps change (design note 3.7)
        behind = clock[KICK_BEFORE]
        kick = behind + (dt if last else 0.5 * dt)
        clock[KICK_BEFORE] = 0.0 if last else 0.5 * dt

        particles_to_grid(
            rows, order, start, block, bounds, west, south, width, tiles, fields.bed, fields.lake_level, report,
            dx, kick, density, gravity,
            effects.metric, effects.still_water, effects.earth_pressure, effects.viscosity,
        )  # fmt: skip
        if wall:
            clear_ghosts(nodes)
        gather_tiles(nodes, tiles, slot, west, south, width, height, touched, n_touched)
        if wall:
            fold_walls(nodes)
        if effects.barrier.barrier_active():
            hold_at_barriers(
                nodes, fields.bed, fields.gradient, slot, touched, n_touched, west, south, width, height,
                barrier_report, dx, kick, density, gravity, wall, fields.barriers, effects.barrier, effects.metric,
            )  # fmt: skip
        update_nodes(
            nodes, fields.bed, fields.gradient, wet, touched, n_touched, west, south, width, node_report,
            dx, kick, density, gravity, settings.thickness_floor, settings.wet_thickness, fields.trigger_thickness,
            fields.zone_values, fields.erodible, wall,
            effects.friction, effects.zones, effects.cohesion, effects.metric, effects.curvature,
            effects.entrainment,
        )  # fmt: skip
        if effects.entrainment.bed_lowering() > 0.0:
            regrade(fields.bed, fields.gradient, touched, n_touched, west, south, width, dx)
        if settings.keep_peaks:
            accumulate_peaks(
                peaks, nodes, fields.gradient, touched, n_touched, west, south, width, dx, density, clock[TIME] + dt,
                settings.arrival_thickness, effects.metric, effects.entrainment,
            )  # fmt: skip
        if wall:
            mirror_walls(nodes)
        grid_to_particles(
            rows, keys, order, start, block, bounds, west, south, width, nodes, fields.bed, fields.inside, report,
            dx, dt, behind, clock[KICK_BEFORE], density, gravity, settings.clamp, wall, settings.holes,
            clock[BOUND_BED], clock[BOUND_ENERGY],
            effects.earth_pressure.largest_factor(), effects.metric, effects.curvature, effects.entrainment,
        )  # fmt: skip

        counts[STEP] += 1
        clock[TIME] = until if last else clock[TIME] + dt
        note_deepest(node_report, clock, nodes, touched, n_touched, west, south, width, dx)
        note_fastest(report, clock, rows, keys, order, start, bounds, effects.metric)
        gone, triggered = collect(report, node_report, ledger, clock, counts)
        if effects.barrier.barrier_active():
            clock[BARRIER_TOTAL] += collect_barriers(barrier_report, barrier_sums, kick)
        if counts[BAD] > 0:
            return NOT_FINITE_STATE
        if gone > 0:
            book_columns_left(rows, keys, order, alive, dt, dx, fields.inside.shape, left_cells)
        if clock[WILD_NOW] > settings.wild_stop:
            return TOO_FAST
        if counts[ALIVE] == 0:
            return ALL_LEFT
        if gone > 0 and counts[SINCE_REORDER] < REORDER_STEPS:
            counts[SINCE_REORDER] = REORDER_STEPS  # drop them from memory at the next step
        if triggered:
            return TRIGGER_REACHED
        if settings.stop_at_rest:
            reason = stop_rule(clock, counts)
            if reason != RUNNING:
                return reason
    return REACHED_TIME if clock[TIME] >= until else RUNNING
