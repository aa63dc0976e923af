"""Grid of the 3D MPM between the two transfers: momentum to velocity, gravity, ground, walls.

Each chunk of a loop over touched blocks has a report of its own, NODE_REPORT numbers.
"""

from math import sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from ...compiled.simd_lanes import load, multiply_add, store
from ...laws.contact_friction import STICKING, contact_at, has_traction, kept_by_traction, kept_slip, traction_parts
from ...laws.friction import Friction
from .bed_drag import flow_on_bed
from .point_barriers import BARRIER, FILLED, ROWED, SHARE, at_barrier, passing_share
from .point_ground import GROUND_HEIGHT, Ground, exact_at, fold_at, plane_at
from .point_records import ColumnSums, ContactLaws, NodeReports, Site
from .point_rows import (
    BLOCK,
    BLOCK_SIZE,
    GHOSTS,
    NODE_MASS,
    NODE_X,
    NODE_Y,
    NODE_Z,
    TILE_LAYER,
    TILE_ROW,
    BlockWindow,
    NodeBlocks,
    Settings,
)

# entries of the report of a chunk of a loop over nodes
FASTEST2 = 0  # [m2 s-2] largest squared speed
GROUND_X = 1  # [N s] impulse that the ground gave to the flow, east, north and up
GROUND_Y = 2
GROUND_Z = 3
WALL_X = 4  # [N s] impulse that the walls on the domain's edges gave to it
WALL_Y = 5
GROUND_WORK = 6  # [J] work that the flow did against the ground
FRICTION_WORK = 7  # [J] of it, against friction along the ground
BARRIER_WORK = 8  # [J] work that the flow did against barriers
LAYER_WORK = 9  # [J] energy that its layers lost to each other
RETURNED_WORK = 10  # [J] energy that ground and barriers that had yielded gave back
CORRECTED = 11  # number of points whose volume is corrected from now on (`point_density`)
CORRECTED_ENERGY = 12  # [J] elastic energy that corrections of volumes have supplied to the points
NODE_REPORT = 13
BENEATH = 1.5  # [cells] under smooth ground, from which nodes are held one by one
REACHED = 3.0  # [cells] above the ground, up to which its contact reaches and a little more
STEEPEST_LIFT = 0.17  # upward part of the ground's normal, under which (80 degrees) a node is not lifted along it


@jit_borrowing
def _gather(block: np.ndarray, sources: np.ndarray, tiles: np.ndarray) -> None:
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
def gather_nodes(nodes: np.ndarray, tiles: np.ndarray, sources: np.ndarray, n_touched: int) -> None:
    """Sum mass and momentum at the nodes of all touched blocks, for what must know them before the nodes move.

    Parameters
    ----------
    nodes : float[touched, BLOCK_SIZE]
        Is set: momentum [kg m s-1] and mass [kg].
    tiles : float[active, TILE_SIZE]
        Sums of the points of each active block.
    sources : int32[touched, 8]
        Active blocks whose tiles overlap each touched block, -1 for none.
    n_touched : int
        Number of touched blocks.
    """
    for c in prange(CHUNKS):
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            _gather(nodes[t], sources[t], tiles)


@jit_inline
def _on_ground(u, v, w, nx, ny, nz, contact, drags, touching, whole, dt, settings):
    """Return the velocity of a node after its contact with the ground, whose unit normal is (nx, ny, nz).

    Where the bed `drags`, `touching` and `whole` are the masses over the area of bed [kg m-2].
    """
    into = u * nx + v * ny + w * nz
    held = into < 0.0 or contact.kind == STICKING
    if held or drags:
        u, v, w = u - into * nx, v - into * ny, w - into * nz
        slip = sqrt(u * u + v * v + w * w)
        kept = 0.0
        if slip > 0.0:
            kept = kept_slip(contact, slip, max(-into, 0.0))
            if drags and kept > 0.0:
                density, gravity, speed = settings.density, settings.gravity, kept * slip
                parts = traction_parts(contact, density, gravity, whole * gravity * nz, whole / density, speed)
                kept *= kept_by_traction(parts, speed, dt, density, touching)
        leaves = 0.0 if held else into
        u, v, w = kept * u + leaves * nx, kept * v + leaves * ny, kept * w + leaves * nz
    return u, v, w


