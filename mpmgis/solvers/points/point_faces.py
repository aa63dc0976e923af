"""Contact of a 3D flow with barriers' smooth faces: one multiplier for each row of nodes (see `press_on_faces`)."""

from math import floor, sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS, GONE
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from ...laws.contact_friction import STICKING, contact_at, dry_slip, kept_slip
from ...laws.friction import Friction
from .contact_shares import contact_shares, foot_of, part_before, pushed_mass, row_shares, share_at, spline_at
from .ground_contact import (
    LAYER,
    LEAST_SHARE,
    MOST_YIELD,
    NO_MASS,
    YIELD,
    YIELD_STEP,
    between_faces,
    carried_yield,
    friction_impulse,
    weighed_yield,
    yielding_impulse,
)
from .point_barriers import ROWED, ROWED_TOO, book_impulse
from .point_blocks import key_column, key_level, key_row, packed
from .point_edges import INSIDE, widen_window
from .point_ground import plane_at
from .point_nodes import (
    BARRIER_WORK,
    FRICTION_WORK,
    GROUND_WORK,
    GROUND_X,
    GROUND_Y,
    GROUND_Z,
    RETURNED_WORK,
    edge_at,
    leaning_edge,
    node_at,
)
from .point_records import ContactLaws, FaceArrays, NodeReports, Site
from .point_report import HELD_WALL
from .point_rows import BLOCK, GHOSTS, NODE_X, NODE_Y, NODE_Z, BlockWindow, NodeBlocks, Settings, X, Y, Z

# entries of a face
FACE_J = 0  # node column nearest to it: row and column
FACE_I = 1
FACE_EAST = 2  # 1 if its rows of nodes run along x, or
FACE_NORTH = 3  # 1 if they run along y
FACE_FOOT = 4  # [cells] its place from that node, along the rows
FACE_OUT = 5  # 1 or -1: on which side the flow is
FACE_X = 6  # its unit normal
FACE_Y = 7
FACE_MU = 8  # [1] friction
FACE_BARRIER = 9  # 1 + number of the barrier; 0: none, a gap between faces
FACE_ARM_X = 10  # [m] its place from the barrier's foot, east and north
FACE_ARM_Y = 11
FACE_BASE = 12  # [m] elevation of that foot
FACE_TOP = 13  # [m] elevation up to which the face holds
FACE_LOWEST = 14  # lowest level that its rows reach
FACE_FIRST = 15  # level of the first of its `lines`
FACE_NEXT = 16  # 1 + the number of the next of the faces that share node columns; 0: none
FACE_FOLLOWS = 17  # 1 for all but the first of these
FACE_TAKEN = 18  # which of its node columns belong to an earlier one of these, as a sum of 1, 2 and 4
FACE_SHIFT = 19  # [cells] in corners: how far the place lies beside the side's plane
FACE_SPREAD = 20  # in corners: root of the variance of the part of the row's spline before it, over that of the whole
FACE_ENTRIES = 21
# entries of a line of nodes in contact, a row or a node column
LINE_X = 0  # [N s] impulse so far
LINE_Y = 1
LINE_Z = 2
LINE_GIVE = 3  # [kg-1] velocity that a unit impulse gives
LINE_HEAVIEST = 4  # [kg] mass of its heaviest node
LINE_YIELD = 5  # [m] yield before the step
LINE_YIELDED = 6  # [m] yield after it
LINE_ON = 7  # 1 where there is contact
LINE_SHARES = 8  # of the nodes -2 to 2: five entries
LINE_ENTRIES = 13
# entries of the last line of a face
SPAN_FIRST = 0  # level of its lowest row in contact
SPAN_LAST = 1  # level of its highest
UPWARDS = (0, 0, 1)  # direction of a node column
FACE_LAYER = 5.0  # [cells] thickness of the elastic layer of a face; a thicker one takes up load later
COLUMNS = 3  # node columns of a face, in front of its levels in the array of lines
SWEEPS = 40  # over the contacts of a face, at most
MOST_BACK = 0.1  # [cells] by which a point that has passed a face is moved back in a step
SETTLED = 1e-4  # of the largest change of velocity, at which sweeps end


