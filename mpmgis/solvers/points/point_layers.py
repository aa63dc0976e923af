"""Layers of a 3D flow on a bed with traction: traction on the mean of each node column, and stress between its layers.

The laws are those of `contact_friction` and `flow_layers`. On each column of nodes that touches smooth ground the
traction of the mean speed U acts on the nodes at the bed, and tangential momentum passes between neighbours by Coulomb
friction and turbulence, and in fluids by yield stress and viscosity of the law. The solution is implicit in the speeds,
with links from the speeds at the start of the step: stable at any step, exact in momentum, without gain of energy.
"""

from math import sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from ...laws.contact_friction import (
    contact_at,
    drag_roughness,
    equal_roughness,
    impulse_friction,
    kept_by_traction,
    traction_parts,
)
from ...laws.flow_layers import turbulent_link
from ...laws.friction import Friction
from .bed_drag import bed_under
from .contact_shares import foot_of, spline_at
from .ground_contact import LEAST_SHARE, is_column_of_block
from .point_barriers import BARRIER, EDGE, HELD
from .point_ground import fold_at, plane_at
from .point_nodes import GROUND_WORK, GROUND_X, GROUND_Y, GROUND_Z, LAYER_WORK
from .point_records import ContactLaws, Site
from .point_rows import BLOCK, GHOSTS, NODE_MASS, NODE_X, NODE_Y, NODE_Z, BlockWindow, NodeBlocks, Settings

# entries of a layer
SLOT = 0  # touched block
PLACE = 1  # index of the node's first entry in it
LAYER_MASS = 2  # [kg]
HEIGHT = 3  # [cells] above the bed; times the upward part of the bed's normal, the distance from the bed
AT_BED = 4  # weight at the bed
PUSH_X = 5  # [N s] its part of the drag
PUSH_Y = 6
PUSH_Z = 7
OLD_X = 8  # [m s-1] tangential velocity before
OLD_Y = 9
OLD_Z = 10
LINK = 11  # [kg] link to the next layer
CARRY = 12  # [1] of the elimination
NEW_X = 13  # [m s-1] tangential velocity after
NEW_Y = 14
NEW_Z = 15
LAYER_ENTRIES = 16
HOLLOW = 0.25  # share of the mass of a full node: above a lighter node, a heavier one belongs to another flow
MIXED = 0.5  # [cells] above the bed, up to which the flow is one layer
CREEP = 1e-3  # slip between layers over sqrt(g dx), below which Coulomb friction is proportional to the slip
NO_LIMIT = 1 << 30  # highest level of a column that no barrier limits


@jit_borrowing
def _take(nodes, slots, place, depth, lowest, column, level, foot, full, top, layers):
    """Read the contiguous nodes of a column from the bed up into `layers`; return their number.

    `place` is the index in `slots` of the lowest block of the column, `lowest` the lowest level of that block; `full`
    [kg] is the mass of a node inside the flow, `top` the highest level of the column.
    """
    count, before = 0, 0.0
    for k in range(level - 1, min(lowest + depth * BLOCK, top + 1)):
        up = (k - lowest) // BLOCK
        slot = slots[place + up] if k >= lowest else -1
        mass = 0.0
        entry = ((k - lowest - up * BLOCK) * BLOCK * BLOCK + column) * 4
        if slot >= 0:
            mass = float(nodes[slot, entry + NODE_MASS])
        if mass <= 0.0:
            if count > 0 or k > level:
                break
            continue
        if count > 0 and k > level + 1 and before < HOLLOW * full and mass > before:
            break
        layers[count, SLOT], layers[count, PLACE], layers[count, LAYER_MASS] = slot, entry, mass
        layers[count, HEIGHT] = float(k - level) - foot
        layers[count, AT_BED] = spline_at(foot, k - level) if k - level <= 1 else 0.0
        before, count = mass, count + 1
    return count


