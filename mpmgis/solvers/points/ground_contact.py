"""Contact of a 3D flow with smooth ground: one multiplier for each node column (see `press_on_ground`)."""

from math import exp, floor, sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from ...laws.contact_friction import STICKING, contact_at, kept_slip
from ...laws.friction import Friction
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
from .point_records import ContactLaws, NodeColumn, Site
from .point_rows import BLOCK, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z, BlockWindow, NodeBlocks, Settings

NO_MASS = 1e-300  # [kg] of a column's heaviest node, up to which there is no flow
LEAST_SHARE = 0.35  # of the heaviest node's mass near the ground, at the ground, from which a flow touches it
LAYER = 20.0  # [cells] thickness of the layer of ground, as stiff as the flow, that yields under it
MOST_YIELD = 0.2  # [cells] by which the ground yields at most
# entries of the ground under a node column
YIELD = 0  # [m] by which it yields
YIELD_STEP = 1  # number of the step after the one that computed it
YIELD_ENTRIES = 2


@jit_inline
def is_column_of_block(level: int, first: int, below: int) -> bool:
    """Return whether a node column is processed in a block.

    It is processed in the block of the node nearest to the ground. If there is no such block, the mass of the column
    begins at the next node, in the block above.

    Parameters
    ----------
    level : int
        Level of the node nearest to the ground.
    first : int
        Lowest level of the block.
    below : int
        Touched block below it, -1 where there is none.
    """
    return (level >= first and level < first + BLOCK) or (level == first - 1 and below < 0)


@jit_inline
def is_sunk_below_block(level: int, first: int, above: int) -> bool:
    """Return whether a block has all mass of a node column whose ground is above it.

    Such a column is up to two levels below its ground, and there is no block around its ground.

    Parameters
    ----------
    level : int
        Level of the node nearest to the ground.
    first : int
        Lowest level of the block.
    above : int
        Touched block above it, -1 where there is none.
    """
    return above < 0 and level >= first + BLOCK and level <= first + BLOCK + 1


@jit_borrowing
def node_of(stack: NodeColumn, level: int) -> tuple[int, int, float]:
    """Return where the node of a column at a level is stored, and its mass.

    Parameters
    ----------
    stack : NodeColumn
    level : int

    Returns
    -------
    slot : int
        Touched block of the node, -1 where there is none.
    n : int
        Index of the node's first entry in the block.
    mass : float [kg]
        0 where there is no block.
    """
    k = level - stack.first
    slot = stack.own
    if k < 0:
        slot, k = stack.below, k + BLOCK
    elif k >= BLOCK:
        slot, k = stack.above, k - BLOCK
    n = (k * BLOCK * BLOCK + stack.column) * 4
    mass = 0.0
    if slot >= 0:
        mass = float(stack.nodes[slot, n + NODE_MASS])
    return slot, n, mass


@jit_borrowing
def mass_near(stack: NodeColumn, level: int) -> tuple[float, float]:
    """Return the mass of the heaviest node of a column near the ground, and the centre of the masses there.

    The heaviest is that of the flow's interior there.

    Parameters
    ----------
    stack : NodeColumn
    level : int
        Level of the node nearest to the ground.

    Returns
    -------
    heaviest : float [kg]
    centre : float [cells]
        Above `level`.
    """
    heaviest = total = moment = 0.0
    for offset in range(-2, 3):
        mass = node_of(stack, level + offset)[2]
        total += mass
        moment += float(offset) * mass
        heaviest = max(heaviest, mass)
    return heaviest, moment / max(total, NO_MASS)


@jit_borrowing
def _masses_at(stack, level, heaviest):
    """Return the masses [1] of the nodes -2 to 2 levels above `level` over that of the `heaviest` [kg]."""
    whole = 1.0 / heaviest
    return (
        whole * node_of(stack, level - 2)[2],
        whole * node_of(stack, level - 1)[2],
        whole * node_of(stack, level)[2],
        whole * node_of(stack, level + 1)[2],
        whole * node_of(stack, level + 2)[2],
    )


