"""The two transfers of the 3D MPM: points to grid and grid to points (design notes 4.1; MLS-MPM of Hu et al. 2018).

A block sums its points into a private tile; the grid gathers the tiles that overlap a node in a fixed order, and gives
each block a tile of velocities back. Nothing is shared between loops and every sum has a fixed order, so that results
are bitwise the same for any number of threads.
"""

from math import sqrt

import numpy as np

from ..effects.material import FAR as FAR_STRAIN
from ..effects.material import NO_TENSION
from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import CHUNKS, GONE
from .jit import jit, jit_inline, jit_parallel, prange
from .lanes import (
    get,
    lanes,
    load,
    multiply_add,
    prefetch,
    put,
    store,
    transposed,
    without_last,
)
from .point_blocks import packed
from .point_ground import GROUND_DEEP
from .point_rows import (
    AXX,
    AXY,
    AXZ,
    BLOCK,
    GHOSTS,
    INDEX_MASK,
    MASS,
    PX,
    S1,
    S2,
    S3,
    S4,
    TILE_LAYER,
    TILE_ROW,
    X,
    Y,
    Z,
    stencil,
)

# what each chunk of the grid-to-point loop reports
(
    KINETIC,  # sum of m |v|^2 / 2 [J], of those that leave in this step too
    POTENTIAL,  # sum of m g z [J], z from the domain's lowest level
    SHEAR_MAX,  # largest |C|^2 [s-2]
    SPEED2_MAX,  # [m2 s-2]
    AT_TIP,  # points without tension
    FAR,  # points whose strain left the series' range
    PLASTIC,  # work done in yielding [J]
    UNDER,  # mass lifted back onto the ground [kg]
    NOT_FINITE,  # points
    BAD_X,
    BAD_Y,
    BLOCK_WEST,
    BLOCK_SOUTH,
    BLOCK_EAST,
    BLOCK_NORTH,
    BLOCK_TALL,
    OUT,  # then the outflow ledger: per edge mass, momentum x, y, z, kinetic and potential energy, number
) = range(17)
EDGES = 4  # west, south, east, north
OUT_ENTRIES = 7
REPORT = OUT + EDGES * OUT_ENTRIES

TIP_CODE, FAR_CODE = NO_TENSION, FAR_STRAIN  # what materials say of a step
STRAINED = 14  # lines that a strain out of range writes: state and stress

# Points go through a transfer BATCH at a time: in loops over short arrays ("lines" of one scratch array), which the
# compiler turns into vector instructions; only reading and writing nodes and rows goes point by point.
BATCH = 32
(
    L_X, L_Y, L_Z, L_S0, L_PX, L_PY, L_PZ, L_MASS, L_AXX, L_AYX, L_AZX, L_S1, L_AXY, L_AYY, L_AZY, L_S2,
    L_AXZ, L_AYZ, L_AZZ, L_S3, L_S4, L_S5, L_S6, L_S7,  # as in a row
    L_FX, L_FY, L_FZ,  # offset from the first node in cells; then the place before the step
    L_WX0, L_WX1, L_WX2, L_WY0, L_WY1, L_WY2, L_WZ0, L_WZ1, L_WZ2,  # weights
    L_MX0, L_MX1, L_MX2, L_MY0, L_MY1, L_MY2, L_MZ0, L_MZ1, L_MZ2,  # weights times the offset from the point
    L_U, L_V, L_W,  # velocity read from the nodes
    L_XX, L_YX, L_ZX, L_XY, L_YY, L_ZY, L_XZ, L_YZ, L_ZZ,  # its first moments: component, then axis
    L_N0, L_N1, L_N2, L_N3, L_N4, L_N5, L_N6, L_N7,  # state after the step
    L_TXX, L_TYY, L_TZZ, L_TXY, L_TXZ, L_TYZ, L_CODE,
    L_SHEAR2, L_SPEED2,
) = range(0, 74 * BATCH, BATCH)  # fmt: skip
LINES = 74 * BATCH
QUAD = 4 * BATCH  # groups of four numbers, one group a point
QUADS = 4 * QUAD
Q_MEAN, Q_MOMENT_X, Q_MOMENT_Y, Q_MOMENT_Z = range(0, 4 * QUAD, QUAD)
# lines of whole numbers: where nodes begin in the tile; nearest node; block of the next step; 1 if the point stays
I_PLACE, I_COLUMN, I_ROW, I_BLOCK_X, I_BLOCK_Y, I_BLOCK_Z, I_STAYS = range(0, 7 * BATCH, BATCH)
INTEGERS = 7 * BATCH