@jit_inline
def _read_speeds(nodes, layers, count, nx, ny, nz):
    """Set the tangential velocities of the layers; return their mass [kg], momentum [N s], mass weighted at the bed."""
    mass = px = py = pz = at_bed = 0.0
    for k in range(count):
        slot, entry, own = int(layers[k, SLOT]), int(layers[k, PLACE]), layers[k, LAYER_MASS]
        u, v, w = nodes[slot, entry + NODE_X], nodes[slot, entry + NODE_Y], nodes[slot, entry + NODE_Z]
        off = u * nx + v * ny + w * nz
        u, v, w = u - off * nx, v - off * ny, w - off * nz
        layers[k, OLD_X], layers[k, OLD_Y], layers[k, OLD_Z] = u, v, w
        mass += own
        px += own * u
        py += own * v
        pz += own * w
        at_bed += own * layers[k, AT_BED]
    return mass, px, py, pz, at_bed


@jit_inline
def _link_layers(layers, count, mass, spacing, bed, density, stresses, roughness, creep, dt):
    """Set the links [kg] between neighbours, stress times bed area and time over slip, from the present speeds.

    `stresses` are mu sigma [Pa] at the bed, which decreases upwards with the mass above as the turbulent stress does,
    the yield stress [Pa] and the viscosity [Pa s]. `roughness` is 0 without turbulence.
    """
    above, (pressed, yields, viscosity) = mass, stresses
    rough = roughness * mass / (density * bed)
    for k in range(count - 1):
        above -= layers[k, LAYER_MASS]
        du, dv = layers[k + 1, OLD_X] - layers[k, OLD_X], layers[k + 1, OLD_Y] - layers[k, OLD_Y]
        dw = layers[k + 1, OLD_Z] - layers[k, OLD_Z]
        slip = sqrt(du * du + dv * dv + dw * dw)
        lower = rough + spacing * max(layers[k, HEIGHT], MIXED)
        upper = rough + spacing * max(layers[k + 1, HEIGHT], MIXED)
        turbulent = density * turbulent_link(slip, lower, upper) if roughness > 0.0 else 0.0
        carried = max(above, 0.0) / mass * (turbulent + pressed / max(slip, creep))
        layers[k, LINK] = dt * bed * (carried + yields / max(slip, creep) + viscosity / spacing)
    layers[count - 1, LINK] = 0.0


@jit_borrowing
def _pushed(layers, count, qx, qy, qz):
    """Solve for the tangential velocities, with a push of -q [m s-1] times the mass at the bed.

    (m_k + L_k-1 + L_k) v_k - L_k-1 v_k-1 - L_k v_k+1 = m_k u_k + push_k, without differences of large links. Returns
    the momentum of the mass at the bed [N s].
    """
    link = held = x = y = z = 0.0
    for k in range(count):
        mass = layers[k, LAYER_MASS]
        at_bed = layers[k, AT_BED] * mass
        layers[k, PUSH_X], layers[k, PUSH_Y], layers[k, PUSH_Z] = -at_bed * qx, -at_bed * qy, -at_bed * qz
        free = mass + link * held
        diagonal = free + layers[k, LINK]
        x = (mass * layers[k, OLD_X] + layers[k, PUSH_X] + link * x) / diagonal
        y = (mass * layers[k, OLD_Y] + layers[k, PUSH_Y] + link * y) / diagonal
        z = (mass * layers[k, OLD_Z] + layers[k, PUSH_Z] + link * z) / diagonal
        link, held = layers[k, LINK], free / diagonal
        layers[k, CARRY], layers[k, NEW_X], layers[k, NEW_Y], layers[k, NEW_Z] = link / diagonal, x, y, z
    bx = by = bz = 0.0
    for k in range(count - 1, -1, -1):
        if k < count - 1:
            layers[k, NEW_X] += layers[k, CARRY] * layers[k + 1, NEW_X]
            layers[k, NEW_Y] += layers[k, CARRY] * layers[k + 1, NEW_Y]
            layers[k, NEW_Z] += layers[k, CARRY] * layers[k + 1, NEW_Z]
        at_bed = layers[k, AT_BED] * layers[k, LAYER_MASS]
        bx += at_bed * layers[k, NEW_X]
        by += at_bed * layers[k, NEW_Y]
        bz += at_bed * layers[k, NEW_Z]
    return bx, by, bz


