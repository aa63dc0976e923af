"""Grid to points on the device: a thread block reads the tile of a block of points; each thread moves some of them.

The rows of the points pass through shared memory, so that neighbouring threads read and write neighbouring numbers.

The arithmetic is that of `grid_to_points` and `point_edges`, point by point instead of in batches. This
kernel has no double precision in single precision. It leaves the points that need it, or rare code, as they are and
marks them for `rare_points.move_rare_points`, which computes their step from the beginning.
"""

from math import floor

import numpy as np
from numba import cuda, int32, uint32

from ...laws.affine_transfer import TURNING_GRADIENT
from ...laws.material import FAR as FAR_CODE
from ...laws.material import NO_TENSION as TIP_CODE
from ...laws.material_choice import stress_step
from ..points.affine_limit import GRIPPED, JET
from ..points.point_edges import INSIDE
from ..points.point_rows import BLOCK, MASS, PX, PY, PZ, ROW_LONG, S0, S1, S2, S3, S4, S5, S6, S7, TILE_SIZE, X, Y, Z
from .device_functions import Part, capped, real
from .device_point_steps import (
    DEEP,
    DENSE,
    EAST,
    GRADIENT,
    LANES,
    MARKS,
    NORTH,
    PLANE,
    PLASTIC,
    PUSH,
    SHEAR,
    SHIFT,
    SLOPE_X,
    SLOPE_Y,
    SOUTH,
    SPEED2,
    STAY,
    STAY2,
    STEP,
    STILL2,
    TALL,
    TORN,
    TURN2,
    WEST,
    Domain,
    blocks_away,
    edges_of,
    enter_block,
    interpolated,
    keep_affine,
    keep_state,
    load_tile,
    only_turning,
    plastic_rate,
)
from .device_records import MotionLaws, PointMap, PointsInBlocks, RarePoints, Shared
from .launch import ACTIVE, STATUS, WIDEST

PITCH = ROW_LONG + 1  # numbers between two rows in shared memory; odd, so that threads read from different banks
UNSURE = 0.05  # [cells] by which heights above the ground in single precision may differ from those in double


@Part
def _widen(counts, row, column, tall):
    """Widen the window as `point_edges.widen_window`, in whole numbers."""
    counts[WEST], counts[EAST] = min(counts[WEST], int32(column)), max(counts[EAST], int32(column))
    counts[SOUTH], counts[NORTH] = min(counts[SOUTH], int32(row)), max(counts[NORTH], int32(row))
    counts[TALL] = max(counts[TALL], int32(tall))


@Part
def _surely_kept(x, y, z, column, row, level, edges, planes, domain):
    """Return whether the affine velocity of a point in a thin part of the flow is kept: it is near the ground."""
    west, south, east, north = edges
    if domain.wall and min(min(x - west, y - south), min(east - x, north - y)) <= JET + UNSURE:
        return False
    ni, nj = int32(x + 0.5) + column * BLOCK, int32(y + 0.5) + row * BLOCK
    plane = planes[uint32(nj), uint32(ni)]
    surface = plane[PLANE] - real(BLOCK * level)
    surface += plane[SLOPE_X] * (x + real(column * BLOCK - ni)) + plane[SLOPE_Y] * (y + real(row * BLOCK - nj))
    above, limit = z - surface, real(GRIPPED - UNSURE)
    slopes = 1.0 + plane[SLOPE_X] * plane[SLOPE_X] + plane[SLOPE_Y] * plane[SLOPE_Y]
    return above < 0.0 or above * above < limit * limit * slopes


@Part
def _stays_common(x, y, z, column, row, level, edges, planes, inside, wall):
    """Return whether a place after a step is finite, in the domain, off walls and above the ground.

    Places are in cells of the block.
    """
    west, south, east, north = edges
    margin = real(INSIDE) if wall else real(0.0)
    if not (x >= west + margin and y >= south + margin and x < east - margin and y < north - margin and z * 0.0 == 0.0):
        return False
    j, i = min(int32(y - south), int32(inside.shape[0] - 1)), min(int32(x - west), int32(inside.shape[1] - 1))
    if inside[uint32(j), uint32(i)] == 0:
        return False
    nj, ni = int32(floor(y + 0.5)) + row * BLOCK, int32(floor(x + 0.5)) + column * BLOCK
    return z >= planes[uint32(nj), uint32(ni), DEEP] - real(BLOCK * level)


