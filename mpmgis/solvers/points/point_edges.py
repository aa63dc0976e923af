"""Points after a step: walls, outflow, points below the ground, next blocks, limit of the affine velocity."""

from math import sqrt

import numpy as np

from ...compiled.block_order import GONE
from ...compiled.jit import jit_borrowing, kernel_part
from ...compiled.lanes import get, lane, lanes, load, multiply_add, multiply_lanes, put
from . import point_batch as line
from . import point_report as entry
from .point_batch import BATCH
from .point_blocks import packed
from .point_ground import GROUND_DEEP, GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y
from .point_rows import BLOCK, GHOSTS, INDEX_MASK, TILE, TILE_LAYER, TILE_ROW

# The limit acts on a point more than GRIPPED cells above the ground or within JET cells of a wall, if the gradient of
# the velocity normal to the wall has more than TOWARDS of the squared gradient: flow along a smooth wall is not limited
# by it. It acts where the grid around the point has less than THIN of the density of the material, where the affine
# velocity exceeds STILL of the speed of pressure waves at half a cell, and where the velocities of the nodes are not
# linear: the affine velocity does not account for more than BENT of their variance.
GRIPPED, JET, TOWARDS, THIN, STILL, BENT = 2.0, 3.0, 0.1, 0.75, 1e-3, 0.02
FAR = 1e9  # cells from a wall where there is none
FAR_BLOCKS = 1e5  # no point moves further in one step; keeps the conversion to integers valid
INSIDE = 1e-6  # [cells] distance from a wall of a point that is stopped there: resolved in single precision
FLOAT_BLOCK = float(BLOCK)


@kernel_part
def limit_thin(scratch, quads, integers, count, tile, block, edges, ground, settings, factors, report):
    """Limit the affine velocity of the batch's points in thin sheets and at free surfaces.

    The nodes around these have less than the mass `factors.dense` [kg]; with `settings.wall` the space beyond the edges
    of the domain counts as full. Points near the ground are not limited: its contact, not the free surface, makes the
    velocities of their nodes nonlinear, and the limit would take energy from the flow over rough ground in every step.
    Points near a wall of the domain are limited there too where the velocity normal to the wall varies: flow that hits
    a wall can form jets along it and in its corners.
    """
    dense, still, dx, thin = factors.dense, factors.still, settings.dx, 0
    for q in range(BATCH):
        thin += (get(scratch, line.NEAR, q) < dense) & (get(scratch, line.AFFINE2, q) > still)
    if thin == 0:
        return
    for q in range(count):
        if scratch[line.NEAR + q] < dense and scratch[line.AFFINE2 + q] > still:
            x, y = float(scratch[line.FX + q]), float(scratch[line.FY + q])
            above = above_ground(x, y, float(scratch[line.FZ + q]), block, ground, dx)
            inside = FAR
            if settings.wall:
                inside = _inside_walls(scratch, q, x, y, edges)
            if above < GRIPPED and inside > JET:
                continue
            filled = filled_share(above)
            if settings.wall:
                filled = filled * filled_share(x - edges.west) * filled_share(y - edges.south)
                filled = filled * filled_share(edges.east - x) * filled_share(edges.north - y)
            if scratch[line.NEAR + q] < dense * filled:
                _limit_point(scratch, quads, integers, q, tile, report)


@kernel_part
def _inside_walls(scratch, q, x, y, edges):
    """Distance [cells] of a point from the nearest wall to which the varying velocity is normal."""
    least, inside = TOWARDS * 0.25 * scratch[line.AFFINE2 + q], FAR
    ux, uy, uz = scratch[line.XX + q], scratch[line.XY + q], scratch[line.XZ + q]
    if ux * ux + uy * uy + uz * uz > least:
        inside = min(x - edges.west, edges.east - x)
    vx, vy, vz = scratch[line.YX + q], scratch[line.YY + q], scratch[line.YZ + q]
    if vx * vx + vy * vy + vz * vz > least:
        inside = min(inside, min(y - edges.south, edges.north - y))
    return inside


@kernel_part
def above_ground(x, y, z, block, ground, dx):
    """Distance [cells] of a place in a block from the plane of the ground at the nearest node."""
    i, j = int(x + 0.5) + block[0] * BLOCK, int(y + 0.5) + block[1] * BLOCK
    slope_x, slope_y = ground[j, i, GROUND_SLOPE_X], ground[j, i, GROUND_SLOPE_Y]
    surface = ground[j, i, GROUND_HEIGHT] / dx + slope_x * (x + float(block[0] * BLOCK - i))
    surface += slope_y * (y + float(block[1] * BLOCK - j))
    return (z + float(block[2] * BLOCK - GHOSTS) - surface) / sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)


@kernel_part
def filled_share(distance):
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


