"""Clock and counts of the time loop over columns: entries, update from the reports of a step, stop rule."""

import numpy as np

from ...compiled.block_order import CHUNKS, GONE
from ...compiled.jit import jit
from ...frames import flow_end
from ...laws.ground_metric import metric_gradient
from .column_blocks import BLOCK, SortedColumns, TouchedBlocks, first_node
from .column_nodes import (
    AIRBORNE_MASS,
    DEEPEST,
    FRICTION_LOSS,
    GREEDY_MASS,
    LOWERING_LOSS,
    MERGING_LOSS,
    THIN_MASS,
    TRIGGERED,
    WET_NEW,
)
from .column_report import (
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
    SIGNAL_MAX,
    SPEED_MAX,
    STIFF,
    WILD,
    WORK,
)
from .column_rows import GX, GY, NODE_MASS, U, V, X, Y

# reasons for which `advance` returns
(
    RUNNING,  # the largest number of steps is done
    REACHED_TIME,
    STOPPED_MOVING,  # almost no mass moves any more
    STOPPED_ENERGY,  # the kinetic energy has been low for STILL_TIME, and little mass flows
    STOPPED_FOOTPRINT,  # the reached area grows no more, and little mass flows
    ALL_LEFT,  # there are no columns
    NOT_FINITE_STATE,  # the state of a column is not finite
    TOO_FAST,  # much of the mass has over twice the speed that energy allows
    TRIGGER_REACHED,  # the flow releases an area
) = range(9)
# float64 clock: state of the time integration, also stored for a restart
(
    TIME,  # [s]
    LAST_DT,  # last time step not cut by a frame time [s]
    KICK_BEFORE,  # [s] of the last step for which velocities have not been driven yet
    SIGNAL,  # max |u| + sqrt(g h) [m s-1]
    SPEED,  # max |u| [m s-1]
    KINETIC_NOW,  # [J] kinetic energy
    KINETIC_PEAK,  # [J] largest so far
    KINETIC_LOW_SINCE,  # [s], -1 while the energy is not low
    MOVING_SHARE,  # [1] share of the mass that is faster than MOVING_SPEED
    MOVING_PEAK,  # [1] largest so far
    FLOWING_SHARE,  # [1] share of the mass on the terrain that is faster than FLOWING_SPEED
    FOOTPRINT_MARK_TIME,  # [s] of the last look at the reached area
    FOOTPRINT_MARK,  # number of reached nodes then
    BOUND_WORST,  # [1] max of |U|^2 over its physical bound, over the run
    BOUND_NOW,  # [1] the same now
    BOUND_NOW_X,  # [m] where that is
    BOUND_NOW_Y,  # [m]
    LIMITED_NOW,  # [1] share of the mass whose speed was limited
    LIMITED_WORST,  # [1] largest so far
    WILD_NOW,  # [1] share of the mass at more than twice the bound of the speed
    DEPTH_NOW,  # [m] largest thickness at a node
    DEPTH_WORST,  # [m] over the run
    AIRBORNE_NOW,  # [1] share of the mass without effective weight
    AIRBORNE_WORST,  # [1] largest so far
    CLAMPED_TOTAL,  # number of areas that the thickness clamp reset
    STIFF_WORST,  # [1] largest share of the columns whose apparent viscosity was limited
    TOTAL_MASS,  # all that ever was in the scene: released and taken up from the bed [kg]
    ENTRAINED_TOTAL,  # [kg]
    BOUND_BED,  # highest bed of any release [m]
    BOUND_ENERGY,  # 4 g h_max and the square of the initial speed [m2 s-2]
    FRICTION_TOTAL,  # energy lost to friction on the bed [J]
    MERGING_TOTAL,  # to mass entrained from the bed [J]
    BARRIER_TOTAL,  # to barriers [J]
    LIMITED_TOTAL,  # to the bound of the speed [J]
    WORK_TOTAL,  # work of weight and pressure [J]
    BENT_TOTAL,  # potential energy that came of changes of the bed's slope [J]
    ENTRAINED_POTENTIAL_TOTAL,  # potential energy of entrained mass, relative to elevation 0 [J]
    DEEPEST_X,  # where DEPTH_WORST was [m]
    DEEPEST_Y,
    DEEPEST_TIME,  # and when [s]
    FASTEST,  # largest |U| over the run [m s-1]
    FASTEST_X,  # where that was [m]
    FASTEST_Y,
    FASTEST_TIME,  # and when [s]
    COLUMN_STEPS,  # number of columns, summed over the steps; next, those on which each limit acted
    STRETCH_TOTAL,  # growth of areas
    THIN_AREA_TOTAL,  # least thickness
    SPEED_TOTAL,  # bound of the speed
    WALL_TOTAL,  # walls at the edges
    STIFF_TOTAL,  # apparent viscosity
    THIN_TOTAL,  # next, limits at nodes, as the number of columns with that share of the mass: thickness for friction
    GREEDY_TOTAL,  # erosion of a step
    AIRBORNE_TOTAL,  # no effective weight
    CLOCK,
) = range(54)
# int64 counts
(
    ROWS,  # columns in memory
    ALIVE,  # columns that have not left
    STEP,  # steps taken
    SINCE_REORDER,  # steps since rows were put in order
    WET,  # nodes that the flow has reached
    WEST,  # window of the blocks with columns: block column of the first ones
    SOUTH,  # block row of the first ones
    EAST,  # block column of the last ones
    NORTH,  # block row of the last ones
    BAD,  # columns that are not finite
    COUNTS,
) = range(11)
# a flow is at rest where one of three rules applies; by none of them with more than 5 % of its mass flowing
STILL_SHARE = 0.01  # [1] of the largest share of moving mass so far, or of the largest kinetic energy so far
STILL_TIME = 2.0  # [s] for which the kinetic energy has to be that low
FOOTPRINT_TIME = 10.0  # [s] between two looks at the reached area
FOOTPRINT_GROWTH = 0.001  # [1] growth of the reached area between two looks below which it has stopped
FOOTPRINT_KINETIC = 0.5  # [1] of the largest kinetic energy so far: above that the flow is not slowing yet
LITTLE_FLOWS = flow_end.FLOWING_SHARE  # [1]
TINY_MASS = 1e-300  # [kg] against a division by zero after all mass has left


