"""Limit of the affine velocity of points in thin sheets and at free surfaces."""

from math import sqrt

from . import point_lines as line
from . import point_report as entry
from .jit import kernel_part
from .lanes import get, lane, lanes, load, multiply_add, multiply_lanes
from .point_ground import GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y
from .point_lines import BATCH
from .point_rows import BLOCK, GHOSTS, TILE_LAYER, TILE_ROW

# The limit acts on a point more than GRIPPED cells above the ground or within JET cells of a wall. It acts where the
# grid around the point has less than THIN of the density of the material, where the affine velocity exceeds STILL of
# the speed of pressure waves at half a cell, and where the velocities of the nodes are not linear: the affine velocity
# does not account for more than BENT of their variance.
GRIPPED, JET, THIN, STILL, BENT = 2.0, 3.0, 0.75, 1e-3, 0.02
FAR = 1e9  # cells from a wall where there is none


@kernel_part
def limit_thin(scratch, quads, integers, count, tile, block, edges, ground, settings, factors, report):
    """Limit the affine velocity of the batch's points in thin sheets and at free surfaces.

    The nodes around these have less than the mass `factors.dense` [kg]; with `settings.wall` the space beyond the edges
    of the domain counts as full. Points near the ground are not limited: its contact, not the free surface, makes the
    velocities of their nodes nonlinear, and the limit would take energy from the flow over rough ground in every step.
    Points near the walls of the domain are always limited, because jets can form along a wall and in its corners.
    """
    dense, still, dx, thin = factors.dense, factors.still, settings.dx, 0
    for q in range(BATCH):
        thin += (get(scratch, line.NEAR, q) < dense) & (get(scratch, line.AFFINE2, q) > still)
    if thin == 0:
        return
    for q in range(count):
        if scratch[line.NEAR + q] < dense and scratch[line.AFFINE2 + q] > still:
            x, y = float(scratch[line.FX + q]), float(scratch[line.FY + q])
            above = _above_ground(x, y, float(scratch[line.FZ + q]), block, ground, dx)
            inside = FAR
            if settings.wall:
                inside = min(min(x - edges.west, y - edges.south), min(edges.east - x, edges.north - y))
            if above < GRIPPED and inside > JET:
                continue
            filled = _filled(above)
            if settings.wall:
                filled = filled * _filled(x - edges.west) * _filled(y - edges.south)
                filled = filled * _filled(edges.east - x) * _filled(edges.north - y)
            if scratch[line.NEAR + q] < dense * filled:
                _limit_point(scratch, quads, integers, q, tile, report)


@kernel_part
def _above_ground(x, y, z, block, ground, dx):
    """Distance [cells] of a place in a block from the plane of the ground at the nearest node."""
    i, j = int(x + 0.5) + block[0] * BLOCK, int(y + 0.5) + block[1] * BLOCK
    slope_x, slope_y = ground[j, i, GROUND_SLOPE_X], ground[j, i, GROUND_SLOPE_Y]
    surface = ground[j, i, GROUND_HEIGHT] / dx + slope_x * (x + block[0] * BLOCK - i)
    surface += slope_y * (y + block[1] * BLOCK - j)
    return (z + block[2] * BLOCK - GHOSTS - surface) / sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)


@kernel_part
def _filled(distance):
    """Share of the full mass at the nodes around a point, `distance` [cells] inside the surface of a half-space.

    The integral of a quintic B-spline, to 0.01.
    """
    d = min(max(distance, 0.0), 1.8)
    return min(0.5 + d * (0.58 - 0.16 * d), 1.0)


@kernel_part
def _limit_point(scratch, quads, integers, q, tile, report):
    """Scale the affine momentum of a point by R^8; R^2 is its share of the variance of the velocities of the nodes.

    The variance is sum w |v_i - v_p|^2, that of the affine velocity dx^2 |C|^2 / 4; both are equal in a linear field.
    """
    affine = float(scratch[line.AFFINE2 + q])
    share = affine / _variance(scratch, quads, integers, q, tile)
    if share < 1.0 - BENT:
        kept = share * share * share * share
        mass = float(scratch[line.MASS + q])
        taken = (1.0 - kept) * 4.0 * mass
        for k in range(3):
            for axis in range(3):
                a, m = line.AXX + (4 * k + axis) * BATCH + q, line.XX + (3 * k + axis) * BATCH + q
                scratch[a] -= taken * float(scratch[m])
        report[entry.LIMITED] += 1.0
        report[entry.LIMITED_ENERGY] += 0.5 * mass * affine * (1.0 - kept * kept)


@kernel_part
def _variance(scratch, quads, integers, q, tile):
    """Weighted variance [m2 s-2] of the velocities of the nodes around a point about its own."""
    t = integers[line.I_PLACE + q]
    own, square = load(quads, line.Q_MEAN + 4 * q), lanes(0.0, 0.0, 0.0, 0.0)
    wx0, wx1, wx2 = get(scratch, line.WX0, q), get(scratch, line.WX1, q), get(scratch, line.WX2, q)
    for k in range(3):
        for j in range(3):
            w = get(scratch, line.WZ0 + k * BATCH, q) * get(scratch, line.WY0 + j * BATCH, q)
            d0, d1 = multiply_add(-1.0, own, load(tile, t)), multiply_add(-1.0, own, load(tile, t + 4))
            d2 = multiply_add(-1.0, own, load(tile, t + 8))
            row = multiply_lanes(d0, d0, wx0, lanes(0.0, 0.0, 0.0, 0.0))
            row = multiply_lanes(d2, d2, wx2, multiply_lanes(d1, d1, wx1, row))
            square = multiply_add(w, row, square)
            t += TILE_ROW
        t += TILE_LAYER - 3 * TILE_ROW
    return float(lane(square, 0)) + float(lane(square, 1)) + float(lane(square, 2))