@jit_borrowing
def is_near_ground(first: int, row: int, column: int, ground: Ground, dx: float) -> bool:
    """Return whether a node of a block can touch the ground under it, or be on a fold.

    Parameters
    ----------
    first : int
        Lowest level of the block.
    row, column : int
        Of the block.
    ground : Ground
    dx : float [m]
    """
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
def has_barrier(row: int, column: int, barriers: np.ndarray) -> bool:
    """Return whether a barrier stands on a node column of the block, or reaches one with its face or its volume.

    Parameters
    ----------
    row, column : int
        Of the block.
    barriers : float[rows, columns, POINT_BARRIER_ENTRIES]
    """
    for j in range(BLOCK):
        for i in range(BLOCK):
            jj, ii = min(row * BLOCK + j, barriers.shape[0] - 1), min(column * BLOCK + i, barriers.shape[1] - 1)
            if barriers[jj, ii, BARRIER] > 0.0 or barriers[jj, ii, ROWED] > 0.0 or barriers[jj, ii, FILLED] > 0.0:
                return True
    return False


@jit_inline
def is_at_wall(row: int, column: int, nx: int, ny: int) -> bool:
    """Return whether a block has nodes on or beyond the domain's edges.

    Parameters
    ----------
    row, column : int
        Of the block.
    nx, ny : int
        Cells of the domain.
    """
    west, south = column * BLOCK, row * BLOCK
    return west <= GHOSTS or south <= GHOSTS or west + BLOCK > GHOSTS + nx or south + BLOCK > GHOSTS + ny


@jit_borrowing
def node_at(grid: NodeBlocks, window: BlockWindow, j: int, i: int, k: int) -> tuple[int, int, float]:
    """Return where a node is stored, and its mass.

    Parameters
    ----------
    grid : NodeBlocks
    window : BlockWindow
    j, i : int
        Node column.
    k : int
        Level.

    Returns
    -------
    slot : int
        Touched block of the node, -1 where there is none.
    n : int
        Index of the node's first entry in the block.
    mass : float [kg]
        0 where there is no block.
    """
    row, column, level = j // BLOCK, i // BLOCK, k // BLOCK
    south, west, lowest = window.south, window.west, window.lowest
    if row < south or row >= south + window.height or column < west or column >= west + window.width or k < 0:
        return -1, 0, 0.0
    if row >= lowest.shape[0] or column >= lowest.shape[1]:
        return -1, 0, 0.0
    up = level - lowest[row, column, 0]
    if up < 0 or up >= window.depth:
        return -1, 0, 0.0
    slot = window.slots[((row - south) * window.width + column - west) * window.depth + up]
    if slot < 0:
        return -1, 0, 0.0
    n = (((k - level * BLOCK) * BLOCK + j - row * BLOCK) * BLOCK + i - column * BLOCK) * 4
    return slot, n, float(grid.nodes[slot, n + NODE_MASS])


@jit_inline
def edge_at(j: int, i: int, nx: int, ny: int) -> tuple[float, float]:
    """Return the inward normals of the domain's edges that a node column is on or beyond.

    Parameters
    ----------
    j, i : int
        Node column.
    nx, ny : int
        Cells of the domain.

    Returns
    -------
    inward_x, inward_y : float
        -1 or 1 at an edge whose normal points along that axis, 0 elsewhere.
    """
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
def leaning_edge(inward_x: float, inward_y: float, ground_x: float, ground_y: float) -> tuple[float, float]:
    """Return the inward normal of the edge towards whose inside the ground's normal leans most.

    Parameters
    ----------
    inward_x, inward_y : float
        Edges at a node column, as of `edge_at`.
    ground_x, ground_y : float
        Horizontal part of the ground's unit normal there.

    Returns
    -------
    inward_x, inward_y : float
        One of the two is 0.
    """
    if inward_y == 0.0 or (inward_x != 0.0 and inward_x * ground_x >= inward_y * ground_y):
        return inward_x, 0.0
    return 0.0, inward_y


@jit_inline
def _held_before_ground(j, i, nx, ny, ground):
    """Return the result of `edge_at` with 0 for an edge that acts together with the ground (`between_faces`)."""
    inward_x, inward_y = edge_at(j, i, nx, ny)
    jj, ii = min(j, ground.nodes.shape[0] - 1), min(i, ground.nodes.shape[1] - 1)
    if fold_at(ground.folds, jj, ii)[2] == 0:
        _, ground_x, ground_y, _ = plane_at(ground.nodes, jj, ii)
        leaning_x, leaning_y = leaning_edge(inward_x, inward_y, ground_x, ground_y)
        if leaning_x * ground_x + leaning_y * ground_y > 0.0:
            return inward_x - leaning_x, inward_y - leaning_y
    return inward_x, inward_y


