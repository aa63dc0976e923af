"""Grid to points on the device, for the points that `grid_to_points` marked as rare.

These are points whose affine velocity may be limited, whose strain exceeds the range of the series, that are stopped at
a wall, leave, may be below the ground or are not finite. `move_rare_points` computes their step from the beginning, in
the precision of the points. `settle_rare_points` then finds their blocks, with what is in double precision in
`point_edges` too: outflow and points below the ground. The reports of all points end there.
"""

from math import floor

import numpy as np
from numba import cuda, float64, int32, int64, uint32

from ...compiled.block_order import GONE, LEFT_MASS, LEFT_X, LEFT_Y, place_left
from ...laws.affine_transfer import TURNING_GRADIENT
from ...laws.material import FAR as FAR_CODE
from ...laws.material import NO_TENSION as TIP_CODE
from ...laws.material_choice import stress_step, stress_step_far
from ..points import point_report as entry
from ..points.affine_limit import BENT, FAR, GRIPPED, JET, TOWARDS, above_ground, filled_share
from ..points.point_edges import INSIDE, widen_window
from ..points.point_ground import GROUND_DEEP
from ..points.point_rows import (
    BLOCK,
    GHOSTS,
    MASS,
    PX,
    PY,
    PZ,
    S0,
    S1,
    S2,
    S3,
    S4,
    S5,
    S6,
    S7,
    TILE_SIZE,
    Settings,
    Surface,
    X,
    Y,
    Z,
)
from . import device_point_steps as step
from .device_functions import Part, capped, in_double, real
from .device_point_places import lifted, way_out
from .device_point_steps import (
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
    stencil,
)
from .device_records import MotionLaws, PointsInBlocks, RarePoints
from .launch import ACTIVE, STATUS, WIDEST

LIST = 512  # rare points of a block that are listed before they are moved, so that all threads have one


@Part
def _between(x, low, high):
    """Return `x` within `low` and `high`; NaN remains, from which min and max of the device would make a number."""
    if x < low:
        return low
    return high if x > high else x


@Part
def _variance(tile, x, y, z, u, v, w):
    """Return the weighted variance [m2 s-2] of the velocities of the nodes around a point about its own."""
    i, _, wx0, wx1, wx2 = stencil(x)
    j, _, wy0, wy1, wy2 = stencil(y)
    k, _, wz0, wz1, wz2 = stencil(z)
    wx, wy, wz = (wx0, wx1, wx2), (wy0, wy1, wy2), (wz0, wz1, wz2)
    first = int64((k * uint32(step.TILE * step.TILE) + j * uint32(step.TILE) + i) * uint32(4))
    east = north = up = real(0.0)
    for c in range(3):
        for b in range(3):
            share, n = wz[c] * wy[b], first + c * step.LAYER + b * step.ROW
            du2 = dv2 = dw2 = real(0.0)
            for e in range(3):
                at = n + 4 * e
                du, dv, dw = tile[uint32(at)] - u, tile[uint32(at + 1)] - v, tile[uint32(at + 2)] - w
                du2, dv2, dw2 = du2 + wx[e] * du * du, dv2 + wx[e] * dv * dv, dw2 + wx[e] * dw * dw
            east, north, up = east + share * du2, north + share * dv2, up + share * dw2
    return east + north + up


@Part
def _keeps(x, y, z, near, affine2, east2, north2, block, edges, ground, scales, settings):
    """Return whether the affine velocity of a point is kept as it is (see `affine_limit.limit_thin`).

    `east2` and `north2` are the parts of the velocities to the east and to the north in `affine2`.
    """
    dx, dense = real(settings.dx), scales[step.DENSE]
    if not (near < dense and affine2 > scales[step.STILL2]):
        return True
    west, south, east, north = edges
    above, inside = above_ground(x, y, z, block, ground, dx), real(FAR)
    if settings.wall and east2 > real(TOWARDS) * affine2:
        inside = min(x - west, east - x)
    if settings.wall and north2 > real(TOWARDS) * affine2:
        inside = min(inside, min(y - south, north - y))
    if above < GRIPPED and inside > JET:
        return True
    filled = filled_share(above)
    if settings.wall:
        filled = (
            filled * filled_share(x - west) * filled_share(y - south) * filled_share(east - x) * filled_share(north - y)
        )
    return not near < dense * filled


