"""Rigid barriers in the 3D solver: they stop flow that moves into them, and their loads are summed."""

from math import floor, sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from ...laws.barrier import let_through, opening_discharge
from ...laws.contact_friction import dry_slip
from .point_ground import GROUND_HEIGHT
from .point_rows import BLOCK, NODE_MASS, NODE_X, NODE_Y

# float64 entries of a node column with a barrier; elevations are above the domain's lowest level
(
    WALL_X,  # [1] outward unit normal of the nearest side, east
    WALL_Y,  # [1] north
    HELD,  # [m] elevation up to which each node holds the flow
    DEPTH,  # [m] depth of the column behind that side
    WALL_MU,  # [1] friction along the barrier
    WEIGHT,  # [m-1] weight with which flow that passes above is counted
    ARM_X,  # [m] place of the column from the barrier's foot, east
    ARM_Y,  # [m] north
    FOOT,  # [m] elevation of the barrier's foot
    BARRIER,  # 1 + number of the barrier; 0: none
    SHARE,  # [1] open share of the column in an opening (`wall_openings`); 0: closed
    LIMIT,  # [1] largest discharge through the opening, over the critical discharge of a metre of it
    SIDE,  # -1, 0 or 1: direction of the opening along (normal north, -normal east)
    EDGE,  # [m] height of the edge from HELD to the crest (`point_crests`); 0: none
    ROWED,  # 1 + number of the smooth face (`point_faces`) that the column belongs to; 0: none
    ROW_TOP,  # [m] elevation up to which the rows of that face hold the flow
    ROWED_TOO,  # 1 + number of a face of another side that it also belongs to, in a corner; 0: none
    FILLED,  # [1] part of the node's spline in the plane that barriers fill, for materials that follow the density
    FILLED_TOP,  # [m] elevation of the crest of these barriers
    POINT_BARRIER_ENTRIES,  # number of entries
) = range(20)
# float64 entries of the flow in a node column, which determines the discharge of an opening
(
    FLOW_MASS,  # [kg]
    FLOW_X,  # [kg m s-1] momentum east
    FLOW_Y,  # [kg m s-1] momentum north
    COLUMN_FLOW,  # number of entries
) = range(4)
BLOCK_FLOW = BLOCK * BLOCK * COLUMN_FLOW  # numbers of a block
LOOK = 64  # [cells] largest distance at which the flow before an opening is searched
# float64 sums of the loads on each barrier; a run has one more, the largest normal force of a single step [N]
(
    NORMAL,  # [N s] impulse into the faces
    IMPULSE_X,  # [N s] impulse east
    IMPULSE_Y,  # [N s] north
    IMPULSE_Z,  # [N s] up
    MOMENT_X,  # [N m s] moment of the impulse about the barrier's foot, around the axis east
    MOMENT_Y,  # [N m s] north
    MOMENT_Z,  # [N m s] up
    OVER,  # [kg] mass that passed above the crest
    POINT_BARRIER_SUMS,  # number of sums
) = range(9)


@jit_inline
def column_flow(block: np.ndarray, column: int) -> tuple[float, float, float]:
    """Sum mass and momentum of a node column within a block.

    Parameters
    ----------
    block : float[BLOCK_SIZE]
        Nodes of the block.
    column : int
        0 to 15: the node column in the block.

    Returns
    -------
    (float [kg], float [kg m s-1], float [kg m s-1])
        Mass; momentum east and north.
    """
    mass = east = north = 0.0
    for k in range(BLOCK):
        n = (k * BLOCK * BLOCK + column) * 4
        mass += block[n + NODE_MASS]
        east += block[n + NODE_X]
        north += block[n + NODE_Y]
    return mass, east, north


@jit_parallel
def weigh_flow(nodes: np.ndarray, touched: np.ndarray, n_touched: int, flows: np.ndarray) -> None:
    """Sum mass and momentum in each block's node columns.

    Parameters
    ----------
    nodes : float[blocks, BLOCK_SIZE]
    touched : int32[blocks, 3]
    n_touched : int
        Number of touched blocks.
    flows : float64[blocks, BLOCK_FLOW]
        Set by this function.
    """
    for c in prange(CHUNKS):
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            for column in range(BLOCK * BLOCK):
                n = column * COLUMN_FLOW
                flows[t, n + FLOW_MASS], flows[t, n + FLOW_X], flows[t, n + FLOW_Y] = column_flow(nodes[t], column)


