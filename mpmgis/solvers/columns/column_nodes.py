"""Grid update between the two transfers: walls, momentum to velocity, friction, erosion, running peaks."""

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the functions of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from ...laws.curvature import LOAD, centrifugal_acceleration, effective_gravity
from ...laws.entrainment import NO_EROSION, Entrainment, erosion_rate
from ...laws.friction import at_node, slowed_speed, stress_parts
from ...laws.ground_metric import cosine_squared, metric_gradient
from .column_barriers import share_within
from .column_blocks import BLOCK, TouchedBlocks, first_node
from .column_forest import added_resistance, share_of_resistance
from .column_records import NodeFields, Settings
from .column_rows import NODE_GAIN, NODE_KINETIC, NODE_MASS, NODE_X, NODE_Y
from .spline_bed import bed_at, bending_at

# report of each chunk of the node loop
(
    WET_NEW,  # number of nodes that the flow reached
    AIRBORNE_MASS,  # [kg] mass without effective weight
    DEEPEST,  # [m] largest thickness
    TRIGGERED,  # number of nodes at which the flow released an area
    FRICTION_LOSS,  # [J] energy lost to friction on the bed
    MERGING_LOSS,  # [J] to the entrained mass, which is at rest
    LOWERING_LOSS,  # [J] potential energy that the flow loses where the bed is lowered
    THIN_MASS,  # [kg] mass that is thinner than friction takes it for
    GREEDY_MASS,  # [kg] mass that would have taken up more than MOST_GAIN in one step
    FOREST_LOSS,  # [J] energy lost to trees
    NODE_REPORT,
) = range(11)
# a node's mark is the sum of
REACHED = 1  # once the flow has been there
ARMED = 2  # times the number, from 1, of the area that the flow releases when it arrives
CHORDS = 5  # evaluations of a viscous law, each at the speed after the last one: Bingham within 0.2 %
MOST_GAIN = 1.0  # [1] mass that a node takes up in one step, over its own: a column at most doubles


class NodeArrays(NamedTuple):
    """Arrays that `update_nodes` changes, in addition to fields."""

    nodes: np.ndarray  # float64[ny + 3, nx + 3, 4]; NODE_MASS, NODE_X, NODE_Y, NODE_KINETIC, later NODE_GAIN
    wet: np.ndarray  # uint8[ny + 3, nx + 3]; marks REACHED and ARMED
    lowered: np.ndarray  # float64[touched blocks, BLOCK * BLOCK] [kg m-2]; mass eroded in this step, for `regrade`
    report: np.ndarray  # float64[CHUNKS, NODE_REPORT]
    peaks: np.ndarray  # float64[ny + 3, nx + 3, entries]; the largest thickness so far, and other entries


class NodeLaws(NamedTuple):
    """Laws that change the velocity of a node; those of the same names in `ColumnEffects`."""

    friction: Any
    zones: bool
    cohesion: float
    metric: int
    curvature: int
    entrainment: Entrainment
    forest: bool


@jit
def clear_ghosts(nodes: np.ndarray) -> None:
    """Zero the ghost ring, which untouched blocks leave as an earlier step had it.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    """
    nodes[0, :, :] = 0.0
    nodes[-1, :, :] = 0.0
    nodes[:, 0, :] = 0.0
    nodes[:, -1, :] = 0.0


@jit
def fold_walls(nodes: np.ndarray) -> None:
    """Mirror the ghost nodes inwards, for walls on all four edges.

    Mass and tangential momentum are added, normal momentum is subtracted; on the wall itself the mirror image doubles
    mass and tangential momentum and takes away the normal one.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    """
    for i in range(nodes.shape[1]):
        fold_column(nodes, i)
    for j in range(nodes.shape[0]):
        fold_row(nodes, j)


