"""Grid to points on the device: a thread block reads the tile of a block of points; each thread moves some of them.

The arithmetic is that of `kernels.grid_to_points` and `kernels.point_edges`, point by point instead of in
batches.
"""

from math import floor, sqrt

from numba import cuda, float64, int32, int64

from ..effects.material import FAR as FAR_CODE
from ..effects.material import NO_TENSION as TIP_CODE
from ..kernels import point_report as entry
from ..kernels.block_order import (
    EAST_EDGE,
    GONE,
    INTO_NODATA,
    LEFT_BLOCK,
    LEFT_MASS,
    LEFT_X,
    LEFT_Y,
    NORTH_EDGE,
    SOUTH_EDGE,
    WEST_EDGE,
)  # fmt: skip
from ..kernels.point_blocks import packed
from ..kernels.point_clock import STEP_NOW
from ..kernels.point_edges import (
    BENT,
    FAR,
    FAR_BLOCKS,
    GRIPPED,
    INSIDE,
    JET,
    STILL,
    THIN,
    _above_ground,
    _filled,
    deepest_level,
    widen_window,
)
from ..kernels.point_ground import GROUND_DEEP
from ..kernels.point_rows import (
    AXX,
    AXY,
    AXZ,
    BLOCK,
    GHOSTS,
    LAST_BASE,
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
    TILE,
    TILE_SIZE,
    X,
    Y,
    Z,
)  # fmt: skip
from .compiled import Kernel, Part, real
from .launch import ACTIVE, DT, STATUS
from .point_places import lifted, way_out

# in addition to the entries of a report: the largest squared speed of a point that stays, and its index
STAY2, STAY_POINT = entry.REPORT, entry.REPORT + 1
POINT_REPORT = entry.REPORT + 2
THIRD = 1.0 / 3.0


@Part
def _stencil(place):
    """As `kernels.point_rows.stencil`, with the index of the first node too."""
    base = min(max(real(floor(place - 0.5)), 0.0), LAST_BASE)
    f = place - base
    return int32(base), f, 0.5 * (1.5 - f) * (1.5 - f), 0.75 - (f - 1.0) * (f - 1.0), 0.5 * (f - 0.5) * (f - 0.5)


@Part
def _clear(mine):
    """A report of nothing."""
    for k in range(POINT_REPORT):
        mine[k] = 0.0
    mine[entry.BLOCK_WEST] = mine[entry.BLOCK_SOUTH] = float(1 << 40)
    mine[entry.BLOCK_EAST] = mine[entry.BLOCK_NORTH] = mine[entry.BLOCK_TALL] = -1.0
    mine[STAY2] = -1.0


@Part
def _between(x, low, high):
    """`x` within `low` and `high`; NaN remains, from which min and max of the device would make a number."""
    if x < low:
        return low
    return high if x > high else x


@Part
def _variance(tile, t, wx, wy, wz, u, v, w):
    """Weighted variance [m2 s-2] of the velocities of the nodes around a point about its own."""
    east = north = up = real(0.0)
    for k in range(3):
        for j in range(3):
            share = wz[k] * wy[j]
            n = t + 4 * (k * TILE * TILE + j * TILE)
            a = b = c = real(0.0)
            for i in range(3):
                du, dv, dw = tile[n + 4 * i] - u, tile[n + 4 * i + 1] - v, tile[n + 4 * i + 2] - w
                a, b, c = a + wx[i] * du * du, b + wx[i] * dv * dv, c + wx[i] * dw * dw
            east, north, up = east + share * a, north + share * b, up + share * c
    return float64(east) + float64(north) + float64(up)


@Part
def _keeps(x, y, z, near, affine2, block, edges, ground, settings):
    """Whether the affine velocity of a point is kept as it is (see `kernels.point_edges.limit_thin`)."""
    dx = settings.dx
    dense, still = real(float64(THIN) * settings.density * dx * dx * dx), float64(STILL) * settings.signal_speed
    if not (near < dense and affine2 > real(still * still)):
        return True
    x, y = float64(x), float64(y)
    west, south, east, north = edges
    above, inside = _above_ground(x, y, float64(z), block, ground, dx), float64(FAR)
    if settings.wall:
        inside = min(min(x - west, y - south), min(east - x, north - y))
    if above < GRIPPED and inside > JET:
        return True
    filled = _filled(above)
    if settings.wall:
        filled = filled * _filled(x - west) * _filled(y - south) * _filled(east - x) * _filled(north - y)
    return not near < dense * filled


