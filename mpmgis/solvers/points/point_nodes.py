"""The grid of the 3D MPM between the two transfers: momentum to velocity, gravity, ground, walls."""

from math import sqrt

from ...compiled import law_methods as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from ...compiled.lanes import load, multiply_add, store
from .bed_drag import bed_per_mass
from .point_barriers import BARRIER, FILLED, ROWED, SHARE, at_barrier, passing_share
from .point_ground import GROUND_HEIGHT, exact_at, fold_at, plane_at
from .point_rows import BLOCK, BLOCK_SIZE, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z, TILE_LAYER, TILE_ROW

# what each chunk of the node loop reports: largest speed squared; what the ground and the walls took up [N s]; work
# that the flow did against the ground, of it against friction along the ground, and against barriers, what its layers
# lost to each other, and what ground and barriers that had yielded gave back [J]; number of points whose volume is
# corrected from now on (`point_density`), and the elastic energy that corrections have supplied to the points [J]
(
    FASTEST2,
    GROUND_X,
    GROUND_Y,
    GROUND_Z,
    WALL_X,
    WALL_Y,
    GROUND_WORK,
    FRICTION_WORK,
    BARRIER_WORK,
    LAYER_WORK,
    RETURNED_WORK,
    CORRECTED,
    CORRECTED_ENERGY,
    NODE_REPORT,
) = range(14)
BENEATH = 1.5  # [cells] under smooth ground, from which nodes are held one by one
REACHED = 3.0  # [cells] above the ground, up to which its contact reaches and a little more
STEEPEST_LIFT = 0.17  # upward part of the ground's normal, under which (80 degrees) a node is not lifted along it


@jit_borrowing
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


@jit_borrowing
def is_near_ground(first, row, column, ground, dx):
    """Can a node of the block whose lowest level is `first` touch the ground under it, or be on a fold?"""
    for j in range(BLOCK):
        for i in range(BLOCK):
            jj, ii = min(row * BLOCK + j, ground.nodes.shape[0] - 1), min(column * BLOCK + i, ground.nodes.shape[1] - 1)
            if (float(first - GHOSTS) - REACHED) * dx <= ground.nodes[jj, ii, GROUND_HEIGHT]:
                return True
            _, lowest, levels = fold_at(ground.folds, jj, ii)
            if levels > 0 and first < lowest + levels:
                return True
    return False


@jit_borrowing
def has_barrier(row, column, barriers):
    """Does a barrier stand on a node column of the block column, or reach one with its face or its volume?"""
    for j in range(BLOCK):
        for i in range(BLOCK):
            jj, ii = min(row * BLOCK + j, barriers.shape[0] - 1), min(column * BLOCK + i, barriers.shape[1] - 1)
            if barriers[jj, ii, BARRIER] > 0.0 or barriers[jj, ii, ROWED] > 0.0 or barriers[jj, ii, FILLED] > 0.0:
                return True
    return False


@jit_inline
def is_at_wall(row, column, nx, ny):
    """Does the block column have nodes on or beyond the domain's edges?"""
    west, south = column * BLOCK, row * BLOCK
    return west <= GHOSTS or south <= GHOSTS or west + BLOCK > GHOSTS + nx or south + BLOCK > GHOSTS + ny


@jit_borrowing
def node_at(nodes, slots, span, lowest, j, i, k):
    """(touched block or -1, index of the node's entry, its mass [kg]) of node [j, i] at level `k`.

    `span` holds the window of blocks: west, south, width, number of rows, depth.
    """
    row, column, level = j // BLOCK, i // BLOCK, k // BLOCK
    if row < span[1] or row >= span[1] + span[3] or column < span[0] or column >= span[0] + span[2] or k < 0:
        return -1, 0, 0.0
    if row >= lowest.shape[0] or column >= lowest.shape[1]:
        return -1, 0, 0.0
    up = level - lowest[row, column, 0]
    if up < 0 or up >= span[4]:
        return -1, 0, 0.0
    slot = slots[((row - span[1]) * span[2] + column - span[0]) * span[4] + up]
    if slot < 0:
        return -1, 0, 0.0
    n = (((k - level * BLOCK) * BLOCK + j - row * BLOCK) * BLOCK + i - column * BLOCK) * 4
    return slot, n, float(nodes[slot, n + NODE_MASS])


@jit_inline
def edge_at(j, i, nx, ny):
    """(east, north) parts, -1, 0 or 1, of the inward normals of the domain's edges that node column [j, i] is at."""
    inward_x, inward_y = 0.0, 0.0
    if i <= GHOSTS:
        inward_x = 1.0
    elif i >= GHOSTS + nx:
        inward_x = -1.0
    if j <= GHOSTS:
        inward_y = 1.0
    elif j >= GHOSTS + ny:
        inward_y = -1.0
    return inward_x, inward_y


