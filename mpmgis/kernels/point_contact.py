"""Contact of a 3D flow with smooth ground: one multiplier for each node column (see `press_on_ground`)."""

from math import sqrt

from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import CHUNKS
from .jit import jit_borrowing, jit_inline, jit_parallel, prange
from .point_ground import fold_at, plane_at
from .point_nodes import GROUND_WORK, GROUND_X, GROUND_Y, GROUND_Z
from .point_rows import BLOCK, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z

LEAST_SHARE = 0.25  # of the heaviest node's mass near the ground, at the ground, from which a flow touches it
LIGHTEST = 0.1  # of a full node's share, as which a lighter node is pushed


@jit_inline
def foot_of(height, dx):
    """(node level nearest to the ground at `height` [m], the ground's place above it in cells, -0.5 to 0.5)."""
    place = height / dx + GHOSTS
    level = int(place + 0.5)
    return level, place - level


@jit_inline
def spline_at(foot, offset):
    """Weight of the node `offset` (-1, 0 or 1) levels above the nearest one, at the ground's place `foot` [cells]."""
    if offset == 0:
        return 0.75 - foot * foot
    return 0.5 * (0.5 + offset * foot) ** 2


@jit_inline
def deals_with(level, first, below):
    """Is the column, nearest to the ground at `level`, dealt with in the block of lowest level `first`?

    That is the block of the node there. Where it is not touched (`below` -1), mass begins at the next node, in the
    block above it.
    """
    return (level >= first and level < first + BLOCK) or (level == first - 1 and below < 0)


@jit_inline
def _node_of(below, own, above, level, first, column):
    """(block or -1, index of its entry) of the node at `level` of a block's node `column` (0 to 15).

    `first` is the lowest level of block `own`; `below` and `above` are its neighbours, -1 where there is none.
    """
    k = level - first
    slot = own
    if k < 0:
        slot, k = below, k + BLOCK
    elif k >= BLOCK:
        slot, k = above, k - BLOCK
    return slot, (k * BLOCK * BLOCK + column) * 4


@jit_inline
def _pushed_mass(mass, weight, heaviest):
    """Mass [kg] as which a node of spline `weight` is pushed; `heaviest` [kg] is that of its column's heaviest one."""
    return max(mass, LIGHTEST * weight * heaviest)


@jit_borrowing
def _heaviest(nodes, below, own, above, first, column, level):
    """Mass [kg] of the heaviest node of a column near the ground: that of the flow's interior there."""
    heaviest = 0.0
    for offset in range(-1, 3):
        slot, n = _node_of(below, own, above, level + offset, first, column)
        if slot >= 0:
            heaviest = max(heaviest, float(nodes[slot, n + NODE_MASS]))
    return heaviest


@jit_borrowing
def _at_foot(nodes, below, own, above, first, column, level, foot, heaviest):
    """What the flow has at the ground under a node column.

    Answers velocity [m s-1], the velocity that a unit impulse gives it [kg-1], and the mass there [kg].
    """
    u = v = w = give = here = 0.0
    for offset in range(-1, 2):
        slot, n = _node_of(below, own, above, level + offset, first, column)
        if slot < 0:
            continue
        mass = float(nodes[slot, n + NODE_MASS])
        if mass <= 0.0:
            continue
        weight = spline_at(foot, offset)
        u += weight * nodes[slot, n + NODE_X]
        v += weight * nodes[slot, n + NODE_Y]
        w += weight * nodes[slot, n + NODE_Z]
        here += weight * mass
        give += weight * weight / _pushed_mass(mass, weight, heaviest)
    return u, v, w, give, here


