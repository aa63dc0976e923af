"""Points to grid on the device: each thread owns a column of nodes of a tile, in registers, and a share of the points.

No atomic additions: every sum has one order.
"""

from numba import cuda

from ..kernels.point_rows import AXX, AXY, AXZ, MASS, PX, TILE, X
from .compiled import Kernel, Part, real
from .launch import ACTIVE, STATUS

COLUMNS = TILE * TILE  # node columns of a tile
MOST_SHARES = 7
PIECE = 56  # points staged at a time
STAGED = 16  # numbers of a point that are staged
STAGE = PIECE * STAGED
PART = MOST_SHARES * COLUMNS * 4


@Part
def _spline(d):
    """Quadratic spline of the distance `d` [cells]."""
    d = abs(d)
    if d < 0.5:
        return 0.75 - d * d
    if d < 1.5:
        return 0.5 * (1.5 - d) * (1.5 - d)
    return 0.0 * d


@Part
def _number_of(e):
    """Number of a row that is staged at `e`: place and mass, momentum, then the columns of the affine momentum."""
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


@Kernel
def points_to_grid(run, rows, order, start, tiles):
    """Sum mass and momentum, with the impulse of the stress, of the points of each block into its tile.

    MLS-MPM of Hu et al. 2018, as `kernels.points_to_grid`. 36 threads for each share of the points, at most
    MOST_SHARES; the results differ in the last bits with the number of shares.
    """
    if run[STATUS] != 0:
        return
    stage = cuda.shared.array(STAGE, real)
    part = cuda.shared.array(PART, real)
    c, n = cuda.threadIdx.x, cuda.blockDim.x
    share, column, shares = c // COLUMNS, c % COLUMNS, n // COLUMNS
    fi, fj = real(column % TILE), real(column // TILE)
    zero = real(0.0)
    for a in range(cuda.blockIdx.x, run[ACTIVE], cuda.gridDim.x):
        x0 = x1 = x2 = x3 = x4 = x5 = zero
        y0 = y1 = y2 = y3 = y4 = y5 = zero
        z0 = z1 = z2 = z3 = z4 = z5 = zero
        m0 = m1 = m2 = m3 = m4 = m5 = zero
        for first in range(start[a], start[a + 1], PIECE):
            count = min(PIECE, start[a + 1] - first)
            for t in range(c, count * STAGED, n):
                q = t // STAGED
                stage[t] = rows[order[first + q], _number_of(t - q * STAGED)]
            cuda.syncthreads()
            for q in range(share, count, shares):
                s = q * STAGED
                dx, dy, z = fi - stage[s], fj - stage[s + 1], stage[s + 2]
                w = _spline(dx) * _spline(dy)
                if w > 0.0:
                    mass = stage[s + 3]
                    px = stage[s + 4] + stage[s + 7] * dx + stage[s + 10] * dy
                    py = stage[s + 5] + stage[s + 8] * dx + stage[s + 11] * dy
                    pz = stage[s + 6] + stage[s + 9] * dx + stage[s + 12] * dy
                    ax, ay, az = stage[s + 13], stage[s + 14], stage[s + 15]
                    d = -z
                    v = w * _spline(d)
                    x0, y0, z0, m0 = (
                        x0 + v * (px + ax * d),
                        y0 + v * (py + ay * d),
                        z0 + v * (pz + az * d),
                        m0 + v * mass,
                    )
                    d = 1.0 - z
                    v = w * _spline(d)
                    x1, y1, z1, m1 = (
                        x1 + v * (px + ax * d),
                        y1 + v * (py + ay * d),
                        z1 + v * (pz + az * d),
                        m1 + v * mass,
                    )
                    d = 2.0 - z
                    v = w * _spline(d)
                    x2, y2, z2, m2 = (
                        x2 + v * (px + ax * d),
                        y2 + v * (py + ay * d),
                        z2 + v * (pz + az * d),
                        m2 + v * mass,
                    )
                    d = 3.0 - z
                    v = w * _spline(d)
                    x3, y3, z3, m3 = (
                        x3 + v * (px + ax * d),
                        y3 + v * (py + ay * d),
                        z3 + v * (pz + az * d),
                        m3 + v * mass,
                    )
                    d = 4.0 - z
                    v = w * _spline(d)
                    x4, y4, z4, m4 = (
                        x4 + v * (px + ax * d),
                        y4 + v * (py + ay * d),
                        z4 + v * (pz + az * d),
                        m4 + v * mass,
                    )
                    d = 5.0 - z
                    v = w * _spline(d)
                    x5, y5, z5, m5 = (
                        x5 + v * (px + ax * d),
                        y5 + v * (py + ay * d),
                        z5 + v * (pz + az * d),
                        m5 + v * mass,
                    )
            cuda.syncthreads()
        xs, ys, zs, ms = (
            (x0, x1, x2, x3, x4, x5),
            (y0, y1, y2, y3, y4, y5),
            (z0, z1, z2, z3, z4, z5),
            (m0, m1, m2, m3, m4, m5),
        )
        for k in range(TILE):
            part[4 * c], part[4 * c + 1], part[4 * c + 2], part[4 * c + 3] = xs[k], ys[k], zs[k], ms[k]
            cuda.syncthreads()
            for t in range(c, 4 * COLUMNS, n):
                total = part[t]
                for h in range(1, shares):
                    total += part[h * 4 * COLUMNS + t]
                tiles[a, k * 4 * COLUMNS + t] = total
            cuda.syncthreads()
