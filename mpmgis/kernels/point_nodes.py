"""The grid of the 3D MPM between the two transfers: momentum to velocity, gravity, ground, walls (design notes 4)."""

from math import sqrt

from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import CHUNKS
from .jit import jit_inline, jit_parallel, prange
from .lanes import load, multiply_add, store
from .point_barriers import BARRIER, SHARE, at_barrier, passing_share
from .point_drag import bed_per_mass
from .point_ground import exact_at, fold_at, plane_at
from .point_rows import BLOCK, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z, TILE_LAYER, TILE_ROW

# what each chunk of the node loop reports: largest speed squared; what the ground and the walls took up [N s]; work
# that the flow did against the ground and against barriers [J]
FASTEST2, GROUND_X, GROUND_Y, GROUND_Z, WALL_X, WALL_Y, GROUND_WORK, BARRIER_WORK, NODE_REPORT = range(9)
STEEPEST_LIFT = 0.17  # upward part of the ground's normal, under which (80 degrees) a node is not lifted along it


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


@jit_parallel
def gather_nodes(nodes, tiles, sources, n_touched):
    """Mass and momentum at the nodes of all touched blocks, for what must know them before the nodes move."""
    for c in prange(CHUNKS):
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            _gather(nodes[t], sources[t], tiles)


@jit_inline
def _on_ground(u, v, w, nx, ny, nz, law, drag):
    """Velocity of a node on the ground, whose unit normal is (nx, ny, nz), after its contact with it."""
    into = u * nx + v * ny + w * nz
    held = into < 0.0 or law.sticks()
    if held or law.drag_active():
        u, v, w = u - into * nx, v - into * ny, w - into * nz
        slip = sqrt(u * u + v * v + w * w)
        kept = 0.0
        if slip > 0.0:
            kept = law.kept_slip(slip, max(-into, 0.0))
            kept *= law.kept_by_drag(kept * slip, drag)
        leaves = 0.0 if held else into
        u, v, w = kept * u + leaves * nx, kept * v + leaves * ny, kept * w + leaves * nz
    return u, v, w


@jit_parallel
def update_points_nodes(
    nodes, tiles, sources, touched, n_touched, gathered, ground, zone_values, barriers, column_mass, flow, report,
    barrier_report, dx, dt, density, gravity, clearance, wall, nx, ny, contact, zones, barrier,
):  # fmt: skip
    """Velocities at the nodes of all touched blocks; contact where a node lies under the ground by `clearance` [m].

    A node that moves into the ground keeps what is tangential, slowed by Coulomb's law on the impulse: v <- v_t
    max(0, 1 - mu |v_n| / |v_t|) (design notes 4.7). Barriers come after it, and the ground is seen to once more. On
    walls the velocity outwards is taken away. Where the contact has drag or a barrier has openings the nodes are
    `gathered` already; `column_mass` is what `kernels/point_drag` has weighed, `flow` the mass and momentum of the node
    columns, which limit what passes openings.
    """
    for c in prange(CHUNKS):
        mine = report[c]
        mine[:] = 0.0
        booked = barrier_report[c]
        booked[:] = 0.0
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            block = nodes[t]
            if not gathered:
                _gather(block, sources[t], tiles)
            j_first, i_first, k_first = touched[t, 0] * BLOCK, touched[t, 1] * BLOCK, touched[t, 2] * BLOCK
            for j in range(BLOCK):
                for i in range(BLOCK):
                    jj, ii = min(j_first + j, ground.nodes.shape[0] - 1), min(i_first + i, ground.nodes.shape[1] - 1)
                    height, gx, gy, gz = plane_at(ground.nodes, jj, ii)
                    first, lowest, levels = fold_at(ground.folds, jj, ii)
                    law, drag = zones.local(contact, zone_values, jj, ii), 0.0
                    if contact.drag_active():
                        drag = density * gravity * dt * bed_per_mass(column_mass, jj, ii, dx * dx / gz)
                    passing = 1.0
                    if barrier.barrier_active() and barriers[jj, ii, SHARE] > 0.0:
                        passing = passing_share(
                            flow, ground.nodes, barriers, jj, ii, density * dx * dx, gravity, barrier
                        )
                    for k in range(BLOCK):
                        n = ((k * BLOCK + j) * BLOCK + i) * 4
                        mass = block[n + NODE_MASS]
                        if mass <= 0.0:
                            continue
                        u, v = block[n + NODE_X] / mass, block[n + NODE_Y] / mass
                        w = block[n + NODE_Z] / mass - dt * gravity
                        away = ((k_first + k - GHOSTS) * dx - height) * gz
                        ox, oy, oz = gx, gy, gz
                        if levels > 0:
                            away, ox, oy, oz = exact_at(ground.exact, first, lowest, levels, k_first + k)
                        if away <= clearance:
                            u1, v1, w1 = _on_ground(u, v, w, ox, oy, oz, law, drag)
                            jx, jy, jz = mass * (u1 - u), mass * (v1 - v), mass * (w1 - w)
                            mine[GROUND_X] += jx
                            mine[GROUND_Y] += jy
                            mine[GROUND_Z] += jz
                            mine[GROUND_WORK] -= jx * u1 + jy * v1 + jz * w1
                            u, v, w = u1, v1, w1
                        if barrier.barrier_active() and barriers[jj, ii, BARRIER] > 0.0:
                            height_here = (k_first + k - GHOSTS) * dx
                            u1, v1, w1 = at_barrier(
                                u, v, w, mass, height_here, dt, barriers[jj, ii], passing, booked, barrier
                            )
                            mine[BARRIER_WORK] -= mass * ((u1 - u) * u1 + (v1 - v) * v1 + (w1 - w) * w1)
                            u, v, w = u1, v1, w1
                            into = u * ox + v * oy + w * oz
                            if away <= clearance and into < 0.0 and oz > STEEPEST_LIFT:
                                mine[GROUND_Z] -= mass * into / oz  # out of the ground again, without a further loss
                                w -= into / oz
                        if wall:
                            if (i_first + i <= GHOSTS and u < 0.0) or (i_first + i >= GHOSTS + nx and u > 0.0):
                                mine[WALL_X] -= mass * u
                                u = 0.0
                            if (j_first + j <= GHOSTS and v < 0.0) or (j_first + j >= GHOSTS + ny and v > 0.0):
                                mine[WALL_Y] -= mass * v
                                v = 0.0
                        block[n + NODE_X], block[n + NODE_Y], block[n + NODE_Z] = u, v, w
                        mine[FASTEST2] = max(mine[FASTEST2], u * u + v * v + w * w)
