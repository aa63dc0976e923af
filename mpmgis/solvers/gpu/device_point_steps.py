"""What the kernels of common and of rare points share: numbers of a step, the ground in short, nodes around a point.

Indices of shared arrays are unsigned: numba tests a signed one for counting from the end.
"""

from math import floor, sqrt
from typing import NamedTuple

import numpy as np
from numba import int32, int64, uint32

from ..points import point_report as entry
from ..points.point_blocks import packed
from ..points.point_edges import FAR_BLOCKS
from ..points.point_ground import GROUND_DEEP, GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y
from ..points.point_rows import AXX, AXY, AXZ, BLOCK, GHOSTS, LAST_BASE, S0, S1, S2, S3, TILE, TILE_SIZE
from .device_functions import Part, real

# numbers of a step in the precision of the points: cells per speed, (cells per speed and radius) for a velocity and its
# square, momentum per stress, length [s], and mass [kg] and squared speed of `point_edges.limit_thin`
SHIFT, GRADIENT, TURN2, PUSH, STEP, DENSE, STILL2, SCALES = range(8)
# ground of a node column: height, slopes, height below which a point is checked; heights in cells from the first ghost
PLANE, SLOPE_X, SLOPE_Y, DEEP, PLANE_ENTRIES = range(5)
# float entries of a thread's report of moved points: largest squares, the largest of a common point that stays, plastic
# work; and of rare points, energy of the limit
SHEAR, SPEED2, STAY2, PLASTIC, MARKS = range(5)
LIMITED_ENERGY, RARE_MARKS = MARKS, MARKS + 1
# int32 entries: window of blocks, points at the tip of the yield surface, index of the fastest common point that stays;
# and numbers of rare points: strained beyond the series, held there, limited, held at walls
WEST, SOUTH, EAST, NORTH, TALL, TORN, STAY, FAR, HELD, LIMITED, WALLED, RARE_COUNTS = range(12)
# a report of settled points has in addition to the entries of a report: the largest squared speed of a point that
# stays, and its index
STAY2_OF_ALL, STAY_POINT = entry.REPORT, entry.REPORT + 1
POINT_REPORT = entry.REPORT + 2
LANES = 8  # threads that copy a row
LAYER, ROW = 4 * TILE * TILE, 4 * TILE
THIRD = 1.0 / 3.0


class Domain(NamedTuple):
    """Numbers of cells, and whether there are walls on the edges."""

    cells_x: int
    cells_y: int
    wall: bool


def planes_of(ground, dx, real):
    """real[rows, columns, PLANE_ENTRIES] of the `ground` float64[rows, columns, GROUND_ENTRIES]; DEEP is rounded up."""
    planes = np.empty((*ground.shape[:2], PLANE_ENTRIES), real)
    planes[..., PLANE] = ground[..., GROUND_HEIGHT] / dx + GHOSTS
    planes[..., SLOPE_X], planes[..., SLOPE_Y] = ground[..., GROUND_SLOPE_X], ground[..., GROUND_SLOPE_Y]
    deep = (ground[..., GROUND_DEEP] / dx + GHOSTS).astype(real)
    planes[..., DEEP] = deep + 4.0 * np.spacing(np.abs(deep) + real(1.0))
    return planes


@Part
def stencil(place):
    """As `point_rows.stencil`, with the index of the first node too."""
    base = min(max(real(floor(place - 0.5)), 0.0), LAST_BASE)
    f = place - base
    return uint32(base), f, 0.5 * (1.5 - f) * (1.5 - f), 0.75 - (f - 1.0) * (f - 1.0), 0.5 * (f - 0.5) * (f - 0.5)


@Part
def cell_of(x, y, z):
    """Cell of a place in its block, from 0 to BLOCK^3 - 1: that of the first of the nodes around it."""
    i = uint32(min(max(real(floor(x - 0.5)), 0.0), LAST_BASE))
    j = uint32(min(max(real(floor(y - 0.5)), 0.0), LAST_BASE))
    k = uint32(min(max(real(floor(z - 0.5)), 0.0), LAST_BASE))
    return (k * uint32(BLOCK) + j) * uint32(BLOCK) + i