@jit_borrowing
def _push(nodes, below, own, above, first, column, level, foot, heaviest, jx, jy, jz, mine):
    """Give the impulse (jx, jy, jz) [N s] at the ground to the nodes around it, and book it and its work."""
    for offset in range(-1, 2):
        slot, n = _node_of(below, own, above, level + offset, first, column)
        if slot < 0:
            continue
        mass = float(nodes[slot, n + NODE_MASS])
        if mass <= 0.0:
            continue
        weight = spline_at(foot, offset)
        share = weight / _pushed_mass(mass, weight, heaviest)
        u = nodes[slot, n + NODE_X] + share * jx
        v = nodes[slot, n + NODE_Y] + share * jy
        w = nodes[slot, n + NODE_Z] + share * jz
        nodes[slot, n + NODE_X], nodes[slot, n + NODE_Y], nodes[slot, n + NODE_Z] = u, v, w
        taken = mass * share
        mine[GROUND_X] += taken * jx
        mine[GROUND_Y] += taken * jy
        mine[GROUND_Z] += taken * jz
        mine[GROUND_WORK] -= taken * (jx * u + jy * v + jz * w)


@jit_inline
def contact_impulse(u, v, w, give, nx, ny, nz, law):
    """Impulse [N s] of the ground, of unit normal (nx, ny, nz), on a flow of velocity (u, v, w) at it.

    Coulomb friction bears at most mu times the normal impulse; drag came before (`point_layers`).
    """
    into = -(u * nx + v * ny + w * nz)
    if law.sticks():
        return -u / give, -v / give, -w / give
    normal = max(into, 0.0) / give
    tx, ty, tz = u + into * nx, v + into * ny, w + into * nz
    slip = sqrt(tx * tx + ty * ty + tz * tz)
    kept = 1.0
    if slip > 0.0:
        kept = law.kept_slip(slip, normal * give)
    along = (kept - 1.0) / give
    return normal * nx + along * tx, normal * ny + along * ty, normal * nz + along * tz


@jit_parallel
def press_on_ground(
    nodes, touched, n_touched, slots, window_west, window_south, width, depth, lowest, ground, zone_values, report, dx,
    contact, zones,
):  # fmt: skip
    """Contact with smooth ground, of velocities at the nodes of all touched blocks.

    The flow's velocity at the ground, v_b = sum N_k v_k over the three nodes of a column around it, is what contact
    acts on; the impulse J is given back with the same weights, dv_k = N_k J / m_k, so that the bed's reaction reaches
    every node that feels the ground (a Lagrange multiplier at one point for each node column). Each column is dealt
    with in the block of the node that is nearest to the ground. Columns on folds are left alone.

    Parameters
    ----------
    slots : int32[.]
        Touched block at each place of the window, or -1 (see `point_blocks.link_blocks`).
    """
    for c in prange(CHUNKS):
        mine = report[c]
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            row, block_column, block_level = touched[t, 0], touched[t, 1], touched[t, 2]
            first = block_level * BLOCK
            place = ((row - window_south) * width + block_column - window_west) * depth
            up = block_level - lowest[row, block_column, 0]
            below = slots[place + up - 1] if up > 0 else -1
            above = slots[place + up + 1] if up + 1 < depth else -1
            for column in range(BLOCK * BLOCK):
                jj = min(row * BLOCK + column // BLOCK, ground.nodes.shape[0] - 1)
                ii = min(block_column * BLOCK + column % BLOCK, ground.nodes.shape[1] - 1)
                height, nx, ny, nz = plane_at(ground.nodes, jj, ii)
                level, foot = foot_of(height, dx)
                if not deals_with(level, first, below) or fold_at(ground.folds, jj, ii)[2] > 0:
                    continue
                heaviest = _heaviest(nodes, below, t, above, first, column, level)
                u, v, w, give, here = _at_foot(nodes, below, t, above, first, column, level, foot, heaviest)
                if here < LEAST_SHARE * heaviest or give <= 0.0:
                    continue
                law = zones.local(contact, zone_values, jj, ii)
                jx, jy, jz = contact_impulse(u, v, w, give, nx, ny, nz, law)
                _push(nodes, below, t, above, first, column, level, foot, heaviest, jx, jy, jz, mine)
