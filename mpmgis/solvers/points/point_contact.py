"""Contact of a 3D flow with smooth ground: one multiplier for each node column (see `press_on_ground`)."""

from math import exp, floor, sqrt

from ...compiled import law_methods as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from .contact_shares import (
    across_part,
    balanced,
    contact_shares,
    depth_of,
    foot_of,
    more_across,
    part_before,
    pushed_mass,
    share_at,
    spline_at,
)
from .point_barriers import BARRIER, DEPTH, EDGE, HELD, ROWED, SHARE, WALL_X, WALL_Y
from .point_ground import fold_at, plane_at
from .point_nodes import FRICTION_WORK, GROUND_WORK, GROUND_X, GROUND_Y, GROUND_Z, RETURNED_WORK, edge_at, leaning_edge
from .point_rows import BLOCK, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z

NO_MASS = 1e-300  # [kg] of a column's heaviest node, up to which there is no flow
LEAST_SHARE = 0.35  # of the heaviest node's mass near the ground, at the ground, from which a flow touches it
LAYER = 20.0  # [cells] thickness of the layer of ground, as stiff as the flow, that yields under it
MOST_YIELD = 0.2  # [cells] by which the ground yields at most
# of the ground under a node column: how far it yields [m], and one more than the number of the step that found it so
YIELD, YIELD_STEP, YIELD_ENTRIES = range(3)


@jit_inline
def is_column_of_block(level, first, below):
    """Is the column whose node nearest to the ground is at `level` processed in the block of lowest level `first`?

    It is processed in the block of that node. If there is no such block (`below` is -1), the mass of the column begins
    at the next node, in the block above.
    """
    return (level >= first and level < first + BLOCK) or (level == first - 1 and below < 0)


@jit_inline
def is_sunk_below_block(level, first, above):
    """Is all mass of the column whose node nearest to the ground is at `level` in the block of lowest level `first`?

    Such a column is up to two levels below its ground, and there is no block around its ground (`above` is -1).
    """
    return above < 0 and level >= first + BLOCK and level <= first + BLOCK + 1


@jit_borrowing
def node_of(nodes, below, own, above, level, first, column):
    """(block, index of its entry, mass [kg]) of the node at `level` of a block's node `column` (0 to 15).

    `first` is the lowest level of block `own`; `below` and `above` are its neighbours, -1 where there is none: the
    mass is 0 there.
    """
    k = level - first
    slot = own
    if k < 0:
        slot, k = below, k + BLOCK
    elif k >= BLOCK:
        slot, k = above, k - BLOCK
    n = (k * BLOCK * BLOCK + column) * 4
    mass = 0.0
    if slot >= 0:
        mass = float(nodes[slot, n + NODE_MASS])
    return slot, n, mass


@jit_borrowing
def mass_near(nodes, below, own, above, first, column, level):
    """(mass [kg] of the heaviest node of a column near the ground, centre of the masses there [levels above `level`]).

    The heaviest is that of the flow's interior there.
    """
    heaviest = total = moment = 0.0
    for offset in range(-2, 3):
        mass = node_of(nodes, below, own, above, level + offset, first, column)[2]
        total += mass
        moment += float(offset) * mass
        heaviest = max(heaviest, mass)
    return heaviest, moment / max(total, NO_MASS)


@jit_borrowing
def _masses_at(nodes, below, own, above, first, column, level, heaviest):
    """Masses [1] of the nodes -2 to 2 levels above `level` over that of the `heaviest` [kg]."""
    whole = 1.0 / heaviest
    return (
        whole * node_of(nodes, below, own, above, level - 2, first, column)[2],
        whole * node_of(nodes, below, own, above, level - 1, first, column)[2],
        whole * node_of(nodes, below, own, above, level, first, column)[2],
        whole * node_of(nodes, below, own, above, level + 1, first, column)[2],
        whole * node_of(nodes, below, own, above, level + 2, first, column)[2],
    )


