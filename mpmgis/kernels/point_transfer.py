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
from .jit import jit_borrowing, jit_parallel, kernel_part, law_function, prange
from .lanes import (
    get,
    lane,
    lanes,
    load,
    multiply_add,
    multiply_lanes,
    prefetch,
    put,
    store,
    transposed,
    without_last,
)
from .point_blocks import packed
from .point_ground import GROUND_DEEP, GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y
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
    TILE,
    TILE_LAYER,
    TILE_ROW,
    X,
    Y,
    Z,
    stencil,
)

# what each chunk of the grid-to-point loop reports
(
    SHEAR_MAX,  # largest |C|^2 [s-2]
    SPEED2_MAX,  # [m2 s-2]
    AT_TIP,  # points without tension
    FAR,  # points whose strain left the series' range
    PLASTIC,  # work done in yielding [J]
    UNDER,  # mass lifted back onto the ground [kg], and what the ground takes up of its momentum [N s]
    UNDER_X,
    UNDER_Y,
    UNDER_Z,
    UNDER_ENERGY,  # potential energy that lifting gives [J]
    LIMITED,  # points whose affine velocity was limited, and the kinetic energy that this took [J]
    LIMITED_ENERGY,
    NOT_FINITE,  # points
    BAD_X,
    BAD_Y,
    BLOCK_WEST,
    BLOCK_SOUTH,
    BLOCK_EAST,
    BLOCK_NORTH,
    BLOCK_TALL,
    UNDER_POINTS,  # points lifted back onto the ground
    HELD_STRETCH,  # points whose stretch was held to what the material bears, or that the step turned inside out
    HELD_WALL,  # points that would have passed a wall at the edge
    OUT,  # then the outflow ledger: per edge mass, momentum x, y, z, kinetic and potential energy, number
) = range(24)
EDGES = 5  # west, south, east, north, nodata
OUT_ENTRIES = 7
REPORT = OUT + EDGES * OUT_ENTRIES

TIP_CODE, FAR_CODE = NO_TENSION, FAR_STRAIN  # what materials say of a step
STRAINED = 14  # lines that a strain out of range writes: state and stress

# Points go through a transfer BATCH at a time: in loops over short arrays ("lines" of one scratch array), which the
# compiler turns into vector instructions without a remainder, for they always run over the whole BATCH: where a block
# has fewer points left, its last one is computed again and again. Only reading and writing nodes and rows goes point by
# point.
BATCH = 32
(
    L_X, L_Y, L_Z, L_S0, L_PX, L_PY, L_PZ, L_MASS, L_AXX, L_AYX, L_AZX, L_S1, L_AXY, L_AYY, L_AZY, L_S2,
    L_AXZ, L_AYZ, L_AZZ, L_S3, L_S4, L_S5, L_S6, L_S7,  # as in a row
    L_FX, L_FY, L_FZ,  # offset from the first node; then the place before the step
    L_WX0, L_WX1, L_WX2, L_WY0, L_WY1, L_WY2, L_WZ0, L_WZ1, L_WZ2,  # weights
    L_MX0, L_MX1, L_MX2, L_MY0, L_MY1, L_MY2, L_MZ0, L_MZ1, L_MZ2,  # weights times the offset from the point
    L_U, L_V, L_W, L_NEAR,  # velocity read from the nodes, and their mass
    L_XX, L_YX, L_ZX, L_XY, L_YY, L_ZY, L_XZ, L_YZ, L_ZZ,  # its first moments: component, then axis
    L_N0, L_N1, L_N2, L_N3, L_N4, L_N5, L_N6, L_N7,  # state after the step
    L_TXX, L_TYY, L_TZZ, L_TXY, L_TXZ, L_TYZ, L_CODE,
    L_SPEED2, L_AFFINE2, L_SHEAR_MOST, L_SPEED_MOST, L_TORN, L_YIELDED,  # the last four gather over a chunk's batches
) = range(0, 79 * BATCH, BATCH)  # fmt: skip
LINES = 79 * BATCH
QUAD = 4 * BATCH  # groups of four numbers, one group a point
QUADS = 4 * QUAD
Q_MEAN, Q_MOMENT_X, Q_MOMENT_Y, Q_MOMENT_Z = range(0, 4 * QUAD, QUAD)
# lines of whole numbers: where nodes begin in the tile; nearest node, from the block's first; by how many blocks it
# moves; 1 if the point stays
I_PLACE, I_COLUMN, I_ROW, I_BLOCK_X, I_BLOCK_Y, I_BLOCK_Z, I_STAYS = range(0, 7 * BATCH, BATCH)
INTEGERS = 7 * BATCH
FAR_BLOCKS = 1e5  # further in one step nobody moves; keeps whole numbers whole
# The affine velocity of a point is limited where the grid has less than THIN of the material's density around it, it
# exceeds STILL of the speed of pressure waves at half a cell, and the velocities of the nodes are not linear: more than
# BENT of their variance about the point's is not in it.
THIN, STILL, BENT = 0.75, 1e-3, 0.02
INSIDE = 1e-6  # cells from a wall to who is pushed against it: what single precision resolves
# as floats, for products with floats
FLOAT_LAYER, FLOAT_ROW, FLOAT_BLOCK = float(TILE_LAYER), float(TILE_ROW), float(BLOCK)
THIRD = 1.0 / 3.0


