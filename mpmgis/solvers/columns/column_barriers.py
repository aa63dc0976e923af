"""Walls on the grid: velocities at their nodes, and the impulse and mass of each wall.

The pass comes between the gathering of the tiles and the update of the nodes. It changes the momentum of the
nodes of walls and reads nodes outside walls, which it does not change, so that the order of nodes does not matter.
"""

from math import floor, sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the functions of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from ...laws.barrier import deflected, let_through, opening_discharge, weir_discharge
from ...laws.ground_metric import metric_gradient
from .column_blocks import BLOCK, BlockWindow, TouchedBlocks, first_node
from .column_records import NodeFields, Settings
from .column_rows import NODE_KINETIC, NODE_MASS, NODE_X, NODE_Y

# entries of a node in a wall
(
    WALL_X,  # [1] outward unit normal of its side, to the east
    WALL_Y,  # [1] to the north
    CREST,  # [m] elevation of the crest
    BARRIER,  # number of the barrier, from 1; 0: no wall here
    WALL_MU,  # [1] friction along the wall
    HOLD,  # how it holds the flow (`laws.barrier`)
    WEIGHT,  # [m-1] with which what passes here is counted: times the distance of nodes, the sum across a wall is 1
    SHARE,  # [1] of the node that is open (`wall_openings`)
    LIMIT,  # [1] how much passes the opening at most
    SIDE,  # [1] to which side of the node the opening lies
    BARRIER_ENTRIES,
) = range(11)
# sums of a barrier
(
    IMPULSE,  # [N s] normal to the wall
    IMPULSE_X,  # [N s] on the barrier, to the east
    IMPULSE_Y,  # [N s] to the north
    OVERTOPPED,  # [kg] mass that passed over the crest
    BARRIER_SUMS,
) = range(5)
BARRIER_LOSS = BARRIER_SUMS  # [J] in the report of a chunk only: kinetic energy lost to the barrier
PEAK_FORCE = BARRIER_SUMS  # [N] after the sums of a barrier: largest normal impulse of a step over its length
LOOK = 64  # [cells] distance within which a node in a wall searches the flow outside
LEAST = 1e-300  # [m2 s-1] keeps a divisor off 0


