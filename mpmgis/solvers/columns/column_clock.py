"""Clock and counts of the time loop over columns: entries, update from the reports of a step, stop rule."""

import numpy as np

from ...compiled.block_order import CHUNKS, GONE
from ...compiled.jit import jit
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
from .column_rows import BLOCK, GX, GY, NODE_MASS, U, V, X, Y, first_node

# reasons for which `advance` returns
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
# float64 clock: state of the time integration, also stored for a restart
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
    STIFF_WORST,  # largest share of the columns whose apparent viscosity was limited
    TOTAL_MASS,  # all that ever was in the scene: released and taken up from the bed [kg]
    ENTRAINED_TOTAL,  # [kg]
    BOUND_BED,  # highest bed of any release [m]
    BOUND_ENERGY,  # 4 g h_max and the square of the initial speed [m2 s-2]
    FRICTION_TOTAL,  # energy lost to friction on the bed [J]; next, to mass entrained from the bed
    MERGING_TOTAL,
    BARRIER_TOTAL,  # to barriers
    LIMITED_TOTAL,  # to the bound of the speed
    WORK_TOTAL,  # work of weight and pressure [J]
    BENT_TOTAL,  # potential energy that came of changes of the bed's slope [J]
    ENTRAINED_POTENTIAL_TOTAL,  # potential energy of entrained mass, relative to elevation 0 [J]
    DEEPEST_X,  # where and when DEPTH_WORST was [m, m, s]
    DEEPEST_Y,
    DEEPEST_TIME,
    FASTEST,  # largest |U| over the run [m s-1], where and when it was
    FASTEST_X,
    FASTEST_Y,
    FASTEST_TIME,
    COLUMN_STEPS,  # number of columns, summed over the steps; then those that each clip acted on
    STRETCH_TOTAL,
    THIN_AREA_TOTAL,
    SPEED_TOTAL,
    WALL_TOTAL,
    STIFF_TOTAL,
    THIN_TOTAL,  # limits at nodes, as the number of columns with that share of the mass
    GREEDY_TOTAL,
    AIRBORNE_TOTAL,
    CLOCK,
) = range(54)
# int64 counts
ROWS, ALIVE, STEP, SINCE_REORDER, WET, WEST, SOUTH, EAST, NORTH, BAD, COUNTS = range(11)


@jit
def collect(report, node_report, ledger, clock, counts):
    """Reduce the reports, of all chunks or of fewer parts of the work, in their order into clock, counts and ledger."""
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
    clock[FLOWING_SHARE] = flowing / total_mass
    clock[MOVING_PEAK] = max(clock[MOVING_PEAK], clock[MOVING_SHARE])
    return alive_before - counts[ALIVE], triggered > 0.0


@jit
def note_deepest(node_report, clock, nodes, touched, dx):
    """Record place and time of a new largest thickness at a node; it is searched in the chunk that reports it."""
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
def note_fastest(report, clock, rows, keys, sorted_columns, metric):
    """Record a new largest speed, its place and time; the column is searched in the chunk that reports it."""
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
        mx, my = metric.metric_gradient(rows[p, GX], rows[p, GY])
        w = rows[p, U] * mx + rows[p, V] * my
        speed2 = rows[p, U] ** 2 + rows[p, V] ** 2 + w * w
        if speed2 > fastest2:
            fastest2 = speed2
            clock[FASTEST_X], clock[FASTEST_Y] = rows[p, X], rows[p, Y]
    clock[FASTEST], clock[FASTEST_TIME] = np.sqrt(most), clock[TIME]


@jit
def stop_rule(clock, counts):
    """Whether the flow has come to rest. Returns the reason or RUNNING."""
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