@jit_inline
def _ground_under(ground, face, n, dx):
    """Return (row, column, height of the ground [m], its unit normal, its rise [1]) under node column `n` of a face.

    What weighs on a column lies before the face: the ground counts as in `ground_under_mass`.
    """
    j = int(face[FACE_J]) + (n - 1) * int(face[FACE_NORTH])
    i = int(face[FACE_I]) + (n - 1) * int(face[FACE_EAST])
    height, nx, ny, nz = plane_at(ground, j, i)
    centre, spread = part_before((float(n - 1) - face[FACE_FOOT] + face[FACE_SHIFT]) * face[FACE_OUT])
    height -= (nx * face[FACE_EAST] + ny * face[FACE_NORTH]) / nz * face[FACE_OUT] * centre * dx
    spread_x, spread_y = (spread, 1.0) if face[FACE_EAST] == 1.0 else (1.0, spread)
    return j, i, height, nx, ny, nz, sqrt(spread_x * nx * nx + spread_y * ny * ny) / nz


@jit_inline
def _ground_at(ground, face, dx):
    """Return the height of the ground [m] at a face."""
    height, nx, ny, nz = plane_at(ground, int(face[FACE_J]), int(face[FACE_I]))
    return height - (nx * face[FACE_EAST] + ny * face[FACE_NORTH]) / nz * face[FACE_FOOT] * dx


@jit_inline
def _across(face):
    """Return the part of a face's unit normal along its rows [1]."""
    return abs(face[FACE_X]) if face[FACE_EAST] == 1.0 else abs(face[FACE_Y])


@jit_inline
def _row_of(face, k):
    """Return the node (j, i, level) of the row at level `k`, and its direction to the flow (east, north, up)."""
    out = int(face[FACE_OUT])
    return (int(face[FACE_J]), int(face[FACE_I]), k), (out * int(face[FACE_EAST]), out * int(face[FACE_NORTH]), 0)


@jit_borrowing
def _weigh_line(grid, window, node, along, line):
    """Set the masses of the line of nodes around `node` (j, i, level), in place of their shares, and the heaviest one.

    The line runs `along` (east, north, up) to the flow.
    """
    j, i, k = node
    east, north, up = along
    line[:] = 0.0
    heaviest = 0.0
    for o in range(-2, 3):
        mass = node_at(grid, window, j + o * north, i + o * east, k + o * up)[2]
        line[LINE_SHARES + 2 + o] = mass
        heaviest = max(heaviest, mass)
    line[LINE_HEAVIEST] = heaviest


@jit_inline
def _relative_masses(line):
    """Return the masses of the nodes of a line over that of the heaviest one [1], where there is one."""
    whole = 1.0 / max(line[LINE_HEAVIEST], NO_MASS)
    return (
        whole * line[LINE_SHARES],
        whole * line[LINE_SHARES + 1],
        whole * line[LINE_SHARES + 2],
        whole * line[LINE_SHARES + 3],
        whole * line[LINE_SHARES + 4],
    )


@jit_inline
def _share_line(line, foot, shares):
    """Set the `shares` of a line in place of its masses; its place of contact lies `foot` [cells] from its node."""
    heaviest, give, here = line[LINE_HEAVIEST], 0.0, 0.0
    for o in range(-2, 3):
        mass, share = line[LINE_SHARES + 2 + o], share_at(o, shares)
        line[LINE_SHARES + 2 + o] = share
        if mass > 0.0:
            give += share * share / pushed_mass(mass, share, heaviest)
            if abs(o) < 2:
                here += spline_at(foot, o) * mass
    line[LINE_GIVE] = give
    line[LINE_ON] = 1.0 if heaviest > NO_MASS and here >= LEAST_SHARE * heaviest and give > 0.0 else 0.0


@jit_borrowing
def _velocity_at(grid, window, node, along, line):
    """Return the velocity [m s-1] of the flow at the place of contact of a line; `node`, `along`: see `_weigh_line`."""
    j, i, k = node
    east, north, up = along
    u = v = w = 0.0
    for o in range(-2, 3):
        share = line[LINE_SHARES + 2 + o]
        if share == 0.0:
            continue
        slot, n, mass = node_at(grid, window, j + o * north, i + o * east, k + o * up)
        if mass > 0.0:
            u += share * grid.nodes[slot, n + NODE_X]
            v += share * grid.nodes[slot, n + NODE_Y]
            w += share * grid.nodes[slot, n + NODE_Z]
    return u, v, w