@capped(single=112)
def move_rare_points(
    run: np.ndarray,
    scales: np.ndarray,
    points: PointsInBlocks,
    nodes: np.ndarray,
    ground: np.ndarray,
    rare: RarePoints,
    domain: Domain,
    settings: Settings,
    laws: MotionLaws,
) -> None:
    """Move the marked points, as `grid_to_points`, with the code that few points need.

    Their places after it are still in cells of the blocks that they are in before it.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    scales : real[SCALES]
    points : PointsInBlocks
    nodes : real[touched, BLOCK_SIZE]
    ground : real[rows, columns, GROUND_ENTRIES]
    rare : RarePoints
        With the reports that `grid_to_points` began.
    domain : Domain
    settings : Settings
    laws : MotionLaws
    """
    order, start = points.order, points.start
    thread, threads = cuda.threadIdx.x, cuda.blockDim.x
    own = uint32(cuda.blockIdx.x * threads + thread)
    mark, count = rare.marks[own], rare.counts[own]
    mark[step.LIMITED_ENERGY] = real(0.0)
    count[step.FAR], count[step.HELD] = int32(0), int32(0)
    count[step.LIMITED], count[step.WALLED] = int32(0), int32(0)
    tile = cuda.shared.array(TILE_SIZE, real, alignment=16)
    marked = cuda.shared.array(WIDEST, int32)
    chosen = cuda.shared.array(LIST, int32)
    for a in range(int32(cuda.blockIdx.x), int32(0 if run[STATUS] != 0 else run[ACTIVE]), int32(cuda.gridDim.x)):
        if rare.blocks[a] == 0:
            continue
        load_tile(tile, nodes, points.targets, a, thread, threads)
        listed = int32(0)
        for first in range(int32(start[a]), int32(start[a + 1]), int32(threads)):
            s = first + thread
            marked[thread] = 1 if s < start[a + 1] and rare.marked[s] != 0 else 0
            cuda.syncthreads()
            at, total = listed, listed
            for t in range(threads):
                at, total = at + (marked[t] if t < thread else int32(0)), total + marked[t]
            if marked[thread] != 0:
                chosen[at] = order[s]
            listed = total
            cuda.syncthreads()
            if listed + threads > LIST or first + threads >= start[a + 1]:
                for e in range(thread, listed, threads):
                    _move(
                        uint32(chosen[e]),
                        tile,
                        points.blocks[a],
                        scales,
                        points.rows,
                        ground,
                        mark,
                        count,
                        domain,
                        settings,
                        laws,
                    )
                listed = int32(0)
                cuda.syncthreads()


@Part
def _move(p, tile, block, scales, rows, ground, mark, count, domain, settings, laws):
    """Move point `p`, whose new place is in cells of `block`."""
    longer = rows.shape[1] > S4
    u, v, w, near, xx, yx, zx, xy, yy, zy, xz, yz, zz = interpolated(tile, rows[p, X], rows[p, Y], rows[p, Z])
    s4 = s5 = s6 = s7 = real(0.0)
    if longer:
        s4, s5, s6, s7 = rows[p, S4], rows[p, S5], rows[p, S6], rows[p, S7]
    before = rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3], s4, s5, s6, s7
    g, time_step = scales[step.GRADIENT], scales[step.STEP]
    strain = g * xx, g * xy, g * xz, g * yx, g * yy, g * yz, g * zx, g * zy, g * zz
    state, stress, code = stress_step(laws.material, laws.softening, before, strain, time_step)
    if code == FAR_CODE:
        count[step.FAR] += int32(1)
        state, stress, held = stress_step_far(laws.material, laws.softening, before, strain, time_step)
        if held == FAR_CODE:
            count[step.HELD] += int32(1)
    if code == TIP_CODE:
        count[step.TORN] += int32(1)
    if longer:
        mark[step.PLASTIC] += rows[p, MASS] * plastic_rate(stress) * (state[6] - s6)
        rows[p, S4], rows[p, S5], rows[p, S6], rows[p, S7] = state[4], state[5], state[6], state[7]
    keep_state(rows, p, state[0], state[1], state[2], state[3])
    x, y, z, mass = rows[p, X], rows[p, Y], rows[p, Z], rows[p, MASS]  # read here, to hold fewer values until now
    edges = edges_of(block[0], block[1], domain)
    if laws.transfer == TURNING_GRADIENT:
        xx, yx, zx, xy, yy, zy, xz, yz, zz = only_turning(xx, yx, zx, xy, yy, zy, xz, yz, zz)
    affine2 = xx * xx + xy * xy + xz * xz + yx * yx + yy * yy + yz * yz + zx * zx + zy * zy + zz * zz
    mark[step.SHEAR] = max(mark[step.SHEAR], affine2 * scales[step.TURN2])
    affine2 = 4.0 * affine2
    mark[step.SPEED2] = max(mark[step.SPEED2], u * u + v * v + w * w)
    carried = 4.0 * mass
    east2, north2 = 4.0 * (xx * xx + xy * xy + xz * xz), 4.0 * (yx * yx + yy * yy + yz * yz)
    if not _keeps(x, y, z, near, affine2, east2, north2, block, edges, ground, scales, settings):
        carried = carried * _limited(affine2 / _variance(tile, x, y, z, u, v, w), affine2, mass, mark, count)
    gradient = xx, yx, zx, xy, yy, zy, xz, yz, zz
    keep_affine(rows, p, carried, scales[step.PUSH] * mass, gradient, stress)
    rows[p, PX], rows[p, PY], rows[p, PZ] = mass * u, mass * v, mass * w
    shift = scales[step.SHIFT]
    x1, y1, z1 = x + shift * u, y + shift * v, z + shift * w
    if domain.wall:
        west, south, east, north = edges
        low = real(INSIDE)
        if x1 < west + low or x1 > east - low or y1 < south + low or y1 > north - low:
            count[step.WALLED] += int32(1)
        x1, y1 = _between(x1, west + low, east - low), _between(y1, south + low, north - low)
    if (x1 + y1 + z1) * 0.0 != 0.0:  # NaN or infinite: the place before the step is reported
        x1, y1, z1 = x, y, x1 + y1 + z1
    rows[p, X], rows[p, Y], rows[p, Z] = x1, y1, z1