@jit
def _weigh(scratch, integers, count, i_block, j_block, k_block, inverse_dx):
    """Weights of each point of the batch, its offsets in cells, and where its nodes begin in the block's tile."""
    for q in range(count):
        i, fx, wx0, wx1, wx2 = stencil(get(scratch, L_X, q), inverse_dx)
        j, fy, wy0, wy1, wy2 = stencil(get(scratch, L_Y, q), inverse_dx)
        k, fz, wz0, wz1, wz2 = stencil(get(scratch, L_Z, q), inverse_dx)
        i, j = min(max(i - i_block, 0), BLOCK - 1), min(max(j - j_block, 0), BLOCK - 1)
        k = min(max(k - k_block, 0), BLOCK - 1)
        put(integers, I_PLACE, q, k * TILE_LAYER + j * TILE_ROW + i * 4)
        put(scratch, L_FX, q, fx)
        put(scratch, L_FY, q, fy)
        put(scratch, L_FZ, q, fz)
        put(scratch, L_WX0, q, wx0)
        put(scratch, L_WX1, q, wx1)
        put(scratch, L_WX2, q, wx2)
        put(scratch, L_WY0, q, wy0)
        put(scratch, L_WY1, q, wy1)
        put(scratch, L_WY2, q, wy2)
        put(scratch, L_WZ0, q, wz0)
        put(scratch, L_WZ1, q, wz1)
        put(scratch, L_WZ2, q, wz2)


@jit
def _take_places(rows, order, first, count, end, row, scratch):
    """Copy the places of points order[first : first + count] into lines; the next batch is asked for from memory."""
    for q in range(first + BATCH, min(first + 2 * BATCH, end)):
        p = (order[q] & INDEX_MASK) * row
        prefetch(rows, p)
        prefetch(rows, p + 8)
        prefetch(rows, p + row - 1)
    for q in range(count):
        p = (order[first + q] & INDEX_MASK) * row
        put(scratch, L_X, q, get(rows, p, X))
        put(scratch, L_Y, q, get(rows, p, Y))
        put(scratch, L_Z, q, get(rows, p, Z))


@jit_inline
def _spread_one(rows, p, scratch, integers, q, tile):
    """Add a point's mass and momentum to its 27 nodes: node gets w (m v + A (x_node - x_point))."""
    t = integers[I_PLACE + q]
    along_x, along_y = without_last(load(rows, p + AXX)), without_last(load(rows, p + AXY))
    along_z = without_last(load(rows, p + AXZ))
    wx0, wx1, wx2 = get(scratch, L_WX0, q), get(scratch, L_WX1, q), get(scratch, L_WX2, q)
    corner = multiply_add(-get(scratch, L_FX, q), along_x, load(rows, p + PX))
    corner = multiply_add(-get(scratch, L_FY, q), along_y, corner)
    corner = multiply_add(-get(scratch, L_FZ, q), along_z, corner)
    for k in range(3):
        wz = get(scratch, L_WZ0 + k * BATCH, q)
        line = corner
        for j in range(3):
            w = wz * get(scratch, L_WY0 + j * BATCH, q)
            middle = multiply_add(1.0, along_x, line)
            store(tile, t, multiply_add(w * wx0, line, load(tile, t)))
            store(tile, t + 4, multiply_add(w * wx1, middle, load(tile, t + 4)))
            store(tile, t + 8, multiply_add(w * wx2, multiply_add(1.0, along_x, middle), load(tile, t + 8)))
            line = multiply_add(1.0, along_y, line)
            t += TILE_ROW
        corner = multiply_add(1.0, along_z, corner)
        t += TILE_LAYER - 3 * TILE_ROW


