"""Numbers of a step, the ground in short, nodes around a point: for kernels of common and of rare points.

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

# numbers of a step, in the precision of the points
SHIFT = 0  # [s m-1] motion in cells per velocity, dt / dx
GRADIENT = 1  # [s m-1] strain of the step per first moment of the velocity, 4 dt / dx
TURN2 = 2  # [m-2] squared gradient of the velocity per squared first moment, 16 / dx^2
PUSH = 3  # [s m2 kg-1] affine momentum of the next step per stress and mass, 4 dt / (dx rho)
STEP = 4  # [s] its length
DENSE = 5  # [kg] mass of the nodes around a point below which `affine_limit.limit_thin` may act
STILL2 = 6  # [m2 s-2] squared affine velocity above which it may act
SCALES = 7
# ground of a node column, heights in cells from the first ghost
PLANE = 0  # [cells] height
SLOPE_X = 1
SLOPE_Y = 2
DEEP = 3  # [cells] height below which a point is checked
PLANE_ENTRIES = 4
# float entries of a thread's report of moved points
SHEAR = 0  # [s-2] largest squared gradient of the velocity
SPEED2 = 1  # [m2 s-2] largest squared speed
STAY2 = 2  # [m2 s-2] largest squared speed of a common point that stays
PLASTIC = 3  # [J kg m-3] plastic work times the density
MARKS = 4  # entries of common points
LIMITED_ENERGY = 4  # [J] of rare points: energy that the limit of the affine velocity removed
RARE_MARKS = 5
# int32 entries of it
WEST = 0  # window of blocks
SOUTH = 1
EAST = 2
NORTH = 3
TALL = 4
TORN = 5  # points at the tip of the yield surface
STAY = 6  # index of the fastest common point that stays
FAR = 7  # rare points whose strain exceeds the range of the series
HELD = 8  # of these, points whose stretch was limited
LIMITED = 9  # rare points whose affine velocity was limited
WALLED = 10  # rare points held at walls
RARE_COUNTS = 11
# entries that a report of settled points has in addition to those of `point_report`
STAY2_OF_ALL = entry.REPORT  # [m2 s-2] largest squared speed of a point that stays
STAY_POINT = entry.REPORT + 1  # index of that point
POINT_REPORT = entry.REPORT + 2
LANES = 8  # threads that copy a row
LAYER, ROW = 4 * TILE * TILE, 4 * TILE  # numbers of a layer and of a row of a tile
THIRD = 1.0 / 3.0


class Domain(NamedTuple):
    """Numbers of cells of the domain, and whether there are walls on its edges."""

    cells_x: int
    cells_y: int
    wall: bool


def planes_of(ground: np.ndarray, dx: float, real: type) -> np.ndarray:
    """Return the ground in short, in the precision of the points.

    Parameters
    ----------
    ground : float64[rows, columns, GROUND_ENTRIES]
    dx : float [m]
    real : np.float32 or np.float64

    Returns
    -------
    planes : real[rows, columns, PLANE_ENTRIES]
        DEEP is rounded up.
    """
    planes = np.empty((*ground.shape[:2], PLANE_ENTRIES), real)
    planes[..., PLANE] = ground[..., GROUND_HEIGHT] / dx + GHOSTS
    planes[..., SLOPE_X], planes[..., SLOPE_Y] = ground[..., GROUND_SLOPE_X], ground[..., GROUND_SLOPE_Y]
    deep = (ground[..., GROUND_DEEP] / dx + GHOSTS).astype(real)
    planes[..., DEEP] = deep + 4.0 * np.spacing(np.abs(deep) + real(1.0))
    return planes


@Part
def stencil(place: float) -> tuple[int, float, float, float, float]:
    """Return first node, offset from it and weights of the spline as `point_rows.stencil`, the node as an index.

    Parameters
    ----------
    place : real [cells]
        In the block, along an axis.
    """
    base = min(max(real(floor(place - 0.5)), 0.0), LAST_BASE)
    f = place - base
    return uint32(base), f, 0.5 * (1.5 - f) * (1.5 - f), 0.75 - (f - 1.0) * (f - 1.0), 0.5 * (f - 0.5) * (f - 0.5)


@Part
def cell_of(x: float, y: float, z: float) -> int:
    """Return the cell of a place in its block, from 0 to BLOCK^3 - 1: that of the first of the nodes around it.

    Parameters
    ----------
    x, y, z : real [cells]
        Place in the block.
    """
    i = uint32(min(max(real(floor(x - 0.5)), 0.0), LAST_BASE))
    j = uint32(min(max(real(floor(y - 0.5)), 0.0), LAST_BASE))
    k = uint32(min(max(real(floor(z - 0.5)), 0.0), LAST_BASE))
    return (k * uint32(BLOCK) + j) * uint32(BLOCK) + i


@Part
def load_tile(tile: np.ndarray, nodes: np.ndarray, targets: np.ndarray, a: int, thread: int, threads: int) -> None:
    """Copy the nodes that points of a block reach into its tile.

    Parameters
    ----------
    tile : real[TILE_SIZE]
        Is set.
    nodes : real[touched, BLOCK_SIZE]
    targets : int32[active, 8]
        Node blocks that the tile of each active block overlaps.
    a : int
        Number of the active block.
    thread, threads : int
        Number of this thread, and of threads that share the work.
    """
    for n in range(uint32(thread), uint32(TILE_SIZE // 4), uint32(threads)):
        i, j, k = n % uint32(TILE), n // uint32(TILE) % uint32(TILE), n // uint32(TILE * TILE)
        o = i // uint32(BLOCK) + uint32(2) * (j // uint32(BLOCK)) + uint32(4) * (k // uint32(BLOCK))
        b, at = uint32(targets[uint32(a), o]), uint32(4) * n
        e = (((k % uint32(BLOCK)) * uint32(BLOCK) + j % uint32(BLOCK)) * uint32(BLOCK) + i % uint32(BLOCK)) * uint32(4)
        u, v, w, mass = nodes[b, e], nodes[b, e + uint32(1)], nodes[b, e + uint32(2)], nodes[b, e + uint32(3)]
        tile[at], tile[at + uint32(1)], tile[at + uint32(2)], tile[at + uint32(3)] = u, v, w, mass


@Part
def edges_of(column: int, row: int, domain: Domain) -> tuple[float, float, float, float]:
    """Return the western, southern, eastern and northern edge of the domain [cells of the block].

    Parameters
    ----------
    column, row : int
        Of the block.
    domain : Domain
    """
    west, south = GHOSTS - BLOCK * column, GHOSTS - BLOCK * row
    return real(west), real(south), real(west + domain.cells_x), real(south + domain.cells_y)


@Part
def around(tile: np.ndarray, n: int) -> tuple[tuple, tuple, tuple, tuple]:
    """Return velocities and masses of three nodes of a row of a tile.

    Parameters
    ----------
    tile : real[TILE_SIZE]
    n : int
        Index of the first number of the first node.

    Returns
    -------
    u, v, w, mass : tuples of 3 numbers
        Of the three nodes, in order.
    """
    a0, a1, a2, a3 = tile[n], tile[n + uint32(1)], tile[n + uint32(2)], tile[n + uint32(3)]
    b0, b1, b2, b3 = tile[n + uint32(4)], tile[n + uint32(5)], tile[n + uint32(6)], tile[n + uint32(7)]
    c0, c1, c2, c3 = tile[n + uint32(8)], tile[n + uint32(9)], tile[n + uint32(10)], tile[n + uint32(11)]
    return (a0, b0, c0), (a1, b1, c1), (a2, b2, c2), (a3, b3, c3)


@Part
def interpolated(tile: np.ndarray, x: float, y: float, z: float) -> tuple:
    """Interpolate the velocity, the mass at the nodes around, and the gradient of the velocity at a place.

    Parameters
    ----------
    tile : real[TILE_SIZE]
    x, y, z : real [cells]
        Place in the block.

    Returns
    -------
    u, v, w : real [m s-1]
    near : real [kg]
    xx, yx, zx, xy, yy, zy, xz, yz, zz : real [m s-1 cells-1 / 4]
        du/dx, dv/dx, dw/dx, du/dy, ...
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
def only_turning(
    xx: float, yx: float, zx: float, xy: float, yy: float, zy: float, xz: float, yz: float, zz: float
) -> tuple:
    """Return the part of a gradient that turns the point without strain.

    Parameters
    ----------
    xx, yx, zx, xy, yy, zy, xz, yz, zz : real
        Gradient, as of `interpolated`.
    """
    zero = real(0.0)
    xy, xz, yz = 0.5 * (xy - yx), 0.5 * (xz - zx), 0.5 * (yz - zy)
    return zero, -xy, -xz, xy, zero, -yz, xz, yz, zero