@kernel_part
def _weigh(scratch, integers):
    """Weights of each point of the batch, its offsets in cells, and where its nodes begin in the block's tile."""
    for q in range(BATCH):
        i, fx, wx0, wx1, wx2 = stencil(get(scratch, L_X, q))
        j, fy, wy0, wy1, wy2 = stencil(get(scratch, L_Y, q))
        k, fz, wz0, wz1, wz2 = stencil(get(scratch, L_Z, q))
        put(integers, I_PLACE, q, np.int32(k * FLOAT_LAYER + j * FLOAT_ROW + i * 4.0))
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


@kernel_part
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


law_function(_spread_one)


@kernel_part
def _spread(rows, order, first, count, row, scratch, integers, tile):
    """Points from the two halves of the batch take turns: neighbours add to the same nodes and would wait."""
    half = (count + 1) // 2
    for q in range(half):
        _spread_one(rows, (order[first + q] & INDEX_MASK) * row, scratch, integers, q, tile)
        if q + half < count:
            _spread_one(rows, (order[first + q + half] & INDEX_MASK) * row, scratch, integers, q + half, tile)


@jit_borrowing
def _sum_blocks(rows, order, start, first_block, end_block, tiles, scratch, integers):
    """Sum the points of the active blocks `first_block` to `end_block` into their tiles."""
    row = rows.shape[1]
    for a in range(first_block, end_block):
        tile = tiles[a]
        tile[:] = 0.0
        for first in range(start[a], start[a + 1], BATCH):
            count = min(BATCH, start[a + 1] - first)
            _take_places(rows, order, first, count, order.size, row, scratch)
            _weigh(scratch, integers)
            _spread(rows, order, first, count, row, scratch, integers, tile)


@jit_parallel
def points_to_grid(rows, order, start, bounds, tiles):
    """Sum mass and momentum, with the impulse of the stress, of each block's points into its tile."""
    for c in prange(CHUNKS):
        scratch, integers = np.zeros(LINES, rows.dtype), np.zeros(INTEGERS, np.int32)
        _sum_blocks(rows, order, start, bounds[c], bounds[c + 1], tiles, scratch, integers)


@kernel_part
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


@kernel_part
def _take_rows(rows, order, first, count, end, row, scratch):
    """Copy what the grid-to-point loop needs of points order[first : first + count] into lines."""
    for q in range(first + BATCH, min(first + 2 * BATCH, end)):
        p = (order[q] & INDEX_MASK) * row
        prefetch(rows, p)
        prefetch(rows, p + 8)
        prefetch(rows, p + row - 1)
    last = count - 1
    for q in range(0, BATCH, 4):  # beyond `count` the last point once more
        p0 = (order[first + min(q, last)] & INDEX_MASK) * row
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
    for q in range(BATCH):
        p = (order[first + min(q, last)] & INDEX_MASK) * row
        put(scratch, L_MASS, q, get(rows, p, MASS))
        put(scratch, L_S1, q, get(rows, p, S1))
        put(scratch, L_S2, q, get(rows, p, S2))
        put(scratch, L_S3, q, get(rows, p, S3))


@kernel_part
def _moments(scratch):
    """Weights times the offset of their node from the point, in cells."""
    for q in range(BATCH):
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


@kernel_part
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


