"""Rigid barriers in the 3D solver: they stop flow that moves into them, and their loads are summed."""

from math import floor, sqrt

from ...compiled import law_methods as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from .point_ground import GROUND_HEIGHT
from .point_rows import BLOCK, NODE_MASS, NODE_X, NODE_Y

# of a node column with a barrier: outward unit normal of its nearest side, elevation above the domain's lowest level up
# to which each node holds the flow [m], depth behind that side [m], friction [1], weight with which what passes
# above is counted [m-1], place of the barrier's foot from here [m], 1 + number of the barrier (0: none); then of
# openings (`wall_openings`) the share that is open, how much passes at most, to which side it lies; height of the
# edge from there to the crest (`point_crests`) [m] (0: none); last of smooth faces (`point_faces`) 1 + the number of
# the face that this node column belongs to (0: none), the elevation up to which rows are held there [m], and 1 + the
# number of a face of another side that it belongs to in a corner (0: none); where the material uses the density at the
# nodes, the part of the node's spline in the plane that barriers fill and the elevation of their crest [m]
(
    WALL_X,
    WALL_Y,
    HELD,
    DEPTH,
    WALL_MU,
    WEIGHT,
    ARM_X,
    ARM_Y,
    FOOT,
    BARRIER,
    SHARE,
    LIMIT,
    SIDE,
    EDGE,
    ROWED,
    ROW_TOP,
    ROWED_TOO,
    FILLED,
    FILLED_TOP,
    POINT_BARRIER_ENTRIES,
) = range(20)
# flow in a node column, which determines the discharge of an opening: mass [kg], momentum east and north [kg m s-1]
FLOW_MASS, FLOW_X, FLOW_Y, COLUMN_FLOW = range(4)
BLOCK_FLOW = BLOCK * BLOCK * COLUMN_FLOW  # numbers of a block
LOOK = 64  # [cells] how far an opening looks for the flow before it
# sums of each barrier: impulses [N s], moments [N m s], mass above its crest [kg]; the last of a run is the largest
# normal force of a single step [N]
(NORMAL, IMPULSE_X, IMPULSE_Y, IMPULSE_Z, MOMENT_X, MOMENT_Y, MOMENT_Z, OVER, POINT_BARRIER_SUMS) = range(9)


@jit_inline
def column_flow(block, column):
    """(mass [kg], momentum east and north [kg m s-1]) of node `column` (0 to 15) of a block."""
    mass = east = north = 0.0
    for k in range(BLOCK):
        n = (k * BLOCK * BLOCK + column) * 4
        mass += block[n + NODE_MASS]
        east += block[n + NODE_X]
        north += block[n + NODE_Y]
    return mass, east, north


@jit_parallel
def weigh_flow(nodes, touched, n_touched, flows):
    """Mass and momentum in each block's node columns, into `flows` float[blocks, BLOCK_FLOW]."""
    for c in prange(CHUNKS):
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            for column in range(BLOCK * BLOCK):
                n = column * COLUMN_FLOW
                flows[t, n + FLOW_MASS], flows[t, n + FLOW_X], flows[t, n + FLOW_Y] = column_flow(nodes[t], column)


@jit
def passing_share(flow, ground, barriers, j, i, per_metre, gravity, barrier):
    """Share [1] of the momentum through the opening that the node column (j, i) keeps, so that no more passes than can.

    `flow` float[rows, columns, COLUMN_FLOW] is that of all node columns, `per_metre` [kg m-1] the mass of one for each
    metre of thickness. The column loses as much at all heights: what passes is a discharge.
    """
    here = barriers[j, i]
    mass = flow[j, i, FLOW_MASS]
    passing = abs(flow[j, i, FLOW_X] * here[WALL_X] + flow[j, i, FLOW_Y] * here[WALL_Y])
    if passing == 0.0 or mass <= 0.0:
        return 1.0
    depth, speed = _flow_before(flow, ground, barriers, j, i, 1.0, per_metre)
    depth_beyond, speed_beyond = _flow_before(flow, ground, barriers, j, i, -1.0, per_metre)
    most = here[LIMIT] * barrier.opening_discharge(gravity, depth, speed, depth_beyond, speed_beyond)
    return min(most * per_metre / passing, 1.0)


@jit_inline
def _along(index, steps, step):
    """Index of the node that is `steps` times `step` [cells] from the node `index`."""
    return int(floor(float(index) + float(steps) * step + 0.5))  # noqa: RUF046  (floor gives a float on CUDA devices)


@jit_inline
def _flow_before(flow, ground, barriers, j, i, side, per_metre):
    """(thickness that the flow beside an opening would have here [m], its speed towards the opening [m s-1]).

    As for columns (`column_barriers`): parallel to the ground, or level where it deepens towards the opening.
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
def passing_over(u, v, mass, dt, place):
    """Part [kg] of the mass that passes over a barrier in `dt` [s], by a node of velocity (u, v) [m s-1] and `mass`."""
    return mass * dt * place[WEIGHT] * abs(u * place[WALL_X] + v * place[WALL_Y])


@jit_inline
def at_barrier(u, v, w, mass, z, dt, place, passing, booked, barrier):
    """Velocity (u, v, w) [m s-1] of a node of `mass` [kg] at height `z` [m] after its contact with a barrier.

    `place` are the entries of the barrier at the node column. The loads over `dt` [s] are added to `booked`
    float64[barriers, POINT_BARRIER_SUMS]. The nearest side of the barrier acts, or its top if that is nearer. Flow
    that moves into the barrier loses that speed, and mu times as much of the speed along it; flow that moves away is
    free. A node that is partly open keeps the share `passing` of its speed through the opening. Nodes around smooth
    faces are those of `point_faces`, those at the edge of the crest those of `point_crests`. Flow at the edge, above
    the crest and along the top counts as passing over the barrier.
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
        u1, v1 = barrier.let_through(u, v, nx, ny, place[SIDE], place[WALL_MU], passing * abs(across))
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
    kept = barrier.kept_along(place[WALL_MU], slip, -into) if slip > 0.0 else 0.0
    u1, v1, w1 = kept * u1, kept * v1, kept * w1
    jx, jy, jz = mass * (u - u1), mass * (v - v1), mass * (w - w1)
    book_impulse(book, jx, jy, jz, -mass * into, place, ARM_X, z)
    return u1, v1, w1


@jit_inline
def book_impulse(book, jx, jy, jz, normal, place, arm, z):
    """Add an impulse (jx, jy, jz) [N s] at height `z` [m] to `book`, `normal` of it into the face.

    Its place from the barrier's foot, east and north, and the elevation of the foot [m] are the entries of `place` from
    `arm` on. They are read where they are needed: a kernel on a device has few registers.
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
def collect_point_barrier(b, report, sums, dt):
    """`collect_point_barriers` for barrier `b`."""
    normal = 0.0
    for c in range(CHUNKS):
        normal += report[c, b, NORMAL]
        for entry in range(POINT_BARRIER_SUMS):
            sums[b, entry] += report[c, b, entry]
    sums[b, POINT_BARRIER_SUMS] = max(sums[b, POINT_BARRIER_SUMS], normal / dt)


@jit
def collect_point_barriers(report, sums, dt):
    """Add a step's bookings of all chunks, in their order, to the run's, and keep the largest force."""
    for b in range(sums.shape[0]):
        collect_point_barrier(b, report, sums, dt)
