"""Crests of rigid barriers in 3D: the edge between side and top, and the top at its exact height.

Nodes of the side that hold a flow slow it up to more than two cells above them. A side held up to its crest would let
too little pass: 0.3 of the discharge of water that stands four cells above the crest. The uppermost nodes of a side
therefore let flow in, but no faster than the flow above them passes over the crest (`slow_at_edge`). The height of the
edge is chosen for the discharge that was measured at weirs (`barrier_faces.edge_height`). Water at rest does not pass,
because nothing moves above it.

The top acts as smooth ground does, by one multiplier for each node column (`rest_on_top`).
"""

from math import floor, sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from ...laws.contact_friction import dry_slip
from .contact_shares import foot_of, share_at
from .ground_contact import (
    LEAST_SHARE,
    NO_MASS,
    at_foot,
    dot,
    is_column_of_block,
    is_sunk_below_block,
    mass_near,
    node_of,
    push_node,
)
from .point_barriers import ARM_X, BARRIER, DEPTH, EDGE, HELD, WALL_MU, WALL_X, WALL_Y, book_impulse
from .point_nodes import BARRIER_WORK
from .point_records import NodeColumn, NodeReports
from .point_rows import BLOCK, GHOSTS, NODE_X, NODE_Y, NODE_Z, BlockWindow, NodeBlocks, Settings

SIDE_DEPTH = 1.5  # [cells] behind a side, up to which points before it have mass at nodes
TOP_DEPTH = 0.5  # [cells] behind a side, from which the top acts
SUNK = 0.75  # [cells] below the crest, up to which the top holds flow near a side
TAIL = 0.2  # of a full node's mass, up to which a node near a side has it from flow before the side
EDGE_LEVELS = 4  # levels from the one nearest to the crest down to the lowest one of an edge


@jit_inline
def into_side(outwards: float, above: float, share: float) -> float:
    """Return the speed [m s-1] into the side that a node at the edge keeps.

    At most the `share` [1] of that is kept which the node one level higher has: all of it from one cell above the
    nodes that hold the side, and less below.

    Parameters
    ----------
    outwards : float [m s-1]
        Speed of the node away from the side.
    above : float [m s-1]
        Speed of the node one level higher into the side.
    share : float [1]
    """
    return min(max(-outwards, 0.0), share * above)


@jit_borrowing
def slow_at_edge(
    stack: NodeColumn, level: int, place: np.ndarray, mine: np.ndarray, booked: np.ndarray, dx: float
) -> None:
    """Slow the nodes of a column at the edge of a barrier, from the crest downwards (`into_side`).

    Flow above that is lighter than the node lets it pass in proportion, because splash does not carry along what is
    below it. Friction acts along the side.

    Parameters
    ----------
    stack : NodeColumn
    level : int
        Level of the node nearest to the crest.
    place : float[POINT_BARRIER_ENTRIES]
        The barrier at the column.
    mine : float[NODE_REPORT]
        Report of the chunk.
    booked : float[barriers, POINT_BARRIER_SUMS]
        Loads on the barriers of the chunk.
    dx : float [m]
    """
    nodes = stack.nodes
    nx, ny = place[WALL_X], place[WALL_Y]
    crest, passing, heavier = place[HELD] + place[EDGE], 0.0, 0.0
    for lower in range(-1, EDGE_LEVELS):
        slot, n, mass = node_of(stack, level - lower)
        if mass <= 0.0:
            continue
        z = float(level - lower - GHOSTS) * dx
        u, v, w = float(nodes[slot, n + NODE_X]), float(nodes[slot, n + NODE_Y]), float(nodes[slot, n + NODE_Z])
        outwards = u * nx + v * ny
        if z > crest:
            passing = max(-outwards, 0.0)
        elif z > place[HELD]:
            share = min((z - place[HELD]) / dx, 1.0) * min(heavier / mass, 1.0)
            passing = into_side(outwards, passing, share)
            stopped = -outwards - passing
            if stopped > 0.0:
                tx, ty = u - outwards * nx, v - outwards * ny
                slip = sqrt(tx * tx + ty * ty + w * w)
                kept = dry_slip(place[WALL_MU], slip, stopped) if slip > 0.0 else 0.0
                tx, ty, w1 = kept * tx, kept * ty, kept * w
                u1, v1 = tx - passing * nx, ty - passing * ny
                nodes[slot, n + NODE_X], nodes[slot, n + NODE_Y], nodes[slot, n + NODE_Z] = u1, v1, w1
                jx, jy, jz = mass * (u - u1), mass * (v - v1), mass * (w - w1)
                book_impulse(booked[int(place[BARRIER]) - 1], jx, jy, jz, mass * stopped, place, ARM_X, z)
                mine[BARRIER_WORK] += jx * tx + jy * ty + jz * w1
        heavier = max(heavier, mass)