@kernel_part
def _turn_quads(scratch, quads, count):
    """Groups of four into lines: velocity, and its first moments; beyond `count` the last point's."""
    for q in range(count, BATCH):
        for group in range(4):
            store(quads, group * QUAD + 4 * q, load(quads, group * QUAD + 4 * (count - 1)))
    for q in range(0, BATCH, 4):
        near = _turn_quad(scratch, quads, Q_MEAN + 4 * q, L_U + q)
        store(scratch, L_NEAR + q, near)
        _turn_quad(scratch, quads, Q_MOMENT_X + 4 * q, L_XX + q)
        _turn_quad(scratch, quads, Q_MOMENT_Y + 4 * q, L_XY + q)
        _turn_quad(scratch, quads, Q_MOMENT_Z + 4 * q, L_XZ + q)


@kernel_part
def _turn_quad(scratch, quads, group, line):
    """The first three entries of four groups into three lines; answers the fourth ones."""
    a, b, c, d = transposed(load(quads, group), load(quads, group + 4), load(quads, group + 8), load(quads, group + 12))
    store(scratch, line, a)
    store(scratch, line + BATCH, b)
    store(scratch, line + 2 * BATCH, c)
    return d


@kernel_part
def _strain(scratch, turn, dt, material, softening):
    """State and stress of each point after the step: gradients are `turn` times the moments of velocity."""
    g = turn * dt
    for q in range(BATCH):
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


@kernel_part
def _strain_far(scratch, count, turn, dt, material, softening, mine):
    """The points of the batch whose strain is too large for the series, one by one; how many go to the report."""
    g, far = turn * dt, 0
    for q in range(count):
        far += get(scratch, L_CODE, q) == FAR_CODE
    if far == 0:
        return
    mine[FAR] += far
    for q in range(count):
        if scratch[L_CODE + q] == FAR_CODE:
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
            mine[HELD_STRETCH] += answer[STRAINED] == FAR_CODE


@kernel_part
def _keep_turning(scratch):
    """Leave of the velocities' first moments the antisymmetric part."""
    for q in range(BATCH):
        xy, yx = get(scratch, L_XY, q), get(scratch, L_YX, q)
        xz, zx = get(scratch, L_XZ, q), get(scratch, L_ZX, q)
        yz, zy = get(scratch, L_YZ, q), get(scratch, L_ZY, q)
        put(scratch, L_XX, q, 0.0)
        put(scratch, L_YY, q, 0.0)
        put(scratch, L_ZZ, q, 0.0)
        put(scratch, L_XY, q, 0.5 * (xy - yx))
        put(scratch, L_YX, q, 0.5 * (yx - xy))
        put(scratch, L_XZ, q, 0.5 * (xz - zx))
        put(scratch, L_ZX, q, 0.5 * (zx - xz))
        put(scratch, L_YZ, q, 0.5 * (yz - zy))
        put(scratch, L_ZY, q, 0.5 * (zy - yz))


@kernel_part
def _move(scratch, count, turn, step, push, carry):
    """Place, momentum and affine momentum after the step, into the lines of a row.

    A = dx (m C - next_dt V0 (4 / dx^2) tau), so that a node i cells away gets w A i beside the point's own momentum.
    """
    for q in range(BATCH):
        mass = get(scratch, L_MASS, q)
        u, v, w = get(scratch, L_U, q), get(scratch, L_V, q), get(scratch, L_W, q)
        cxx, cxy, cxz = get(scratch, L_XX, q), get(scratch, L_XY, q), get(scratch, L_XZ, q)
        cyx, cyy, cyz = get(scratch, L_YX, q), get(scratch, L_YY, q), get(scratch, L_YZ, q)
        czx, czy, czz = get(scratch, L_ZX, q), get(scratch, L_ZY, q), get(scratch, L_ZZ, q)
        shear2 = cxx * cxx + cxy * cxy + cxz * cxz + cyx * cyx + cyy * cyy + cyz * cyz + czx * czx
        shear2 += czy * czy + czz * czz
        put(scratch, L_AFFINE2, q, 4.0 * shear2)
        shear2 *= turn * turn
        speed2 = u * u + v * v + w * w
        put(scratch, L_SPEED2, q, speed2)
        put(scratch, L_SHEAR_MOST, q, max(get(scratch, L_SHEAR_MOST, q), shear2))
        put(scratch, L_SPEED_MOST, q, max(get(scratch, L_SPEED_MOST, q), speed2))
        torn = 1.0 if (get(scratch, L_CODE, q) == TIP_CODE) & (q < count) else 0.0
        put(scratch, L_TORN, q, get(scratch, L_TORN, q) + torn)
        x, y, z = get(scratch, L_X, q), get(scratch, L_Y, q), get(scratch, L_Z, q)
        put(scratch, L_FX, q, x)
        put(scratch, L_FY, q, y)
        put(scratch, L_FZ, q, z)
        put(scratch, L_X, q, x + step * u)
        put(scratch, L_Y, q, y + step * v)
        put(scratch, L_Z, q, z + step * w)
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