@jit_inline
def fold_column(nodes: np.ndarray, i: int) -> None:
    """Mirror the ghosts at the southern and northern wall inwards in column `i` of the nodes; `fold_row` comes later.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    i : int
    """
    ny = nodes.shape[0]
    for ghost, wall, inner in ((0, 1, 2), (ny - 1, ny - 2, ny - 3)):
        for e in range(4):
            nodes[wall, i, e] *= 2.0
            nodes[inner, i, e] += -nodes[ghost, i, e] if e == NODE_Y else nodes[ghost, i, e]
        nodes[wall, i, NODE_Y] = 0.0


@jit_inline
def fold_row(nodes: np.ndarray, j: int) -> None:
    """Mirror the ghosts at the western and eastern wall inwards in row `j` of the nodes.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    j : int
    """
    nx = nodes.shape[1]
    for ghost, wall, inner in ((0, 1, 2), (nx - 1, nx - 2, nx - 3)):
        for e in range(4):
            nodes[j, wall, e] *= 2.0
            nodes[j, inner, e] += -nodes[j, ghost, e] if e == NODE_X else nodes[j, ghost, e]
        nodes[j, wall, NODE_X] = 0.0


@jit
def mirror_walls(nodes: np.ndarray) -> None:
    """Give the ghosts the mirrored state of the inner nodes, so that columns at a wall see no flow through it.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    """
    for j in range(nodes.shape[0]):
        mirror_row(nodes, j)
    for i in range(nodes.shape[1]):
        mirror_column(nodes, i)


@jit_inline
def mirror_row(nodes: np.ndarray, j: int) -> None:
    """Set the ghosts beyond the western and eastern wall in row `j` of the nodes; `mirror_column` comes later.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    j : int
    """
    nx = nodes.shape[1]
    for ghost, wall, inner in ((0, 1, 2), (nx - 1, nx - 2, nx - 3)):
        nodes[j, wall, NODE_X] = 0.0
        nodes[j, ghost, NODE_MASS] = nodes[j, inner, NODE_MASS]
        nodes[j, ghost, NODE_GAIN] = nodes[j, inner, NODE_GAIN]
        nodes[j, ghost, NODE_X] = -nodes[j, inner, NODE_X]
        nodes[j, ghost, NODE_Y] = nodes[j, inner, NODE_Y]


@jit_inline
def mirror_column(nodes: np.ndarray, i: int) -> None:
    """Set the ghosts beyond the southern and northern wall in column `i` of the nodes.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    i : int
    """
    ny = nodes.shape[0]
    for ghost, wall, inner in ((0, 1, 2), (ny - 1, ny - 2, ny - 3)):
        nodes[wall, i, NODE_Y] = 0.0
        nodes[ghost, i, NODE_MASS] = nodes[inner, i, NODE_MASS]
        nodes[ghost, i, NODE_GAIN] = nodes[inner, i, NODE_GAIN]
        nodes[ghost, i, NODE_X] = nodes[inner, i, NODE_X]
        nodes[ghost, i, NODE_Y] = -nodes[inner, i, NODE_Y]


