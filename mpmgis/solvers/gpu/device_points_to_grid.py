"""Points to grid on the device: each thread owns the nodes of a tile with the same remainders by three.

The points of a block are in the order of their cells. The 27 nodes that a point reaches have different remainders, so
that each of 27 threads adds to one of them, in registers as long as the next point is in the same cell, and then to a
tile in shared memory, in which no other thread adds to that node. No atomic additions: every sum has one order.
"""

import numpy as np
from numba import cuda, int32, uint32

from ..points.point_rows import AXX, AXY, AXZ, MASS, PX, TILE, TILE_SIZE, X, Y, Z
from .device_functions import Kernel, Part, real
from .device_point_steps import cell_of
from .launch import ACTIVE, MOST_GROUPS, STATUS

GROUP, OWNERS = 32, 27  # threads that work on the same points, and those of them that own nodes
PIECE = GROUP  # points that a group stages at a time
STAGED = 16  # numbers of a point that are staged
TOGETHER = GROUP // STAGED  # points whose numbers a group reads with one instruction
STAGE, CELLS, PART = MOST_GROUPS * PIECE * STAGED, MOST_GROUPS * PIECE, MOST_GROUPS * TILE_SIZE
NONE = 1 << 16  # no cell


@Part
def _number_of(e):
    """Return the number of a row that is staged at `e`.

    They are place and mass, momentum, then the columns of the affine momentum.
    """
    if e < 3:
        return X + e
    if e == 3:
        return MASS
    if e < 7:
        return PX + e - 4
    if e < 10:
        return AXX + e - 7
    if e < 13:
        return AXY + e - 10
    return AXZ + e - 13


@Part
def _owned(base, remainder):
    """Return the node from `base` to `base` + 2 with the `remainder`, and s, a, b of its weight a + b (s - |d|)^2."""
    away = remainder + uint32(3) - base
    if away >= uint32(3):
        away -= uint32(3)
    if away == uint32(1):
        return base + away, real(0.0), real(0.75), real(-1.0)
    return base + away, real(1.5), real(0.0), real(0.5)