@jit_borrowing
def rest_on_top(
    stack: NodeColumn,
    level: int,
    foot: float,
    place: np.ndarray,
    mine: np.ndarray,
    booked: np.ndarray,
    settings: Settings,
) -> None:
    """Apply the contact of a node column with the top of a barrier, as with smooth ground.

    Flow whose centre near the crest is lower is held there. Near a side, mass that is centred more than SUNK below the
    crest or less than TAIL of a full node belongs to points before the side. The top does not act on it.

    Parameters
    ----------
    stack : NodeColumn
    level : int
        Level of the node nearest to the crest.
    foot : float [cells]
        Place of the crest above that node, -0.5 to 0.5.
    place : float[POINT_BARRIER_ENTRIES]
        The barrier at the column.
    mine : float[NODE_REPORT]
        Report of the chunk.
    booked : float[barriers, POINT_BARRIER_SUMS]
        Loads on the barriers of the chunk.
    settings : Settings
    """
    dx = settings.dx
    heaviest, centre = mass_near(stack, level)
    if heaviest <= NO_MASS:
        return
    if place[DEPTH] < SIDE_DEPTH * dx and (centre < foot - SUNK or heaviest < TAIL * settings.density * dx * dx * dx):
        return
    if centre < foot:
        lower = int(floor(centre + 0.5))  # noqa: RUF046  (floor gives a float on CUDA devices)
        level, foot = level + lower, centre - float(lower)
    u, v, w, give, here, shares = at_foot(stack, level, foot, 0.0, heaviest)
    if here < LEAST_SHARE * heaviest or give <= 0.0 or w >= 0.0:
        return
    slip = sqrt(u * u + v * v)
    kept = dry_slip(place[WALL_MU], slip, -w) if slip > 0.0 else 0.0
    push, friction = (0.0, 0.0, -w / give), ((kept - 1.0) * u / give, (kept - 1.0) * v / give, 0.0)
    z = (float(level - GHOSTS) + foot) * dx
    for offset in range(-2, 3):
        slot, n, mass = node_of(stack, level + offset)
        if mass <= 0.0:
            continue
        share = share_at(offset, shares)
        taken, _, velocity = push_node(stack.nodes, slot, n, mass, heaviest, share, share, push, friction)
        book_impulse(booked[int(place[BARRIER]) - 1], -taken[0], -taken[1], -taken[2], taken[2], place, ARM_X, z)
        mine[BARRIER_WORK] -= dot(taken, velocity)


@jit_inline
def press_at_crest(
    t: int,
    column: int,
    grid: NodeBlocks,
    window: BlockWindow,
    barriers: np.ndarray,
    mine: np.ndarray,
    booked: np.ndarray,
    settings: Settings,
) -> None:
    """Apply `press_on_crests` to one node column of a touched block.

    Parameters
    ----------
    t : int
        Number of the block.
    column : int
        Node column in the block, 0 to 15.
    grid : NodeBlocks
    window : BlockWindow
    barriers : float[rows, columns, POINT_BARRIER_ENTRIES]
    mine : float[NODE_REPORT]
        Report of the chunk.
    booked : float[barriers, POINT_BARRIER_SUMS]
        Loads on the barriers of the chunk.
    settings : Settings
    """
    touched, slots, dx = grid.touched, window.slots, settings.dx
    row, block_column, block_level = touched[t, 0], touched[t, 1], touched[t, 2]
    jj = min(row * BLOCK + column // BLOCK, barriers.shape[0] - 1)
    ii = min(block_column * BLOCK + column % BLOCK, barriers.shape[1] - 1)
    place = barriers[jj, ii]
    if place[BARRIER] <= 0.0 or place[EDGE] <= 0.0:
        return
    first = block_level * BLOCK
    level, foot = foot_of(place[HELD] + place[EDGE], dx)
    at = ((row - window.south) * window.width + block_column - window.west) * window.depth
    up = block_level - window.lowest[row, block_column, 0]
    below = slots[at + up - 1] if up > 0 else -1
    above = slots[at + up + 1] if up + 1 < window.depth else -1
    if not is_column_of_block(level, first, below) and not is_sunk_below_block(level, first, above):
        return
    stack = NodeColumn(grid.nodes, below, t, above, first, column)
    if place[DEPTH] >= TOP_DEPTH * dx:
        rest_on_top(stack, level, foot, place, mine, booked, settings)
    if place[DEPTH] < SIDE_DEPTH * dx:
        slow_at_edge(stack, level, place, mine, booked, dx)


@jit_parallel
def press_on_crests(
    grid: NodeBlocks,
    window: BlockWindow,
    free: np.ndarray,
    barriers: np.ndarray,
    reports: NodeReports,
    settings: Settings,
) -> None:
    """Apply the contact with the crests of barriers to velocities at the nodes of all touched blocks.

    Each column of nodes is processed in the block of the node that is nearest to the crest. Nodes below the edge follow
    (`point_barriers.at_barrier`).

    Parameters
    ----------
    grid : NodeBlocks
    window : BlockWindow
    free : uint8[touched]
        1 for blocks whose nodes touch nothing: they are left out.
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    reports : NodeReports
        Work and loads on barriers are added to them.
    settings : Settings
    """
    n_touched = grid.count
    for c in prange(CHUNKS):
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            if free[t] == 1:
                continue
            for column in range(BLOCK * BLOCK):
                press_at_crest(t, column, grid, window, barriers, reports.nodes[c], reports.barriers[c], settings)