@Part
def keep_state(rows: np.ndarray, p: int, n0: float, n1: float, n2: float, n3: float) -> None:
    """Write the first four numbers of state.

    Parameters
    ----------
    rows : real[n, ...]
    p : int
        Row of the point.
    n0, n1, n2, n3 : real
    """
    rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3] = n0, n1, n2, n3


@Part
def keep_affine(rows: np.ndarray, p: int, carried: float, pushed: float, gradient: tuple, stress: tuple) -> None:
    """Write the affine momentum: that of the gradient less the impulse of the stress.

    Parameters
    ----------
    rows : real[n, ...]
    p : int
        Row of the point.
    carried : real
        Affine momentum per gradient.
    pushed : real
        Affine momentum per stress.
    gradient : tuple of 9 numbers
        xx, yx, zx, xy, yy, zy, xz, yz, zz as of `interpolated`.
    stress : tuple of 6 numbers [Pa]
        xx, yy, zz, xy, xz, yz.
    """
    xx, yx, zx, xy, yy, zy, xz, yz, zz = gradient
    txx, tyy, tzz, txy, txz, tyz = stress
    rows[p, AXX], rows[p, AXX + 1] = carried * xx - pushed * txx, carried * yx - pushed * txy
    rows[p, AXX + 2] = carried * zx - pushed * txz
    rows[p, AXY], rows[p, AXY + 1] = carried * xy - pushed * txy, carried * yy - pushed * tyy
    rows[p, AXY + 2] = carried * zy - pushed * tyz
    rows[p, AXZ], rows[p, AXZ + 1] = carried * xz - pushed * txz, carried * yz - pushed * tyz
    rows[p, AXZ + 2] = carried * zz - pushed * tzz