@kernel_part
def _limit_thin(
    scratch, quads, integers, count, tile, block, ground, dx, dense, still, carry, wall, west, south, east, north, mine
):  # fmt: skip
    """Limit the affine velocity of the batch's points in thin sheets and at free surfaces.

    These have nodes of less than the mass `dense` [kg] around them, where what lies beyond the ground and, with `wall`,
    beyond the edges of the domain counts as full.
    """
    thin = 0
    for q in range(BATCH):
        thin += (get(scratch, L_NEAR, q) < dense) & (get(scratch, L_AFFINE2, q) > still)
    if thin == 0:
        return
    for q in range(count):
        if scratch[L_NEAR + q] < dense and scratch[L_AFFINE2 + q] > still:
            x, y = float(scratch[L_FX + q]), float(scratch[L_FY + q])
            filled = _filled(_above_ground(x, y, float(scratch[L_FZ + q]), block, ground, dx))
            if wall:
                filled *= _filled(x - west) * _filled(y - south) * _filled(east - x) * _filled(north - y)
            if scratch[L_NEAR + q] < dense * filled:
                _limit_one(scratch, quads, integers, q, tile, carry, mine)


@kernel_part
def _above_ground(x, y, z, block, ground, dx):
    """Distance of a place in a block to the plane of the ground at its nearest node, in cells."""
    i, j = int(x + 0.5) + block[0] * BLOCK, int(y + 0.5) + block[1] * BLOCK
    slope_x, slope_y = ground[j, i, GROUND_SLOPE_X], ground[j, i, GROUND_SLOPE_Y]
    surface = ground[j, i, GROUND_HEIGHT] / dx + slope_x * (x + block[0] * BLOCK - i)
    surface += slope_y * (y + block[1] * BLOCK - j)
    return (z + block[2] * BLOCK - GHOSTS - surface) / sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)


@kernel_part
def _filled(distance):
    """Share of the full mass that a point's nodes have around it, `distance` [cells] from the face of a half-space.

    That is the integral of a quintic B-spline, to 0.01.
    """
    d = min(max(distance, 0.0), 1.8)
    return min(0.5 + d * (0.58 - 0.16 * d), 1.0)


@kernel_part
def _limit_one(scratch, quads, integers, q, tile, carry, mine):
    """Scale the affine momentum of a point by R^8, R^2 the share of the variance of its nodes' velocities in it.

    The variance is sum w |v_i - v_p|^2, that of the affine velocity dx^2 |C|^2 / 4. They are equal in a linear field.
    """
    affine = float(scratch[L_AFFINE2 + q])
    share = affine / _variance(scratch, quads, integers, q, tile)
    if share < 1.0 - BENT:
        kept = share * share * share * share
        mass = float(scratch[L_MASS + q])
        taken = (1.0 - kept) * float(carry) * mass
        for k in range(3):
            for line in range(3):
                a, m = L_AXX + (4 * k + line) * BATCH + q, L_XX + (3 * k + line) * BATCH + q
                scratch[a] -= taken * float(scratch[m])
        mine[LIMITED] += 1.0
        mine[LIMITED_ENERGY] += 0.5 * mass * affine * (1.0 - kept * kept)