@Part
def _limited(share, affine2, mass, mark, count):
    """Return the factor of the affine momentum of a point that accounts for `share` of the nodes' variance."""
    if not share < 1.0 - BENT:
        return real(1.0)
    kept = share * share * share * share
    count[step.LIMITED] += int32(1)
    mark[step.LIMITED_ENERGY] += 0.5 * mass * affine2 * (1.0 - kept * kept)
    return kept


@in_double
def begin_reports(
    run: np.ndarray, marks: np.ndarray, counts: np.ndarray, reports: np.ndarray, settings: Settings
) -> None:
    """Begin the reports of the threads with what they did when points were moved.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    marks : real[threads, RARE_MARKS]
    counts : int32[threads, RARE_COUNTS]
    reports : float64[threads, POINT_REPORT]
        Is set.
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    entries, n = uint32(step.POINT_REPORT), uint32(reports.shape[0] * step.POINT_REPORT)
    for e in range(uint32(cuda.grid(1)), n, uint32(cuda.gridsize(1))):
        t = e // entries
        reports[t, e - t * entries] = _begun(e - t * entries, marks[t], counts[t], settings.density)


@Part
def _begun(k, mark, count, density):
    """Return entry `k` of the report of a thread with the `mark` and `count` of moved points."""
    if k == entry.SHEAR_MAX:
        return float64(mark[step.SHEAR])
    if k == entry.SPEED2_MAX:
        return float64(mark[step.SPEED2])
    if k == step.STAY2_OF_ALL:
        return float64(mark[step.STAY2])
    if k == entry.PLASTIC:
        return float64(mark[step.PLASTIC]) / density
    if k == entry.LIMITED_ENERGY:
        return float64(mark[step.LIMITED_ENERGY])
    if k == step.STAY_POINT:
        return float64(count[step.STAY])
    if k == entry.AT_TIP:
        return float64(count[step.TORN])
    if k == entry.FAR:
        return float64(count[step.FAR])
    if k == entry.HELD_STRETCH:
        return float64(count[step.HELD])
    if k == entry.LIMITED:
        return float64(count[step.LIMITED])
    if k == entry.HELD_WALL:
        return float64(count[step.WALLED])
    if k == entry.BLOCK_WEST:
        return float64(count[step.WEST])
    if k == entry.BLOCK_SOUTH:
        return float64(count[step.SOUTH])
    if k == entry.BLOCK_EAST:
        return float64(count[step.EAST])
    if k == entry.BLOCK_NORTH:
        return float64(count[step.NORTH])
    if k == entry.BLOCK_TALL:
        return float64(count[step.TALL])
    return float64(0.0)


@in_double
def settle_rare_points(
    run: np.ndarray,
    points: PointsInBlocks,
    surface: Surface,
    left: np.ndarray,
    units: np.ndarray,
    rare: RarePoints,
    reports: np.ndarray,
    domain: Domain,
    settings: Settings,
) -> None:
    """Find the blocks of the marked points from their places after the step, or the edge they leave over.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    points : PointsInBlocks
    surface : Surface
    left : int64[WAYS, blocks, blocks, LEFT_ENTRIES]
        Points that leave are added to it, in whole numbers, whose sum does not depend on the order.
    units : float64[LEFT_ENTRIES]
        Of these numbers.
    rare : RarePoints
    reports : float64[threads, POINT_REPORT]
        That `begin_reports` began.
    domain : Domain
    settings : Settings
    """
    start = points.start
    thread, threads = cuda.threadIdx.x, cuda.blockDim.x
    own = cuda.blockIdx.x * threads + thread
    mine = reports[own]
    for a in range(int32(cuda.blockIdx.x), int32(0 if run[STATUS] != 0 else run[ACTIVE]), int32(cuda.gridDim.x)):
        if rare.blocks[a] == 0:
            continue
        for s in range(int32(start[a]) + int32(thread), int32(start[a + 1]), int32(threads)):
            if rare.marked[s] == 0:
                continue
            p = uint32(points.order[s])
            way, x, y, mass = _settle(p, points.blocks[a], points, surface, mine, domain, settings)
            if 0 <= way < entry.EDGES:
                over, j, i, x, y = place_left(surface.inside.shape, x, y, settings.dx)
                cuda.atomic.add(left, (over, j, i, LEFT_MASS), _whole(mass / units[LEFT_MASS]))
                cuda.atomic.add(left, (over, j, i, LEFT_X), _whole(mass * x / units[LEFT_X]))
                cuda.atomic.add(left, (over, j, i, LEFT_Y), _whole(mass * y / units[LEFT_Y]))


@Part
def _settle(p, block, points, surface, mine, domain, settings):
    """Settle point `p`; return the edge over which it leaves (EDGES: none, -1: not finite), x, y [m], mass."""
    rows = points.rows
    dx, column, row = settings.dx, block[0], block[1]
    x, y, z, mass = rows[p, X], rows[p, Y], rows[p, Z], rows[p, MASS]
    px, py, pz = rows[p, PX], rows[p, PY], rows[p, PZ]
    if z * 0.0 != 0.0:  # NaN or infinite
        mine[entry.NOT_FINITE] += 1.0
        mine[entry.BAD_X], mine[entry.BAD_Y] = _metres(x, column, dx), _metres(y, row, dx)
        way = -1
    else:
        way = way_out(x, y, edges_of(column, row, domain), surface.inside)
    speed2 = (px * px + py * py + pz * pz) / (mass * mass)
    if way != entry.EDGES:
        if way >= 0:
            _book_out(way, block, z, px, py, pz, speed2, mass, settings, mine)
        points.keys[p] = GONE
        return way, _metres(x, column, dx), _metres(y, row, dx), float64(mass)
    _enter(p, block, (x, y, z), (px, py, pz), mass, points, surface, settings, mine)
    if float64(speed2) > mine[step.STAY2_OF_ALL]:
        mine[step.STAY2_OF_ALL], mine[step.STAY_POINT] = speed2, p
    return way, float64(0.0), float64(0.0), float64(mass)


@Part
def _metres(place, block, dx):
    """Return the place [m] from the domain's edge or lowest level of a `place` [cells of its block] on one axis."""
    return (float64(place) + float64(block * BLOCK - GHOSTS)) * dx