@kernel_part
def keep_inside(scratch, count, edges):
    """Stop points at the walls on the edges; returns the number of points that were stopped."""
    west, south, east, north, held = edges.west, edges.south, edges.east, edges.north, 0
    for q in range(BATCH):
        x, y = get(scratch, line.X, q), get(scratch, line.Y, q)
        passed = (x < west + INSIDE) | (x > east - INSIDE) | (y < south + INSIDE) | (y > north - INSIDE)
        held += passed & (q < count)
        put(scratch, line.X, q, min(max(x, west + INSIDE), east - INSIDE))
        put(scratch, line.Y, q, min(max(y, south + INSIDE), north - INSIDE))
    return held


@kernel_part
def all_inside(scratch, integers, edges):
    """Whether all points are finite and inside the `edges` of the domain."""
    west, south, east, north, within = edges.west, edges.south, edges.east, edges.north, 0
    for q in range(BATCH):
        x, y, z = get(scratch, line.X, q), get(scratch, line.Y, q), get(scratch, line.Z, q)
        within += (x >= west) & (y >= south) & (x < east) & (y < north) & (z * 0.0 == 0.0)
        put(integers, line.I_STAYS, q, np.int32(1))
    return within == BATCH


@kernel_part
def find_blocks(scratch, integers):
    """Nearest node and new block of each point, and its place in that block."""
    for q in range(BATCH):
        x, y, z = get(scratch, line.X, q), get(scratch, line.Y, q), get(scratch, line.Z, q)
        put(integers, line.I_COLUMN, q, np.int32(np.floor(x + 0.5)))
        put(integers, line.I_ROW, q, np.int32(np.floor(y + 0.5)))
        i, j, k = np.floor((x - 0.5) * 0.25), np.floor((y - 0.5) * 0.25), np.floor((z - 0.5) * 0.25)
        k = min(max(k, -FAR_BLOCKS), FAR_BLOCKS)
        put(integers, line.I_BLOCK_X, q, np.int32(i))
        put(integers, line.I_BLOCK_Y, q, np.int32(j))
        put(integers, line.I_BLOCK_Z, q, np.int32(k))
        put(scratch, line.X, q, x - FLOAT_BLOCK * i)
        put(scratch, line.Y, q, y - FLOAT_BLOCK * j)
        put(scratch, line.Z, q, z - FLOAT_BLOCK * k)


@kernel_part
def book_out(scratch, integers, count, block, inside, edges, settings, report):
    """Record points that left over an edge or onto nodata, or are not finite; they keep their last place."""
    west, south, east, north = edges.west, edges.south, edges.east, edges.north
    dx, gravity = settings.dx, settings.gravity
    for q in range(count):
        x, y, z = scratch[line.X + q], scratch[line.Y + q], scratch[line.Z + q]
        if (x + y + z) * 0.0 != 0.0:  # NaN or infinite
            report[entry.NOT_FINITE] += 1.0
            report[entry.BAD_X] = (scratch[line.FX + q] + (block[0] * BLOCK - GHOSTS)) * dx
            report[entry.BAD_Y] = (scratch[line.FY + q] + (block[1] * BLOCK - GHOSTS)) * dx
            integers[line.I_STAYS + q] = 0
        edge = 0 if x < west else 1 if y < south else 2 if x >= east else 3 if y >= north else entry.EDGES
        if edge == entry.EDGES and integers[line.I_STAYS + q] == 1:
            # `x - west` would round up to the edge for a point that is stopped at a wall, in single precision
            known = inside[int(np.floor(y)) - int(south), int(np.floor(x)) - int(west)]
            edge = entry.EDGES if known else entry.EDGES - 1
        if edge < entry.EDGES and integers[line.I_STAYS + q] == 1:
            out, mass = entry.OUT + edge * entry.OUT_ENTRIES, float(scratch[line.MASS + q])
            report[out] += mass
            report[out + 1] += scratch[line.PX + q]
            report[out + 2] += scratch[line.PY + q]
            report[out + 3] += scratch[line.PZ + q]
            report[out + 4] += 0.5 * mass * scratch[line.SPEED2 + q]
            report[out + 5] += mass * gravity * ((z + (block[2] * BLOCK - GHOSTS)) * dx)
            report[out + 6] += 1.0
            integers[line.I_STAYS + q] = 0
        if integers[line.I_STAYS + q] == 0:
            for axis in range(3):
                scratch[line.X + axis * BATCH + q] = scratch[line.FX + axis * BATCH + q]