@kernel_part
def _variance(scratch, quads, integers, q, tile):
    """Weighted variance of the velocities of a point's nodes about its own [m2 s-2]."""
    t = integers[I_PLACE + q]
    own, square = load(quads, Q_MEAN + 4 * q), lanes(0.0, 0.0, 0.0, 0.0)
    wx0, wx1, wx2 = get(scratch, L_WX0, q), get(scratch, L_WX1, q), get(scratch, L_WX2, q)
    for k in range(3):
        for j in range(3):
            w = get(scratch, L_WZ0 + k * BATCH, q) * get(scratch, L_WY0 + j * BATCH, q)
            d0, d1 = multiply_add(-1.0, own, load(tile, t)), multiply_add(-1.0, own, load(tile, t + 4))
            d2 = multiply_add(-1.0, own, load(tile, t + 8))
            line = multiply_lanes(d0, d0, wx0, lanes(0.0, 0.0, 0.0, 0.0))
            line = multiply_lanes(d2, d2, wx2, multiply_lanes(d1, d1, wx1, line))
            square = multiply_add(w, line, square)
            t += TILE_ROW
        t += TILE_LAYER - 3 * TILE_ROW
    return float(lane(square, 0)) + float(lane(square, 1)) + float(lane(square, 2))


@kernel_part
def _yield_work(scratch, count):
    """Add the work of yielding, q de_d a volume, times the density: q = sqrt(3/2) |dev tau|, e_d is in the state."""
    for q in range(BATCH):
        txx, tyy, tzz = get(scratch, L_TXX, q), get(scratch, L_TYY, q), get(scratch, L_TZZ, q)
        txy, txz, tyz = get(scratch, L_TXY, q), get(scratch, L_TXZ, q), get(scratch, L_TYZ, q)
        mean = (txx + tyy + tzz) * THIRD
        square = (txx - mean) * (txx - mean) + (tyy - mean) * (tyy - mean) + (tzz - mean) * (tzz - mean)
        square += 2.0 * (txy * txy + txz * txz + tyz * tyz)
        mass = get(scratch, L_MASS, q) if q < count else 0.0
        work = mass * sqrt(1.5 * square) * (get(scratch, L_N6, q) - get(scratch, L_S6, q))
        put(scratch, L_YIELDED, q, get(scratch, L_YIELDED, q) + work)


@kernel_part
def _keep_in(scratch, count, west, south, east, north):
    """Walls: nobody passes them by more than rounding; answers how many were held."""
    held = 0
    for q in range(BATCH):
        x, y = get(scratch, L_X, q), get(scratch, L_Y, q)
        passed = (x < west + INSIDE) | (x > east - INSIDE) | (y < south + INSIDE) | (y > north - INSIDE)
        held += passed & (q < count)
        put(scratch, L_X, q, min(max(x, west + INSIDE), east - INSIDE))
        put(scratch, L_Y, q, min(max(y, south + INSIDE), north - INSIDE))
    return held


@kernel_part
def _all_within(scratch, integers, west, south, east, north):
    """True if all points are finite and within the domain, whose edges are given in cells from the block's."""
    within = 0
    for q in range(BATCH):
        x, y, z = get(scratch, L_X, q), get(scratch, L_Y, q), get(scratch, L_Z, q)
        within += (x >= west) & (y >= south) & (x < east) & (y < north) & (z * 0.0 == 0.0)
        put(integers, I_STAYS, q, np.int32(1))
    return within == BATCH


@kernel_part
def _settle(scratch, integers):
    """Nearest node of each point, and its place in the block that it comes to."""
    for q in range(BATCH):
        x, y, z = get(scratch, L_X, q), get(scratch, L_Y, q), get(scratch, L_Z, q)
        put(integers, I_COLUMN, q, np.int32(np.floor(x + 0.5)))
        put(integers, I_ROW, q, np.int32(np.floor(y + 0.5)))
        i, j, k = np.floor((x - 0.5) * 0.25), np.floor((y - 0.5) * 0.25), np.floor((z - 0.5) * 0.25)
        k = min(max(k, -FAR_BLOCKS), FAR_BLOCKS)
        put(integers, I_BLOCK_X, q, np.int32(i))
        put(integers, I_BLOCK_Y, q, np.int32(j))
        put(integers, I_BLOCK_Z, q, np.int32(k))
        put(scratch, L_X, q, x - FLOAT_BLOCK * i)
        put(scratch, L_Y, q, y - FLOAT_BLOCK * j)
        put(scratch, L_Z, q, z - FLOAT_BLOCK * k)