@jit_borrowing
def _stop_bed(layers, count, most):
    """Push against the momentum of the mass at the bed, up to its stop, with at most `most` [m s-1] of `_pushed`."""
    bx, by, bz = _pushed(layers, count, 0.0, 0.0, 0.0)
    before2, free = bx * bx + by * by + bz * bz, 0.0
    for k in range(count):
        free += layers[k, AT_BED] * layers[k, AT_BED] * layers[k, LAYER_MASS]
    if before2 > 0.0:  # `free`: momentum that a push of 1 m/s takes from the bed without links
        cx, cy, cz = _pushed(layers, count, bx / free, by / free, bz / free)
        taken = 1.0 - (cx * bx + cy * by + cz * bz) / before2
        push = min(1.0 / (taken * free), most / sqrt(before2))
        _pushed(layers, count, push * bx, push * by, push * bz)


@jit_inline
def _give(nodes, layers, count, report):
    """Write the velocities of the layers to their nodes; add drag, its work and the loss in the links to `report`."""
    for k in range(count):
        slot, entry, mass = int(layers[k, SLOT]), int(layers[k, PLACE]), layers[k, LAYER_MASS]
        u, v, w = layers[k, NEW_X], layers[k, NEW_Y], layers[k, NEW_Z]
        du, dv, dw = u - layers[k, OLD_X], v - layers[k, OLD_Y], w - layers[k, OLD_Z]
        nodes[slot, entry + NODE_X] += du
        nodes[slot, entry + NODE_Y] += dv
        nodes[slot, entry + NODE_Z] += dw
        report[GROUND_X] += layers[k, PUSH_X]
        report[GROUND_Y] += layers[k, PUSH_Y]
        report[GROUND_Z] += layers[k, PUSH_Z]
        drag = layers[k, PUSH_X] * u + layers[k, PUSH_Y] * v + layers[k, PUSH_Z] * w
        report[GROUND_WORK] -= drag
        report[LAYER_WORK] -= mass * (du * u + dv * v + dw * w) - drag


@jit_borrowing
def _couple(nodes, layers, count, normal, covered, contact, rough, dt, settings, report):
    """Apply traction and links to one column, whose flow covers the share `covered` of its bed.

    A traction that would drive the mass at the bed backwards resists the motion of this mass instead: links carry
    little of it upwards where a material has its own strength.
    `rough` is the roughness of the bed, 0 where it depends on the column.
    """
    dx, density, gravity, (nx, ny, nz) = settings.dx, settings.density, settings.gravity, normal
    mass, px, py, pz, at_bed = _read_speeds(nodes, layers, count, nx, ny, nz)
    bed = covered * dx * dx / nz
    speed = sqrt(px * px + py * py + pz * pz) / mass
    load, thickness = mass * gravity * nz / bed, mass / (density * bed)
    parts = traction_parts(contact, density, gravity, load, thickness, speed)
    lost = 1.0 - kept_by_traction(parts, speed, dt, density, mass / bed) if speed > 0.0 else 0.0
    yields, viscous, drag = parts
    if drag > 0.0 and rough == 0.0:
        rough = drag_roughness(drag)
    strength = settings.slack
    stresses = strength * impulse_friction(contact) * load, strength * yields, strength * viscous * thickness / 3.0
    creep = CREEP * sqrt(gravity * dx) + 1e-300
    _link_layers(layers, count, mass, dx * nz, bed, density, stresses, rough if drag > 0.0 else 0.0, creep, dt)
    share = lost / at_bed
    bx, by, bz = _pushed(layers, count, share * px, share * py, share * pz)
    if bx * px + by * py + bz * pz < 0.0:
        _stop_bed(layers, count, max(lost * mass * speed, dt * bed * yields) / at_bed)
    _give(nodes, layers, count, report)


@jit_inline
def _touches(layers, count):
    """Return whether enough of the mass of the interior is at the bed for the flow to touch it."""
    here = heaviest = 0.0
    for k in range(min(count, 4)):
        heaviest = max(heaviest, layers[k, LAYER_MASS])
        here += layers[k, AT_BED] * layers[k, LAYER_MASS]
    return here > 0.0 and here >= LEAST_SHARE * heaviest