@jit_borrowing
def _give_line(grid, window, node, along, impulse, line):
    """Make `impulse` (x, y, z) [N s] that of a line; return the change of its velocity [m s-1]."""
    j, i, k = node
    east, north, up = along
    jx, jy, jz = impulse
    dx, dy, dz = jx - line[LINE_X], jy - line[LINE_Y], jz - line[LINE_Z]
    for o in range(-2, 3):
        share = line[LINE_SHARES + 2 + o]
        if share == 0.0:
            continue
        slot, n, mass = node_at(grid, window, j + o * north, i + o * east, k + o * up)
        if mass > 0.0:
            share /= pushed_mass(mass, share, line[LINE_HEAVIEST])
            grid.nodes[slot, n + NODE_X] += share * dx
            grid.nodes[slot, n + NODE_Y] += share * dy
            grid.nodes[slot, n + NODE_Z] += share * dz
    line[LINE_X], line[LINE_Y], line[LINE_Z] = jx, jy, jz
    return line[LINE_GIVE] * sqrt(dx * dx + dy * dy + dz * dz)


@jit_borrowing
def _taken(grid, window, node, along, line):
    """Return the part of its impulse that a line's nodes take, and their velocity [m s-1] times the part of each."""
    j, i, k = node
    east, north, up = along
    part = u = v = w = 0.0
    for o in range(-2, 3):
        share = line[LINE_SHARES + 2 + o]
        if share == 0.0:
            continue
        slot, n, mass = node_at(grid, window, j + o * north, i + o * east, k + o * up)
        if mass > 0.0:
            taken = share * mass / pushed_mass(mass, share, line[LINE_HEAVIEST])
            part += taken
            u += taken * grid.nodes[slot, n + NODE_X]
            v += taken * grid.nodes[slot, n + NODE_Y]
            w += taken * grid.nodes[slot, n + NODE_Z]
    return part, u, v, w


@jit_inline
def face_impulse(
    velocity: tuple[float, float, float],
    give: float,
    nx: float,
    ny: float,
    mu: float,
    impedance: float,
    yielded: float,
    back: float,
    most: float,
    dt: float,
) -> tuple[float, float, float, float]:
    """Return the impulse of a face on the flow, and its yield after it.

    Faces with friction yield as ground does (`yielding_impulse`), others are rigid.

    Parameters
    ----------
    velocity : (x, y, z) [m s-1]
        Of the flow at the face.
    give : float [kg-1]
        Velocity that a unit impulse gives to the flow.
    nx, ny : float
        Unit normal of the face.
    mu : float [1]
        Friction.
    impedance, yielded, back, most, dt : float
        As of `yielding_impulse`.

    Returns
    -------
    x, y, z : float [N s]
        Impulse.
    yielded : float [m]
    """
    u, v, w = velocity
    into = -(u * nx + v * ny)
    normal = max(into, 0.0) / give
    if mu > 0.0:
        normal, yielded = yielding_impulse(into, give, yielded, impedance, back, most, dt)
    tx, ty = u + into * nx, v + into * ny
    slip = sqrt(tx * tx + ty * ty + w * w)
    kept = dry_slip(mu, slip, normal * give) if slip > 0.0 else 1.0
    along = (kept - 1.0) / give
    return normal * nx + along * tx, normal * ny + along * ty, along * w, yielded


@jit_borrowing
def _press_row(grid, window, face, k, line, dt, settings):
    """Apply the contact of the row at level `k` with its face, beside what else pushes; return the change [m s-1]."""
    dx, signal_speed = settings.dx, settings.signal_speed
    nx, ny, give = face[FACE_X], face[FACE_Y], line[LINE_GIVE]
    node, along = _row_of(face, k)
    u, v, w = _velocity_at(grid, window, node, along, line)
    u, v, w = u - give * line[LINE_X], v - give * line[LINE_Y], w - give * line[LINE_Z]
    impedance = signal_speed * line[LINE_HEAVIEST] / (dx * _across(face))
    jx, jy, jz, line[LINE_YIELDED] = face_impulse(
        (u, v, w),
        give,
        nx,
        ny,
        face[FACE_MU],
        impedance,
        line[LINE_YIELD],
        FACE_LAYER * dx / signal_speed,
        MOST_YIELD * dx,
        dt,
    )
    return _give_line(grid, window, node, along, (jx, jy, jz), line)