@kernel_part
def _book_out(scratch, integers, count, block, inside, west, south, east, north, dx, gravity, mine):
    """Book the points that left over an edge or onto nodata, or are not finite; they wait at their last place."""
    for q in range(count):
        x, y, z = scratch[L_X + q], scratch[L_Y + q], scratch[L_Z + q]
        if (x + y + z) * 0.0 != 0.0:  # NaN or infinite
            mine[NOT_FINITE] += 1.0
            mine[BAD_X] = (scratch[L_FX + q] + (block[0] * BLOCK - GHOSTS)) * dx
            mine[BAD_Y] = (scratch[L_FY + q] + (block[1] * BLOCK - GHOSTS)) * dx
            integers[I_STAYS + q] = 0
        edge = 0 if x < west else 1 if y < south else 2 if x >= east else 3 if y >= north else EDGES
        if edge == EDGES and integers[I_STAYS + q] == 1 and inside[int(y - south), int(x - west)] == 0:
            edge = EDGES - 1
        if edge < EDGES and integers[I_STAYS + q] == 1:
            out, mass = OUT + edge * OUT_ENTRIES, float(scratch[L_MASS + q])
            mine[out] += mass
            mine[out + 1] += scratch[L_PX + q]
            mine[out + 2] += scratch[L_PY + q]
            mine[out + 3] += scratch[L_PZ + q]
            mine[out + 4] += 0.5 * mass * scratch[L_SPEED2 + q]
            mine[out + 5] += mass * gravity * ((z + (block[2] * BLOCK - GHOSTS)) * dx)
            mine[out + 6] += 1.0
            integers[I_STAYS + q] = 0
        if integers[I_STAYS + q] == 0:
            for line in range(3):
                scratch[L_X + line * BATCH + q] = scratch[L_FX + line * BATCH + q]


@kernel_part
def _lift(scratch, integers, q, block, ground, dx, gravity, mine):
    """A point more than a cell under the ground is laid on it, and what it moves into the ground is taken from it."""
    i, j = integers[I_COLUMN + q] + block[0] * BLOCK, integers[I_ROW + q] + block[1] * BLOCK
    slope_x, slope_y = ground[j, i, GROUND_SLOPE_X], ground[j, i, GROUND_SLOPE_Y]
    x = float(scratch[L_X + q]) + (block[0] + integers[I_BLOCK_X + q]) * BLOCK
    y = float(scratch[L_Y + q]) + (block[1] + integers[I_BLOCK_Y + q]) * BLOCK
    level = block[2] + integers[I_BLOCK_Z + q]
    west, south = min(int(x), ground.shape[1] - 2), min(int(y), ground.shape[0] - 2)
    x, y = x - west, y - south  # between four nodes: at a cliff a node's plane stands metres above the ground near by
    surface = (1.0 - y) * ((1.0 - x) * ground[south, west, GROUND_HEIGHT] + x * ground[south, west + 1, GROUND_HEIGHT])
    surface += y * ((1.0 - x) * ground[south + 1, west, GROUND_HEIGHT] + x * ground[south + 1, west + 1, GROUND_HEIGHT])
    height = (float(scratch[L_Z + q]) + (level * BLOCK - GHOSTS)) * dx
    if height < surface - dx:
        mine[UNDER] += scratch[L_MASS + q]
        mine[UNDER_POINTS] += 1.0
        mine[UNDER_ENERGY] += float(scratch[L_MASS + q]) * gravity * (surface - height)
        steep = sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        nx, ny, nz = -slope_x / steep, -slope_y / steep, 1.0 / steep
        into = min(scratch[L_PX + q] * nx + scratch[L_PY + q] * ny + scratch[L_PZ + q] * nz, 0.0)
        scratch[L_PX + q] -= into * nx
        scratch[L_PY + q] -= into * ny
        scratch[L_PZ + q] -= into * nz
        mine[UNDER_X] -= into * nx
        mine[UNDER_Y] -= into * ny
        mine[UNDER_Z] -= into * nz
        up = surface / dx + GHOSTS
        level = int(up - 0.5) // BLOCK
        integers[I_BLOCK_Z + q] = level - block[2]
        scratch[L_Z + q] = up - level * BLOCK