@jit
def passing_share(
    flow: np.ndarray, ground: np.ndarray, barriers: np.ndarray, j: int, i: int, per_metre: float, gravity: float
) -> float:
    """Compute the share of the momentum through an opening that a node column keeps [1].

    It limits the discharge to the largest that can pass. The column loses as much at all heights, because a discharge
    is limited.

    Parameters
    ----------
    flow : float64[rows, columns, COLUMN_FLOW]
        In all node columns.
    ground : float64[rows, columns, GROUND_ENTRIES]
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    j, i : int
        Row and column of the node column.
    per_metre : float [kg m-1]
        Mass of a node column for each metre of thickness.
    gravity : float [m s-2]
    """
    here = barriers[j, i]
    mass = flow[j, i, FLOW_MASS]
    passing = abs(flow[j, i, FLOW_X] * here[WALL_X] + flow[j, i, FLOW_Y] * here[WALL_Y])
    if passing == 0.0 or mass <= 0.0:
        return 1.0
    depth, speed = _flow_before(flow, ground, barriers, j, i, 1.0, per_metre)
    depth_beyond, speed_beyond = _flow_before(flow, ground, barriers, j, i, -1.0, per_metre)
    most = here[LIMIT] * opening_discharge(gravity, depth, speed, depth_beyond, speed_beyond)
    return min(most * per_metre / passing, 1.0)


@jit_inline
def _along(index, steps, step):
    """Return the index of the node that is `steps` times `step` [cells] from the node `index`."""
    return int(floor(float(index) + float(steps) * step + 0.5))  # noqa: RUF046  (floor gives a float on CUDA devices)


@jit_inline
def _flow_before(flow, ground, barriers, j, i, side, per_metre):
    """Find the flow beside an opening and return its thickness here [m] and its speed towards the opening [m s-1].

    The thickness is that of columns (`column_barriers`): parallel to the ground, or level where it deepens towards the
    opening.
    """
    step_x, step_y = side * barriers[j, i, WALL_X], side * barriers[j, i, WALL_Y]
    thickness, speed = 0.0, 0.0
    for k in range(1, LOOK):
        near_j, near_i = _along(j, k, step_y), _along(i, k, step_x)
        far_j, far_i = _along(j, k + 1, step_y), _along(i, k + 1, step_x)
        if min(near_j, near_i, far_j, far_i) < 0:
            break
        if max(near_j, far_j) >= flow.shape[0] or max(near_i, far_i) >= flow.shape[1]:
            break
        if barriers[near_j, near_i, BARRIER] > 0.0:
            continue
        mass = flow[near_j, near_i, FLOW_MASS]
        if mass > 0.0:
            thickness = mass / per_metre
            deeper = float(k) * (thickness - flow[far_j, far_i, FLOW_MASS] / per_metre)
            lower = ground[near_j, near_i, GROUND_HEIGHT] - ground[j, i, GROUND_HEIGHT]
            thickness += max(min(deeper, lower), 0.0)
            speed = -(flow[near_j, near_i, FLOW_X] * step_x + flow[near_j, near_i, FLOW_Y] * step_y) / mass
        break
    return thickness, max(speed, 0.0)


@jit_inline
def passing_over(u: float, v: float, mass: float, dt: float, place: np.ndarray) -> float:
    """Compute the part of a node's mass that passes over a barrier [kg].

    Parameters
    ----------
    u, v : float [m s-1]
        Velocity of the node.
    mass : float [kg]
    dt : float [s]
    place : float64[POINT_BARRIER_ENTRIES]
        The barrier at the node column.
    """
    return mass * dt * place[WEIGHT] * abs(u * place[WALL_X] + v * place[WALL_Y])