@jit_inline
def couple_column(
    t: int,
    column: int,
    grid: NodeBlocks,
    window: BlockWindow,
    site: Site,
    column_mass: np.ndarray,
    layers: np.ndarray,
    report: np.ndarray,
    dt: float,
    settings: Settings,
    laws: ContactLaws,
    rough: float,
) -> None:
    """Apply `couple_layers` to one node column of a touched block.

    Parameters
    ----------
    t : int
        Number of the block.
    column : int
        Node column in the block, 0 to 15.
    grid : NodeBlocks
    window : BlockWindow
    site : Site
    column_mass : float[rows, columns, COLUMN_MASSES] [kg]
    layers : float[levels, LAYER_ENTRIES]
        Work array.
    report : float[NODE_REPORT]
        Of the chunk.
    dt : float [s]
    settings : Settings
    laws : ContactLaws
    rough : float [1]
        `equal_roughness` of the contact, computed once because it takes long.
    """
    ground, barriers, barrier = site.ground, site.barriers, laws.barrier
    nodes, touched = grid.nodes, grid.touched
    slots, depth, lowest, dx = window.slots, window.depth, window.lowest, settings.dx
    row, block_column, block_level = touched[t, 0], touched[t, 1], touched[t, 2]
    first, base = block_level * BLOCK, lowest[row, block_column, 0]
    place = ((row - window.south) * window.width + block_column - window.west) * depth
    below = slots[place + block_level - base - 1] if block_level > base else -1
    jj = min(row * BLOCK + column // BLOCK, ground.shape[0] - 1)
    ii = min(block_column * BLOCK + column % BLOCK, ground.shape[1] - 1)
    height, nx, ny, nz = plane_at(ground, jj, ii)
    level, foot = foot_of(height, dx)
    if not is_column_of_block(level, first, below) or fold_at(site.folds, jj, ii)[2] > 0:
        return
    covered, top = bed_under(column_mass, jj, ii, 1.0), NO_LIMIT
    if barrier and barriers[jj, ii, BARRIER] > 0.0:
        top = int((barriers[jj, ii, HELD] + barriers[jj, ii, EDGE]) / dx) + GHOSTS
    full = covered * settings.density * dx * dx * dx
    count = _take(nodes, slots, place, depth, base * BLOCK, column, level, foot, full, top, layers)
    if count == 0 or covered <= 0.0 or not _touches(layers, count):
        return
    contact = contact_at(laws.contact, laws.zones, site.zone_values, jj, ii)
    _couple(nodes, layers, count, (nx, ny, nz), covered, contact, rough, dt, settings, report)


@jit_parallel
def couple_layers(
    grid: NodeBlocks,
    window: BlockWindow,
    site: Site,
    column_mass: np.ndarray,
    report: np.ndarray,
    dt: float,
    settings: Settings,
    contact: Friction,
    zones: bool,
    barrier: bool,
) -> None:
    """Apply the traction of a law of friction, and links between layers, to velocities at the nodes of touched blocks.

    Each column is computed in the block of the node nearest to the ground, as in `press_on_ground`, which follows.
    Columns on folds are skipped. In a barrier a column ends at its crest. `settings.slack` is 1 where the links
    transfer mu p, a yield stress and viscous stress, 0 where the material has a strength of its own.

    Parameters
    ----------
    grid : NodeBlocks
    window : BlockWindow
    site : Site
    column_mass : float64[rows, columns, COLUMN_MASSES] [kg]
    report : float64[CHUNKS, NODE_REPORT]
        Impulses, work and losses are added to it.
    dt : float [s]
    settings : Settings
    contact, zones, barrier
        As of `ContactLaws`.
    """
    n_touched, depth = grid.count, window.depth
    rough = equal_roughness(contact, zones, settings.gravity)
    for c in prange(CHUNKS):
        laws, mine = ContactLaws(contact, zones, barrier), report[c]
        layers = np.zeros((depth * BLOCK, LAYER_ENTRIES))
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            for column in range(BLOCK * BLOCK):
                couple_column(t, column, grid, window, site, column_mass, layers, mine, dt, settings, laws, rough)