@kernel_part
def _give_keys(scratch, integers, keys, order, first, count, block, ground, lowest, dx, deepest, gravity, mine):
    """Blocks of the next step for those that leave theirs, which widen the window; who is under the ground is lifted.

    `deepest` [cells from the block's] is where in the block one may be under the ground at all.
    """
    for q in range(count):
        p = order[first + q] & INDEX_MASK
        if integers[I_STAYS + q] == 0:
            keys[p] = GONE
            continue
        if scratch[L_Z + q] + integers[I_BLOCK_Z + q] * FLOAT_BLOCK < deepest:
            i, j = integers[I_COLUMN + q] + block[0] * BLOCK, integers[I_ROW + q] + block[1] * BLOCK
            level = block[2] + integers[I_BLOCK_Z + q]
            if (float(scratch[L_Z + q]) + (level * BLOCK - GHOSTS)) * dx < ground[j, i, GROUND_DEEP]:
                _lift(scratch, integers, q, block, ground, dx, gravity, mine)
        if integers[I_BLOCK_X + q] | integers[I_BLOCK_Y + q] | integers[I_BLOCK_Z + q]:
            column, row = block[0] + integers[I_BLOCK_X + q], block[1] + integers[I_BLOCK_Y + q]
            level = block[2] + integers[I_BLOCK_Z + q] - lowest[row, column, 0]
            if level < 0:
                scratch[L_Z + q] += FLOAT_BLOCK * level
                level = 0
            keys[p] = packed(row, column, level)
            _widen(mine, row, column, level + lowest[row, column, 1])


@kernel_part
def _widen(mine, row, column, tall):
    """Let the chunk's window include a block that reaches `tall` blocks above the ground's lowest near it."""
    mine[BLOCK_WEST], mine[BLOCK_EAST] = min(mine[BLOCK_WEST], float(column)), max(mine[BLOCK_EAST], float(column))
    mine[BLOCK_SOUTH], mine[BLOCK_NORTH] = min(mine[BLOCK_SOUTH], float(row)), max(mine[BLOCK_NORTH], float(row))
    mine[BLOCK_TALL] = max(mine[BLOCK_TALL], float(tall))


@kernel_part
def _give_rows(rows, order, first, count, row, scratch):
    """Copy the lines into the rows of points order[first : first + count]."""
    last = count - 1
    for q in range(0, count, 4):
        # beyond `count` the last point again: its own numbers are stored after what stands in the lines there
        p0 = (order[first + q] & INDEX_MASK) * row
        p1 = (order[first + min(q + 1, last)] & INDEX_MASK) * row
        p2 = (order[first + min(q + 2, last)] & INDEX_MASK) * row
        p3 = (order[first + min(q + 3, last)] & INDEX_MASK) * row
        for group in range(6 if row > S4 else 5):
            line, fourth = _lines_of_group(group)
            a, b, c, d = transposed(
                load(scratch, line + q), load(scratch, line + BATCH + q), load(scratch, line + 2 * BATCH + q),
                load(scratch, fourth + q),
            )  # fmt: skip
            store(rows, p3 + 4 * group, d)
            store(rows, p2 + 4 * group, c)
            store(rows, p1 + 4 * group, b)
            store(rows, p0 + 4 * group, a)


@kernel_part
def _lines_of_group(group):
    """Where the first three numbers and the fourth of a group of four in a row stand in the lines."""
    line = L_X + group * 4 * BATCH
    fourth = L_MASS
    if group == 0:
        fourth = L_N0
    elif group == 2:
        fourth = L_N1
    elif group == 3:
        fourth = L_N2
    elif group == 4:
        fourth = L_N3
    elif group == 5:
        line, fourth = L_N4, L_N7
    return line, fourth