@capped(single=112)
def grid_to_points(
    run: np.ndarray,
    scales: np.ndarray,
    points: PointsInBlocks,
    nodes: np.ndarray,
    below: PointMap,
    rare: RarePoints,
    domain: Domain,
    laws: MotionLaws,
) -> None:
    """Interpolate the velocity field, move the points, strain them and compute the stress of the next step.

    As `grid_to_points.grid_to_points`, but for rare points: they and their blocks are marked.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    scales : real[SCALES]
    points : PointsInBlocks
    nodes : real[touched, BLOCK_SIZE]
    below : PointMap
    rare : RarePoints
        Is set.
    domain : Domain
    laws : MotionLaws
    """
    rows, order, start, blocks, lowest = points.rows, points.order, points.start, points.blocks, below.lowest
    thread, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    own = uint32(int32(cuda.blockIdx.x) * threads + thread)
    count = rare.counts[own]
    count[WEST] = count[SOUTH] = int32(1 << 30)
    count[EAST] = count[NORTH] = count[TALL] = int32(-1)
    count[TORN] = count[STAY] = int32(0)
    tile = cuda.shared.array(TILE_SIZE, real, alignment=16)
    here = cuda.shared.array((WIDEST, MARKS), real)
    lines = cuda.shared.array((WIDEST, PITCH), real)
    shared = Shared(lines, tile, here)
    mine = here[uint32(thread)]
    width = uint32(rows.shape[1])
    mine[SHEAR] = mine[SPEED2] = mine[PLASTIC] = real(0.0)
    mine[STAY2] = real(-1.0)
    for a in range(int32(cuda.blockIdx.x), int32(0 if run[STATUS] != 0 else run[ACTIVE]), int32(cuda.gridDim.x)):
        load_tile(tile, nodes, points.targets, a, thread, threads)
        if thread == 0:
            rare.blocks[a] = 0
            column, row, level = blocks[uint32(a), 0], blocks[uint32(a), 1], blocks[uint32(a), 2]
            _widen(count, row, column, level - lowest[row, column, 0] + lowest[row, column, 1])
        first = int32(start[uint32(a)])
        while first < int32(start[uint32(a + 1)]):  # read again each time: a register less
            _take_lines(lines, rows, order, first, int32(start[uint32(a + 1)]), thread, threads)
            cuda.syncthreads()
            if first + thread < int32(start[uint32(a + 1)]):
                _move(
                    uint32(thread),
                    uint32(first + thread),
                    uint32(a),
                    shared,
                    points,
                    scales,
                    below,
                    rare,
                    count,
                    domain,
                    laws,
                    width > uint32(S4),
                )
            cuda.syncthreads()
            _give_lines(lines, rows, order, first, int32(start[uint32(a + 1)]), thread, threads)
            first += threads
        cuda.syncthreads()
    for k in range(MARKS):
        rare.marks[own, k] = mine[k]