@jit_borrowing
def at_foot(nodes, below, own, above, first, column, level, foot, rise, heaviest):
    """What the flow has at the ground under a node column.

    Returns velocity [m s-1], the velocity that a unit impulse gives it [kg-1], the mass there [kg], and the
    `contact_shares` of the nodes.
    """
    u = v = w = give = here = 0.0
    m0, m1, m2, m3, m4 = _masses_at(nodes, below, own, above, first, column, level, heaviest)
    shares = contact_shares(foot, rise, m0, m1, m2, m3, m4)
    for offset in range(-2, 3):
        slot, n, mass = node_of(nodes, below, own, above, level + offset, first, column)
        if mass <= 0.0:
            continue
        share = share_at(offset, shares)
        u += share * nodes[slot, n + NODE_X]
        v += share * nodes[slot, n + NODE_Y]
        w += share * nodes[slot, n + NODE_Z]
        if abs(offset) < 2:
            here += spline_at(foot, offset) * mass
        give += share * share / pushed_mass(mass, share, heaviest)
    return u, v, w, give, here, shares


@jit_borrowing
def across_foot(nodes, below, own, above, first, column, level, foot, rise, part, heaviest, shares, nx, ny):
    """What differs from `at_foot` for the horizontal component, along (`nx`, `ny`), of a normal impulse.

    `part` is that of `across_part`; in a sheet thinner than 1.5 cells it counts less. `shares` are the
    `contact_shares` of the nodes. Returns the speed at the ground along (nx, ny) [m s-1] less that of `at_foot`, the
    velocity [kg-1] that a unit impulse gives there with the other shares, the same measured with `shares`, and what
    the other shares follow from: (part, total, moment), see `balanced`.
    """
    whole = 1.0 / heaviest
    m0, m1, m2, m3, m4 = _masses_at(nodes, below, own, above, first, column, level, heaviest)
    part *= depth_of(foot, m0, m1, m2, m3, m4)
    total = moment = speed = give = both = 0.0
    for offset in range(-2, 3):
        mass = whole * node_of(nodes, below, own, above, level + offset, first, column)[2]
        more = more_across(foot - float(offset), rise, part, share_at(offset, shares), mass)
        total += more
        moment += float(offset) * more
    for offset in range(-2, 3):
        slot, n, mass = node_of(nodes, below, own, above, level + offset, first, column)
        if mass <= 0.0:
            continue
        share = share_at(offset, shares)
        more = more_across(foot - float(offset), rise, part, share, whole * mass)
        more = balanced(offset, more, total, moment)
        speed += more * (nx * nodes[slot, n + NODE_X] + ny * nodes[slot, n + NODE_Y])
        pushed = 1.0 / pushed_mass(mass, max(share, abs(share + more)), heaviest)
        give += (share + more) * (share + more) * pushed
        both += (share + more) * share * pushed
    return speed, give, both, (part, total, moment)


@jit_borrowing
def push_node(nodes, slot, n, mass, heaviest, share, across, normal, friction):
    """Give a node its part of the impulse of the ground.

    Its `share` and its share `across` the column [1] are those of the vertical and the horizontal components of
    the `normal` impulse (x, y, z) [N s]; `friction` (x, y, z) [N s] has the `share`. Returns the impulse (x, y, z) that
    the node takes, the part of it that is friction, and the velocity [m s-1] of the node after it.
    """
    taken = mass / pushed_mass(mass, max(share, abs(across)), heaviest)
    fx, fy, fz = taken * share * friction[0], taken * share * friction[1], taken * share * friction[2]
    jx = taken * across * normal[0] + fx
    jy = taken * across * normal[1] + fy
    jz = taken * share * normal[2] + fz
    u, v, w = (
        nodes[slot, n + NODE_X] + jx / mass,
        nodes[slot, n + NODE_Y] + jy / mass,
        nodes[slot, n + NODE_Z] + jz / mass,
    )
    nodes[slot, n + NODE_X], nodes[slot, n + NODE_Y], nodes[slot, n + NODE_Z] = u, v, w
    return (jx, jy, jz), (fx, fy, fz), (u, v, w)