@jit_borrowing
def _advance_blocks(
    rows, keys, order, start, first_block, end_block, blocks, targets, nodes, tiles, ground, lowest, inside, mine,
    scratch, quads, integers, dx, dt, next_dt, density, signal_speed, gravity, wall, holes, cells_x, cells_y, material,
    softening, transfer,
):  # fmt: skip
    """`grid_to_points` for the active blocks `first_block` to `end_block`."""
    row, real = rows.shape[1], scratch.dtype.type
    turn, time_step, step = real(4.0 / dx), real(dt), real(dt / dx)
    push, carry = real(next_dt * 4.0 / (dx * density)), real(4.0)
    dense, still = real(THIN * density * dx * dx * dx), real((STILL * signal_speed) ** 2)
    for a in range(first_block, end_block):
        tile, block = tiles[a], blocks[a]
        _fill_tile(tile, nodes, targets[a])
        west, south = real(GHOSTS - BLOCK * block[0]), real(GHOSTS - BLOCK * block[1])
        east, north = real(GHOSTS - BLOCK * block[0] + cells_x), real(GHOSTS - BLOCK * block[1] + cells_y)
        deepest = real(_deepest(ground, block, dx))
        _widen(mine, block[1], block[0], block[2] - lowest[block[1], block[0], 0] + lowest[block[1], block[0], 1])
        for first in range(start[a], start[a + 1], BATCH):
            count = min(BATCH, start[a + 1] - first)
            _take_rows(rows, order, first, count, order.size, row, scratch)
            _weigh(scratch, integers)
            _moments(scratch)
            _read_tile(scratch, quads, integers, count, tile)
            _turn_quads(scratch, quads, count)
            _strain(scratch, turn, time_step, material, softening)
            _strain_far(scratch, count, turn, time_step, material, softening, mine)
            if transfer.only_turns():
                _keep_turning(scratch)
            _move(scratch, count, turn, step, push, carry)
            _limit_thin(
                scratch, quads, integers, count, tile, block, ground, dx, dense, still, carry, wall, west, south, east,
                north, mine,
            )  # fmt: skip
            if row > S4:
                _yield_work(scratch, count)
            if wall:
                mine[HELD_WALL] += _keep_in(scratch, count, west, south, east, north)
            if not _all_within(scratch, integers, west, south, east, north) or holes:
                _book_out(scratch, integers, count, block, inside, west, south, east, north, dx, gravity, mine)
            _settle(scratch, integers)
            _give_keys(scratch, integers, keys, order, first, count, block, ground, lowest, dx, deepest, gravity, mine)
            _give_rows(rows, order, first, count, row, scratch)


@jit_borrowing
def _deepest(ground, block, dx):
    """Place above the block [cells from its own] beneath which a point near it may be under the ground."""
    deep = -np.inf
    for j in range(max(block[1] * BLOCK, 0), min(block[1] * BLOCK + TILE, ground.shape[0])):
        for i in range(max(block[0] * BLOCK, 0), min(block[0] * BLOCK + TILE, ground.shape[1])):
            deep = max(deep, ground[j, i, GROUND_DEEP])
    return deep / dx + (GHOSTS - BLOCK * block[2]) + INSIDE


@jit_parallel
def grid_to_points(
    rows, keys, order, start, bounds, blocks, targets, nodes, tiles, ground, lowest, inside, report,
    dx, dt, next_dt, density, signal_speed, gravity, wall, holes, cells_x, cells_y, material, softening,
    transfer,
):  # fmt: skip
    """Read the velocity field back, move the points, strain them and give them the stress of the next step.

    APIC: v_p = sum w_i v_i, C_p = 4/dx^2 sum w_i v_i (x_i - x_p)^T (Jiang et al. 2015); the deformation follows C.
    In thin sheets and at free surfaces a limited C is carried on where the nodes' velocities are not linear.
    Points that leave over an edge or into a cell without elevation, `inside` uint8[cells_y, cells_x] = 0 (looked for
    only with `holes`), go to the ledger. `blocks` int32[active, 3] are the active blocks' places (x, y, z); `material`
    and `softening` have parameters of the rows' precision.
    """
    for c in prange(CHUNKS):
        mine = report[c]
        mine[:] = 0.0
        mine[BLOCK_WEST] = mine[BLOCK_SOUTH] = 1 << 40
        mine[BLOCK_EAST] = mine[BLOCK_NORTH] = mine[BLOCK_TALL] = -1
        scratch, quads = np.zeros(LINES, rows.dtype), np.zeros(QUADS, rows.dtype)
        integers = np.zeros(INTEGERS, np.int32)
        _advance_blocks(
            rows, keys, order, start, bounds[c], bounds[c + 1], blocks, targets, nodes, tiles, ground, lowest, inside,
            mine, scratch, quads, integers, dx, dt, next_dt, density, signal_speed, gravity, wall, holes, cells_x,
            cells_y, material, softening, transfer,
        )  # fmt: skip
        for q in range(BATCH):
            mine[SHEAR_MAX] = max(mine[SHEAR_MAX], scratch[L_SHEAR_MOST + q])
            mine[SPEED2_MAX] = max(mine[SPEED2_MAX], scratch[L_SPEED_MOST + q])
            mine[AT_TIP] += scratch[L_TORN + q]
            mine[PLASTIC] += scratch[L_YIELDED + q] / density