@jit
def _spread(rows, order, first, count, row, scratch, integers, tile):
    """Points from the two halves of the batch take turns: neighbours add to the same nodes and would wait."""
    half = (count + 1) // 2
    for q in range(half):
        _spread_one(rows, (order[first + q] & INDEX_MASK) * row, scratch, integers, q, tile)
        if q + half < count:
            _spread_one(rows, (order[first + q + half] & INDEX_MASK) * row, scratch, integers, q + half, tile)


@jit_parallel
def points_to_grid(rows, order, start, bounds, active_nodes, tiles, inverse_dx):
    """Sum mass and momentum, with the impulse of the stress, of each block's points into its tile.

    `active_nodes` int64[active, 3]: first node (x, y, z) of each active block.
    """
    row = rows.shape[1]
    for c in prange(CHUNKS):
        scratch = np.empty(LINES)
        integers = np.empty(INTEGERS, np.int64)
        for a in range(bounds[c], bounds[c + 1]):
            tile = tiles[a]
            tile[:] = 0.0
            for first in range(start[a], start[a + 1], BATCH):
                count = min(BATCH, start[a + 1] - first)
                _take_places(rows, order, first, count, order.size, row, scratch)
                _weigh(scratch, integers, count, active_nodes[a, 0], active_nodes[a, 1], active_nodes[a, 2], inverse_dx)
                _spread(rows, order, first, count, row, scratch, integers, tile)


@jit_inline
def _fill_tile(tile, nodes, targets):
    """The block's tile of velocities out of the eight node blocks that it overlaps."""
    for o in range(8):
        part = nodes[targets[o]]
        oi, oj, ok = o & 1, (o >> 1) & 1, o >> 2
        for k in range(2 if ok else BLOCK):
            for j in range(2 if oj else BLOCK):
                t = (k + BLOCK * ok) * TILE_LAYER + (j + BLOCK * oj) * TILE_ROW + BLOCK * oi * 4
                n = (k * BLOCK + j) * BLOCK * 4
                for i in range(2 if oi else BLOCK):
                    store(tile, t + 4 * i, load(part, n + 4 * i))


@jit
def _take_rows(rows, order, first, count, end, row, scratch):
    """Copy what the grid-to-point loop needs of points order[first : first + count] into lines."""
    for q in range(first + BATCH, min(first + 2 * BATCH, end)):
        p = (order[q] & INDEX_MASK) * row
        prefetch(rows, p)
        prefetch(rows, p + 8)
        prefetch(rows, p + row - 1)
    last = count - 1
    for q in range(0, count, 4):  # beyond `count` the last point once more, which nobody reads
        p0 = (order[first + q] & INDEX_MASK) * row
        p1 = (order[first + min(q + 1, last)] & INDEX_MASK) * row
        p2 = (order[first + min(q + 2, last)] & INDEX_MASK) * row
        p3 = (order[first + min(q + 3, last)] & INDEX_MASK) * row
        x, y, z, s0 = transposed(load(rows, p0), load(rows, p1), load(rows, p2), load(rows, p3))
        store(scratch, L_X + q, x)
        store(scratch, L_Y + q, y)
        store(scratch, L_Z + q, z)
        store(scratch, L_S0 + q, s0)
        if row > S4:
            s4, s5, s6, s7 = transposed(
                load(rows, p0 + S4), load(rows, p1 + S4), load(rows, p2 + S4), load(rows, p3 + S4)
            )
            store(scratch, L_S4 + q, s4)
            store(scratch, L_S5 + q, s5)
            store(scratch, L_S6 + q, s6)
            store(scratch, L_S7 + q, s7)
    for q in range(count):
        p = (order[first + q] & INDEX_MASK) * row
        put(scratch, L_MASS, q, get(rows, p, MASS))
        put(scratch, L_S1, q, get(rows, p, S1))
        put(scratch, L_S2, q, get(rows, p, S2))
        put(scratch, L_S3, q, get(rows, p, S3))