@jit_borrowing
def at_foot(
    stack: NodeColumn, level: int, foot: float, rise: float, heaviest: float
) -> tuple[float, float, float, float, float, tuple]:
    """Return what the flow has at the ground under a node column.

    Parameters
    ----------
    stack : NodeColumn
    level : int
        Level of the node nearest to the ground.
    foot : float [cells]
        Place of the ground above that node, -0.5 to 0.5.
    rise : float [1]
        Of the ground.
    heaviest : float [kg]
        Mass of the heaviest node near the ground.

    Returns
    -------
    u, v, w : float [m s-1]
        Velocity.
    give : float [kg-1]
        Velocity that a unit impulse gives it.
    here : float [kg]
        Mass there.
    shares : tuple of 5 floats
        `contact_shares` of the nodes.
    """
    nodes = stack.nodes
    u = v = w = give = here = 0.0
    m0, m1, m2, m3, m4 = _masses_at(stack, level, heaviest)
    shares = contact_shares(foot, rise, m0, m1, m2, m3, m4)
    for offset in range(-2, 3):
        slot, n, mass = node_of(stack, level + offset)
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
def across_foot(
    stack: NodeColumn,
    level: int,
    foot: float,
    rise: float,
    part: float,
    heaviest: float,
    shares: tuple,
    nx: float,
    ny: float,
) -> tuple[float, float, float, tuple[float, float, float]]:
    """Return what differs from `at_foot` for the horizontal component of a normal impulse.

    Parameters
    ----------
    stack : NodeColumn
    level : int
        Level of the node nearest to the ground.
    foot : float [cells]
        Place of the ground above that node, -0.5 to 0.5.
    rise : float [1]
        Of the ground.
    part : float [1]
        That of `across_part`; in a sheet thinner than 1.5 cells it counts less.
    heaviest : float [kg]
        Mass of the heaviest node near the ground.
    shares : tuple of 5 floats
        `contact_shares` of the nodes.
    nx, ny : float
        Horizontal part of the ground's unit normal.

    Returns
    -------
    speed : float [m s-1]
        Speed at the ground along (nx, ny) less that of `at_foot`.
    give : float [kg-1]
        Velocity that a unit impulse gives there with the other shares.
    both : float [kg-1]
        The same, measured with `shares`.
    across : (part, total, moment)
        What the other shares follow from (see `balanced`).
    """
    nodes = stack.nodes
    whole = 1.0 / heaviest
    m0, m1, m2, m3, m4 = _masses_at(stack, level, heaviest)
    part *= depth_of(foot, m0, m1, m2, m3, m4)
    total = moment = speed = give = both = 0.0
    for offset in range(-2, 3):
        mass = whole * node_of(stack, level + offset)[2]
        more = more_across(foot - float(offset), rise, part, share_at(offset, shares), mass)
        total += more
        moment += float(offset) * more
    for offset in range(-2, 3):
        slot, n, mass = node_of(stack, level + offset)
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
def push_node(
    nodes: np.ndarray,
    slot: int,
    n: int,
    mass: float,
    heaviest: float,
    share: float,
    across: float,
    normal: tuple[float, float, float],
    friction: tuple[float, float, float],
) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
    """Give a node its part of the impulse of the ground.

    Parameters
    ----------
    nodes : float[touched, BLOCK_SIZE]
    slot, n : int
        Block of the node, and index of its first entry there.
    mass : float [kg]
        Of the node.
    heaviest : float [kg]
        Mass of the heaviest node near the ground.
    share, across : float [1]
        Shares of the node in the vertical and in the horizontal components of the normal impulse.
    normal : (x, y, z) [N s]
        Normal impulse on the column.
    friction : (x, y, z) [N s]
        Impulse of friction on the column, of which the node has `share`.

    Returns
    -------
    taken : (x, y, z) [N s]
        Impulse that the node takes.
    rubbed : (x, y, z) [N s]
        Part of it that is friction.
    velocity : (x, y, z) [m s-1]
        Of the node after it.
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
def dot(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """Compute the scalar product of two vectors.

    Parameters
    ----------
    a, b : (x, y, z)
    """
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit_borrowing
def _push(stack, level, foot, rise, across_of, shares, heaviest, normal, friction, mine):
    """Give the `normal` impulse and that of `friction` (x, y, z) [N s] at the ground to the nodes around it.

    `shares` are the `contact_shares` at the ground's place `foot` and its `rise`; `across_of` is that of `across_foot`.
    The impulse, its work and the work of friction are added to the report `mine`.
    """
    part, total, moment = across_of
    for offset in range(-2, 3):
        slot, n, mass = node_of(stack, level + offset)
        if mass <= 0.0:
            continue
        share = across = share_at(offset, shares)
        if part > 0.0:
            more = more_across(foot - float(offset), rise, part, share, mass / heaviest)
            across += balanced(offset, more, total, moment)
        taken, rubbed, velocity = push_node(stack.nodes, slot, n, mass, heaviest, share, across, normal, friction)
        mine[GROUND_X] += taken[0]
        mine[GROUND_Y] += taken[1]
        mine[GROUND_Z] += taken[2]
        mine[GROUND_WORK] -= dot(taken, velocity)
        mine[FRICTION_WORK] -= dot(rubbed, velocity)


@jit_inline
def yielding_impulse(
    into: float, give: float, yielded: float, impedance: float, back: float, most: float, dt: float
) -> tuple[float, float]:
    """Return the normal impulse of yielding ground, and its yield after it.

    The ground is an elastic layer on rigid rock: it pushes with `impedance` [kg s-1] times (speed + yield / `back`
    [s]), at most `most` [m] deep, and comes back by itself where nothing touches it. Rigid ground reflects waves of
    separation, with which a slab slides under less friction than Coulomb's (Adams, 1995, J. Appl. Mech. 62); this
    impedance, that of the flow itself, absorbs them (Lysmer & Kuhlemeyer, 1969, J. Eng. Mech. 95).

    Parameters
    ----------
    into : float [m s-1]
        Speed of the flow into the ground.
    give : float [kg-1]
        Velocity that a unit impulse gives to the flow.
    yielded : float [m]
        Yield before the step.
    impedance : float [kg s-1]
    back : float [s]
        Time in which ground that nothing touches comes back.
    most : float [m]
        Largest yield.
    dt : float [s]

    Returns
    -------
    normal : float [N s]
    yielded : float [m]
    """
    normal = max(dt * impedance * (into + yielded / back) / (1.0 + dt * impedance * give), 0.0)
    if yielded + dt * (into - normal * give) > most:
        normal = max((into - max(most - yielded, 0.0) / dt) / give, normal)
    if normal > 0.0:
        return normal, max(yielded + dt * (into - normal * give), 0.0)
    return 0.0, yielded * exp(-dt / back)


@jit_borrowing
def _mass_above(nodes, slots, place, up, depth, column):
    """Return the mass [kg] of a node column up to the first gap.

    It is summed from the block below the one at `place` + `up` of the window.
    """
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
def carried_yield(before: np.ndarray, step: int, j: int, i: int, east: float, north: float, weighed: float) -> float:
    """Return the yield [m] under a node column, which moved with the flow in this step.

    A column that the flow has just reached has the mean of its neighbours', so that a front does not fall into the
    ground cell by cell. What comes along makes the yield no larger than that under the column's weight: ground pressed
    by a deep flow would throw up the thin front that it moves to.

    Parameters
    ----------
    before : float[rows, columns, YIELD_ENTRIES]
        Yields before this step.
    step : int
        Number of this step, from 1.
    j, i : int
        Node column.
    east, north : float [cells]
        Motion of the flow in this step.
    weighed : float [m]
        Yield under the column's weight (`weighed_yield`).
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
def weighed_yield(mass: float, heaviest: float, nz: float, settings: Settings) -> float:
    """Return the yield [m] under a node column at rest.

    Of a flow many cells deep it is LAYER dx g h nz^2 / c^2 (h: thickness, nz: upward part of the ground's normal); at
    most MOST_YIELD cells.

    Parameters
    ----------
    mass : float [kg]
        Of the column.
    heaviest : float [kg]
        Mass of its heaviest node at the ground.
    nz : float
        Upward part of the ground's unit normal.
    settings : Settings
    """
    dx, cells, signal_speed = settings.dx, mass / heaviest, settings.signal_speed
    yielded = LAYER * dx * dx * settings.gravity * cells * nz * nz / (signal_speed * signal_speed)
    return min(yielded, MOST_YIELD * dx)