@Part
def _book_out(way, block, z, px, py, pz, speed2, mass, settings, mine):
    """Report a point that leaves, to the height `z` [cells of its block]."""
    out, m = entry.OUT + way * entry.OUT_ENTRIES, float64(mass)
    mine[out] += m
    mine[out + 1] += px
    mine[out + 2] += py
    mine[out + 3] += pz
    mine[out + 4] += float64(0.5) * m * float64(speed2)
    mine[out + 5] += m * settings.gravity * _metres(z, block[2], settings.dx)
    mine[out + 6] += 1.0


@Part
def _enter(p, block, place, momentum, mass, points, surface, settings, mine):
    """Write the place of a point that stays, its block, and its momentum if it is lifted onto the ground."""
    (x1, y1, z1), (px, py, pz) = place, momentum
    rows, ground = points.rows, surface.ground
    dx, column, row, level = settings.dx, block[0], block[1], block[2]
    ni, nj = int32(floor(x1 + 0.5)) + column * BLOCK, int32(floor(y1 + 0.5)) + row * BLOCK
    bx, by, bz = blocks_away(x1, y1, z1)
    x1, y1, z1 = x1 - 4.0 * real(bx), y1 - 4.0 * real(by), z1 - 4.0 * real(bz)
    height = _metres(z1, level + bz, dx)
    if height < ground[nj, ni, GROUND_DEEP]:
        cells = float64(x1) + float64((column + bx) * BLOCK), float64(y1) + float64((row + by) * BLOCK)
        energy, px, py, pz, up = lifted(cells, height, ni, nj, mass, px, py, pz, ground, settings, mine)
        if energy > 0.0:
            new = int32(up - 0.5) // BLOCK
            bz, z1 = new - level, real(up - float64(new * BLOCK))
            rows[p, PX], rows[p, PY], rows[p, PZ] = px, py, pz
    rows[p, X], rows[p, Y] = x1, y1
    if bx != 0 or by != 0 or bz != 0:
        z1, tall = enter_block(p, column + bx, row + by, level + bz, z1, points.keys, surface.lowest)
        widen_window(mine, row + by, column + bx, tall)
    rows[p, Z] = z1


@Part
def _whole(value):
    """Return the whole number nearest to `value`, which is not negative."""
    return int64(value + float64(0.5))