@jit_inline
def leaning_edge(inward_x, inward_y, ground_x, ground_y):
    """Of the edges `edge_at` a node column, that towards whose inside the ground's normal leans most."""
    if inward_y == 0.0 or (inward_x != 0.0 and inward_x * ground_x >= inward_y * ground_y):
        return inward_x, 0.0
    return 0.0, inward_y


@jit_inline
def _held_before_ground(j, i, nx, ny, ground):
    """As `edge_at`, but 0 for an edge that bears together with the ground (`point_contact.between_faces`)."""
    inward_x, inward_y = edge_at(j, i, nx, ny)
    jj, ii = min(j, ground.nodes.shape[0] - 1), min(i, ground.nodes.shape[1] - 1)
    if fold_at(ground.folds, jj, ii)[2] == 0:
        _, ground_x, ground_y, _ = plane_at(ground.nodes, jj, ii)
        leaning_x, leaning_y = leaning_edge(inward_x, inward_y, ground_x, ground_y)
        if leaning_x * ground_x + leaning_y * ground_y > 0.0:
            return inward_x - leaning_x, inward_y - leaning_y
    return inward_x, inward_y


@jit_borrowing
def stop_at_walls(block, row, column, nx, ny, ground, at_last, mine):
    """Remove the outward velocity of the nodes on and beyond the domain's edges, and add the impulses to the report.

    With `at_last` false, before the contact with the ground, only at walls that this contact does not include.
    """
    for j in range(BLOCK):
        for i in range(BLOCK):
            inward_x, inward_y = edge_at(row * BLOCK + j, column * BLOCK + i, nx, ny)
            if not at_last and (inward_x != 0.0 or inward_y != 0.0):
                inward_x, inward_y = _held_before_ground(row * BLOCK + j, column * BLOCK + i, nx, ny, ground)
            if inward_x == 0.0 and inward_y == 0.0:
                continue
            for k in range(BLOCK):
                n = ((k * BLOCK + j) * BLOCK + i) * 4
                mass, u, v = block[n + NODE_MASS], block[n + NODE_X], block[n + NODE_Y]
                if inward_x * u < 0.0:
                    mine[WALL_X] -= mass * u
                    block[n + NODE_X] = 0.0
                if inward_y * v < 0.0:
                    mine[WALL_Y] -= mass * v
                    block[n + NODE_Y] = 0.0


@jit_borrowing
def fastest_squared(block):
    """Largest squared speed [m2 s-2] at the nodes of `block` that have mass."""
    fastest2 = 0.0
    for n in range(0, BLOCK_SIZE, 4):
        if block[n + NODE_MASS] > 0.0:
            u, v, w = block[n + NODE_X], block[n + NODE_Y], block[n + NODE_Z]
            fastest2 = max(fastest2, float(u * u + v * v + w * w))
    return fastest2


@jit_parallel
def move_nodes(grid, tiles, sources, gathered, free, ground, barriers, report, dt, settings, barred):
    """Velocities at the nodes of all touched blocks after gravity and walls, before any contact with the ground.

    Walls come first, because friction acts along what they leave, and once more in the end.

    Nodes are `gathered` already where something had to know their masses; `barred`: there are `barriers`. `free`
    uint8[n_touched] becomes 1 for blocks whose nodes touch nothing: they are finished.
    """
    nodes, touched, n_touched = grid.nodes, grid.touched, grid.count
    dx, gravity, wall, nx, ny = settings.dx, settings.gravity, settings.wall, settings.cells_x, settings.cells_y
    for c in prange(CHUNKS):
        mine = report[c]
        mine[:] = 0.0
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            block = nodes[t]
            if not gathered:
                _gather(block, sources[t], tiles)
            for n in range(0, BLOCK_SIZE, 4):
                mass = block[n + NODE_MASS]
                if mass > 0.0:
                    block[n + NODE_X] /= mass
                    block[n + NODE_Y] /= mass
                    block[n + NODE_Z] = block[n + NODE_Z] / mass - dt * gravity
            row, column = touched[t, 0], touched[t, 1]
            touches = is_near_ground(touched[t, 2] * BLOCK, row, column, ground, dx)
            if wall and is_at_wall(row, column, nx, ny):
                stop_at_walls(block, row, column, nx, ny, ground, False, mine)
                touches = True
            touches = touches or (barred and has_barrier(row, column, barriers))
            free[t] = 0 if touches else 1
            if not touches:
                mine[FASTEST2] = max(mine[FASTEST2], fastest_squared(block))


