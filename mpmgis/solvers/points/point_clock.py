"""Clock and counts of the time loop over points: entries, time step, update from the reports of a step."""

from math import sqrt

from ...compiled.block_order import CHUNKS, GONE, book_left
from ...compiled.jit import jit
from . import point_report as entry
from .point_blocks import EAST, NORTH, SOUTH, TALL, WEST, WINDOW, no_window, places_of
from .point_nodes import (
    BARRIER_WORK,
    CORRECTED,
    CORRECTED_ENERGY,
    FASTEST2,
    FRICTION_WORK,
    GROUND_WORK,
    GROUND_X,
    GROUND_Y,
    GROUND_Z,
    LAYER_WORK,
    RETURNED_WORK,
    WALL_X,
    WALL_Y,
)
from .point_rows import BLOCK, GHOSTS, MASS, PX, PY, PZ, X, Y

# reasons for which `advance` returns
RUNNING, REACHED_TIME, ALL_LEFT, NOT_FINITE_STATE, LEAKED, SCATTERED, WATCHED_REACHED = range(7)
# float64 clock: state of the time integration, also stored for a restart
(
    TIME,
    STEP_NOW,  # length [s] of the next step, for which the impulses of the points are computed
    HITS,  # 1 if that step ends exactly at the requested time
    LAST_DT,  # last time step not cut by a frame time [s]
    FASTEST,  # largest speed at a node [m s-1]
    SHEAR,  # largest |C| of a point [s-1]
    SPEED_NOW,  # largest speed of a point [m s-1]
    SPEED_WORST,
    TIP_TOTAL,  # point-steps at the tip of the yield surface
    FAR_TOTAL,  # point-steps whose strain exceeded the range of the series
    LIFTED_MASS,  # mass moved back onto the ground, counted each time [kg]
    TOTAL_MASS,  # [kg]
    MASS_NOW,  # on the terrain [kg]
    BAD_AT_X,
    BAD_AT_Y,
    IMPULSE_GROUND_X,  # impulse of the ground on the flow [N s]
    IMPULSE_GROUND_Y,
    IMPULSE_GROUND_Z,
    IMPULSE_WALL_X,
    IMPULSE_WALL_Y,
    IMPULSE_GRAVITY,  # downwards [N s]
    GROUND_LOSS,  # work against friction and drag of the ground [J]
    BARRIER_LOSS,  # work against barriers [J]
    PLASTIC_LOSS,  # plastic work [J]
    LIFTED_ENERGY,  # potential energy added by moving mass back onto the ground [J]
    FASTEST_X,  # place and time of SPEED_WORST [m, m, m, s]
    FASTEST_Y,
    FASTEST_Z,
    FASTEST_TIME,
    HIGHEST,  # largest height of a point at the start [m]
    START_SPEED,  # largest speed of a point at the start [m s-1]
    DEEPEST,  # largest thickness of the flow at the times it was evaluated [m]; its place and time [m, m, s]
    DEEPEST_X,
    DEEPEST_Y,
    DEEPEST_TIME,
    POINT_STEPS,  # number of points, summed over the steps; then those that each clip acted on
    LIFTED_TOTAL,
    STRETCH_TOTAL,
    WALL_TOTAL,
    LIMITED_TOTAL,
    LIMIT_LOSS,  # kinetic energy removed by the limit of affine velocities [J]
    SPEED_P999,  # largest 99.9th percentile of the speed, by mass [m s-1], and its time [s]
    SPEED_P999_TIME,
    LAYER_LOSS,  # energy lost between layers of a flow with drag [J]
    FRICTION_LOSS,  # part of GROUND_LOSS by friction along the ground [J]
    RETURNED,  # energy that ground and barriers, which yield elastically, gave back to the flow [J]
    CORRECTED_TOTAL,  # corrections of the volumes of points
    CORRECTION_ENERGY,  # elastic energy [J] that they supplied until the last comparison with the density
    CLOCK,
) = range(49)
# int64 counts; then the window of blocks
ROWS, ALIVE, STEP, SINCE_REORDER, BAD, WINDOW_FIRST = range(6)
COUNTS = WINDOW_FIRST + WINDOW


@jit
def largest_time_step(fastest, shear, settings):
    """Time step [s] C min(dx / (c_p + v), 0.2 / |C|, sqrt(dx / g), rho dx^2 / (6 eta))."""
    return settings.cfl * min(
        min(settings.dx / (settings.signal_speed + fastest), 0.2 / max(shear, 1e-300)),
        min(sqrt(settings.dx / max(settings.gravity, 1e-300)), settings.viscous_limit),
    )


@jit
def set_next_step(clock, counts, time, until, after, settings):
    """Choose the time step after `time` so that `until`, and then `after`, are reached exactly."""
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
    elif limit > 0.5 * left:  # two equal steps instead of one whole and one tiny
        clock[STEP_NOW] = 0.5 * left
    else:
        clock[STEP_NOW] = limit


@jit
def book_points_left(points, blocks, active, dt, dx, shape, left_cells):
    """Add the points that left in this step of `dt` [s] to `block_order` at their new places (see `book_left`)."""
    rows = points.rows
    for a in range(active):
        east, north = (blocks[a, 0] * BLOCK - GHOSTS) * dx, (blocks[a, 1] * BLOCK - GHOSTS) * dx
        for q in range(points.start[a], points.start[a + 1]):
            p = points.order[q]
            if points.keys[p] == GONE:
                mass = float(rows[p, MASS])
                x = east + rows[p, X] * dx + dt * rows[p, PX] / mass
                y = north + rows[p, Y] * dx + dt * rows[p, PY] / mass
                book_left(left_cells, shape, x, y, dx, mass)