@kernel_part
def _lift_onto_ground(scratch, integers, q, block, ground, settings, report):
    """Move a point more than a cell below the ground onto it, and remove its momentum into the ground."""
    dx, gravity = settings.dx, settings.gravity
    i, j = integers[line.I_COLUMN + q] + block[0] * BLOCK, integers[line.I_ROW + q] + block[1] * BLOCK
    slope_x, slope_y = ground[j, i, GROUND_SLOPE_X], ground[j, i, GROUND_SLOPE_Y]
    x = float(scratch[line.X + q]) + (block[0] + integers[line.I_BLOCK_X + q]) * BLOCK
    y = float(scratch[line.Y + q]) + (block[1] + integers[line.I_BLOCK_Y + q]) * BLOCK
    level = block[2] + integers[line.I_BLOCK_Z + q]
    west, south = min(int(x), ground.shape[1] - 2), min(int(y), ground.shape[0] - 2)
    x, y = x - west, y - south  # between four nodes: at a cliff the plane of one node is metres too high
    surface = (1.0 - y) * ((1.0 - x) * ground[south, west, GROUND_HEIGHT] + x * ground[south, west + 1, GROUND_HEIGHT])
    surface += y * ((1.0 - x) * ground[south + 1, west, GROUND_HEIGHT] + x * ground[south + 1, west + 1, GROUND_HEIGHT])
    height = (float(scratch[line.Z + q]) + (level * BLOCK - GHOSTS)) * dx
    if height < surface - dx:
        report[entry.UNDER] += scratch[line.MASS + q]
        report[entry.UNDER_POINTS] += 1.0
        report[entry.UNDER_ENERGY] += float(scratch[line.MASS + q]) * gravity * (surface - height)
        steep = sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        nx, ny, nz = -slope_x / steep, -slope_y / steep, 1.0 / steep
        into = min(scratch[line.PX + q] * nx + scratch[line.PY + q] * ny + scratch[line.PZ + q] * nz, 0.0)
        scratch[line.PX + q] -= into * nx
        scratch[line.PY + q] -= into * ny
        scratch[line.PZ + q] -= into * nz
        report[entry.UNDER_X] -= into * nx
        report[entry.UNDER_Y] -= into * ny
        report[entry.UNDER_Z] -= into * nz
        up = surface / dx + GHOSTS
        level = int(up - 0.5) // BLOCK
        integers[line.I_BLOCK_Z + q] = level - block[2]
        scratch[line.Z + q] = up - level * BLOCK


@kernel_part
def give_keys(scratch, integers, points, first, count, block, surface, deepest, settings, report):
    """Set the blocks of the next step and widen the window; points below the ground are moved onto it.

    Only points below `deepest` [cells from the first node of the block] can be below the ground.
    """
    keys, order, ground, lowest = points.keys, points.order, surface.ground, surface.lowest
    for q in range(count):
        p = order[first + q] & INDEX_MASK
        if integers[line.I_STAYS + q] == 0:
            keys[p] = GONE
            continue
        if scratch[line.Z + q] + integers[line.I_BLOCK_Z + q] * FLOAT_BLOCK < deepest:
            i, j = integers[line.I_COLUMN + q] + block[0] * BLOCK, integers[line.I_ROW + q] + block[1] * BLOCK
            level = block[2] + integers[line.I_BLOCK_Z + q]
            if (float(scratch[line.Z + q]) + (level * BLOCK - GHOSTS)) * settings.dx < ground[j, i, GROUND_DEEP]:
                _lift_onto_ground(scratch, integers, q, block, ground, settings, report)
        if integers[line.I_BLOCK_X + q] | integers[line.I_BLOCK_Y + q] | integers[line.I_BLOCK_Z + q]:
            column, row = block[0] + integers[line.I_BLOCK_X + q], block[1] + integers[line.I_BLOCK_Y + q]
            level = block[2] + integers[line.I_BLOCK_Z + q] - lowest[row, column, 0]
            if level < 0:
                scratch[line.Z + q] += FLOAT_BLOCK * level
                level = 0
            keys[p] = packed(row, column, level)
            widen_window(report, row, column, level + lowest[row, column, 1])


@kernel_part
def widen_window(report, row, column, tall):
    """Widen the window of the chunk to a block that is `tall` blocks above the lowest one near it."""
    report[entry.BLOCK_WEST] = min(report[entry.BLOCK_WEST], float(column))
    report[entry.BLOCK_EAST] = max(report[entry.BLOCK_EAST], float(column))
    report[entry.BLOCK_SOUTH] = min(report[entry.BLOCK_SOUTH], float(row))
    report[entry.BLOCK_NORTH] = max(report[entry.BLOCK_NORTH], float(row))
    report[entry.BLOCK_TALL] = max(report[entry.BLOCK_TALL], float(tall))


@jit_borrowing
def deepest_level(ground, block, dx):
    """Level [cells from the first node of the block] below which a point near it can be below the ground."""
    deep = -np.inf
    for j in range(max(block[1] * BLOCK, 0), min(block[1] * BLOCK + TILE, ground.shape[0])):
        for i in range(max(block[0] * BLOCK, 0), min(block[0] * BLOCK + TILE, ground.shape[1])):
            deep = max(deep, ground[j, i, GROUND_DEEP])
    return deep / dx + (GHOSTS - BLOCK * block[2]) + INSIDE