@jit_parallel
def update_nodes(
    arrays: NodeArrays,
    fields: NodeFields,
    touched: TouchedBlocks,
    dt: float,
    settings: Settings,
    friction: tuple,
    zones: bool,
    cohesion: float,
    metric: int,
    curvature: int,
    entrainment: Entrainment,
    forest: bool,
) -> None:
    """Turn momentum into velocity; basal friction and resistance of trees, semi-implicit in the metric of the ground.

    An impulse J of friction takes the energy J (U_before + U_after) / 2, with the speed of the columns before the
    step's forces and that of the node after the step: of second order in time, as the step is. Mass that is taken up
    at rest takes the rest, m gain U_before U_after / 2.

    Erosion books its share of a node's mass in NODE_GAIN, which the columns read with the velocity, so that together
    they gain what the bed loses. The mass taken up is at rest: velocities here are those of the mass before, whose
    momentum the columns share out over both. `regrade` lowers the bed after all nodes have read it for its bending.

    Parameters
    ----------
    arrays : NodeArrays
    fields : NodeFields
    touched : TouchedBlocks
    dt : float [s]
        Time for which forces act in this step.
    settings : Settings
    friction, zones, cohesion, metric, curvature, entrainment, forest
        Slots of these names (`ColumnEffects`).
    """
    # arrays come out of the record before the loop: numba drops what a loop writes to arrays that it takes from a tuple
    nodes, wet, lowered, report, peaks = arrays.nodes, arrays.wet, arrays.lowered, arrays.report, arrays.peaks
    rows, columns = nodes.shape[0], nodes.shape[1]
    for c in prange(CHUNKS):
        laws = NodeLaws(friction, zones, cohesion, metric, curvature, entrainment, forest)
        part = report[c]
        part[:] = 0.0
        for k in range(c * touched.count // CHUNKS, (c + 1) * touched.count // CHUNKS):
            j_first, i_first = first_node(touched, k)
            for j in range(j_first, min(j_first + BLOCK, rows)):
                for i in range(i_first, min(i_first + BLOCK, columns)):
                    eroded = update_node(nodes, fields, wet, j, i, part, dt, settings, laws)
                    note_thickness(peaks, nodes, j, i, settings)
                    if entrainment.lowering > 0.0:
                        lowered[k, (j - j_first) * BLOCK + i - i_first] = eroded


@jit_inline
def update_node(
    nodes: np.ndarray,
    fields: NodeFields,
    wet: np.ndarray,
    j: int,
    i: int,
    report: np.ndarray,
    dt: float,
    settings: Settings,
    laws: NodeLaws,
) -> float:
    """Turn the momentum of node [j, i] into velocity (see `update_nodes`); return the mass eroded there [kg m-2].

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    fields : NodeFields
    wet : uint8[ny + 3, nx + 3]
    j, i : int
    report : float64[NODE_REPORT]
    dt : float [s]
    settings : Settings
    laws : NodeLaws
    """
    entrainment, forest = laws.entrainment, laws.forest
    node_gradient, erodible = fields.gradient, fields.erodible
    dx, density, gravity = settings.dx, settings.density, settings.gravity
    thickness_floor, wet_thickness, wall = settings.thickness_floor, settings.wet_thickness, settings.wall
    rows, columns = nodes.shape[0], nodes.shape[1]
    per_area = 1.0 / (density * dx * dx)
    mass = nodes[j, i, NODE_MASS]
    if mass <= 0.0:
        return 0.0
    u, v = nodes[j, i, NODE_X] / mass, nodes[j, i, NODE_Y] / mass
    grid_thickness = mass * per_area
    report[DEEPEST] = max(report[DEEPEST], grid_thickness)
    if grid_thickness > wet_thickness and wet[j, i] != REACHED:
        _reach(wet, j, i, grid_thickness, fields.trigger_thickness, report)
    mx, my = metric_gradient(laws.metric, node_gradient[j, i, 0], node_gradient[j, i, 1])
    c2 = cosine_squared(mx, my)
    w = u * mx + v * my
    speed = sqrt(u * u + v * v + w * w)
    effective = gravity
    if laws.curvature & LOAD:
        bend_xx, bend_xy, bend_yy = bending_at(fields.bed, j, i, 1.0 / dx)
        effective = effective_gravity(gravity, centrifugal_acceleration(u, v, bend_xx, bend_xy, bend_yy))
    if effective == 0.0:
        report[AIRBORNE_MASS] += mass
    gain = eroded = 0.0
    if speed > 0.0:
        law = at_node(laws.friction, fields.zone_values, j, i) if laws.zones else laws.friction
        thickness = max(grid_thickness, thickness_floor)
        if grid_thickness < thickness_floor:
            report[THIN_MASS] += mass
        normal_thickness = thickness * sqrt(c2)
        normal_stress = density * thickness * effective * c2
        dry, viscous, drag = stress_parts(law, density, gravity, normal_stress, normal_thickness, speed)
        dry += laws.cohesion
        per_mass = 1.0 / (density * normal_thickness)
        own = mass * share_within(j, i, rows, columns, wall)
        before = sqrt(2.0 * nodes[j, i, NODE_KINETIC] / mass)
        decelerated, drawn = dry * per_mass, drag / normal_thickness
        trees_dry = trees_drag = 0.0
        if forest:
            trees_dry, trees_drag = added_resistance(fields.forest, fields.forest_state, j, i, effective * sqrt(c2))
            decelerated += trees_dry
            drawn += trees_drag
        slowed = slowed_speed(speed, dt, decelerated, viscous * per_mass, drawn)
        for _ in range(CHORDS - 1 if viscous > 0.0 else 0):
            if viscous > 0.0 and slowed > 0.0:
                _, viscous, _ = stress_parts(law, density, gravity, normal_stress, normal_thickness, slowed)
                slowed = slowed_speed(speed, dt, decelerated, viscous * per_mass, drawn)
        u, v = u * (slowed / speed), v * (slowed / speed)
        if entrainment.kind != NO_EROSION:
            basal_stress = dry + viscous * slowed + density * drag * slowed * slowed
            wanted = dt * erosion_rate(entrainment, density, basal_stress, slowed) / sqrt(c2)
            covered = min(grid_thickness / wet_thickness, 1.0) * fields.erodible_share[j, i]  # none at the margin
            most = MOST_GAIN * mass / (dx * dx)
            if min(covered * wanted, erodible[j, i]) > most:
                report[GREEDY_MASS] += mass
            eroded = min(covered * wanted, erodible[j, i], most)
            gain = eroded * dx * dx / mass
            erodible[j, i] -= eroded
            report[LOWERING_LOSS] += own * gravity * eroded * entrainment.lowering
        after = slowed / (1.0 + gain)
        loss = 0.5 * own * (speed - slowed) * (before + after)
        if forest:
            share = share_of_resistance(trees_dry, trees_drag, decelerated, viscous * per_mass, drawn, slowed)
            report[FOREST_LOSS] += share * loss
            loss -= share * loss
        report[FRICTION_LOSS] += loss
        report[MERGING_LOSS] += 0.5 * own * gain * before * after
    nodes[j, i, NODE_X], nodes[j, i, NODE_Y] = u, v
    if entrainment.kind != NO_EROSION:
        nodes[j, i, NODE_MASS] = mass * (1.0 + gain)
        nodes[j, i, NODE_GAIN] = gain
    return eroded


@jit
def _reach(wet, j, i, thickness, trigger_thickness, report):
    """Mark a node that the flow has reached, and fire it where it is armed and the flow is thick enough."""
    if wet[j, i] & REACHED == 0:
        report[WET_NEW] += 1.0
        wet[j, i] |= REACHED
    if wet[j, i] >= ARMED and thickness > trigger_thickness[wet[j, i] // ARMED - 1]:
        report[TRIGGERED] += 1.0
        wet[j, i] = REACHED


@jit_parallel
def regrade(
    bed: np.ndarray, node_gradient: np.ndarray, touched: TouchedBlocks, dx: float, lowered: np.ndarray, lowering: float
) -> None:
    """Lower the bed by what was eroded (see `update_nodes`), and recompute the gradients at the touched nodes.

    Parameters
    ----------
    bed : float64[ny + 3, nx + 3] [m]
    node_gradient : float64[ny + 3, nx + 3, 2] [1]
        Of the bed.
    touched : TouchedBlocks
    dx : float [m]
    lowered : float64[touched blocks, BLOCK * BLOCK] [kg m-2]
        Mass eroded.
    lowering : float [m3 kg-1]
        Of the `Entrainment`.
    """
    rows, columns = bed.shape[0], bed.shape[1]
    for k in prange(touched.count):
        j_first, i_first = first_node(touched, k)
        for j in range(j_first, min(j_first + BLOCK, rows)):
            for i in range(i_first, min(i_first + BLOCK, columns)):
                bed[j, i] -= lowered[k, (j - j_first) * BLOCK + i - i_first] * lowering
    for k in prange(touched.count):
        j_first, i_first = first_node(touched, k)
        for j in range(max(j_first, 1), min(j_first + BLOCK, rows - 1)):
            for i in range(max(i_first, 1), min(i_first + BLOCK, columns - 1)):
                _, node_gradient[j, i, 0], node_gradient[j, i, 1] = bed_at(bed, (i - 1) * dx, (j - 1) * dx, 1.0 / dx)


@jit_inline
def note_thickness(peaks: np.ndarray, nodes: np.ndarray, j: int, i: int, settings: Settings) -> None:
    """Update the largest thickness [m] at node [j, i].

    Parameters
    ----------
    peaks : float64[ny + 3, nx + 3, entries]
    nodes : float64[ny + 3, nx + 3, 4]
    j, i : int
    settings : Settings
    """
    peaks[j, i, 0] = max(peaks[j, i, 0], nodes[j, i, NODE_MASS] / (settings.density * settings.dx * settings.dx))


@jit_parallel
def accumulate_peaks(
    peaks: np.ndarray,
    nodes: np.ndarray,
    node_gradient: np.ndarray,
    touched: TouchedBlocks,
    time: float,
    settings: Settings,
    metric: int,
    entrainment: Entrainment,
) -> None:
    """Update the running peaks at the nodes: speed [m s-1], pressure rho U^2 [Pa], first arrival [s].

    They count where the flow is at least `settings.arrival_thickness` [m] deep, so that empty rims do
    not.

    Parameters
    ----------
    peaks : float64[ny + 3, nx + 3, PEAK_ENTRIES]
        An arrival of -1 means never.
    nodes : float64[ny + 3, nx + 3, 4]
    node_gradient : float64[ny + 3, nx + 3, 2] [1]
        Of the bed.
    touched : TouchedBlocks
    time : float [s]
        At the end of the step.
    settings : Settings
    metric, entrainment
        Slots of these names (`ColumnEffects`).
    """
    rows, columns = nodes.shape[0], nodes.shape[1]
    for k in prange(touched.count):
        j_first, i_first = first_node(touched, k)
        for j in range(j_first, min(j_first + BLOCK, rows)):
            for i in range(i_first, min(i_first + BLOCK, columns)):
                note_node(peaks, nodes, node_gradient, j, i, time, settings, metric, entrainment)


@jit_inline
def note_node(
    peaks: np.ndarray,
    nodes: np.ndarray,
    node_gradient: np.ndarray,
    j: int,
    i: int,
    time: float,
    settings: Settings,
    metric: int,
    entrainment: Entrainment,
) -> None:
    """Update the running peaks at node [j, i] (see `accumulate_peaks`).

    Parameters
    ----------
    peaks : float64[ny + 3, nx + 3, PEAK_ENTRIES]
    nodes : float64[ny + 3, nx + 3, 4]
    node_gradient : float64[ny + 3, nx + 3, 2] [1]
        Of the bed.
    j, i : int
    time : float [s]
    settings : Settings
    metric, entrainment
        Slots of these names (`ColumnEffects`).
    """
    density, dx = settings.density, settings.dx
    thickness = nodes[j, i, NODE_MASS] / (density * dx * dx)
    if thickness >= settings.arrival_thickness:
        u, v = nodes[j, i, NODE_X], nodes[j, i, NODE_Y]
        if entrainment.kind != NO_EROSION:
            u, v = u / (1.0 + nodes[j, i, NODE_GAIN]), v / (1.0 + nodes[j, i, NODE_GAIN])
        mx, my = metric_gradient(metric, node_gradient[j, i, 0], node_gradient[j, i, 1])
        w = u * mx + v * my
        speed2 = u * u + v * v + w * w
        peaks[j, i, 1] = max(peaks[j, i, 1], sqrt(speed2))
        peaks[j, i, 2] = max(peaks[j, i, 2], density * speed2)
        if peaks[j, i, 3] < 0.0:
            peaks[j, i, 3] = time
