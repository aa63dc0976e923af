"""The grid of the 3D MPM between the two transfers: momentum to velocity, gravity, ground, walls (design notes 4)."""

from math import sqrt

from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import CHUNKS
from .jit import jit_inline, jit_parallel, prange
from .lanes import load, multiply_add, store
from .point_barriers import BARRIER, at_barrier
from .point_rows import BLOCK, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z, TILE_LAYER, TILE_ROW

# what each chunk of the node loop reports: largest speed squared; what the ground and the walls took up [N s]
FASTEST2, GROUND_X, GROUND_Y, GROUND_Z, WALL_X, WALL_Y, GROUND_WORK, NODE_REPORT = range(8)
# of the ground at a node: height [m], slopes, and how low near it a point may be before it is looked at [m]
GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y, GROUND_DEEP, GROUND_ENTRIES = range(5)


@jit_inline
def _gather(block, sources, tiles):
    """Sum the up to eight tiles that overlap a node block, always in the same order."""
    block[:] = 0.0
    for o in range(8):
        a = sources[o]
        if a < 0:
            continue
        tile = tiles[a]
        oi, oj, ok = o & 1, (o >> 1) & 1, o >> 2
        for k in range(2 if ok else BLOCK):
            for j in range(2 if oj else BLOCK):
                t = (k + BLOCK * ok) * TILE_LAYER + (j + BLOCK * oj) * TILE_ROW + BLOCK * oi * 4
                n = (k * BLOCK + j) * BLOCK * 4
                for i in range(2 if oi else BLOCK):
                    store(block, n + 4 * i, multiply_add(1.0, load(tile, t + 4 * i), load(block, n + 4 * i)))


@jit_inline
def _on_ground(u, v, w, slope_x, slope_y, contact, zones, zone_values, j, i):
    """Velocity of a node under the ground's surface after its contact with it."""
    steep = sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    nx, ny, nz = -slope_x / steep, -slope_y / steep, 1.0 / steep
    into = u * nx + v * ny + w * nz
    law = zones.local(contact, zone_values, j, i)
    if into < 0.0 or law.sticks():
        u, v, w = u - into * nx, v - into * ny, w - into * nz
        slip = sqrt(u * u + v * v + w * w)
        if slip > 0.0:
            kept = law.kept_slip(slip, max(-into, 0.0))
            u, v, w = u * kept, v * kept, w * kept
    return u, v, w


@jit_parallel
def update_points_nodes(
    nodes, tiles, sources, touched, n_touched, ground, zone_values, barriers, report, barrier_report,
    dx, dt, gravity, clearance, wall, nx, ny, contact, zones, barrier,
):  # fmt: skip
    """Velocities at the nodes of all touched blocks; contact where a node lies under the ground by `clearance` [m].

    A node that moves into the ground keeps what is tangential, slowed by Coulomb's law on the impulse: v <- v_t
    max(0, 1 - mu |v_n| / |v_t|) (design notes 4.7). Barriers come after it, and the ground is seen to once more. On
    walls the velocity outwards is taken away.
    """
    for c in prange(CHUNKS):
        mine = report[c]
        mine[:] = 0.0
        booked = barrier_report[c]
        booked[:] = 0.0
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            block = nodes[t]
            _gather(block, sources[t], tiles)
            j_first, i_first, k_first = touched[t, 0] * BLOCK, touched[t, 1] * BLOCK, touched[t, 2] * BLOCK
            for j in range(BLOCK):
                for i in range(BLOCK):
                    jj, ii = min(j_first + j, ground.shape[0] - 1), min(i_first + i, ground.shape[1] - 1)
                    height = ground[jj, ii, GROUND_HEIGHT]
                    slope_x, slope_y = ground[jj, ii, GROUND_SLOPE_X], ground[jj, ii, GROUND_SLOPE_Y]
                    flat = 1.0 / sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
                    for k in range(BLOCK):
                        n = ((k * BLOCK + j) * BLOCK + i) * 4
                        mass = block[n + NODE_MASS]
                        if mass <= 0.0:
                            continue
                        u, v = block[n + NODE_X] / mass, block[n + NODE_Y] / mass
                        w = block[n + NODE_Z] / mass - dt * gravity
                        above = (k_first + k - GHOSTS) * dx - height
                        if above * flat <= clearance:
                            before = u * u + v * v + w * w
                            u1, v1, w1 = _on_ground(u, v, w, slope_x, slope_y, contact, zones, zone_values, jj, ii)
                            mine[GROUND_X] += mass * (u1 - u)
                            mine[GROUND_Y] += mass * (v1 - v)
                            mine[GROUND_Z] += mass * (w1 - w)
                            u, v, w = u1, v1, w1
                            mine[GROUND_WORK] += 0.5 * mass * (before - u * u - v * v - w * w)
                        if barrier.barrier_active() and barriers[jj, ii, BARRIER] > 0.0:
                            height_here = (k_first + k - GHOSTS) * dx
                            u, v, w = at_barrier(u, v, w, mass, height_here, dt, barriers[jj, ii], booked, barrier)
                            if above * flat <= clearance and w - u * slope_x - v * slope_y < 0.0:
                                w1 = u * slope_x + v * slope_y  # out of the ground again, without a further loss
                                mine[GROUND_Z] += mass * (w1 - w)
                                w = w1
                        if wall:
                            if (i_first + i <= GHOSTS and u < 0.0) or (i_first + i >= GHOSTS + nx and u > 0.0):
                                mine[WALL_X] -= mass * u
                                u = 0.0
                            if (j_first + j <= GHOSTS and v < 0.0) or (j_first + j >= GHOSTS + ny and v > 0.0):
                                mine[WALL_Y] -= mass * v
                                v = 0.0
                        block[n + NODE_X], block[n + NODE_Y], block[n + NODE_Z] = u, v, w
                        mine[FASTEST2] = max(mine[FASTEST2], u * u + v * v + w * w)