@jit_inline
def friction_impulse(
    u: float, v: float, w: float, normal: float, give: float, nx: float, ny: float, nz: float, contact: Friction
) -> tuple[float, float, float]:
    """Return the impulse of friction (x, y, z) [N s] on a flow at the ground.

    The normal speed of the flow does not count. Coulomb friction bears at most mu times the normal impulse. Drag came
    before (`point_layers`). Ground to which the flow sticks leaves it no velocity.

    Parameters
    ----------
    u, v, w : float [m s-1]
        Velocity of the flow at the ground.
    normal : float [N s]
        Normal impulse.
    give : float [kg-1]
        Velocity that a unit impulse gives to the flow.
    nx, ny, nz : float
        Direction of the normal impulse.
    contact : Friction
    """
    if contact.kind == STICKING:
        return -u / give - normal * nx, -v / give - normal * ny, -w / give - normal * nz
    out = (u * nx + v * ny + w * nz) / (nx * nx + ny * ny + nz * nz)
    tx, ty, tz = u - out * nx, v - out * ny, w - out * nz
    slip = sqrt(tx * tx + ty * ty + tz * tz)
    if slip == 0.0:
        return 0.0 * tx, 0.0 * ty, 0.0 * tz
    along = (kept_slip(contact, slip, normal * give) - 1.0) / give
    return along * tx, along * ty, along * tz