@Part
def plastic_rate(stress: tuple) -> float:
    """Return the stress whose product with the plastic strain is plastic work: sqrt(3 / 2 s : s) [Pa].

    Parameters
    ----------
    stress : tuple of 6 numbers [Pa]
        xx, yy, zz, xy, xz, yz.
    """
    txx, tyy, tzz, txy, txz, tyz = stress
    mean = (txx + tyy + tzz) * THIRD
    square = (txx - mean) * (txx - mean) + (tyy - mean) * (tyy - mean) + (tzz - mean) * (tzz - mean)
    return sqrt(1.5 * (square + 2.0 * (txy * txy + txz * txz + tyz * tyz)))


@Part
def blocks_away(x: float, y: float, z: float) -> tuple[int, int, int]:
    """Return how many blocks a place is from a block, to the east, to the north and upwards.

    Parameters
    ----------
    x, y, z : real [cells]
        Place in the block.
    """
    up = min(max(real(floor((z - 0.5) * 0.25)), -FAR_BLOCKS), FAR_BLOCKS)
    return int32(floor((x - 0.5) * 0.25)), int32(floor((y - 0.5) * 0.25)), int32(up)


@Part
def enter_block(
    p: int, column: int, row: int, level: int, z: float, keys: np.ndarray, lowest: np.ndarray
) -> tuple[float, int]:
    """Write the key of a point that entered a block.

    A point below the lowest level of its column belongs to the block of that level.

    Parameters
    ----------
    p : int
        Number of the point.
    column, row, level : int
        Of the block.
    z : real [cells]
        Height of the point in it.
    keys : int64[n]
        Block of each point.
    lowest : int32[block rows, block columns, 2]
        See `point_blocks.lowest_blocks`.

    Returns
    -------
    z : real [cells]
        Height of the point in its block.
    tall : int
        Blocks above the lowest level that the window must have.
    """
    new = level - lowest[row, column, 0]
    if new < 0:
        z += 4.0 * real(new)
        new = 0
    keys[p] = packed(int64(row), int64(column), int64(new))
    return z, new + lowest[row, column, 1]