@jit_borrowing
def stop_at_walls(
    block: np.ndarray, row: int, column: int, nx: int, ny: int, ground: Ground, at_last: bool, mine: np.ndarray
) -> None:
    """Remove the outward velocity of the nodes on and beyond the domain's edges, and add the impulses to the report.

    Parameters
    ----------
    block : float[BLOCK_SIZE]
        Velocities and masses at the nodes of the block.
    row, column : int
        Of the block.
    nx, ny : int
        Cells of the domain.
    ground : Ground
    at_last : bool
        False before the contact with the ground: only at walls that this contact does not include.
    mine : float[NODE_REPORT]
        Report of the chunk.
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
def fastest_squared(block: np.ndarray) -> float:
    """Return the largest squared speed [m2 s-2] at the nodes of a block that have mass.

    Parameters
    ----------
    block : float[BLOCK_SIZE]
        Velocities and masses at the nodes.
    """
    fastest2 = 0.0
    for n in range(0, BLOCK_SIZE, 4):
        if block[n + NODE_MASS] > 0.0:
            u, v, w = block[n + NODE_X], block[n + NODE_Y], block[n + NODE_Z]
            fastest2 = max(fastest2, float(u * u + v * v + w * w))
    return fastest2


@jit_parallel
def move_nodes(
    grid: NodeBlocks,
    tiles: np.ndarray,
    sources: np.ndarray,
    gathered: bool,
    free: np.ndarray,
    ground: Ground,
    barriers: np.ndarray,
    report: np.ndarray,
    dt: float,
    settings: Settings,
    barred: bool,
) -> None:
    """Compute velocities at the nodes of all touched blocks after gravity and walls, before contact with the ground.

    Walls act first, because friction acts along what they leave, and once more at the end of the step.

    Parameters
    ----------
    grid : NodeBlocks
    tiles : float[active, TILE_SIZE]
        Sums of the points of each active block.
    sources : int32[touched, 8]
        Active blocks whose tiles overlap each touched block, -1 for none.
    gathered : bool
        Whether the tiles have been summed already, because something had to know the masses.
    free : uint8[touched]
        Is set: 1 for blocks whose nodes touch nothing. They are finished.
    ground : Ground
    barriers : float[rows, columns, POINT_BARRIER_ENTRIES]
    report : float64[CHUNKS, NODE_REPORT]
        Is set.
    dt : float [s]
    settings : Settings
    barred : bool
        Whether there are barriers.
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
    t: int,
    j: int,
    i: int,
    grid: NodeBlocks,
    site: Site,
    sums: ColumnSums,
    mine: np.ndarray,
    booked: np.ndarray,
    dt: float,
    settings: Settings,
    laws: ContactLaws,
) -> None:
    """Apply `hold_nodes` to one node column of a touched block.

    Parameters
    ----------
    t : int
        Number of the block.
    j, i : int
        Node column in the block, from 0 to BLOCK - 1.
    grid : NodeBlocks
    site : Site
    sums : ColumnSums
    mine : float[NODE_REPORT]
        Report of the chunk.
    booked : float[barriers, POINT_BARRIER_SUMS]
        Loads on the barriers of the chunk.
    dt : float [s]
    settings : Settings
    laws : ContactLaws
    """
    ground, barriers, barrier = site.ground, site.barriers, laws.barrier
    block, touched = grid.nodes[t], grid.touched
    dx, density, gravity, clearance = settings.dx, settings.density, settings.gravity, settings.clearance
    j_first, i_first, k_first = touched[t, 0] * BLOCK, touched[t, 1] * BLOCK, touched[t, 2] * BLOCK
    jj, ii = min(j_first + j, ground.shape[0] - 1), min(i_first + i, ground.shape[1] - 1)
    height, nx, ny, nz = plane_at(ground, jj, ii)
    first, lowest, levels = fold_at(site.folds, jj, ii)
    touching = clearance if levels > 0 else -BENEATH * dx * nz
    beyond = levels == 0 and (float(k_first - GHOSTS) * dx - height) * nz > touching  # even the lowest node
    if beyond and (not barrier or barriers[jj, ii, BARRIER] <= 0.0):
        return
    contact, touching_mass, whole_mass = contact_at(laws.contact, laws.zones, site.zone_values, jj, ii), 0.0, 0.0
    drags = levels > 0 and has_traction(contact)
    if drags:
        touching_mass, whole_mass = flow_on_bed(sums.mass, jj, ii, dx * dx / nz)
    passing = 1.0
    if barrier and barriers[jj, ii, SHARE] > 0.0:
        passing = passing_share(sums.flow, ground, barriers, jj, ii, density * dx * dx, gravity)
    for k in range(BLOCK):
        n = ((k * BLOCK + j) * BLOCK + i) * 4
        mass = block[n + NODE_MASS]
        if mass <= 0.0:
            continue
        u, v, w = block[n + NODE_X], block[n + NODE_Y], block[n + NODE_Z]
        if levels > 0:
            away, nx, ny, nz = exact_at(site.exact, first, lowest, levels, k_first + k)
        else:
            away = (float(k_first + k - GHOSTS) * dx - height) * nz
        if away <= touching:
            u1, v1, w1 = _on_ground(u, v, w, nx, ny, nz, contact, drags, touching_mass, whole_mass, dt, settings)
            jx, jy, jz = mass * (u1 - u), mass * (v1 - v), mass * (w1 - w)
            mine[GROUND_X] += jx
            mine[GROUND_Y] += jy
            mine[GROUND_Z] += jz
            into = (jx * nx + jy * ny + jz * nz) * (u1 * nx + v1 * ny + w1 * nz)
            work = jx * u1 + jy * v1 + jz * w1
            mine[GROUND_WORK] -= work
            mine[FRICTION_WORK] -= work - into
            u, v, w = u1, v1, w1
        if barrier and barriers[jj, ii, BARRIER] > 0.0:
            height_here = float(k_first + k - GHOSTS) * dx
            u1, v1, w1 = at_barrier(u, v, w, mass, height_here, dt, barriers[jj, ii], passing, booked)
            mine[BARRIER_WORK] -= mass * ((u1 - u) * u1 + (v1 - v) * v1 + (w1 - w) * w1)
            u, v, w = u1, v1, w1
            into = u * nx + v * ny + w * nz
            if away <= touching and into < 0.0 and nz > STEEPEST_LIFT:
                mine[GROUND_Z] -= mass * into / nz  # out of the ground again, without a further loss
                w -= into / nz
        block[n + NODE_X], block[n + NODE_Y], block[n + NODE_Z] = u, v, w