@Kernel
def points_to_grid(run: np.ndarray, rows: np.ndarray, order: np.ndarray, start: np.ndarray, tiles: np.ndarray) -> None:
    """Sum mass and momentum, with the impulse of the stress, of the points of each block into its tile.

    MLS-MPM of Hu et al. 2018, as `points_to_grid`. The groups of a thread block, at most MOST_GROUPS, share the
    points of a block; the results differ in the last bits with their number.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    rows : real[n, ROW_SHORT or ROW_LONG]
    order : int32[n]
        Indices of the points, sorted by block.
    start : int64[active + 1]
        First point of each active block in `order`.
    tiles : real[active, TILE_SIZE]
        Is set.
    """
    if run[STATUS] != 0:
        return
    stage = cuda.shared.array(STAGE, real, alignment=16)
    cells = cuda.shared.array(CELLS, uint32)
    part = cuda.shared.array(PART, real, alignment=16)
    thread, threads = uint32(cuda.threadIdx.x), uint32(cuda.blockDim.x)
    group, lane, groups = thread // uint32(GROUP), thread % uint32(GROUP), int32(threads // uint32(GROUP))
    mine, staged, listed = group * uint32(TILE_SIZE), group * uint32(PIECE * STAGED), group * uint32(PIECE)
    ri, rj, rk = lane % uint32(3), lane // uint32(3) % uint32(3), lane // uint32(9)
    entry = lane % uint32(STAGED)  # that this thread stages
    zero, number = real(0.0), uint32(_number_of(int32(entry)))
    for a in range(int32(cuda.blockIdx.x), int32(run[ACTIVE]), int32(cuda.gridDim.x)):
        first, count = int32(start[uint32(a)]), int32(start[uint32(a + 1)]) - int32(start[uint32(a)])
        share = (count + groups - int32(1)) // groups
        low = min(int32(group) * share, count)
        own = min(share, count - low)
        low += first
        for e in range(lane, uint32(TILE_SIZE), uint32(GROUP)):
            part[mine + e] = zero
        known, at = uint32(NONE), uint32(0)
        ni = nj = nk = si = sj = sk = ai = aj = ak = bi = bj = bk = zero
        x = y = z = m = zero
        for done in range(int32(0), share, int32(PIECE)):
            here = min(int32(PIECE), own - done)
            if int32(lane) < here:
                p = uint32(order[uint32(low + done + int32(lane))])
                cells[listed + lane] = cell_of(rows[p, X], rows[p, Y], rows[p, Z])
            last, to = low + done + here - int32(1), staged + entry
            for q in range(int32(lane // uint32(STAGED)), here, int32(4 * TOGETHER)):  # four points are read at once
                s0 = low + done + q
                s1, s2, s3 = s0 + int32(TOGETHER), s0 + int32(2 * TOGETHER), s0 + int32(3 * TOGETHER)
                p0, p1 = uint32(order[uint32(s0)]), uint32(order[uint32(min(s1, last))])
                p2, p3 = uint32(order[uint32(min(s2, last))]), uint32(order[uint32(min(s3, last))])
                v0, v1, v2, v3 = rows[p0, number], rows[p1, number], rows[p2, number], rows[p3, number]
                at0 = to + uint32(q) * uint32(STAGED)
                stage[at0], stage[at0 + uint32(GROUP)] = v0, v1
                stage[at0 + uint32(2 * GROUP)], stage[at0 + uint32(3 * GROUP)] = v2, v3
            cuda.syncthreads()
            if lane < uint32(OWNERS):
                for q in range(uint32(0), uint32(max(here, int32(0))), uint32(1)):
                    cell = cells[listed + q]
                    if cell != known:
                        if known != uint32(NONE):
                            part[at] += x
                            part[at + uint32(1)] += y
                            part[at + uint32(2)] += z
                            part[at + uint32(3)] += m
                            x = y = z = m = zero
                        known = cell
                        i, si, ai, bi = _owned(cell & uint32(3), ri)
                        j, sj, aj, bj = _owned((cell >> uint32(2)) & uint32(3), rj)
                        k, sk, ak, bk = _owned(cell >> uint32(4), rk)
                        ni, nj, nk = real(i), real(j), real(k)
                        at = mine + ((k * uint32(TILE) + j) * uint32(TILE) + i) * uint32(4)
                    s = staged + q * uint32(STAGED)
                    dx, dy, dz = ni - stage[s], nj - stage[s + uint32(1)], nk - stage[s + uint32(2)]
                    tx, ty, tz = si - abs(dx), sj - abs(dy), sk - abs(dz)
                    w = (ai + bi * tx * tx) * (aj + bj * ty * ty) * (ak + bk * tz * tz)
                    m += w * stage[s + uint32(3)]
                    x += w * (
                        stage[s + uint32(4)]
                        + stage[s + uint32(7)] * dx
                        + stage[s + uint32(10)] * dy
                        + stage[s + uint32(13)] * dz
                    )
                    y += w * (
                        stage[s + uint32(5)]
                        + stage[s + uint32(8)] * dx
                        + stage[s + uint32(11)] * dy
                        + stage[s + uint32(14)] * dz
                    )
                    z += w * (
                        stage[s + uint32(6)]
                        + stage[s + uint32(9)] * dx
                        + stage[s + uint32(12)] * dy
                        + stage[s + uint32(15)] * dz
                    )
            cuda.syncthreads()
        if known != uint32(NONE):
            part[at] += x
            part[at + uint32(1)] += y
            part[at + uint32(2)] += z
            part[at + uint32(3)] += m
        cuda.syncthreads()
        for e in range(thread, uint32(TILE_SIZE), threads):
            total = part[e]
            for g in range(int32(1), groups):
                total += part[uint32(g) * uint32(TILE_SIZE) + e]
            tiles[uint32(a), e] = total
        cuda.syncthreads()