@Part
def load_tile(tile, nodes, targets, a, thread, threads):
    """Copy the nodes that points of block `a` reach into `tile`."""
    for n in range(uint32(thread), uint32(TILE_SIZE // 4), uint32(threads)):
        i, j, k = n % uint32(TILE), n // uint32(TILE) % uint32(TILE), n // uint32(TILE * TILE)
        o = i // uint32(BLOCK) + uint32(2) * (j // uint32(BLOCK)) + uint32(4) * (k // uint32(BLOCK))
        b, at = uint32(targets[uint32(a), o]), uint32(4) * n
        e = (((k % uint32(BLOCK)) * uint32(BLOCK) + j % uint32(BLOCK)) * uint32(BLOCK) + i % uint32(BLOCK)) * uint32(4)
        u, v, w, mass = nodes[b, e], nodes[b, e + uint32(1)], nodes[b, e + uint32(2)], nodes[b, e + uint32(3)]
        tile[at], tile[at + uint32(1)], tile[at + uint32(2)], tile[at + uint32(3)] = u, v, w, mass


@Part
def edges_of(column, row, domain):
    """Western, southern, eastern and northern edge of the domain [cells of the block]."""
    west, south = GHOSTS - BLOCK * column, GHOSTS - BLOCK * row
    return real(west), real(south), real(west + domain.cells_x), real(south + domain.cells_y)


@Part
def around(tile, n):
    """The three nodes from `n` of a row of the `tile`: their numbers in order."""
    a0, a1, a2, a3 = tile[n], tile[n + uint32(1)], tile[n + uint32(2)], tile[n + uint32(3)]
    b0, b1, b2, b3 = tile[n + uint32(4)], tile[n + uint32(5)], tile[n + uint32(6)], tile[n + uint32(7)]
    c0, c1, c2, c3 = tile[n + uint32(8)], tile[n + uint32(9)], tile[n + uint32(10)], tile[n + uint32(11)]
    return (a0, b0, c0), (a1, b1, c1), (a2, b2, c2), (a3, b3, c3)


@Part
def interpolated(tile, x, y, z):
    """Velocity, mass at the nodes around, and gradient [velocity per cell / 4] at a place.

    u, v, w, near, then du/dx, dv/dx, dw/dx, du/dy, ... .
    """
    i, fx, wx0, wx1, wx2 = stencil(x)
    j, fy, wy0, wy1, wy2 = stencil(y)
    k, fz, wz0, wz1, wz2 = stencil(z)
    m0, m1, m2 = -wx0 * fx, wx1 * (1.0 - fx), wx2 * (2.0 - fx)
    wy, wz = (wy0, wy1, wy2), (wz0, wz1, wz2)
    first = (k * uint32(TILE * TILE) + j * uint32(TILE) + i) * uint32(4)
    u = v = w = near = real(0.0)
    xx = yx = zx = xy = yy = zy = xz = yz = zz = real(0.0)
    for c in range(3):
        lu = lv = lw = lm = real(0.0)
        ax = ay = az = bx = by = bz = real(0.0)
        for b in range(3):
            us, vs, ws, ms = around(tile, first + uint32(c) * uint32(LAYER) + uint32(b) * uint32(ROW))
            ru = wx0 * us[0] + wx1 * us[1] + wx2 * us[2]
            rv = wx0 * vs[0] + wx1 * vs[1] + wx2 * vs[2]
            rw = wx0 * ws[0] + wx1 * ws[1] + wx2 * ws[2]
            rm = wx0 * ms[0] + wx1 * ms[1] + wx2 * ms[2]
            side, arm = wy[b], wy[b] * (real(b) - fy)
            ax += side * (m0 * us[0] + m1 * us[1] + m2 * us[2])
            ay += side * (m0 * vs[0] + m1 * vs[1] + m2 * vs[2])
            az += side * (m0 * ws[0] + m1 * ws[1] + m2 * ws[2])
            lu, lv, lw, lm = lu + side * ru, lv + side * rv, lw + side * rw, lm + side * rm
            bx, by, bz = bx + arm * ru, by + arm * rv, bz + arm * rw
        side, arm = wz[c], wz[c] * (real(c) - fz)
        u, v, w, near = u + side * lu, v + side * lv, w + side * lw, near + side * lm
        xx, yx, zx = xx + side * ax, yx + side * ay, zx + side * az
        xy, yy, zy = xy + side * bx, yy + side * by, zy + side * bz
        xz, yz, zz = xz + arm * lu, yz + arm * lv, zz + arm * lw
    return u, v, w, near, xx, yx, zx, xy, yy, zy, xz, yz, zz


@Part
def only_turning(xx, yx, zx, xy, yy, zy, xz, yz, zz):
    """The part of a gradient that turns the point without strain."""
    zero = real(0.0)
    xy, xz, yz = 0.5 * (xy - yx), 0.5 * (xz - zx), 0.5 * (yz - zy)
    return zero, -xy, -xz, xy, zero, -yz, xz, yz, zero


@Part
def keep_state(rows, p, n0, n1, n2, n3):
    """Write the first four numbers of state."""
    rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3] = n0, n1, n2, n3


@Part
def keep_affine(rows, p, carried, pushed, xx, yx, zx, xy, yy, zy, xz, yz, zz, txx, tyy, tzz, txy, txz, tyz):
    """Write the affine momentum: `carried` times the gradient less the impulse `pushed` of the stress."""
    rows[p, AXX], rows[p, AXX + 1] = carried * xx - pushed * txx, carried * yx - pushed * txy
    rows[p, AXX + 2] = carried * zx - pushed * txz
    rows[p, AXY], rows[p, AXY + 1] = carried * xy - pushed * txy, carried * yy - pushed * tyy
    rows[p, AXY + 2] = carried * zy - pushed * tyz
    rows[p, AXZ], rows[p, AXZ + 1] = carried * xz - pushed * txz, carried * yz - pushed * tyz
    rows[p, AXZ + 2] = carried * zz - pushed * tzz


@Part
def plastic_rate(txx, tyy, tzz, txy, txz, tyz):
    """Stress whose product with the plastic strain is plastic work: sqrt(3 / 2 s : s) [Pa]."""
    mean = (txx + tyy + tzz) * THIRD
    square = (txx - mean) * (txx - mean) + (tyy - mean) * (tyy - mean) + (tzz - mean) * (tzz - mean)
    return sqrt(1.5 * (square + 2.0 * (txy * txy + txz * txz + tyz * tyz)))


@Part
def blocks_away(x, y, z):
    """How many blocks a place [cells of a block] is from that block, to the east, north and up."""
    up = min(max(real(floor((z - 0.5) * 0.25)), -FAR_BLOCKS), FAR_BLOCKS)
    return int32(floor((x - 0.5) * 0.25)), int32(floor((y - 0.5) * 0.25)), int32(up)


@Part
def enter_block(p, column, row, level, z, keys, lowest):
    """Write the key of point `p`, which entered a block; its height there [cells] and how tall the window must be.

    A point below the lowest level of its column belongs to the block of that level.
    """
    new = level - lowest[row, column, 0]
    if new < 0:
        z += 4.0 * real(new)
        new = 0
    keys[p] = packed(int64(row), int64(column), int64(new))
    return z, new + lowest[row, column, 1]