@jit_inline
def between_faces(
    u: float, v: float, into: float, give: float, nx: float, ny: float, wall_x: float, wall_y: float
) -> tuple[float, float, float, float, float, float]:
    """Prepare the contact with the ground beside a wall: both act together.

    If the ground alone moves the flow away from the wall, nothing changes. Otherwise the flow keeps no speed into the
    wall, and the wall takes the part of the ground's impulse towards it. One after the other, ground and wall would
    push the flow out of an acute corner in each step.

    Parameters
    ----------
    u, v : float [m s-1]
        Horizontal velocity of the flow at the ground.
    into : float [m s-1]
        Its speed into the ground.
    give : float [kg-1]
        Speed out of the ground that a unit impulse along its normal gives.
    nx, ny : float
        Horizontal part of the ground's unit normal.
    wall_x, wall_y : float
        Outward unit normal of the wall.

    Returns
    -------
    u, v, into, give, nx, ny : float
        The same after the wall has acted; (nx, ny) lies within the face of the wall.
    """
    leans = nx * wall_x + ny * wall_y
    across = u * wall_x + v * wall_y
    if across + max(into, 0.0) * leans >= 0.0:
        return u, v, into, give, nx, ny
    u, v = u - across * wall_x, v - across * wall_y
    return u, v, into + across * leans, give * (1.0 - leans * leans), nx - leans * wall_x, ny - leans * wall_y