@jit
def collect(report, ledger, clock, counts, window):
    """Reduce the rows of the `report`, in order, into clock, counts, ledger and window; returns lifted mass [kg]."""
    clock[SPEED_NOW] = clock[SHEAR] = 0.0
    clock[POINT_STEPS] += counts[ALIVE]
    no_window(window)
    lifted = 0.0
    for c in range(report.shape[0]):
        part = report[c]
        clock[SPEED_NOW] = max(clock[SPEED_NOW], sqrt(part[entry.SPEED2_MAX]))
        clock[SHEAR] = max(clock[SHEAR], sqrt(part[entry.SHEAR_MAX]))
        clock[TIP_TOTAL] += part[entry.AT_TIP]
        clock[FAR_TOTAL] += part[entry.FAR]
        clock[PLASTIC_LOSS] += part[entry.PLASTIC]
        clock[LIMITED_TOTAL] += part[entry.LIMITED]
        clock[LIMIT_LOSS] += part[entry.LIMITED_ENERGY]
        lifted += part[entry.UNDER]
        clock[LIFTED_TOTAL] += part[entry.UNDER_POINTS]
        clock[STRETCH_TOTAL] += part[entry.HELD_STRETCH]
        clock[WALL_TOTAL] += part[entry.HELD_WALL]
        clock[LIFTED_ENERGY] += part[entry.UNDER_ENERGY]
        clock[IMPULSE_GROUND_X] += part[entry.UNDER_X]
        clock[IMPULSE_GROUND_Y] += part[entry.UNDER_Y]
        clock[IMPULSE_GROUND_Z] += part[entry.UNDER_Z]
        if part[entry.NOT_FINITE] > 0.0:
            counts[BAD] += int(part[entry.NOT_FINITE])
            clock[BAD_AT_X], clock[BAD_AT_Y] = part[entry.BAD_X], part[entry.BAD_Y]
        window[WEST] = min(window[WEST], int(part[entry.BLOCK_WEST]))
        window[SOUTH] = min(window[SOUTH], int(part[entry.BLOCK_SOUTH]))
        window[EAST] = max(window[EAST], int(part[entry.BLOCK_EAST]))
        window[NORTH] = max(window[NORTH], int(part[entry.BLOCK_NORTH]))
        window[TALL] = max(window[TALL], int(part[entry.BLOCK_TALL]))
        for edge in range(entry.EDGES):
            clock[MASS_NOW] -= part[entry.OUT + edge * entry.OUT_ENTRIES]
            for k in range(entry.OUT_ENTRIES):
                ledger[edge, k] += part[entry.OUT + edge * entry.OUT_ENTRIES + k]
            counts[ALIVE] -= int(part[entry.OUT + edge * entry.OUT_ENTRIES + 6])
    clock[LIFTED_MASS] += lifted
    clock[SPEED_WORST] = max(clock[SPEED_WORST], clock[SPEED_NOW])
    return lifted


@jit
def note_fastest(report, clock, points, dx, lowest):
    """Record place and time of a new largest speed; the point is searched in the chunk that reports it."""
    most, chunk = clock[SPEED_WORST] ** 2, -1
    for c in range(CHUNKS):
        if report[c, entry.SPEED2_MAX] > most:
            most, chunk = report[c, entry.SPEED2_MAX], c
    if chunk < 0:
        return
    rows, keys, start, bounds = points.rows, points.keys, points.start, points.bounds
    fastest2, fastest = -1.0, -1
    for k in range(start[bounds[chunk]], start[bounds[chunk + 1]]):
        p = points.order[k]
        if keys[p] == GONE:
            continue
        momentum2 = float(rows[p, PX]) ** 2 + float(rows[p, PY]) ** 2 + float(rows[p, PZ]) ** 2
        if momentum2 > fastest2 * float(rows[p, MASS]) ** 2:
            fastest2, fastest = momentum2 / float(rows[p, MASS]) ** 2, p
    if fastest >= 0:
        place = places_of(rows[fastest : fastest + 1], keys[fastest : fastest + 1], dx, lowest)
        clock[FASTEST_X], clock[FASTEST_Y], clock[FASTEST_Z] = place[0, 0], place[0, 1], place[0, 2]
        clock[FASTEST_TIME] = clock[TIME]


@jit
def collect_nodes(node_report, clock):
    """Reduce the reports of the node loop: largest speed, impulses of ground and walls, energy losses."""
    fastest2 = 0.0
    for c in range(node_report.shape[0]):
        part = node_report[c]
        fastest2 = max(fastest2, part[FASTEST2])
        clock[IMPULSE_GROUND_X] += part[GROUND_X]
        clock[IMPULSE_GROUND_Y] += part[GROUND_Y]
        clock[IMPULSE_GROUND_Z] += part[GROUND_Z]
        clock[IMPULSE_WALL_X] += part[WALL_X]
        clock[IMPULSE_WALL_Y] += part[WALL_Y]
        clock[GROUND_LOSS] += part[GROUND_WORK]
        clock[FRICTION_LOSS] += part[FRICTION_WORK]
        clock[BARRIER_LOSS] += part[BARRIER_WORK]
        clock[LAYER_LOSS] += part[LAYER_WORK]
        clock[RETURNED] += part[RETURNED_WORK]
        clock[CORRECTED_TOTAL] += part[CORRECTED]
        clock[CORRECTION_ENERGY] += part[CORRECTED_ENERGY]
    clock[FASTEST] = sqrt(fastest2)