@jit
def _moments(scratch, count):
    """Weights times the offset of their node from the point, in cells."""
    for q in range(count):
        fx, fy, fz = get(scratch, L_FX, q), get(scratch, L_FY, q), get(scratch, L_FZ, q)
        put(scratch, L_MX0, q, -get(scratch, L_WX0, q) * fx)
        put(scratch, L_MX1, q, get(scratch, L_WX1, q) * (1.0 - fx))
        put(scratch, L_MX2, q, get(scratch, L_WX2, q) * (2.0 - fx))
        put(scratch, L_MY0, q, -get(scratch, L_WY0, q) * fy)
        put(scratch, L_MY1, q, get(scratch, L_WY1, q) * (1.0 - fy))
        put(scratch, L_MY2, q, get(scratch, L_WY2, q) * (2.0 - fy))
        put(scratch, L_MZ0, q, -get(scratch, L_WZ0, q) * fz)
        put(scratch, L_MZ1, q, get(scratch, L_WZ1, q) * (1.0 - fz))
        put(scratch, L_MZ2, q, get(scratch, L_WZ2, q) * (2.0 - fz))


@jit
def _read_tile(scratch, quads, integers, count, tile):
    """Mean velocity of each point's nodes, and its first moments about the point along x, y and z [m s-1 cells]."""
    nothing = lanes(0.0, 0.0, 0.0, 0.0)
    for q in range(count):
        t = integers[I_PLACE + q]
        wx0, wx1, wx2 = get(scratch, L_WX0, q), get(scratch, L_WX1, q), get(scratch, L_WX2, q)
        mx0, mx1, mx2 = get(scratch, L_MX0, q), get(scratch, L_MX1, q), get(scratch, L_MX2, q)
        mean = moment_x = moment_y = moment_z = nothing
        for k in range(3):
            layer = layer_x = layer_y = nothing
            for j in range(3):
                n0, n1, n2 = load(tile, t), load(tile, t + 4), load(tile, t + 8)
                line = multiply_add(wx0, n0, multiply_add(wx1, n1, multiply_add(wx2, n2, nothing)))
                line_x = multiply_add(mx0, n0, multiply_add(mx1, n1, multiply_add(mx2, n2, nothing)))
                wy = get(scratch, L_WY0 + j * BATCH, q)
                layer = multiply_add(wy, line, layer)
                layer_x = multiply_add(wy, line_x, layer_x)
                layer_y = multiply_add(get(scratch, L_MY0 + j * BATCH, q), line, layer_y)
                t += TILE_ROW
            wz = get(scratch, L_WZ0 + k * BATCH, q)
            mean = multiply_add(wz, layer, mean)
            moment_x = multiply_add(wz, layer_x, moment_x)
            moment_y = multiply_add(wz, layer_y, moment_y)
            moment_z = multiply_add(get(scratch, L_MZ0 + k * BATCH, q), layer, moment_z)
            t += TILE_LAYER - 3 * TILE_ROW
        store(quads, Q_MEAN + 4 * q, mean)
        store(quads, Q_MOMENT_X + 4 * q, moment_x)
        store(quads, Q_MOMENT_Y + 4 * q, moment_y)
        store(quads, Q_MOMENT_Z + 4 * q, moment_z)


@jit
def _turn_quads(scratch, quads, count):
    """Groups of four into lines: velocity, and its first moments."""
    for q in range(0, count, 4):
        _turn_quad(scratch, quads, Q_MEAN + 4 * q, L_U + q)
        _turn_quad(scratch, quads, Q_MOMENT_X + 4 * q, L_XX + q)
        _turn_quad(scratch, quads, Q_MOMENT_Y + 4 * q, L_XY + q)
        _turn_quad(scratch, quads, Q_MOMENT_Z + 4 * q, L_XZ + q)


@jit_inline
def _turn_quad(scratch, quads, group, line):
    """The first three entries of four groups into three lines."""
    a, b, c, _ = transposed(load(quads, group), load(quads, group + 4), load(quads, group + 8), load(quads, group + 12))
    store(scratch, line, a)
    store(scratch, line + BATCH, b)
    store(scratch, line + 2 * BATCH, c)