@jit_borrowing
def _press_column(grid, window, face, n, site, line, dt, settings, laws):
    """Apply the contact of node column `n` of a face with the ground, as in `press_on_ground`, beside what else pushes.

    Returns the change [m s-1].
    """
    dx, signal_speed = settings.dx, settings.signal_speed
    j, i, height, nx, ny, nz, _ = _ground_under(site.ground, face, n, dx)
    level, _ = foot_of(height, dx)
    contact, give = contact_at(laws.contact, laws.zones, site.zone_values, j, i), line[LINE_GIVE]
    u, v, w = _velocity_at(grid, window, (j, i, level), UPWARDS, line)
    u, v, w = u - give * line[LINE_X], v - give * line[LINE_Y], w - give * line[LINE_Z]
    into, push_give, tx, ty = -(u * nx + v * ny + w * nz), give, nx, ny
    if settings.wall:
        inward_x, inward_y = edge_at(j, i, settings.cells_x, settings.cells_y)
        wall_x, wall_y = leaning_edge(inward_x, inward_y, nx, ny)
        if wall_x != 0.0 or wall_y != 0.0:
            u, v, into, push_give, tx, ty = between_faces(u, v, into, give, nx, ny, wall_x, wall_y)
    normal = max(into, 0.0) / push_give
    if kept_slip(contact, 1.0, 1.0) < 1.0 and contact.kind != STICKING:
        impedance = signal_speed * line[LINE_HEAVIEST] / (dx * nz)
        back, most = LAYER * dx / signal_speed, MOST_YIELD * dx
        normal, line[LINE_YIELDED] = yielding_impulse(into, push_give, line[LINE_YIELD], impedance, back, most, dt)
    fx, fy, fz = friction_impulse(u, v, w, normal, give, tx, ty, nz, contact)
    impulse = fx + normal * nx, fy + normal * ny, fz + normal * nz
    return _give_line(grid, window, (j, i, level), UPWARDS, impulse, line)


@jit_borrowing
def _begin_column(grid, window, face, n, ground, line, before, step, dt, settings):
    """Weigh node column `n` of a face at the ground and find how far the ground yielded before this step."""
    dx = settings.dx
    j, i, height, _, _, nz, rise = _ground_under(ground, face, n, dx)
    level, foot = foot_of(height, dx)
    _weigh_line(grid, window, (j, i, level), UPWARDS, line)
    m0, m1, m2, m3, m4 = _relative_masses(line)
    _share_line(line, foot, contact_shares(foot, rise, m0, m1, m2, m3, m4))
    if line[LINE_ON] == 0.0:
        return
    mass, k = 0.0, level - 1
    while True:
        slot, _, here = node_at(grid, window, j, i, k)
        if k > level + 1 and slot < 0:
            break
        mass += here
        k += 1
    weighed = weighed_yield(mass, line[LINE_HEAVIEST], nz, settings)
    u, v, _ = _velocity_at(grid, window, (j, i, level), UPWARDS, line)
    line[LINE_YIELD] = carried_yield(before, step, j, i, u * dt / dx, v * dt / dx, weighed)


@jit_inline
def top_of(face: np.ndarray, dx: float) -> int:
    """Return the level of the highest row of a face.

    Parameters
    ----------
    face : float[FACE_ENTRIES]
    dx : float [m]
    """
    return int(face[FACE_TOP] / dx + float(GHOSTS))


@jit_borrowing
def share_row(f: int, k: int, grid: NodeBlocks, window: BlockWindow, faces: FaceArrays) -> None:
    """Weigh a row of a face, and set its shares in the contact across it.

    Parameters
    ----------
    f : int
        Number of the face.
    k : int
        Level of the row.
    grid : NodeBlocks
    window : BlockWindow
    faces : FaceArrays
    """
    face = faces.values[f]
    line = faces.lines[f, COLUMNS + k - int(face[FACE_FIRST])]
    node, along = _row_of(face, k)
    _weigh_line(grid, window, node, along, line)
    m0, m1, m2, m3, m4 = _relative_masses(line)
    foot, across = face[FACE_FOOT] * face[FACE_OUT], _across(face)
    rise = face[FACE_SPREAD] * sqrt(max(1.0 - across * across, 0.0)) / across
    _share_line(line, foot, row_shares(foot, rise, m0, m1, m2, m3, m4))