@Part
def _take_lines(lines, rows, order, first, end, thread, threads):
    """Copy rows of as many points as `threads` from place `first`, before `end`, to `lines`.

    LANES threads read a row; each reads parts of four rows before it writes them, those after the last as the last one.
    """
    lane, stride, last = uint32(thread % int32(LANES)), threads // int32(LANES), end - int32(1)
    e0, e1, e2 = lane, lane + uint32(LANES), min(lane + uint32(2 * LANES), uint32(rows.shape[1] - 1))
    for q in range(thread // int32(LANES), min(threads, end - first), int32(4) * stride):
        s0, s1, s2, s3 = first + q, first + q + stride, first + q + int32(2) * stride, first + q + int32(3) * stride
        p0, p1 = uint32(order[uint32(min(s0, last))]), uint32(order[uint32(min(s1, last))])
        p2, p3 = uint32(order[uint32(min(s2, last))]), uint32(order[uint32(min(s3, last))])
        a0, b0, c0 = rows[p0, e0], rows[p0, e1], rows[p0, e2]
        a1, b1, c1 = rows[p1, e0], rows[p1, e1], rows[p1, e2]
        a2, b2, c2 = rows[p2, e0], rows[p2, e1], rows[p2, e2]
        a3, b3, c3 = rows[p3, e0], rows[p3, e1], rows[p3, e2]
        _give_line(lines, uint32(q), e0, e1, a0, b0, c0)
        _give_line(lines, uint32(q + stride), e0, e1, a1, b1, c1)
        _give_line(lines, uint32(q + int32(2) * stride), e0, e1, a2, b2, c2)
        _give_line(lines, uint32(q + int32(3) * stride), e0, e1, a3, b3, c3)


@Part
def _give_line(lines, q, e0, e1, a, b, c):
    """Write the numbers of a row that one thread has read."""
    lines[q, e0], lines[q, e1], lines[q, e1 + uint32(LANES)] = a, b, c


@Part
def _give_lines(lines, rows, order, first, end, thread, threads):
    """Copy back to the rows what `_take_lines` has copied from them, each thread what it has read."""
    lane, stride = uint32(thread % int32(LANES)), threads // int32(LANES)
    e1, e2 = lane + uint32(LANES), lane + uint32(2 * LANES)
    for s in range(first + thread // int32(LANES), min(first + threads, end), stride):
        p, q = uint32(order[uint32(s)]), uint32(s - first)
        rows[p, lane], rows[p, e1] = lines[q, lane], lines[q, e1]
        if e2 < uint32(rows.shape[1]):
            rows[p, e2] = lines[q, e2]


@Part
def _move(t, s, a, shared, points, scales, below, rare, count, domain, laws, longer):
    """Move the point at place `s` of the order, whose row is line `t`, or mark it in `rare`."""
    lines, tile, here, blocks, planes, inside = (
        shared.lines,
        shared.tile,
        shared.marks,
        points.blocks,
        below.planes,
        below.inside,
    )
    u, v, w, near, xx, yx, zx, xy, yy, zy, xz, yz, zz = interpolated(tile, lines[t, X], lines[t, Y], lines[t, Z])
    thin = near < scales[DENSE]
    here[t, SPEED2] = max(here[t, SPEED2], u * u + v * v + w * w)
    s4 = s5 = s6 = s7 = real(0.0)
    if longer:
        s4, s5, s6, s7 = lines[t, S4], lines[t, S5], lines[t, S6], lines[t, S7]
    state = lines[t, S0], lines[t, S1], lines[t, S2], lines[t, S3], s4, s5, s6, s7
    g = scales[GRADIENT]
    strain = g * xx, g * xy, g * xz, g * yx, g * yy, g * yz, g * zx, g * zy, g * zz
    state, stress, code = stress_step(laws.material, laws.softening, state, strain, scales[STEP])
    if laws.transfer == TURNING_GRADIENT:
        xx, yx, zx, xy, yy, zy, xz, yz, zz = only_turning(xx, yx, zx, xy, yy, zy, xz, yz, zz)
    affine2 = xx * xx + xy * xy + xz * xz + yx * yx + yy * yy + yz * yz + zx * zx + zy * zy + zz * zz
    here[t, SHEAR] = max(here[t, SHEAR], affine2 * scales[TURN2])
    column, row, level = blocks[a, 0], blocks[a, 1], blocks[a, 2]
    x, y, z = lines[t, X], lines[t, Y], lines[t, Z]
    shift, edges = scales[SHIFT], edges_of(column, row, domain)
    x1, y1, z1 = x + shift * u, y + shift * v, z + shift * w
    common = code != FAR_CODE and _stays_common(x1, y1, z1, column, row, level, edges, planes, inside, domain.wall)
    if common and thin and 4.0 * affine2 > scales[STILL2]:
        common = _surely_kept(x, y, z, column, row, level, edges, planes, domain)
    rare.marked[s] = 0 if common else 1
    if not common:
        rare.blocks[a] = 1
        return
    if code == TIP_CODE:
        count[TORN] += int32(1)
    mass, p = lines[t, MASS], uint32(points.order[s])
    if longer:
        here[t, PLASTIC] += mass * plastic_rate(stress) * (state[6] - lines[t, S6])
        lines[t, S4], lines[t, S5], lines[t, S6], lines[t, S7] = state[4], state[5], state[6], state[7]
    keep_state(lines, t, state[0], state[1], state[2], state[3])
    gradient = xx, yx, zx, xy, yy, zy, xz, yz, zz
    keep_affine(lines, t, 4.0 * mass, scales[PUSH] * mass, gradient, stress)
    lines[t, PX], lines[t, PY], lines[t, PZ] = mass * u, mass * v, mass * w
    bx, by, bz = blocks_away(x1, y1, z1)
    z1 = z1 - 4.0 * real(bz)
    if bx != 0 or by != 0 or bz != 0:
        z1, tall = enter_block(p, column + bx, row + by, level + bz, z1, points.keys, below.lowest)
        _widen(count, row + by, column + bx, tall)
    lines[t, X], lines[t, Y], lines[t, Z] = x1 - 4.0 * real(bx), y1 - 4.0 * real(by), z1
    speed2 = u * u + v * v + w * w
    if speed2 > here[t, STAY2]:
        here[t, STAY2], count[STAY] = speed2, int32(p)