@jit_inline
def dot(a, b):
    """Scalar product of two vectors (x, y, z)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit_borrowing
def _push(
    nodes, below, own, above, first, column, level, foot, rise, across_of, shares, heaviest, normal, friction, mine
):
    """Give the `normal` impulse and that of `friction` (x, y, z) [N s] at the ground to the nodes around it.

    `shares` are the `contact_shares` at the ground's place `foot` and its `rise`; `across_of` is that of `across_foot`.

    The impulse, its work and the work of friction are added to the report `mine`.
    """
    part, total, moment = across_of
    for offset in range(-2, 3):
        slot, n, mass = node_of(nodes, below, own, above, level + offset, first, column)
        if mass <= 0.0:
            continue
        share = across = share_at(offset, shares)
        if part > 0.0:
            more = more_across(foot - float(offset), rise, part, share, mass / heaviest)
            across += balanced(offset, more, total, moment)
        taken, rubbed, velocity = push_node(nodes, slot, n, mass, heaviest, share, across, normal, friction)
        mine[GROUND_X] += taken[0]
        mine[GROUND_Y] += taken[1]
        mine[GROUND_Z] += taken[2]
        mine[GROUND_WORK] -= dot(taken, velocity)
        mine[FRICTION_WORK] -= dot(rubbed, velocity)


@jit_inline
def yielding_impulse(into, give, yielded, impedance, back, most, dt):
    """(normal impulse [N s], yield [m] after it) of yielding ground under a flow with the speed `into` [m s-1] into it.

    The ground is an elastic layer on rigid rock: it pushes with `impedance` [kg s-1] times (speed + yield / `back`
    [s]), at most `most` [m] deep, and comes back by itself where nothing touches it. Rigid ground reflects waves of
    separation, with which a slab slides under less friction than Coulomb's (Adams, 1995, J. Appl. Mech. 62); this
    impedance, that of the flow itself, absorbs them (Lysmer & Kuhlemeyer, 1969, J. Eng. Mech. 95).
    """
    normal = max(dt * impedance * (into + yielded / back) / (1.0 + dt * impedance * give), 0.0)
    if yielded + dt * (into - normal * give) > most:
        normal = max((into - max(most - yielded, 0.0) / dt) / give, normal)
    if normal > 0.0:
        return normal, max(yielded + dt * (into - normal * give), 0.0)
    return 0.0, yielded * exp(-dt / back)


@jit_borrowing
def _mass_above(nodes, slots, place, up, depth, column):
    """Mass [kg] of a node column from the block below the one at `place` + `up` of the window up to the first gap."""
    mass = 0.0
    for level in range(max(up - 1, 0), depth):
        slot = slots[place + level]
        if slot < 0:
            if level >= up:
                break
            continue
        for k in range(BLOCK):
            mass += nodes[slot, (k * BLOCK * BLOCK + column) * 4 + NODE_MASS]
    return mass


@jit_borrowing
def carried_yield(before, step, j, i, east, north, weighed):
    """Yield [m] under node column [j, i] that moved with the flow, by `east` and `north` [cells] in this step.

    `before` are the yields before this step, whose number is `step`. A column that the flow has just reached has the
    mean of its neighbours', so that a front does not fall into the ground cell by cell. What comes along makes the
    yield no larger than `weighed` [m], that under the column's weight: ground pressed by a deep flow would throw up
    the thin front that it moves to.
    """
    now = float(step)
    if before[j, i, YIELD_STEP] != now:
        total = count = 0.0
        for jj, ii in ((j, i - 1), (j, i + 1), (j - 1, i), (j + 1, i)):
            if before[jj, ii, YIELD_STEP] == now:
                total += before[jj, ii, YIELD]
                count += 1.0
        return min(total / max(count, 1.0), weighed)
    own = before[j, i, YIELD]
    behind = i - 1 if east > 0.0 else i + 1
    carried = own
    if before[j, behind, YIELD_STEP] == now:
        carried += abs(east) * (before[j, behind, YIELD] - own)
    behind = j - 1 if north > 0.0 else j + 1
    if before[behind, i, YIELD_STEP] == now:
        carried += abs(north) * (before[behind, i, YIELD] - own)
    return max(min(carried, max(own, weighed)), 0.0)


@jit_inline
def weighed_yield(mass, heaviest, nz, settings):
    """Yield [m] under a node column of `mass` [kg] at rest, whose heaviest node at the ground has `heaviest` [kg].

    Of a flow many cells deep it is LAYER dx g h nz^2 / c^2 (h: thickness, nz: upward part of the ground's normal); at
    most MOST_YIELD cells.
    """
    dx, cells, signal_speed = settings.dx, mass / heaviest, settings.signal_speed
    yielded = LAYER * dx * dx * settings.gravity * cells * nz * nz / (signal_speed * signal_speed)
    return min(yielded, MOST_YIELD * dx)


@jit_inline
def friction_impulse(u, v, w, normal, give, nx, ny, nz, law):
    """Impulse of friction [N s] on a flow of velocity (u, v, w) at the ground, beside the `normal` impulse [N s].

    (nx, ny, nz) is the direction of the normal impulse; the normal speed of the flow does not count. Coulomb friction
    bears at most mu times the normal impulse. Drag came before (`point_layers`). Ground to which the flow sticks leaves
    it no velocity.
    """
    if law.sticks():
        return -u / give - normal * nx, -v / give - normal * ny, -w / give - normal * nz
    out = (u * nx + v * ny + w * nz) / (nx * nx + ny * ny + nz * nz)
    tx, ty, tz = u - out * nx, v - out * ny, w - out * nz
    slip = sqrt(tx * tx + ty * ty + tz * tz)
    if slip == 0.0:
        return 0.0 * tx, 0.0 * ty, 0.0 * tz
    along = (law.kept_slip(slip, normal * give) - 1.0) / give
    return along * tx, along * ty, along * tz


@jit_inline
def between_faces(u, v, into, give, nx, ny, wall_x, wall_y):
    """Contact with the ground beside a wall of outward unit normal (wall_x, wall_y); both act together.

    If the ground alone moves the flow away from the wall, nothing changes. Otherwise the flow keeps no speed into the
    wall, and the wall takes the part of the ground's impulse towards it. One after the other, ground and wall would
    push the flow out of an acute corner in each step.

    Returns the velocity (u, v) [m s-1], the speed `into` the ground [m s-1], the speed out of it per unit impulse along
    its normal, `give` [kg-1], and the ground's normal (nx, ny) within the face of the wall.
    """
    leans = nx * wall_x + ny * wall_y
    across = u * wall_x + v * wall_y
    if across + max(into, 0.0) * leans >= 0.0:
        return u, v, into, give, nx, ny
    u, v = u - across * wall_x, v - across * wall_y
    return u, v, into + across * leans, give * (1.0 - leans * leans), nx - leans * wall_x, ny - leans * wall_y


@jit_inline
def ground_under_mass(height, nx, ny, nz, j, i, settings):
    """(height [m], rise [1]) of the ground, of unit normal (nx, ny, nz), where the mass of node column [j, i] lies.

    Walls around the domain hold the flow inside: of a column on or beyond an edge only a part of its splines has mass.
    The ground counts as high as at the centre of that part, and rises less over it because the part is narrower.
    """
    dx, spread_x, spread_y = settings.dx, 1.0, 1.0
    if settings.wall:
        inward_x, inward_y = edge_at(j, i, settings.cells_x, settings.cells_y)
        if inward_x != 0.0:
            away = i - GHOSTS if inward_x > 0.0 else GHOSTS + settings.cells_x - i
            centre, spread_x = part_before(float(away))
            height -= nx / nz * inward_x * centre * dx
        if inward_y != 0.0:
            away = j - GHOSTS if inward_y > 0.0 else GHOSTS + settings.cells_y - j
            centre, spread_y = part_before(float(away))
            height -= ny / nz * inward_y * centre * dx
    return height, sqrt(spread_x * nx * nx + spread_y * ny * ny) / nz


@jit_inline
def _face_at(place, height, wall_x, wall_y):
    """Outward unit normal of the barrier's side that holds the node column `place` at ground `height` [m].

    (wall_x, wall_y) where none does: no barrier, an opening, or its top is nearer.
    """
    beneath = place[HELD] + place[EDGE] - height
    if place[BARRIER] > 0.0 and place[SHARE] <= 0.0 and beneath >= 0.0 and place[DEPTH] <= beneath:
        return place[WALL_X], place[WALL_Y]
    return wall_x, wall_y


@jit_inline
def press_column(
    t, column, grid, window, ground, zone_values, barriers, yields, step, mine, dt, settings, contact, zones, barrier
):
    """`press_on_ground` for node `column` (0 to 15) of touched block `t`; `mine` is the report of its chunk."""
    nodes, touched = grid.nodes, grid.touched
    slots, width, depth, lowest = window.slots, window.width, window.depth, window.lowest
    dx, signal_speed = settings.dx, settings.signal_speed
    wall, cells_x, cells_y = settings.wall, settings.cells_x, settings.cells_y
    row, block_column, block_level = touched[t, 0], touched[t, 1], touched[t, 2]
    first = block_level * BLOCK
    place = ((row - window.south) * width + block_column - window.west) * depth
    up = block_level - lowest[row, block_column, 0]
    below = slots[place + up - 1] if up > 0 else -1
    above = slots[place + up + 1] if up + 1 < depth else -1
    jj = min(row * BLOCK + column // BLOCK, ground.nodes.shape[0] - 1)
    ii = min(block_column * BLOCK + column % BLOCK, ground.nodes.shape[1] - 1)
    height, nx, ny, nz = plane_at(ground.nodes, jj, ii)
    height, rise = ground_under_mass(height, nx, ny, nz, jj, ii, settings)
    level, foot = foot_of(height, dx)
    if not is_column_of_block(level, first, below) and not is_sunk_below_block(level, first, above):
        return
    if fold_at(ground.folds, jj, ii)[2] > 0:
        return
    if barrier.barrier_active() and barriers[jj, ii, ROWED] > 0.0:
        return
    heaviest, centre = mass_near(nodes, below, t, above, first, column, level)
    if heaviest <= NO_MASS:
        return
    law = zones.local(contact, zone_values, jj, ii)
    rubs = law.kept_slip(1.0, 1.0) < 1.0
    yielding = rubs and not law.sticks()
    mass = _mass_above(nodes, slots, place, up, depth, column) if yielding else 0.0  # here: fewer registers on devices
    wall_x, wall_y = 0.0, 0.0
    if wall:
        inward_x, inward_y = edge_at(jj, ii, cells_x, cells_y)
        wall_x, wall_y = leaning_edge(inward_x, inward_y, nx, ny)
    if barrier.barrier_active():
        wall_x, wall_y = _face_at(barriers[jj, ii], plane_at(ground.nodes, jj, ii)[0], wall_x, wall_y)
    if centre < foot:  # sunk: the ground acts where the mass is
        lower = int(floor(centre + 0.5))  # noqa: RUF046  (floor gives a float on CUDA devices)
        level, foot = level + lower, centre - float(lower)
    u, v, w, give, here, shares = at_foot(nodes, below, t, above, first, column, level, foot, rise, heaviest)
    if here < LEAST_SHARE * heaviest or give <= 0.0:
        return
    into, push_give, turned, across = -(u * nx + v * ny + w * nz), give, 0.0, (0.0, 0.0, 0.0)
    part = across_part(nx, ny, nz)
    if part > 0.0:
        speed, give_across, both, across = across_foot(
            nodes, below, t, above, first, column, level, foot, rise, part, heaviest, shares, nx, ny
        )
        into, turned = into - speed, both - give
        push_give = give * nz * nz + give_across * (1.0 - nz * nz)
    tx, ty = nx, ny
    if wall_x != 0.0 or wall_y != 0.0:
        u, v, into, push_give, tx, ty = between_faces(u, v, into, push_give, nx, ny, wall_x, wall_y)
    back, most, impedance = LAYER * dx / signal_speed, MOST_YIELD * dx, signal_speed * heaviest / (dx * nz)
    yielded_before = yielded = 0.0
    if yielding:
        weighed = weighed_yield(mass, heaviest, nz, settings)
        yielded_before = carried_yield(yields[(step - 1) % 2], step, jj, ii, u * dt / dx, v * dt / dx, weighed)
    normal = pressed = fx = fy = fz = 0.0
    for _ in range(2 if yielding and turned != 0.0 else 1):  # friction and normal impulse change each other a little
        pressed = into - (fx * tx + fy * ty) * turned
        normal = max(pressed, 0.0) / push_give
        if yielding:
            normal, yielded = yielding_impulse(pressed, push_give, yielded_before, impedance, back, most, dt)
        if rubs or law.sticks():
            along = normal * turned
            fx, fy, fz = friction_impulse(u + along * tx, v + along * ty, w, normal, give, tx, ty, nz, law)
    if yielding:
        mine[RETURNED_WORK] += normal * max(normal * push_give - pressed, 0.0)
        after = yields[step % 2]
        after[jj, ii, YIELD], after[jj, ii, YIELD_STEP] = yielded, step + 1
    push, friction = (normal * nx, normal * ny, normal * nz), (fx, fy, fz)
    _push(nodes, below, t, above, first, column, level, foot, rise, across, shares, heaviest, push, friction, mine)


@jit_parallel
def press_on_ground(
    grid, window, free, ground, zone_values, barriers, yields, step, report, dt, settings, contact, zones, barrier
):
    """Contact with smooth ground, of velocities at the nodes of all touched blocks that are not `free`.

    The flow's velocity at the ground, v_b = sum s_k v_k over the nodes of a column around it, is what contact acts on;
    the impulse J is given back with the same shares, dv_k = s_k J / m_k, so that the bed's reaction reaches every node
    as the pressure of the points does (a Lagrange multiplier at one point for each node column; `contact_shares`). The
    horizontal components of the normal impulse, and of the velocity into the ground, have other shares (`more_across`).
    If the centre of the column's mass near the ground is below the ground, the contact acts at that centre: at the
    ground it would let a single layer of points sink further. Each column is processed in the block of the node
    that is nearest to the ground. Columns on folds, and those at smooth faces of barriers (`point_faces`), are not
    changed. Ground with friction yields a little (see `yielding_impulse`), ground without is rigid.

    Parameters
    ----------
    grid : NodeBlocks
    window : BlockWindow
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
        Barriers and walls of the domain act later; the contact of the ground beside them already assumes that they act
        (see `between_faces`).
    yields : float64[2, rows, columns, YIELD_ENTRIES]
        Of the last step and of this one, by turns.
    step : int
        Number of this step, from 1.
    report : float64[CHUNKS, NODE_REPORT]
        Impulses and work are added to it.
    dt : float [s]
    """
    n_touched = grid.count
    for c in prange(CHUNKS):
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            if free[t] == 1:
                continue
            for column in range(BLOCK * BLOCK):
                press_column(
                    t,
                    column,
                    grid,
                    window,
                    ground,
                    zone_values,
                    barriers,
                    yields,
                    step,
                    report[c],
                    dt,
                    settings,
                    contact,
                    zones,
                    barrier,
                )