@jit
def collect(
    report: np.ndarray, node_report: np.ndarray, ledger: np.ndarray, clock: np.ndarray, counts: np.ndarray
) -> tuple[int, bool]:
    """Add up the reports, of all chunks or of fewer parts of the work, in their order into clock, counts and ledger.

    Parameters
    ----------
    report : float64[parts, REPORT]
        Of columns.
    node_report : float64[parts, NODE_REPORT]
    ledger : float64[EDGES, OUT_ENTRIES]
    clock : float64[CLOCK]
    counts : int64[COUNTS]

    Returns
    -------
    (int, bool)
        Number of columns that left, and whether the flow has released an area.
    """
    clock[SIGNAL] = clock[SPEED] = clock[KINETIC_NOW] = clock[DEPTH_NOW] = clock[BOUND_NOW] = 0.0
    moving, flowing, airborne, limited, wild, alive_before = 0.0, 0.0, 0.0, 0.0, 0.0, counts[ALIVE]
    stiff, triggered, thin, greedy = 0.0, 0.0, 0.0, 0.0
    west, south, east, north = 1 << 16, 1 << 16, -1, -1
    for c in range(report.shape[0]):
        part = report[c]
        stiff += part[STIFF]
        clock[ENTRAINED_TOTAL] += part[ENTRAINED]
        clock[TOTAL_MASS] += part[ENTRAINED]
        clock[ENTRAINED_POTENTIAL_TOTAL] += part[ENTRAINED_POTENTIAL] - node_report[c, LOWERING_LOSS]
        clock[WORK_TOTAL] += part[WORK]
        clock[BENT_TOTAL] += part[BENT]
        clock[LIMITED_TOTAL] += part[LIMITED_LOSS]
        clock[FRICTION_TOTAL] += node_report[c, FRICTION_LOSS]
        clock[MERGING_TOTAL] += node_report[c, MERGING_LOSS]
        triggered += node_report[c, TRIGGERED]
        clock[SIGNAL] = max(clock[SIGNAL], part[SIGNAL_MAX])
        clock[SPEED] = max(clock[SPEED], part[SPEED_MAX])
        clock[KINETIC_NOW] += part[KINETIC]
        clock[CLAMPED_TOTAL] += part[CLAMPED]
        clock[STRETCH_TOTAL] += part[HELD_STRETCH]
        clock[THIN_AREA_TOTAL] += part[HELD_THIN]
        clock[SPEED_TOTAL] += part[HELD_SPEED]
        clock[WALL_TOTAL] += part[HELD_WALL]
        thin += node_report[c, THIN_MASS]
        greedy += node_report[c, GREEDY_MASS]
        moving += part[MOVING]
        flowing += part[FLOWING]
        limited += part[LIMITED]
        wild += part[WILD]
        if part[BOUND_RATIO] > clock[BOUND_NOW]:
            clock[BOUND_NOW], clock[BOUND_NOW_X], clock[BOUND_NOW_Y] = part[BOUND_RATIO], part[BOUND_X], part[BOUND_Y]
        if part[NOT_FINITE] > 0.0:
            counts[BAD] += int(part[NOT_FINITE])
            clock[BOUND_NOW_X], clock[BOUND_NOW_Y] = part[BOUND_X], part[BOUND_Y]
        west, east = min(west, int(part[BLOCK_WEST])), max(east, int(part[BLOCK_EAST]))
        south, north = min(south, int(part[BLOCK_SOUTH])), max(north, int(part[BLOCK_NORTH]))
        for edge in range(EDGES):
            for entry in range(OUT_ENTRIES):
                ledger[edge, entry] += part[OUT + edge * OUT_ENTRIES + entry]
            counts[ALIVE] -= int(part[OUT + edge * OUT_ENTRIES + 5])
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
    left = 0.0
    for edge in range(EDGES):
        left += ledger[edge, 0]
    clock[FLOWING_SHARE] = flowing / max(total_mass - left, flowing, TINY_MASS)
    clock[MOVING_PEAK] = max(clock[MOVING_PEAK], clock[MOVING_SHARE])
    return alive_before - counts[ALIVE], triggered > 0.0