@jit_borrowing
def _begin_rows(grid, window, face, f, ground, lines, before, step, dt, settings):
    """Find the rows in contact of a face, from its top down, and how far it yielded at them; return (lowest, highest).

    At and under the ground rows are in contact with those above them: their masses tell how the ground lies.
    """
    dx, density, signal_speed = settings.dx, settings.density, settings.signal_speed
    bottom, base, top = int(face[FACE_LOWEST]), int(face[FACE_FIRST]), top_of(face, dx)
    stretch, first, last, above = FACE_LAYER * dx * settings.gravity / (signal_speed * signal_speed), top + 1, top, 0.0
    deep = _ground_at(ground, face, dx) / dx + float(GHOSTS) + 0.5
    for k in range(top, bottom - 1, -1):
        line = lines[COLUMNS + k - base]
        if float(k) <= deep and first == k + 1 and first <= last and line[LINE_GIVE] > 0.0:
            line[LINE_ON] = 1.0
        if line[LINE_ON] == 0.0:
            if first > last:
                last = k - 1
            continue
        first = k
        above += line[LINE_HEAVIEST] / (density * dx * dx)
        if face[FACE_MU] > 0.0:
            node, along = _row_of(face, k)
            u, v, w = _velocity_at(grid, window, node, along, line)
            sideways = v if face[FACE_EAST] == 1.0 else u
            weighed = min(stretch * above, MOST_YIELD * dx)
            line[LINE_YIELD] = carried_yield(before, step, f, k - base + 1, w * dt / dx, sideways * dt / dx, weighed)
    return first, last


@jit_borrowing
def _book_row(grid, window, face, k, line, dx, booked, mine):
    """Add the load of a row on its face, and its work, to `booked` and to the report `mine`."""
    node, along = _row_of(face, k)
    part, u, v, w = _taken(grid, window, node, along, line)
    jx, jy, jz = line[LINE_X], line[LINE_Y], line[LINE_Z]
    book_impulse(
        booked[int(face[FACE_BARRIER]) - 1],
        -part * jx,
        -part * jy,
        -part * jz,
        part * (jx * face[FACE_X] + jy * face[FACE_Y]),
        face,
        FACE_ARM_X,
        float(k - GHOSTS) * dx,
    )
    mine[BARRIER_WORK] -= jx * u + jy * v + jz * w
    nx, ny = face[FACE_X], face[FACE_Y]
    mine[RETURNED_WORK] += max((jx * nx + jy * ny) * (u * nx + v * ny), 0.0)


@jit_borrowing
def _book_column(grid, window, face, n, ground, line, dx, mine):
    """Add the impulse of the ground on node column `n` of a face, and its work, to the report `mine`."""
    j, i, height, nx, ny, nz, _ = _ground_under(ground, face, n, dx)
    level, _ = foot_of(height, dx)
    part, u, v, w = _taken(grid, window, (j, i, level), UPWARDS, line)
    jx, jy, jz = line[LINE_X], line[LINE_Y], line[LINE_Z]
    mine[GROUND_X] += part * jx
    mine[GROUND_Y] += part * jy
    mine[GROUND_Z] += part * jz
    work, normal_work = jx * u + jy * v + jz * w, (jx * nx + jy * ny + jz * nz) * (u * nx + v * ny + w * nz)
    mine[GROUND_WORK] -= work
    mine[FRICTION_WORK] -= work - normal_work
    mine[RETURNED_WORK] += max(normal_work, 0.0)


@jit_borrowing
def weigh_rows(
    f: int,
    grid: NodeBlocks,
    window: BlockWindow,
    site: Site,
    faces: FaceArrays,
    step: int,
    dt: float,
    settings: Settings,
) -> None:
    """Find the rows in contact of a face, after `share_row`, and how far it yielded; set SPAN_FIRST and SPAN_LAST.

    Parameters
    ----------
    f : int
        Number of the face.
    grid : NodeBlocks
    window : BlockWindow
    site : Site
    faces : FaceArrays
    step : int
        Number of this step, from 1.
    dt : float [s]
    settings : Settings
    """
    own = faces.lines[f]
    before, span = faces.yields[(step - 1) % 2], own[own.shape[0] - 1]
    span[SPAN_FIRST], span[SPAN_LAST] = _begin_rows(
        grid, window, faces.values[f], f + 1, site.ground, own, before, step, dt, settings
    )