@jit_inline
def ground_under_mass(
    height: float, nx: float, ny: float, nz: float, j: int, i: int, settings: Settings
) -> tuple[float, float]:
    """Return height and rise of the ground where the mass of a node column lies.

    Walls around the domain hold the flow inside: of a column on or beyond an edge only a part of its splines has mass.
    The ground counts as high as at the centre of that part, and rises less over it because the part is narrower.

    Parameters
    ----------
    height : float [m]
        Of the ground at the node column.
    nx, ny, nz : float
        Unit normal of the ground.
    j, i : int
        Node column.
    settings : Settings

    Returns
    -------
    height : float [m]
    rise : float [1]
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
    """Return the outward unit normal of the barrier's side that holds the node column `place` at ground `height` [m].

    (wall_x, wall_y) where none does: no barrier, an opening, or its top is nearer.
    """
    beneath = place[HELD] + place[EDGE] - height
    if place[BARRIER] > 0.0 and place[SHARE] <= 0.0 and beneath >= 0.0 and place[DEPTH] <= beneath:
        return place[WALL_X], place[WALL_Y]
    return wall_x, wall_y


@jit_inline
def press_column(
    t: int,
    column: int,
    grid: NodeBlocks,
    window: BlockWindow,
    site: Site,
    yields: np.ndarray,
    step: int,
    mine: np.ndarray,
    dt: float,
    settings: Settings,
    laws: ContactLaws,
) -> None:
    """Apply `press_on_ground` to one node column of a touched block.

    Parameters
    ----------
    t : int
        Number of the block.
    column : int
        Node column in the block, 0 to 15.
    grid : NodeBlocks
    window : BlockWindow
    site : Site
    yields : float[2, rows, columns, YIELD_ENTRIES]
        Of the last step and of this one, by turns.
    step : int
        Number of this step, from 1.
    mine : float[NODE_REPORT]
        Report of the chunk.
    dt : float [s]
    settings : Settings
    laws : ContactLaws
    """
    ground, barriers, barrier = site.ground, site.barriers, laws.barrier
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
    jj = min(row * BLOCK + column // BLOCK, ground.shape[0] - 1)
    ii = min(block_column * BLOCK + column % BLOCK, ground.shape[1] - 1)
    height, nx, ny, nz = plane_at(ground, jj, ii)
    height, rise = ground_under_mass(height, nx, ny, nz, jj, ii, settings)
    level, foot = foot_of(height, dx)
    if not is_column_of_block(level, first, below) and not is_sunk_below_block(level, first, above):
        return
    if fold_at(site.folds, jj, ii)[2] > 0:
        return
    if barrier and barriers[jj, ii, ROWED] > 0.0:
        return
    stack = NodeColumn(nodes, below, t, above, first, column)
    heaviest, centre = mass_near(stack, level)
    if heaviest <= NO_MASS:
        return
    contact = contact_at(laws.contact, laws.zones, site.zone_values, jj, ii)
    rubs = kept_slip(contact, 1.0, 1.0) < 1.0
    yielding = rubs and contact.kind != STICKING
    mass = _mass_above(nodes, slots, place, up, depth, column) if yielding else 0.0  # here: fewer registers on devices
    wall_x, wall_y = 0.0, 0.0
    if wall:
        inward_x, inward_y = edge_at(jj, ii, cells_x, cells_y)
        wall_x, wall_y = leaning_edge(inward_x, inward_y, nx, ny)
    if barrier:
        wall_x, wall_y = _face_at(barriers[jj, ii], plane_at(ground, jj, ii)[0], wall_x, wall_y)
    if centre < foot:  # sunk: the ground acts where the mass is
        lower = int(floor(centre + 0.5))  # noqa: RUF046  (floor gives a float on CUDA devices)
        level, foot = level + lower, centre - float(lower)
    u, v, w, give, here, shares = at_foot(stack, level, foot, rise, heaviest)
    if here < LEAST_SHARE * heaviest or give <= 0.0:
        return
    into, push_give, turned, across = -(u * nx + v * ny + w * nz), give, 0.0, (0.0, 0.0, 0.0)
    part = across_part(nx, ny, nz)
    if part > 0.0:
        speed, give_across, both, across = across_foot(stack, level, foot, rise, part, heaviest, shares, nx, ny)
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
        if rubs:
            along = normal * turned
            fx, fy, fz = friction_impulse(u + along * tx, v + along * ty, w, normal, give, tx, ty, nz, contact)
    if yielding:
        mine[RETURNED_WORK] += normal * max(normal * push_give - pressed, 0.0)
        after = yields[step % 2]
        after[jj, ii, YIELD], after[jj, ii, YIELD_STEP] = yielded, step + 1
    push, friction = (normal * nx, normal * ny, normal * nz), (fx, fy, fz)
    _push(stack, level, foot, rise, across, shares, heaviest, push, friction, mine)


@jit_parallel
def press_on_ground(
    grid: NodeBlocks,
    window: BlockWindow,
    free: np.ndarray,
    site: Site,
    yields: np.ndarray,
    step: int,
    report: np.ndarray,
    dt: float,
    settings: Settings,
    contact: Friction,
    zones: bool,
    barrier: bool,
) -> None:
    """Apply the contact with smooth ground to velocities at the nodes of all touched blocks that are not `free`.

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
    free : uint8[touched]
        1 for blocks whose nodes touch nothing.
    site : Site
        Barriers and walls of the domain act later; the contact of the ground beside them already assumes that they act
        (see `between_faces`).
    yields : float64[2, rows, columns, YIELD_ENTRIES]
        Of the last step and of this one, by turns.
    step : int
        Number of this step, from 1.
    report : float64[CHUNKS, NODE_REPORT]
        Impulses and work are added to it.
    dt : float [s]
    settings : Settings
    contact, zones, barrier
        As of `ContactLaws`.
    """
    n_touched = grid.count
    for c in prange(CHUNKS):
        laws, mine = ContactLaws(contact, zones, barrier), report[c]
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            if free[t] == 1:
                continue
            for column in range(BLOCK * BLOCK):
                press_column(t, column, grid, window, site, yields, step, mine, dt, settings, laws)