@jit
def note_deepest(
    node_report: np.ndarray, clock: np.ndarray, nodes: np.ndarray, touched: TouchedBlocks, dx: float
) -> None:
    """Record place and time of a new largest thickness at a node; it is searched in the chunk that reports it.

    Parameters
    ----------
    node_report : float64[CHUNKS, NODE_REPORT]
    clock : float64[CLOCK]
    nodes : float64[ny + 3, nx + 3, 4]
    touched : TouchedBlocks
    dx : float [m]
    """
    most, chunk = clock[DEPTH_WORST], -1
    for c in range(CHUNKS):
        if node_report[c, DEEPEST] > most:
            most, chunk = node_report[c, DEEPEST], c
    if chunk < 0:
        return
    heaviest = 0.0
    for k in range(chunk * touched.count // CHUNKS, (chunk + 1) * touched.count // CHUNKS):
        j_first, i_first = first_node(touched, k)
        for j in range(j_first, min(j_first + BLOCK, nodes.shape[0])):
            for i in range(i_first, min(i_first + BLOCK, nodes.shape[1])):
                if nodes[j, i, NODE_MASS] > heaviest:
                    heaviest = nodes[j, i, NODE_MASS]
                    clock[DEEPEST_X], clock[DEEPEST_Y] = (i - 1) * dx, (j - 1) * dx
    clock[DEEPEST_TIME] = clock[TIME]


@jit
def note_fastest(
    report: np.ndarray,
    clock: np.ndarray,
    rows: np.ndarray,
    keys: np.ndarray,
    sorted_columns: SortedColumns,
    metric: int,
) -> None:
    """Record a new largest speed, its place and time; the column is searched in the chunk that reports it.

    Parameters
    ----------
    report : float64[CHUNKS, REPORT]
    clock : float64[CLOCK]
    rows : float64[columns, ROW]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    sorted_columns : SortedColumns
    metric : int
        Slot of this name (`ColumnEffects`).
    """
    most, chunk = clock[FASTEST] ** 2, -1
    for c in range(CHUNKS):
        if report[c, FASTEST2] > most:
            most, chunk = report[c, FASTEST2], c
    if chunk < 0:
        return
    fastest2 = -1.0
    start, bounds = sorted_columns.start, sorted_columns.bounds
    for k in range(start[bounds[chunk]], start[bounds[chunk + 1]]):
        p = sorted_columns.order[k]
        if keys[p] == GONE:
            continue
        mx, my = metric_gradient(metric, rows[p, GX], rows[p, GY])
        w = rows[p, U] * mx + rows[p, V] * my
        speed2 = rows[p, U] ** 2 + rows[p, V] ** 2 + w * w
        if speed2 > fastest2:
            fastest2 = speed2
            clock[FASTEST_X], clock[FASTEST_Y] = rows[p, X], rows[p, Y]
    clock[FASTEST], clock[FASTEST_TIME] = np.sqrt(most), clock[TIME]


@jit
def stop_rule(clock: np.ndarray, counts: np.ndarray) -> int:
    """Return why the flow has come to rest, or RUNNING.

    Parameters
    ----------
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    """
    time = clock[TIME]
    if clock[MOVING_PEAK] > 0.0 and clock[MOVING_SHARE] < STILL_SHARE * clock[MOVING_PEAK]:
        return STOPPED_MOVING
    if clock[KINETIC_PEAK] > 0.0 and clock[KINETIC_NOW] < STILL_SHARE * clock[KINETIC_PEAK]:
        if clock[KINETIC_LOW_SINCE] < 0.0:
            clock[KINETIC_LOW_SINCE] = time
        elif time - clock[KINETIC_LOW_SINCE] >= STILL_TIME and clock[FLOWING_SHARE] < LITTLE_FLOWS:
            return STOPPED_ENERGY
    else:
        clock[KINETIC_LOW_SINCE] = -1.0
    if time - clock[FOOTPRINT_MARK_TIME] >= FOOTPRINT_TIME:
        grown = counts[WET] - clock[FOOTPRINT_MARK]
        clock[FOOTPRINT_MARK_TIME], clock[FOOTPRINT_MARK] = time, float(counts[WET])
        slowing = clock[KINETIC_NOW] <= FOOTPRINT_KINETIC * clock[KINETIC_PEAK]
        if slowing and grown < FOOTPRINT_GROWTH * counts[WET] and clock[FLOWING_SHARE] < LITTLE_FLOWS:
            return STOPPED_FOOTPRINT
    return RUNNING