@jit
def _strain(scratch, count, turn, dt, material, softening):
    """State and stress of each point after the step: gradients are `turn` times the moments of velocity."""
    g = turn * dt
    for q in range(count):
        s0, s1, s2, s3, s4, s5, s6, s7, txx, tyy, tzz, txy, txz, tyz, code = material.stress_step(
            get(scratch, L_S0, q), get(scratch, L_S1, q), get(scratch, L_S2, q), get(scratch, L_S3, q),
            get(scratch, L_S4, q), get(scratch, L_S5, q), get(scratch, L_S6, q), get(scratch, L_S7, q),
            g * get(scratch, L_XX, q), g * get(scratch, L_XY, q), g * get(scratch, L_XZ, q),
            g * get(scratch, L_YX, q), g * get(scratch, L_YY, q), g * get(scratch, L_YZ, q),
            g * get(scratch, L_ZX, q), g * get(scratch, L_ZY, q), g * get(scratch, L_ZZ, q),
            dt, softening,
        )  # fmt: skip
        put(scratch, L_N0, q, s0)
        put(scratch, L_N1, q, s1)
        put(scratch, L_N2, q, s2)
        put(scratch, L_N3, q, s3)
        put(scratch, L_N4, q, s4)
        put(scratch, L_N5, q, s5)
        put(scratch, L_N6, q, s6)
        put(scratch, L_N7, q, s7)
        put(scratch, L_TXX, q, txx)
        put(scratch, L_TYY, q, tyy)
        put(scratch, L_TZZ, q, tzz)
        put(scratch, L_TXY, q, txy)
        put(scratch, L_TXZ, q, txz)
        put(scratch, L_TYZ, q, tyz)
        put(scratch, L_CODE, q, code)


@jit
def _strain_far(scratch, count, turn, dt, material, softening):
    """The points of the batch whose strain is too large for the series, one by one; answers how many."""
    g, far = turn * dt, 0
    for q in range(count):
        if scratch[L_CODE + q] == FAR_CODE:
            far += 1
            answer = material.stress_step_far(
                scratch[L_S0 + q], scratch[L_S1 + q], scratch[L_S2 + q], scratch[L_S3 + q],
                scratch[L_S4 + q], scratch[L_S5 + q], scratch[L_S6 + q], scratch[L_S7 + q],
                g * scratch[L_XX + q], g * scratch[L_XY + q], g * scratch[L_XZ + q],
                g * scratch[L_YX + q], g * scratch[L_YY + q], g * scratch[L_YZ + q],
                g * scratch[L_ZX + q], g * scratch[L_ZY + q], g * scratch[L_ZZ + q],
                dt, softening,
            )  # fmt: skip
            for line in range(STRAINED):
                scratch[L_N0 + line * BATCH + q] = answer[line]
    return far


@jit
def _move(scratch, count, turn, dt, next_dt, dx, density):
    """Place, momentum and affine momentum after the step, into the lines of a row.

    A = dx (m C - next_dt V0 (4 / dx^2) tau), so that a node i cells away gets w A i beside the point's own momentum.
    """
    push = next_dt * 4.0 / (dx * density)
    carry = dx * turn
    for q in range(count):
        mass = get(scratch, L_MASS, q)
        u, v, w = get(scratch, L_U, q), get(scratch, L_V, q), get(scratch, L_W, q)
        cxx, cxy, cxz = get(scratch, L_XX, q), get(scratch, L_XY, q), get(scratch, L_XZ, q)
        cyx, cyy, cyz = get(scratch, L_YX, q), get(scratch, L_YY, q), get(scratch, L_YZ, q)
        czx, czy, czz = get(scratch, L_ZX, q), get(scratch, L_ZY, q), get(scratch, L_ZZ, q)
        shear2 = cxx * cxx + cxy * cxy + cxz * cxz + cyx * cyx + cyy * cyy + cyz * cyz + czx * czx
        put(scratch, L_SHEAR2, q, shear2 + czy * czy + czz * czz)
        put(scratch, L_SPEED2, q, u * u + v * v + w * w)
        x, y, z = get(scratch, L_X, q), get(scratch, L_Y, q), get(scratch, L_Z, q)
        put(scratch, L_FX, q, x)
        put(scratch, L_FY, q, y)
        put(scratch, L_FZ, q, z)
        put(scratch, L_X, q, x + dt * u)
        put(scratch, L_Y, q, y + dt * v)
        put(scratch, L_Z, q, z + dt * w)
        put(scratch, L_PX, q, mass * u)
        put(scratch, L_PY, q, mass * v)
        put(scratch, L_PZ, q, mass * w)
        pushed, carried = push * mass, carry * mass
        txy, txz = pushed * get(scratch, L_TXY, q), pushed * get(scratch, L_TXZ, q)
        tyz = pushed * get(scratch, L_TYZ, q)
        put(scratch, L_AXX, q, carried * cxx - pushed * get(scratch, L_TXX, q))
        put(scratch, L_AYX, q, carried * cyx - txy)
        put(scratch, L_AZX, q, carried * czx - txz)
        put(scratch, L_AXY, q, carried * cxy - txy)
        put(scratch, L_AYY, q, carried * cyy - pushed * get(scratch, L_TYY, q))
        put(scratch, L_AZY, q, carried * czy - tyz)
        put(scratch, L_AXZ, q, carried * cxz - txz)
        put(scratch, L_AYZ, q, carried * cyz - tyz)
        put(scratch, L_AZZ, q, carried * czz - pushed * get(scratch, L_TZZ, q))