@jit_parallel
def hold_nodes(
    grid: NodeBlocks,
    free: np.ndarray,
    site: Site,
    sums: ColumnSums,
    reports: NodeReports,
    dt: float,
    settings: Settings,
    contact: Friction,
    zones: bool,
    barrier: bool,
) -> None:
    """Apply the contact of single nodes: ground on folds or far below the surface, barriers, walls.

    On folds a node touches the ground up to `settings.clearance` [m] above it, elsewhere from BENEATH cells under it.
    A node that moves into the ground keeps its tangential velocity, slowed by Coulomb's law on the impulse:
    v <- v_t max(0, 1 - mu |v_n| / |v_t|). Barriers follow, then walls, which remove the outward velocity.

    Parameters
    ----------
    grid : NodeBlocks
    free : uint8[touched]
        1 for blocks whose nodes touch nothing: they are left out.
    site : Site
    sums : ColumnSums
        `mass` is the mass on which the drag acts; `flow` limits the discharge of openings.
    reports : NodeReports
        Impulses, work and loads on barriers are added to them.
    dt : float [s]
    settings : Settings
    contact, zones, barrier
        As of `ContactLaws`.
    """
    nodes, touched, n_touched = grid.nodes, grid.touched, grid.count
    wall, nx, ny = settings.wall, settings.cells_x, settings.cells_y
    ground = Ground(site.ground, site.folds, site.exact)
    for c in prange(CHUNKS):
        laws, mine, booked = ContactLaws(contact, zones, barrier), reports.nodes[c], reports.barriers[c]
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            if free[t] == 1:
                continue
            block = nodes[t]
            for j in range(BLOCK):
                for i in range(BLOCK):
                    hold_column(t, j, i, grid, site, sums, mine, booked, dt, settings, laws)
            if wall and is_at_wall(touched[t, 0], touched[t, 1], nx, ny):
                stop_at_walls(block, touched[t, 0], touched[t, 1], nx, ny, ground, True, mine)
            mine[FASTEST2] = max(mine[FASTEST2], fastest_squared(block))