@jit_inline
def at_barrier(
    u: float,
    v: float,
    w: float,
    mass: float,
    z: float,
    dt: float,
    place: np.ndarray,
    passing: float,
    booked: np.ndarray,
) -> tuple[float, float, float]:
    """Compute the velocity of a node after its contact with a barrier, and book the loads.

    The nearest side of the barrier acts, or its top if that is nearer. Flow that moves into the barrier loses that
    speed, and mu times as much of the speed along it; flow that moves away is free. A node that is partly open keeps
    the share `passing` of its speed through the opening. Nodes around smooth faces are those of `point_faces`, those at
    the edge of the crest those of `point_crests`. Flow at the edge, above the crest and along the top counts as passing
    over the barrier.

    Parameters
    ----------
    u, v, w : float [m s-1]
        Velocity of the node.
    mass : float [kg]
    z : float [m]
        Height of the node.
    dt : float [s]
    place : float64[POINT_BARRIER_ENTRIES]
        The barrier at the node column.
    passing : float [1]
        The result of `passing_share`.
    booked : float64[barriers, POINT_BARRIER_SUMS]
        The loads over `dt` are added to it.

    Returns
    -------
    (float, float, float) [m s-1]
    """
    if place[ROWED] > 0.0 and z <= place[ROW_TOP]:
        return u, v, w
    book = booked[int(place[BARRIER]) - 1]
    beneath = place[HELD] - z
    if beneath < 0.0:
        book[OVER] += passing_over(u, v, mass, dt, place)
        return u, v, w
    if place[SHARE] > 0.0:
        nx, ny = place[WALL_X], place[WALL_Y]
        across, along = u * nx + v * ny, u * ny - v * nx
        u1, v1 = let_through(u, v, nx, ny, place[SIDE], place[WALL_MU], passing * abs(across))
        pressed = abs(across - (u1 * nx + v1 * ny)) + abs(along - (u1 * ny - v1 * nx))
        jx, jy = mass * (u - u1), mass * (v - v1)
        book_impulse(book, jx, jy, 0.0, mass * pressed, place, ARM_X, z)
        return u1, v1, w
    sideways = place[DEPTH] <= beneath
    if not sideways:
        book[OVER] += passing_over(u, v, mass, dt, place)
    nx, ny, nz = (place[WALL_X], place[WALL_Y], 0.0) if sideways else (0.0, 0.0, 1.0)
    into = u * nx + v * ny + w * nz
    if into >= 0.0:
        return u, v, w
    u1, v1, w1 = u - into * nx, v - into * ny, w - into * nz
    slip = sqrt(u1 * u1 + v1 * v1 + w1 * w1)
    kept = dry_slip(place[WALL_MU], slip, -into) if slip > 0.0 else 0.0
    u1, v1, w1 = kept * u1, kept * v1, kept * w1
    jx, jy, jz = mass * (u - u1), mass * (v - v1), mass * (w - w1)
    book_impulse(book, jx, jy, jz, -mass * into, place, ARM_X, z)
    return u1, v1, w1


@jit_inline
def book_impulse(
    book: np.ndarray, jx: float, jy: float, jz: float, normal: float, place: np.ndarray, arm: int, z: float
) -> None:
    """Add an impulse on a barrier to its loads.

    The place of the node from the barrier's foot and the elevation of the foot are read where they are needed: a kernel
    on a device has few registers.

    Parameters
    ----------
    book : float64[POINT_BARRIER_SUMS]
        Loads of the barrier.
    jx, jy, jz : float [N s]
        The impulse.
    normal : float [N s]
        Its part into the face.
    place : float64[...]
        Entries of the node column.
    arm : int
        Index in `place` of the place from the barrier's foot, east and north, and of the elevation of the foot [m].
    z : float [m]
        Height of the node.
    """
    book[NORMAL] += normal
    book[IMPULSE_X] += jx
    book[IMPULSE_Y] += jy
    book[IMPULSE_Z] += jz
    book[MOMENT_Z] += place[arm] * jy - place[arm + 1] * jx
    up = z - place[arm + 2]
    book[MOMENT_X] += place[arm + 1] * jz - up * jy
    book[MOMENT_Y] += up * jx - place[arm] * jz


@jit
def collect_point_barrier(b: int, report: np.ndarray, sums: np.ndarray, dt: float) -> None:
    """Add a step's bookings of all chunks for one barrier, in their order, to the run's, and keep the largest force.

    Parameters
    ----------
    b : int
        Index of the barrier.
    report : float64[CHUNKS, barriers, POINT_BARRIER_SUMS]
        Bookings of the step.
    sums : float64[barriers, POINT_BARRIER_SUMS + 1]
        Loads of the run.
    dt : float [s]
    """
    normal = 0.0
    for c in range(CHUNKS):
        normal += report[c, b, NORMAL]
        for entry in range(POINT_BARRIER_SUMS):
            sums[b, entry] += report[c, b, entry]
    sums[b, POINT_BARRIER_SUMS] = max(sums[b, POINT_BARRIER_SUMS], normal / dt)


@jit
def collect_point_barriers(report: np.ndarray, sums: np.ndarray, dt: float) -> None:
    """Add a step's bookings of all chunks for all barriers, in their order, to the run's, and keep the largest forces.

    Parameters
    ----------
    report : float64[CHUNKS, barriers, POINT_BARRIER_SUMS]
        Bookings of the step.
    sums : float64[barriers, POINT_BARRIER_SUMS + 1]
        Loads of the run.
    dt : float [s]
    """
    for b in range(sums.shape[0]):
        collect_point_barrier(b, report, sums, dt)