@jit
def _keep_in(scratch, count, dx, length_x, length_y):
    """Walls: nobody passes them by more than rounding."""
    for q in range(count):
        put(scratch, L_X, q, min(max(get(scratch, L_X, q), 1e-9 * dx), length_x - 1e-9 * dx))
        put(scratch, L_Y, q, min(max(get(scratch, L_Y, q), 1e-9 * dx), length_y - 1e-9 * dx))


@jit
def _survey(scratch, count, turn, density, gravity, mine):
    """Energies and the largest speed and |C| of the batch, into the chunk's report.

    Yielding takes q de_d a volume: q = sqrt(3/2) |dev tau|, e_d is the state's plastic strain (`effects/material`).
    """
    kinetic, potential, plastic, tip = mine[KINETIC], mine[POTENTIAL], mine[PLASTIC], mine[AT_TIP]
    fastest, shear2 = mine[SPEED2_MAX], 0.0
    for q in range(count):
        mass, speed2 = get(scratch, L_MASS, q), get(scratch, L_SPEED2, q)
        kinetic += 0.5 * mass * speed2
        potential += mass * gravity * get(scratch, L_Z, q)
        txx, tyy, tzz = get(scratch, L_TXX, q), get(scratch, L_TYY, q), get(scratch, L_TZZ, q)
        txy, txz, tyz = get(scratch, L_TXY, q), get(scratch, L_TXZ, q), get(scratch, L_TYZ, q)
        mean = (txx + tyy + tzz) / 3.0
        square = (txx - mean) * (txx - mean) + (tyy - mean) * (tyy - mean) + (tzz - mean) * (tzz - mean)
        square += 2.0 * (txy * txy + txz * txz + tyz * tyz)
        plastic += mass / density * sqrt(1.5 * square) * (get(scratch, L_N6, q) - get(scratch, L_S6, q))
        fastest = max(fastest, speed2)
        shear2 = max(shear2, get(scratch, L_SHEAR2, q))
        tip += 1.0 if get(scratch, L_CODE, q) == TIP_CODE else 0.0
    mine[KINETIC], mine[POTENTIAL], mine[PLASTIC] = kinetic, potential, plastic
    mine[AT_TIP], mine[SPEED2_MAX] = tip, fastest
    mine[SHEAR_MAX] = max(mine[SHEAR_MAX], turn * turn * shear2)