@jit_inline
def hold_column(
    t, j, i, grid, ground, zone_values, barriers, column_mass, flow, mine, booked, dt, settings, contact, zones, barrier
):
    """`hold_nodes` for node column [j, i] of touched block `t`; `mine` and `booked` are the reports of its chunk."""
    block, touched = grid.nodes[t], grid.touched
    dx, density, gravity, clearance = settings.dx, settings.density, settings.gravity, settings.clearance
    j_first, i_first, k_first = touched[t, 0] * BLOCK, touched[t, 1] * BLOCK, touched[t, 2] * BLOCK
    jj, ii = min(j_first + j, ground.nodes.shape[0] - 1), min(i_first + i, ground.nodes.shape[1] - 1)
    height, nx, ny, nz = plane_at(ground.nodes, jj, ii)
    first, lowest, levels = fold_at(ground.folds, jj, ii)
    touching = clearance if levels > 0 else -BENEATH * dx * nz
    beyond = levels == 0 and (float(k_first - GHOSTS) * dx - height) * nz > touching  # even the lowest node
    if beyond and (not barrier.barrier_active() or barriers[jj, ii, BARRIER] <= 0.0):
        return
    law, drag = zones.local(contact, zone_values, jj, ii), 0.0
    if contact.drag_active() and levels > 0:
        drag = density * gravity * dt * bed_per_mass(column_mass, jj, ii, dx * dx / nz)
    passing = 1.0
    if barrier.barrier_active() and barriers[jj, ii, SHARE] > 0.0:
        passing = passing_share(flow, ground.nodes, barriers, jj, ii, density * dx * dx, gravity, barrier)
    for k in range(BLOCK):
        n = ((k * BLOCK + j) * BLOCK + i) * 4
        mass = block[n + NODE_MASS]
        if mass <= 0.0:
            continue
        u, v, w = block[n + NODE_X], block[n + NODE_Y], block[n + NODE_Z]
        if levels > 0:
            away, nx, ny, nz = exact_at(ground.exact, first, lowest, levels, k_first + k)
        else:
            away = (float(k_first + k - GHOSTS) * dx - height) * nz
        if away <= touching:
            u1, v1, w1 = _on_ground(u, v, w, nx, ny, nz, law, drag)
            jx, jy, jz = mass * (u1 - u), mass * (v1 - v), mass * (w1 - w)
            mine[GROUND_X] += jx
            mine[GROUND_Y] += jy
            mine[GROUND_Z] += jz
            into = (jx * nx + jy * ny + jz * nz) * (u1 * nx + v1 * ny + w1 * nz)
            work = jx * u1 + jy * v1 + jz * w1
            mine[GROUND_WORK] -= work
            mine[FRICTION_WORK] -= work - into
            u, v, w = u1, v1, w1
        if barrier.barrier_active() and barriers[jj, ii, BARRIER] > 0.0:
            height_here = float(k_first + k - GHOSTS) * dx
            u1, v1, w1 = at_barrier(u, v, w, mass, height_here, dt, barriers[jj, ii], passing, booked, barrier)
            mine[BARRIER_WORK] -= mass * ((u1 - u) * u1 + (v1 - v) * v1 + (w1 - w) * w1)
            u, v, w = u1, v1, w1
            into = u * nx + v * ny + w * nz
            if away <= touching and into < 0.0 and nz > STEEPEST_LIFT:
                mine[GROUND_Z] -= mass * into / nz  # out of the ground again, without a further loss
                w -= into / nz
        block[n + NODE_X], block[n + NODE_Y], block[n + NODE_Z] = u, v, w


@jit_parallel
def hold_nodes(
    grid,
    free,
    ground,
    zone_values,
    barriers,
    column_mass,
    flow,
    report,
    barrier_report,
    dt,
    settings,
    contact,
    zones,
    barrier,
):
    """Contact of single nodes in blocks that are not `free`: ground on folds or far below the surface, barriers, walls.

    On folds a node touches the ground up to `settings.clearance` [m] above it, elsewhere from BENEATH cells under it.
    A node that moves into the ground keeps its tangential velocity, slowed by Coulomb's law on the impulse:
    v <- v_t max(0, 1 - mu |v_n| / |v_t|). Barriers follow, then walls, which remove the outward velocity. `flow` are
    mass and momentum of the node columns, which limit the discharge of openings.
    """
    nodes, touched, n_touched = grid.nodes, grid.touched, grid.count
    wall, nx, ny = settings.wall, settings.cells_x, settings.cells_y
    for c in prange(CHUNKS):
        mine = report[c]
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            if free[t] == 1:
                continue
            block = nodes[t]
            for j in range(BLOCK):
                for i in range(BLOCK):
                    hold_column(
                        t,
                        j,
                        i,
                        grid,
                        ground,
                        zone_values,
                        barriers,
                        column_mass,
                        flow,
                        mine,
                        barrier_report[c],
                        dt,
                        settings,
                        contact,
                        zones,
                        barrier,
                    )
            if wall and is_at_wall(touched[t, 0], touched[t, 1], nx, ny):
                stop_at_walls(block, touched[t, 0], touched[t, 1], nx, ny, ground, True, mine)
            mine[FASTEST2] = max(mine[FASTEST2], fastest_squared(block))