@jit_borrowing
def weigh_column(
    f: int,
    n: int,
    grid: NodeBlocks,
    window: BlockWindow,
    site: Site,
    faces: FaceArrays,
    yields: np.ndarray,
    step: int,
    dt: float,
    settings: Settings,
) -> None:
    """Weigh a node column of a face at the ground and find how far the ground yielded.

    One that belongs to an earlier face is not in contact here.

    Parameters
    ----------
    f : int
        Number of the face.
    n : int
        Node column of the face, 0 to COLUMNS - 1.
    grid : NodeBlocks
    window : BlockWindow
    site : Site
    faces : FaceArrays
    yields : float[2, rows, columns, YIELD_ENTRIES]
        Of the ground.
    step : int
        Number of this step, from 1.
    dt : float [s]
    settings : Settings
    """
    face, line = faces.values[f], faces.lines[f, n]
    if int(face[FACE_TAKEN]) >> n & 1:
        line[LINE_ON] = 0.0
        return
    before = yields[(step - 1) % 2]
    _begin_column(grid, window, face, n, site.ground, line, before, step, dt, settings)


@jit_borrowing
def _press_face(f, reach, grid, window, site, faces, dt, settings, laws):
    """Push at the rows of face `f` up to level `reach`, then at its node columns.

    Returns the largest change of the velocity of a node [m s-1].
    """
    face, own = faces.values[f], faces.lines[f]
    base, span, change = int(face[FACE_FIRST]), own[own.shape[0] - 1], 0.0
    for k in range(int(span[SPAN_FIRST]), min(int(span[SPAN_LAST]), reach) + 1):
        if own[COLUMNS + k - base, LINE_ON] > 0.0:
            line = own[COLUMNS + k - base]  # here: fewer registers on devices
            change = max(change, _press_row(grid, window, face, k, line, dt, settings))
    for n in range(COLUMNS):
        if own[n, LINE_ON] > 0.0:
            change = max(change, _press_column(grid, window, face, n, site, own[n], dt, settings, laws))
    return change


@jit_borrowing
def settle_face(
    f: int,
    grid: NodeBlocks,
    window: BlockWindow,
    site: Site,
    faces: FaceArrays,
    dt: float,
    settings: Settings,
    laws: ContactLaws,
) -> None:
    """Push at the rows and node columns of a face in turn, and of all that it meets, until nothing changes.

    Rows above the ground's reach do not share nodes with what else pushes, unless two sides meet in a corner.

    Parameters
    ----------
    f : int
        Number of the face.
    grid : NodeBlocks
    window : BlockWindow
    site : Site
    faces : FaceArrays
    dt : float [s]
    settings : Settings
    laws : ContactLaws
    """
    values = faces.values
    if values[f, FACE_FOLLOWS] > 0.0:
        return
    top, reach, largest = top_of(values[f], settings.dx), 0, 0.0
    for n in range(COLUMNS):
        reach = max(reach, foot_of(_ground_under(site.ground, values[f], n, settings.dx)[2], settings.dx)[0] + 1)
    g = int(values[f, FACE_NEXT]) - 1
    while g >= 0:
        top = max(top, top_of(values[g], settings.dx))
        reach, g = top, int(values[g, FACE_NEXT]) - 1
    for sweep in range(SWEEPS):
        change, g = 0.0, f
        while g >= 0:
            up_to = top if sweep == 0 else reach  # here: fewer registers on devices
            change = max(change, _press_face(g, up_to, grid, window, site, faces, dt, settings, laws))
            g = int(values[g, FACE_NEXT]) - 1
        largest = max(largest, change)
        if change <= SETTLED * largest:
            break


@jit_borrowing
def book_face(
    f: int,
    grid: NodeBlocks,
    window: BlockWindow,
    site: Site,
    faces: FaceArrays,
    yields: np.ndarray,
    step: int,
    mine: np.ndarray,
    booked: np.ndarray,
    settings: Settings,
) -> None:
    """Add the loads on a face and on the ground beside it to the reports, and store how far they yielded.

    Parameters
    ----------
    f : int
        Number of the face.
    grid : NodeBlocks
    window : BlockWindow
    site : Site
    faces : FaceArrays
    yields : float[2, rows, columns, YIELD_ENTRIES]
        Of the ground.
    step : int
        Number of this step, from 1.
    mine : float[NODE_REPORT]
        Report of the chunk.
    booked : float[barriers, POINT_BARRIER_SUMS]
        Loads on the barriers of the chunk.
    settings : Settings
    """
    face, own, dx = faces.values[f], faces.lines[f], settings.dx
    base = int(face[FACE_FIRST])
    after, face_after, span = yields[step % 2], faces.yields[step % 2], own[own.shape[0] - 1]
    for k in range(int(span[SPAN_FIRST]), int(span[SPAN_LAST]) + 1):
        line = own[COLUMNS + k - base]
        if line[LINE_ON] > 0.0:
            _book_row(grid, window, face, k, line, dx, booked, mine)
            face_after[f + 1, k - base + 1, YIELD] = line[LINE_YIELDED]
            face_after[f + 1, k - base + 1, YIELD_STEP] = step + 1
    for n in range(COLUMNS):
        if own[n, LINE_ON] > 0.0:
            j, i = _ground_under(site.ground, face, n, dx)[:2]
            _book_column(grid, window, face, n, site.ground, own[n], dx, mine)
            after[j, i, YIELD], after[j, i, YIELD_STEP] = own[n, LINE_YIELDED], step + 1