@jit_parallel
def hold_at_barriers(
    nodes: np.ndarray,
    fields: NodeFields,
    slot: np.ndarray,
    touched: TouchedBlocks,
    report: np.ndarray,
    dt: float,
    settings: Settings,
    metric: int,
) -> None:
    """Hold the flow at the nodes in walls (`fields.barriers`) and book it in `report`.

    The higher of the two surfaces at the wall determines the discharge over the crest. The normal impulse acts
    away from that side; the overtopping is the mean flux through the middle of the wall.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    fields : NodeFields
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    touched : TouchedBlocks
    report : float64[CHUNKS, barriers, BARRIER_LOSS + 1]
        Sums of this step.
    dt : float [s]
        Time for which forces act in this step.
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).
    """
    rows, columns = nodes.shape[0], nodes.shape[1]
    window = BlockWindow(touched.west, touched.south, touched.width, touched.height)
    walls = fields.barriers
    for c in prange(CHUNKS):
        report[c, :, :] = 0.0
        for k in range(c * touched.count // CHUNKS, (c + 1) * touched.count // CHUNKS):
            j_first, i_first = first_node(touched, k)
            for j in range(j_first, min(j_first + BLOCK, rows)):
                for i in range(i_first, min(i_first + BLOCK, columns)):
                    mass, number = nodes[j, i, NODE_MASS], int(walls[j, i, BARRIER])
                    if mass <= 0.0 or number <= 0:
                        continue
                    hold_node(nodes, fields, slot, window, j, i, report[c, number - 1], dt, settings, metric)


@jit_inline
def hold_node(
    nodes: np.ndarray,
    fields: NodeFields,
    slot: np.ndarray,
    window: BlockWindow,
    j: int,
    i: int,
    sums: np.ndarray,
    dt: float,
    settings: Settings,
    metric: int,
) -> None:
    """Hold the flow at node [j, i], which is in a wall and has mass (see `hold_at_barriers`).

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    fields : NodeFields
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    window : BlockWindow
        Of the blocks with columns in `slot`.
    j, i : int
    sums : float64[BARRIER_LOSS + 1]
        Of the barrier; what happens here is added.
    dt : float [s]
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).
    """
    bed, walls, dx = fields.bed, fields.barriers, settings.dx
    per_metre = settings.density * dx * dx  # mass of a node for each metre of thickness
    here, mass = walls[j, i], nodes[j, i, NODE_MASS]
    rows, columns = nodes.shape[0], nodes.shape[1]
    u, v = nodes[j, i, NODE_X] / mass, nodes[j, i, NODE_Y] / mass
    before, speed_before = _adjacent_flow(nodes, bed, walls, slot, window, j, i, 1.0, per_metre)
    beyond, speed_beyond = _adjacent_flow(nodes, bed, walls, slot, window, j, i, -1.0, per_metre)
    side = 1.0 if before >= beyond else -1.0  # with the higher flow
    head = max(before, beyond) - (here[CREST] - bed[j, i])
    speed = speed_before if before >= beyond else speed_beyond
    over = weir_discharge(settings.gravity, head, speed) * (1.0 - here[SHARE])
    if here[SHARE] > 0.0:
        passing = opening_discharge(settings.gravity, before, speed_before, beyond, speed_beyond)
        through = here[LIMIT] * passing
        u_held, v_held = let_through(
            u, v, here[WALL_X], here[WALL_Y], here[SIDE], here[WALL_MU], (over + through) * per_metre / mass
        )
        over /= max(over + through, LEAST)
    else:
        u_held, v_held = deflected(u, v, here[WALL_X], here[WALL_Y], here[HOLD], here[WALL_MU], over * per_metre / mass)
        over = 1.0
    nodes[j, i, NODE_X], nodes[j, i, NODE_Y] = mass * u_held, mass * v_held
    own = mass * share_within(j, i, rows, columns, settings.wall)
    slopes = metric_gradient(metric, fields.gradient[j, i, 0], fields.gradient[j, i, 1])
    sums[BARRIER_LOSS] += own * _loss_at_wall(nodes[j, i], u, v, u_held, v_held, slopes)
    sums[IMPULSE] += own * side * ((u_held - u) * here[WALL_X] + (v_held - v) * here[WALL_Y])
    sums[IMPULSE_X] += own * (u - u_held)
    sums[IMPULSE_Y] += own * (v - v_held)
    across = -side * (u_held * here[WALL_X] + v_held * here[WALL_Y])
    if head > 0.0 and across > 0.0:
        sums[OVERTOPPED] += own * across * dt * here[WEIGHT] * over


@jit_inline
def _adjacent_flow(nodes, bed, walls, slot, window, j, i, side, per_metre):
    """(thickness of the flow at the foot of the wall here [m], its speed towards the wall [m s-1]).

    `side` 1 looks along the outward normal, -1 through the wall to the other side. The flow is followed to the wall
    parallel to the bed, or, where it deepens towards the wall as a pool does, with its surface level at most.
    """
    step_x, step_y = side * walls[j, i, WALL_X], side * walls[j, i, WALL_Y]
    thickness, speed = 0.0, 0.0
    for k in range(1, LOOK):
        near_j, near_i = node_near(j + k * step_y), node_near(i + k * step_x)
        far_j, far_i = node_near(j + (k + 1) * step_y), node_near(i + (k + 1) * step_x)
        if min(near_j, near_i, far_j, far_i) < 0:
            break
        if max(near_j, far_j) >= nodes.shape[0] or max(near_i, far_i) >= nodes.shape[1]:
            break
        if walls[near_j, near_i, BARRIER] > 0.0:
            continue
        mass = _mass_now(nodes, slot, window, near_j, near_i)
        if mass > 0.0:
            thickness = mass / per_metre
            deeper = k * (thickness - _mass_now(nodes, slot, window, far_j, far_i) / per_metre)
            thickness += max(min(deeper, bed[near_j, near_i] - bed[j, i]), 0.0)
            speed = -(nodes[near_j, near_i, NODE_X] * step_x + nodes[near_j, near_i, NODE_Y] * step_y) / mass
        break
    return thickness, max(speed, 0.0)


@jit_inline
def node_near(place: float) -> int:
    """Return the index of the node nearest to a place along an axis.

    Parameters
    ----------
    place : float [cells]
        In the array of nodes.
    """
    return int(floor(place + 0.5))  # noqa: RUF046  (floor answers a float where it is compiled for a device)


@jit_inline
def _mass_now(nodes: np.ndarray, slot: np.ndarray, window: BlockWindow, j: int, i: int):
    """Mass of a node [kg]; 0 in blocks that no column touches, whose nodes are as an earlier step left them."""
    return nodes[j, i, NODE_MASS] if is_touched(slot, window, j, i) else 0.0


@jit_inline
def is_touched(slot: np.ndarray, window: BlockWindow, j: int, i: int) -> bool:
    """Return whether node [j, i] is in a block that columns touch.

    Parameters
    ----------
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    window : BlockWindow
    j, i : int
    """
    bi, bj = i // BLOCK - window.west, j // BLOCK - window.south
    touched = False
    for back_j in range(2):
        for back_i in range(2):
            oi, oj = bi - back_i, bj - back_j
            if 0 <= oi < window.width and 0 <= oj < window.height and slot[oj * window.width + oi] >= 0:
                touched = True
    return touched


@jit_inline
def _loss_at_wall(node, u, v, u_held, v_held, slopes):
    """Energy that a wall takes from a kilogram of a node, (U - U_held) (U_before + U_held) / 2 [J kg-1].

    U_before has the direction of U and the speed of the columns before the step's forces. The node's kinetic energy
    becomes that of what is held, for the loss to friction that follows.
    """
    w, w_held = u * slopes[0] + v * slopes[1], u_held * slopes[0] + v_held * slopes[1]
    speed2 = u * u + v * v + w * w
    if speed2 == 0.0:
        return 0.0
    held2 = u_held * u_held + v_held * v_held + w_held * w_held
    along = u * u_held + v * v_held + w * w_held
    share = sqrt(2.0 * node[NODE_KINETIC] / (node[NODE_MASS] * speed2))
    node[NODE_KINETIC] *= held2 / speed2
    return 0.5 * (share * (speed2 - along) + along - held2)


@jit_inline
def share_within(j: int, i: int, rows: int, columns: int, wall: bool) -> float:
    """Return the share [1] of a node's mass that is no mirror image: walls around the domain double the mass on them.

    Parameters
    ----------
    j, i : int
    rows, columns : int
        Size of the array of nodes.
    wall : bool
        The edges are walls.
    """
    share = 1.0
    if wall:
        for index, size in ((j, rows), (i, columns)):
            if index == 0 or index == size - 1:
                share = 0.0
            elif index == 1 or index == size - 2:
                share *= 0.5
    return share


@jit
def collect_barriers(barrier_report: np.ndarray, sums: np.ndarray, dt: float) -> float:
    """Add the reports of the chunks to the sums of all barriers, in their order.

    Parameters
    ----------
    barrier_report : float64[CHUNKS, barriers, BARRIER_LOSS + 1]
    sums : float64[barriers, BARRIER_SUMS + 1]
    dt : float [s]
        Time for which forces acted.

    Returns
    -------
    float [J]
        Energy lost to the barriers.
    """
    lost = 0.0
    for k in range(sums.shape[0]):
        lost = collect_barrier(barrier_report, sums, k, dt, lost)
    return lost


@jit_inline
def collect_barrier(barrier_report: np.ndarray, sums: np.ndarray, k: int, dt: float, lost: float) -> float:
    """Add the reports of the chunks to the sums of barrier `k` (see `collect_barriers`).

    Parameters
    ----------
    barrier_report : float64[CHUNKS, barriers, BARRIER_LOSS + 1]
    sums : float64[barriers, BARRIER_SUMS + 1]
    k : int
    dt : float [s]
    lost : float [J]
        Energy lost to the barriers before this one.

    Returns
    -------
    float [J]
        Energy lost with that of this one.
    """
    before = sums[k, IMPULSE]
    for c in range(barrier_report.shape[0]):
        for entry in range(BARRIER_SUMS):
            sums[k, entry] += barrier_report[c, k, entry]
        lost += barrier_report[c, k, BARRIER_LOSS]
    sums[k, PEAK_FORCE] = max(sums[k, PEAK_FORCE], (sums[k, IMPULSE] - before) / dt)
    return lost