@jit
def _locate(scratch, integers, count, inverse_dx, length_x, length_y):
    """Nearest node and next block of each point; True if all are finite and within the domain."""
    within = 0
    for q in range(count):
        x, y, z = get(scratch, L_X, q), get(scratch, L_Y, q), get(scratch, L_Z, q)
        stays = (x >= 0.0) & (y >= 0.0) & (x < length_x) & (y < length_y) & (z * 0.0 == 0.0)
        put(integers, I_STAYS, q, 1)
        within += stays
        i, j, k = x * inverse_dx + GHOSTS, y * inverse_dx + GHOSTS, z * inverse_dx + GHOSTS
        put(integers, I_COLUMN, q, int(i + 0.5))
        put(integers, I_ROW, q, int(j + 0.5))
        put(integers, I_BLOCK_X, q, int(i - 0.5) // BLOCK)
        put(integers, I_BLOCK_Y, q, int(j - 0.5) // BLOCK)
        put(integers, I_BLOCK_Z, q, int(k - 0.5) // BLOCK)
    return within == count


@jit
def _book_out(scratch, integers, count, length_x, length_y, gravity, mine):
    """Book the points that left over an edge or are not finite; they wait at their last place."""
    for q in range(count):
        x, y, z = scratch[L_X + q], scratch[L_Y + q], scratch[L_Z + q]
        if (x + y + z) * 0.0 != 0.0:  # NaN or infinite
            mine[NOT_FINITE] += 1.0
            mine[BAD_X], mine[BAD_Y] = scratch[L_FX + q], scratch[L_FY + q]
            integers[I_STAYS + q] = 0
        edge = 0 if x < 0.0 else 1 if y < 0.0 else 2 if x >= length_x else 3 if y >= length_y else EDGES
        if edge < EDGES and integers[I_STAYS + q] == 1:
            out, mass = OUT + edge * OUT_ENTRIES, scratch[L_MASS + q]
            mine[out] += mass
            mine[out + 1] += scratch[L_PX + q]
            mine[out + 2] += scratch[L_PY + q]
            mine[out + 3] += scratch[L_PZ + q]
            mine[out + 4] += 0.5 * mass * scratch[L_SPEED2 + q]
            mine[out + 5] += mass * gravity * z
            mine[out + 6] += 1.0
            integers[I_STAYS + q] = 0
        if integers[I_STAYS + q] == 0:
            for line in range(3):
                scratch[L_X + line * BATCH + q] = scratch[L_FX + line * BATCH + q]


@jit
def _lift(scratch, integers, q, ground, dx, mine):
    """A point more than a cell under the ground is laid on it, and what it moves into the ground is taken from it."""
    i, j = integers[I_COLUMN + q], integers[I_ROW + q]
    slope_x, slope_y = ground[j, i, 1], ground[j, i, 2]
    x, y = scratch[L_X + q] / dx + GHOSTS, scratch[L_Y + q] / dx + GHOSTS
    west, south = min(int(x), ground.shape[1] - 2), min(int(y), ground.shape[0] - 2)
    x, y = x - west, y - south  # between four nodes: at a cliff a node's plane stands metres above the ground near by
    surface = (1.0 - y) * ((1.0 - x) * ground[south, west, 0] + x * ground[south, west + 1, 0])
    surface += y * ((1.0 - x) * ground[south + 1, west, 0] + x * ground[south + 1, west + 1, 0])
    if scratch[L_Z + q] < surface - dx:
        mine[UNDER] += scratch[L_MASS + q]
        steep = sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        nx, ny, nz = -slope_x / steep, -slope_y / steep, 1.0 / steep
        into = min(scratch[L_PX + q] * nx + scratch[L_PY + q] * ny + scratch[L_PZ + q] * nz, 0.0)
        scratch[L_PX + q] -= into * nx
        scratch[L_PY + q] -= into * ny
        scratch[L_PZ + q] -= into * nz
        scratch[L_Z + q] = surface
        integers[I_BLOCK_Z + q] = int(surface / dx + (GHOSTS - 0.5)) // BLOCK


@jit
def _give_keys(scratch, integers, keys, order, first, count, ground, lowest, dx, mine):
    """Blocks of the next step, and the window of blocks that hold points; who is under the ground is lifted."""
    last = GONE
    for q in range(count):
        p = order[first + q] & INDEX_MASK
        if integers[I_STAYS + q] == 0:
            keys[p] = GONE
            continue
        i, j = integers[I_COLUMN + q], integers[I_ROW + q]
        if scratch[L_Z + q] < ground[j, i, GROUND_DEEP]:
            _lift(scratch, integers, q, ground, dx, mine)
        row, column = integers[I_BLOCK_Y + q], integers[I_BLOCK_X + q]
        level = max(integers[I_BLOCK_Z + q] - lowest[row, column, 0], 0)
        key = packed(row, column, level)
        keys[p] = key
        if key != last:
            last = key
            x, y, tall = float(column), float(row), float(level + lowest[row, column, 1])
            mine[BLOCK_WEST], mine[BLOCK_EAST] = min(mine[BLOCK_WEST], x), max(mine[BLOCK_EAST], x)
            mine[BLOCK_SOUTH], mine[BLOCK_NORTH] = min(mine[BLOCK_SOUTH], y), max(mine[BLOCK_NORTH], y)
            mine[BLOCK_TALL] = max(mine[BLOCK_TALL], tall)


@jit
def _give_rows(rows, order, first, count, row, scratch):
    """Copy the lines into the rows of points order[first : first + count]."""
    for q in range(0, count, 4):
        _give_groups(rows, order, first, count, q, row, scratch, L_X, L_N0, X)
        _give_groups(rows, order, first, count, q, row, scratch, L_PX, L_MASS, PX)
        _give_groups(rows, order, first, count, q, row, scratch, L_AXX, L_N1, AXX)
        _give_groups(rows, order, first, count, q, row, scratch, L_AXY, L_N2, AXY)
        _give_groups(rows, order, first, count, q, row, scratch, L_AXZ, L_N3, AXZ)
        if row > S4:
            _give_groups(rows, order, first, count, q, row, scratch, L_N4, L_N7, S4)


@jit_inline
def _give_groups(rows, order, first, count, q, row, scratch, line, fourth, entry):
    """Store three lines from `line` on, and a fourth, at `entry` of the rows of up to four points from q on."""
    groups = transposed(
        load(scratch, line + q), load(scratch, line + BATCH + q), load(scratch, line + 2 * BATCH + q),
        load(scratch, fourth + q),
    )  # fmt: skip
    store(rows, (order[first + q] & INDEX_MASK) * row + entry, groups[0])
    if q + 1 < count:
        store(rows, (order[first + q + 1] & INDEX_MASK) * row + entry, groups[1])
    if q + 2 < count:
        store(rows, (order[first + q + 2] & INDEX_MASK) * row + entry, groups[2])
    if q + 3 < count:
        store(rows, (order[first + q + 3] & INDEX_MASK) * row + entry, groups[3])


@jit_parallel
def grid_to_points(
    rows, keys, order, start, bounds, active_nodes, targets, nodes, tiles, ground, lowest, report,
    dx, dt, next_dt, density, gravity, wall, length_x, length_y, material, softening,
):  # fmt: skip
    """Read the velocity field back, move the points, strain them and give them the stress of the next step.

    APIC: v_p = sum w_i v_i, C_p = 4/dx^2 sum w_i v_i (x_i - x_p)^T (Jiang et al. 2015); the deformation follows C.
    """
    inverse_dx = 1.0 / dx
    turn = 4.0 * inverse_dx
    row = rows.shape[1]
    for c in prange(CHUNKS):
        mine = report[c]
        mine[:] = 0.0
        mine[BLOCK_WEST] = mine[BLOCK_SOUTH] = 1 << 40
        mine[BLOCK_EAST] = mine[BLOCK_NORTH] = mine[BLOCK_TALL] = -1
        scratch = np.zeros(LINES)
        quads = np.empty(QUADS)
        integers = np.empty(INTEGERS, np.int64)
        for a in range(bounds[c], bounds[c + 1]):
            tile = tiles[a]
            _fill_tile(tile, nodes, targets[a])
            for first in range(start[a], start[a + 1], BATCH):
                count = min(BATCH, start[a + 1] - first)
                _take_rows(rows, order, first, count, order.size, row, scratch)
                _weigh(scratch, integers, count, active_nodes[a, 0], active_nodes[a, 1], active_nodes[a, 2], inverse_dx)
                _moments(scratch, count)
                _read_tile(scratch, quads, integers, count, tile)
                _turn_quads(scratch, quads, count)
                _strain(scratch, count, turn, dt, material, softening)
                mine[FAR] += _strain_far(scratch, count, turn, dt, material, softening)
                _move(scratch, count, turn, dt, next_dt, dx, density)
                if wall:
                    _keep_in(scratch, count, dx, length_x, length_y)
                _survey(scratch, count, turn, density, gravity, mine)
                if not _locate(scratch, integers, count, inverse_dx, length_x, length_y):
                    _book_out(scratch, integers, count, length_x, length_y, gravity, mine)
                _give_keys(scratch, integers, keys, order, first, count, ground, lowest, dx, mine)
                _give_rows(rows, order, first, count, row, scratch)