@jit_parallel
def press_on_faces(
    grid: NodeBlocks,
    window: BlockWindow,
    site: Site,
    faces: FaceArrays,
    yields: np.ndarray,
    step: int,
    reports: NodeReports,
    dt: float,
    settings: Settings,
    contact: Friction,
    zones: bool,
    barrier: bool,
) -> None:
    """Apply the contact with barriers' smooth faces, and with the ground under the node columns beside them.

    As at the ground (`press_on_ground`) the flow's velocity at the face, sum s_k v_k over the nodes of a row around it,
    is what contact acts on, and the impulse is given back with the same shares. Rows and the node columns
    that they share nodes with push at the same time: each in turn is given the impulse that it needs beside the
    others', until nothing changes (projected Gauss-Seidel; each turn takes the kinetic energy to its least, so without
    friction none is made). Faces that share node columns, in corners, settle together (`FACE_NEXT`).

    Parameters
    ----------
    grid : NodeBlocks
    window : BlockWindow
    site : Site
    faces : FaceArrays
        `lines` have room for the node columns, the rows and the span (`SPAN_FIRST`) of each face.
    yields : float64[2, rows, columns, YIELD_ENTRIES]
        Of the ground.
    step : int
        Number of this step, from 1.
    reports : NodeReports
        Impulses, work and loads on barriers are added to them.
    dt : float [s]
    settings : Settings
    contact, zones, barrier
        As of `ContactLaws`.
    """
    values = faces.values
    for c in prange(CHUNKS):
        for f in range(c * values.shape[0] // CHUNKS, (c + 1) * values.shape[0] // CHUNKS):
            if values[f, FACE_BARRIER] == 0.0:
                continue
            for k in range(int(values[f, FACE_LOWEST]), top_of(values[f], settings.dx) + 1):
                share_row(f, k, grid, window, faces)
            weigh_rows(f, grid, window, site, faces, step, dt, settings)
            for n in range(COLUMNS):
                weigh_column(f, n, grid, window, site, faces, yields, step, dt, settings)
    for c in prange(CHUNKS):
        laws = ContactLaws(contact, zones, barrier)
        for f in range(c * values.shape[0] // CHUNKS, (c + 1) * values.shape[0] // CHUNKS):
            if values[f, FACE_BARRIER] > 0.0:
                settle_face(f, grid, window, site, faces, dt, settings, laws)
    for c in prange(CHUNKS):
        for f in range(c * values.shape[0] // CHUNKS, (c + 1) * values.shape[0] // CHUNKS):
            if values[f, FACE_BARRIER] > 0.0:
                mine, booked = reports.nodes[c], reports.barriers[c]
                book_face(f, grid, window, site, faces, yields, step, mine, booked, settings)


@jit_inline
def _depth_behind(p, rows, row, column, face):
    """Return the distance [cells] of point `p`, in block [row, column], behind the plane of a face."""
    foot = face[FACE_FOOT] - face[FACE_SHIFT]
    east = float(rows[p, X]) + float(column * BLOCK - int(face[FACE_I])) - foot * face[FACE_EAST]
    north = float(rows[p, Y]) + float(row * BLOCK - int(face[FACE_J])) - foot * face[FACE_NORTH]
    return -(east * face[FACE_X] + north * face[FACE_Y])


@jit_inline
def keep_before_face(
    p: int,
    rows: np.ndarray,
    keys: np.ndarray,
    lowest: np.ndarray,
    inside: np.ndarray,
    faces: np.ndarray,
    barriers: np.ndarray,
    dx: float,
    mine: np.ndarray,
) -> None:
    """Move a point towards the smooth face that it has passed, along its normal.

    By at most MOST_BACK a step, and not over an edge of the domain. Faces with friction yield: the point may be behind
    them by MOST_YIELD. Points that are more than a cell behind a face came another way and stay. In a corner the point
    moves towards the side behind which it is further.

    Parameters
    ----------
    p : int
        Number of the point.
    rows, keys, lowest, inside, faces, barriers, dx
        As of `keep_before_faces`.
    mine : float64[REPORT]
        Report of the chunk: points that are moved are counted as held, and its window is widened to their blocks.
    """
    if keys[p] == GONE:
        return
    row, column = key_row(keys[p]), key_column(keys[p])
    j = min(row * BLOCK + int(floor(rows[p, Y] + 0.5)), barriers.shape[0] - 1)  # noqa: RUF046  (a float on CUDA devices)
    i = min(column * BLOCK + int(floor(rows[p, X] + 0.5)), barriers.shape[1] - 1)  # noqa: RUF046
    if barriers[j, i, ROWED] <= 0.0:
        return
    f = int(barriers[j, i, ROWED]) - 1
    into = _depth_behind(p, rows, row, column, faces[f])
    if barriers[j, i, ROWED_TOO] > 0.0:
        other = int(barriers[j, i, ROWED_TOO]) - 1
        beside = _depth_behind(p, rows, row, column, faces[other])
        if beside > into:
            f, into = other, beside
    face = faces[f]
    level = key_level(keys[p]) + lowest[row, column, 0]
    z = (float(rows[p, Z]) + float(level * BLOCK - GHOSTS)) * dx
    if face[FACE_BARRIER] <= 0.0 or z > face[FACE_TOP]:
        return
    back = into - MOST_YIELD if face[FACE_MU] > 0.0 else into
    if not (back > 0.0 and into <= 1.0):
        return
    back = min(back, MOST_BACK)
    x, y = float(rows[p, X]) + back * face[FACE_X], float(rows[p, Y]) + back * face[FACE_Y]
    cell_x, cell_y = x + float(column * BLOCK - GHOSTS), y + float(row * BLOCK - GHOSTS)
    if not (cell_x >= INSIDE and cell_y >= INSIDE):
        return
    if not (cell_x <= float(inside.shape[1]) - INSIDE and cell_y <= float(inside.shape[0]) - INSIDE):
        return
    if inside[min(int(cell_y), inside.shape[0] - 1), min(int(cell_x), inside.shape[1] - 1)] == 0:
        return
    blocks_east, blocks_north = int(floor((x - 0.5) * 0.25)), int(floor((y - 0.5) * 0.25))  # noqa: RUF046
    rows[p, X], rows[p, Y] = x - float(BLOCK * blocks_east), y - float(BLOCK * blocks_north)
    if blocks_east != 0 or blocks_north != 0:
        row, column = row + blocks_north, column + blocks_east
        up = level - lowest[row, column, 0]
        if up < 0:
            rows[p, Z] += float(BLOCK * up)
            up = 0
        keys[p] = packed(row, column, up)
        widen_window(mine, row, column, up + lowest[row, column, 1])
    mine[HELD_WALL] += 1.0


@jit_parallel
def keep_before_faces(
    rows: np.ndarray,
    keys: np.ndarray,
    count: int,
    lowest: np.ndarray,
    inside: np.ndarray,
    faces: np.ndarray,
    barriers: np.ndarray,
    dx: float,
    report: np.ndarray,
) -> None:
    """Move the first `count` points back to barriers' smooth faces that they have passed.

    The contact of nodes (`press_on_faces`) stops the mean flow at a face. Points of a fluid creep past it by fractions
    of a cell, and in a pool that is at rest for long they would fill the barrier. Walls on the edges of the domain
    hold points in the same way (`point_edges.keep_inside`), and both count in HELD_WALL.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]
        Block of each point.
    count : int
    lowest : int32[block rows, block columns, 2]
        See `point_blocks.lowest_blocks`.
    inside : uint8[cells_y, cells_x]
        1 where the terrain has an elevation.
    faces : float64[faces, FACE_ENTRIES]
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    dx : float [m]
    report : float64[CHUNKS, REPORT]
        Of the points of this step.
    """
    if faces.shape[0] == 0:
        return
    for c in prange(CHUNKS):
        for p in range(c * count // CHUNKS, (c + 1) * count // CHUNKS):
            keep_before_face(p, rows, keys, lowest, inside, faces, barriers, dx, report[c])