@Kernel
def grid_to_points(
    run, stage, clock, rows, keys, order, start, blocks, targets, nodes, ground, lowest, inside, left, units, reports,
    settings, material, softening, transfer,
):  # fmt: skip
    """Interpolate the velocity field, move the points, strain them and compute the stress of the next step.

    As `kernels.grid_to_points`. Points that leave are added to `left` int64[WAYS, blocks, blocks, LEFT_ENTRIES] in
    `units` float64[LEFT_ENTRIES], in whole numbers: their sum has no order. `reports` float64[threads, POINT_REPORT].
    """
    thread, threads = cuda.threadIdx.x, cuda.blockDim.x
    mine = reports[cuda.blockIdx.x * threads + thread]
    _clear(mine)
    if run[STATUS] != 0:
        return
    tile = cuda.shared.array(TILE_SIZE, real)
    deepest = cuda.shared.array(1, float64)
    dx, wall = settings.dx, settings.wall
    dt, next_dt = stage[DT], clock[STEP_NOW]
    turn, shift, g = real(4.0 / dx), real(dt / dx), real(4.0 / dx) * real(dt)
    push, step = real(next_dt * 4.0 / (dx * settings.density)), real(dt)
    longer = rows.shape[1] > S4
    shear_most = speed_most = real(0.0)
    torn, plastic, stay2, stay = 0.0, float64(0.0), float64(-1.0), 0
    for a in range(cuda.blockIdx.x, run[ACTIVE], cuda.gridDim.x):
        block = blocks[a]
        column, row, level = block[0], block[1], block[2]
        for e in range(thread, TILE_SIZE, threads):
            n = e // 4
            i, j, k = n % TILE, (n // TILE) % TILE, n // (TILE * TILE)
            o = (i // BLOCK) + 2 * (j // BLOCK) + 4 * (k // BLOCK)
            tile[e] = nodes[targets[a, o], (((k & 3) * BLOCK + (j & 3)) * BLOCK + (i & 3)) * 4 + e % 4]
        if thread == 0:
            deepest[0] = deepest_level(ground, block, dx)
            widen_window(mine, row, column, level - lowest[row, column, 0] + lowest[row, column, 1])
        cuda.syncthreads()
        west, south = real(GHOSTS - BLOCK * column), real(GHOSTS - BLOCK * row)
        east = real(GHOSTS - BLOCK * column + settings.cells_x)
        north = real(GHOSTS - BLOCK * row + settings.cells_y)
        edges = west, south, east, north
        for s in range(start[a] + thread, start[a + 1], threads):
            p = order[s]
            x, y, z, mass = rows[p, X], rows[p, Y], rows[p, Z], rows[p, MASS]
            i, fx, wx0, wx1, wx2 = _stencil(x)
            j, fy, wy0, wy1, wy2 = _stencil(y)
            k, fz, wz0, wz1, wz2 = _stencil(z)
            wx, wy, wz = (wx0, wx1, wx2), (wy0, wy1, wy2), (wz0, wz1, wz2)
            first = 4 * ((k * TILE + j) * TILE + i)
            u = v = w = near = real(0.0)
            xx = yx = zx = xy = yy = zy = xz = yz = zz = real(0.0)
            for c in range(3):
                lu = lv = lw = lm = real(0.0)
                ax = ay = az = bx = by = bz = real(0.0)
                for b in range(3):
                    n = first + 4 * (c * TILE * TILE + b * TILE)
                    ru = wx0 * tile[n] + wx1 * tile[n + 4] + wx2 * tile[n + 8]
                    rv = wx0 * tile[n + 1] + wx1 * tile[n + 5] + wx2 * tile[n + 9]
                    rw = wx0 * tile[n + 2] + wx1 * tile[n + 6] + wx2 * tile[n + 10]
                    rm = wx0 * tile[n + 3] + wx1 * tile[n + 7] + wx2 * tile[n + 11]
                    m0, m1, m2 = -wx0 * fx, wx1 * (1.0 - fx), wx2 * (2.0 - fx)
                    side, arm = wy[b], wy[b] * (real(b) - fy)
                    ax += side * (m0 * tile[n] + m1 * tile[n + 4] + m2 * tile[n + 8])
                    ay += side * (m0 * tile[n + 1] + m1 * tile[n + 5] + m2 * tile[n + 9])
                    az += side * (m0 * tile[n + 2] + m1 * tile[n + 6] + m2 * tile[n + 10])
                    lu, lv, lw, lm = lu + side * ru, lv + side * rv, lw + side * rw, lm + side * rm
                    bx, by, bz = bx + arm * ru, by + arm * rv, bz + arm * rw
                side, arm = wz[c], wz[c] * (real(c) - fz)
                u, v, w, near = u + side * lu, v + side * lv, w + side * lw, near + side * lm
                xx, yx, zx = xx + side * ax, yx + side * ay, zx + side * az
                xy, yy, zy = xy + side * bx, yy + side * by, zy + side * bz
                xz, yz, zz = xz + arm * lu, yz + arm * lv, zz + arm * lw
            s4 = s5 = s6 = s7 = real(0.0)
            if longer:
                s4, s5, s6, s7 = rows[p, S4], rows[p, S5], rows[p, S6], rows[p, S7]
            n0, n1, n2, n3, n4, n5, n6, n7, txx, tyy, tzz, txy, txz, tyz, code = material.stress_step(
                rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3], s4, s5, s6, s7,
                g * xx, g * xy, g * xz, g * yx, g * yy, g * yz, g * zx, g * zy, g * zz, step, softening,
            )  # fmt: skip
            if code == FAR_CODE:
                mine[entry.FAR] += 1.0
                n0, n1, n2, n3, n4, n5, n6, n7, txx, tyy, tzz, txy, txz, tyz, held = material.stress_step_far(
                    rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3], s4, s5, s6, s7,
                    g * xx, g * xy, g * xz, g * yx, g * yy, g * yz, g * zx, g * zy, g * zz, step, softening,
                )  # fmt: skip
                if held == FAR_CODE:
                    mine[entry.HELD_STRETCH] += 1.0
            if code == TIP_CODE:
                torn += 1.0
            if transfer.only_turns():
                xx = yy = zz = real(0.0)
                xy, xz, yz = 0.5 * (xy - yx), 0.5 * (xz - zx), 0.5 * (yz - zy)
                yx, zx, zy = -xy, -xz, -yz
            affine2 = xx * xx + xy * xy + xz * xz + yx * yx + yy * yy + yz * yz + zx * zx + zy * zy + zz * zz
            shear_most = max(shear_most, affine2 * (turn * turn))
            affine2 = 4.0 * affine2
            speed2 = u * u + v * v + w * w
            speed_most = max(speed_most, speed2)
            carried = 4.0 * mass
            if not _keeps(x, y, z, near, affine2, block, edges, ground, settings):
                share = float64(affine2) / _variance(tile, first, wx, wy, wz, u, v, w)
                if share < 1.0 - BENT:
                    kept = share * share * share * share
                    mine[entry.LIMITED] += 1.0
                    energy = float64(0.5) * float64(mass) * float64(affine2) * (float64(1.0) - kept * kept)
                    mine[entry.LIMITED_ENERGY] += energy
                    carried = carried * real(kept)
            if longer:
                mean = (txx + tyy + tzz) * THIRD
                square = (txx - mean) * (txx - mean) + (tyy - mean) * (tyy - mean) + (tzz - mean) * (tzz - mean)
                square += 2.0 * (txy * txy + txz * txz + tyz * tyz)
                plastic += float64(mass * sqrt(1.5 * square) * (n6 - s6))
                rows[p, S4], rows[p, S5], rows[p, S6], rows[p, S7] = n4, n5, n6, n7
            pushed = push * mass
            rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3] = n0, n1, n2, n3
            rows[p, AXX], rows[p, AXX + 1], rows[p, AXX + 2] = (
                carried * xx - pushed * txx, carried * yx - pushed * txy, carried * zx - pushed * txz,
            )  # fmt: skip
            rows[p, AXY], rows[p, AXY + 1], rows[p, AXY + 2] = (
                carried * xy - pushed * txy, carried * yy - pushed * tyy, carried * zy - pushed * tyz,
            )  # fmt: skip
            rows[p, AXZ], rows[p, AXZ + 1], rows[p, AXZ + 2] = (
                carried * xz - pushed * txz, carried * yz - pushed * tyz, carried * zz - pushed * tzz,
            )  # fmt: skip
            px, py, pz = mass * u, mass * v, mass * w
            x1, y1, z1 = x + shift * u, y + shift * v, z + shift * w
            if wall:
                if x1 < west + INSIDE or x1 > east - INSIDE or y1 < south + INSIDE or y1 > north - INSIDE:
                    mine[entry.HELD_WALL] += 1.0
                x1, y1 = _between(x1, west + INSIDE, east - INSIDE), _between(y1, south + INSIDE, north - INSIDE)
            way = entry.EDGES
            if (x1 + y1 + z1) * 0.0 != 0.0:  # NaN or infinite
                mine[entry.NOT_FINITE] += 1.0
                mine[entry.BAD_X] = (float64(x) + float64(column * BLOCK - GHOSTS)) * dx
                mine[entry.BAD_Y] = (float64(y) + float64(row * BLOCK - GHOSTS)) * dx
                way = -1
            else:
                way = way_out(x1, y1, edges, inside)
            if way != entry.EDGES:
                if way >= 0:
                    out, m = entry.OUT + way * entry.OUT_ENTRIES, float64(mass)
                    mine[out] += m
                    mine[out + 1] += px
                    mine[out + 2] += py
                    mine[out + 3] += pz
                    mine[out + 4] += float64(0.5) * m * float64(speed2)
                    mine[out + 5] += m * settings.gravity * ((float64(z1) + float64(level * BLOCK - GHOSTS)) * dx)
                    mine[out + 6] += 1.0
                    over, j, i, ex, ey = _left_at(inside.shape, column, row, float64(x1), float64(y1), dx)
                    cuda.atomic.add(left, (over, j, i, LEFT_MASS), _whole(m / units[LEFT_MASS]))
                    cuda.atomic.add(left, (over, j, i, LEFT_X), _whole(m * ex / units[LEFT_X]))
                    cuda.atomic.add(left, (over, j, i, LEFT_Y), _whole(m * ey / units[LEFT_Y]))
                rows[p, PX], rows[p, PY], rows[p, PZ] = px, py, pz
                keys[p] = GONE
                continue
            ni, nj = int32(floor(x1 + 0.5)) + column * BLOCK, int32(floor(y1 + 0.5)) + row * BLOCK
            bx, by = int32(floor((x1 - 0.5) * 0.25)), int32(floor((y1 - 0.5) * 0.25))
            bz = int32(min(max(real(floor((z1 - 0.5) * 0.25)), -FAR_BLOCKS), FAR_BLOCKS))
            x1, y1, z1 = x1 - 4.0 * real(bx), y1 - 4.0 * real(by), z1 - 4.0 * real(bz)
            if z1 + 4.0 * real(bz) < real(deepest[0]):
                height = (float64(z1) + float64((level + bz) * BLOCK - GHOSTS)) * dx
                if height < ground[nj, ni, GROUND_DEEP]:
                    place = float64(x1) + float64((column + bx) * BLOCK), float64(y1) + float64((row + by) * BLOCK)
                    energy, px, py, pz, up = lifted(place, height, ni, nj, mass, px, py, pz, ground, settings, mine)
                    if energy > 0.0:
                        new = int32(up - 0.5) // BLOCK
                        bz, z1 = new - level, real(up - float64(new * BLOCK))
            rows[p, X], rows[p, Y] = x1, y1
            rows[p, PX], rows[p, PY], rows[p, PZ] = px, py, pz
            if bx != 0 or by != 0 or bz != 0:
                new_column, new_row = column + bx, row + by
                new = level + bz - lowest[new_row, new_column, 0]
                if new < 0:
                    z1 += 4.0 * real(new)
                    new = 0
                keys[p] = packed(int64(new_row), int64(new_column), int64(new))
                widen_window(mine, new_row, new_column, new + lowest[new_row, new_column, 1])
            rows[p, Z] = z1
            if float64(speed2) > stay2:
                stay2, stay = float64(speed2), p
        cuda.syncthreads()
    mine[entry.SHEAR_MAX], mine[entry.SPEED2_MAX] = shear_most, speed_most
    mine[entry.AT_TIP], mine[entry.PLASTIC] = torn, plastic / settings.density
    mine[STAY2], mine[STAY_POINT] = stay2, stay


@Part
def _whole(value):
    """The whole number nearest to `value`, which is not negative."""
    return int64(value + float64(0.5))


@Part
def _left_at(shape, column, row, x, y, dx):
    """(way, row and column of a block of cells, place [m]) of a point that left to (x, y) [cells of its block].

    As `kernels.block_order.book_left`.
    """
    x, y = (x + float64(column * BLOCK - GHOSTS)) * dx, (y + float64(row * BLOCK - GHOSTS)) * dx
    ny, nx = shape
    way = INTO_NODATA
    if x < 0.0:
        way = WEST_EDGE
    elif y < 0.0:
        way = SOUTH_EDGE
    elif x >= nx * dx:
        way = EAST_EDGE
    elif y >= ny * dx:
        way = NORTH_EDGE
    x, y = min(max(x, float64(0.0)), nx * dx), min(max(y, float64(0.0)), ny * dx)
    return way, min(int64(y / dx), ny - 1) // LEFT_BLOCK, min(int64(x / dx), nx - 1) // LEFT_BLOCK, x, y
