"""Clock and counts of the time loop over points: entries, time step, update from the reports of a step."""

from math import sqrt

import numpy as np

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
from .point_rows import BLOCK, GHOSTS, MASS, PX, PY, PZ, Settings, SortedPoints, X, Y

# reasons for which `advance` returns
(
    RUNNING,  # the largest number of steps was taken
    REACHED_TIME,  # the requested time is reached
    ALL_LEFT,  # no point is on the terrain any more
    NOT_FINITE_STATE,  # a point is not finite
    LEAKED,  # too much mass was below the ground in one step
    SCATTERED,  # the points are too far apart for the window of blocks
) = range(6)
# float64 clock: state of the time integration, also stored for a restart
(
    TIME,  # [s] simulated time
    STEP_NOW,  # [s] length of the next step, for which the impulses of the points are computed
    HITS,  # 1 if that step ends exactly at the requested time
    LAST_DT,  # [s] last time step not shortened to reach a requested time
    FASTEST,  # [m s-1] largest speed at a node
    SHEAR,  # [s-1] largest |C| of a point
    SPEED_NOW,  # [m s-1] largest speed of a point
    SPEED_WORST,  # [m s-1] largest speed of a point so far
    TIP_TOTAL,  # point-steps at the tip of the yield surface
    FAR_TOTAL,  # point-steps whose strain exceeded the range of the series
    LIFTED_MASS,  # [kg] mass moved back onto the ground, counted each time
    TOTAL_MASS,  # [kg] mass of all points at their start
    MASS_NOW,  # [kg] mass on the terrain
    BAD_AT_X,  # [m] place of a point that is not finite, from the domain's corner
    BAD_AT_Y,  # [m]
    IMPULSE_GROUND_X,  # [N s] impulse of the ground on the flow, east
    IMPULSE_GROUND_Y,  # [N s] north
    IMPULSE_GROUND_Z,  # [N s] up
    IMPULSE_WALL_X,  # [N s] impulse of the walls on the edges on the flow, east
    IMPULSE_WALL_Y,  # [N s] north
    IMPULSE_GRAVITY,  # [N s] impulse of gravity, downwards
    GROUND_LOSS,  # [J] work against friction and drag of the ground
    BARRIER_LOSS,  # [J] work against barriers
    PLASTIC_LOSS,  # [J] plastic work
    LIFTED_ENERGY,  # [J] potential energy added by moving mass back onto the ground
    FASTEST_X,  # [m] place of SPEED_WORST, from the domain's corner
    FASTEST_Y,  # [m]
    FASTEST_Z,  # [m]
    FASTEST_TIME,  # [s] time of SPEED_WORST
    HIGHEST,  # [m] largest height of a point at the start
    START_SPEED,  # [m s-1] largest speed of a point at the start
    DEEPEST,  # [m] largest thickness of the flow at the times it was evaluated
    DEEPEST_X,  # [m] its place, from the domain's corner
    DEEPEST_Y,  # [m]
    DEEPEST_TIME,  # [s] its time
    POINT_STEPS,  # number of points, summed over the steps
    LIFTED_TOTAL,  # point-steps moved back onto the ground
    STRETCH_TOTAL,  # point-steps whose stretch was limited
    WALL_TOTAL,  # point-steps stopped at a wall on the edge
    LIMITED_TOTAL,  # point-steps whose affine velocity was limited
    LIMIT_LOSS,  # [J] kinetic energy removed by the limit of affine velocities
    SPEED_P999,  # [m s-1] largest 99.9th percentile of the speed, by mass
    SPEED_P999_TIME,  # [s] its time
    LAYER_LOSS,  # [J] energy lost between layers of a flow with drag
    FRICTION_LOSS,  # [J] part of GROUND_LOSS by friction along the ground
    RETURNED,  # [J] energy that ground and barriers, which yield elastically, gave back to the flow
    CORRECTED_TOTAL,  # number of corrections of the volumes of points
    CORRECTION_ENERGY,  # [J] elastic energy that they supplied until the last comparison with the density
    CLOCK,  # number of entries
) = range(49)
# int64 counts, before the entries of the window of blocks
(
    ROWS,  # number of rows with points, those that have left included
    ALIVE,  # number of points on the terrain
    STEP,  # number of steps taken
    SINCE_REORDER,  # steps since the rows were put in order
    BAD,  # number of points that are not finite
    WINDOW_FIRST,  # first entry of the window
) = range(6)
COUNTS = WINDOW_FIRST + WINDOW  # number of entries


@jit
def largest_time_step(fastest: float, shear: float, settings: Settings) -> float:
    """Compute the time step [s]: C min(dx / (c_p + v), 0.2 / |C|, sqrt(dx / g), rho dx^2 / (6 eta)).

    Parameters
    ----------
    fastest : float [m s-1]
        Largest speed v at a node.
    shear : float [s-1]
        Largest velocity gradient |C| of a point.
    settings : Settings
    """
    return settings.cfl * min(
        min(settings.dx / (settings.signal_speed + fastest), 0.2 / max(shear, 1e-300)),
        min(sqrt(settings.dx / max(settings.gravity, 1e-300)), settings.viscous_limit),
    )


@jit
def set_next_step(
    clock: np.ndarray, counts: np.ndarray, time: float, until: float, after: float, settings: Settings
) -> None:
    """Choose the time step after `time` so that `until`, and then `after`, are reached exactly.

    Parameters
    ----------
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    time, until, after : float [s]
    settings : Settings
    """
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
def book_points_left(
    points: SortedPoints,
    blocks: np.ndarray,
    active: int,
    dt: float,
    dx: float,
    shape: tuple[int, int],
    left_cells: np.ndarray,
) -> None:
    """Add the points that left in this step at their new places to the outflow (see `block_order.book_left`).

    Parameters
    ----------
    points : SortedPoints
    blocks : int32[active, 3]
        Places of the active blocks.
    active : int
        Number of active blocks.
    dt : float [s]
    dx : float [m]
    shape : (int, int)
        Rows and columns of the cells.
    left_cells : float64[WAYS, block rows, block columns, LEFT_ENTRIES]
        Outflow by blocks of cells.
    """
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
def collect(report: np.ndarray, ledger: np.ndarray, clock: np.ndarray, counts: np.ndarray, window: np.ndarray) -> float:
    """Add the reports of all chunks, in order, to clock, counts, ledger and window.

    Parameters
    ----------
    report : float64[CHUNKS, REPORT]
    ledger : float64[EDGES, OUT_ENTRIES]
        Outflow over each edge.
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    window : int64[WINDOW]

    Returns
    -------
    float [kg]
        Mass moved back onto the ground.
    """
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
def note_fastest(report: np.ndarray, clock: np.ndarray, points: SortedPoints, dx: float, lowest: np.ndarray) -> None:
    """Record place and time of a new largest speed; the point is searched in the chunk that reports it.

    Parameters
    ----------
    report : float64[CHUNKS, REPORT]
    clock : float64[CLOCK]
    points : SortedPoints
    dx : float [m]
    lowest : int32[block rows, block columns, 2]
        The result of `point_blocks.lowest_blocks`.
    """
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
def collect_nodes(node_report: np.ndarray, clock: np.ndarray) -> None:
    """Add the reports of the node loop to the clock: largest speed, impulses of ground and walls, energy losses.

    Parameters
    ----------
    node_report : float64[CHUNKS, NODE_REPORT]
    clock : float64[CLOCK]
    """
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
