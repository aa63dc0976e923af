"""Limit of the affine velocity of points in thin sheets and at free surfaces.

The limit acts on a point where the grid around it has less than THIN of the density of the material, where the affine
velocity exceeds STILL of the speed of pressure waves at half a cell, and where the velocities of the nodes are not
linear: the affine velocity does not account for more than BENT of their variance. It acts more than GRIPPED cells above
the ground, or within JET cells of a wall if the gradient of the velocity normal to the wall has more than TOWARDS of
the squared gradient: flow along a smooth wall is not limited by it.
"""

from math import sqrt

import numpy as np

from ...compiled.jit import kernel_part
from ...compiled.simd_lanes import get, lane, lanes, load, multiply_add, multiply_lanes
from . import point_batch as line
from . import point_report as entry
from .point_batch import BATCH
from .point_ground import GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y
from .point_rows import BLOCK, GHOSTS, TILE_LAYER, TILE_ROW, Edges, Settings, StepFactors

GRIPPED = 2.0  # [cells] height above the ground up to which a point is not limited, except near a wall
JET = 3.0  # [cells] distance from a wall within which jets can form
TOWARDS = 0.1  # [1] least share of the squared velocity gradient that belongs to the velocity normal to the wall
THIN = 0.75  # [1] mass of the nodes around a point, over that in a full flow, below which it is in a thin sheet
STILL = 1e-3  # [1] affine velocity at half a cell, over the speed of pressure waves, up to which it is kept
BENT = 0.02  # [1] share of the variance of the nodes' velocities that the affine velocity may leave out
FAR = 1e9  # [cells] distance from a wall where there is none


@kernel_part
def limit_thin(
    scratch: np.ndarray,
    quads: np.ndarray,
    integers: np.ndarray,
    count: int,
    tile: np.ndarray,
    block: np.ndarray,
    edges: Edges,
    ground: np.ndarray,
    settings: Settings,
    factors: StepFactors,
    report: np.ndarray,
) -> None:
    """Limit the affine velocity of the batch's points in thin sheets and at free surfaces.

    The nodes around these have less than the mass `factors.dense` [kg]; with `settings.wall` the space beyond the edges
    of the domain counts as full. Points near the ground are not limited: its contact, not the free surface, makes the
    velocities of their nodes nonlinear, and the limit would take energy from the flow over rough ground in every step.
    Points near a wall of the domain are limited there too where the velocity normal to the wall varies: flow that hits
    a wall can form jets along it and in its corners.

    Parameters
    ----------
    scratch : float[LINES]
    quads : float[QUADS]
    integers : int32[INTEGERS]
    count : int
        Number of points in the batch.
    tile : float[TILE_SIZE]
        Velocities at the nodes of the tile.
    block : int32[3]
        x, y and z of the block.
    edges : Edges
    ground : float64[rows, columns, GROUND_ENTRIES]
    settings : Settings
    factors : StepFactors
    report : float64[REPORT]
        Of the chunk.
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
    """Compute the distance [cells] of a point from the nearest wall to which the varying velocity is normal."""
    least, inside = TOWARDS * 0.25 * scratch[line.AFFINE2 + q], FAR
    ux, uy, uz = scratch[line.XX + q], scratch[line.XY + q], scratch[line.XZ + q]
    if ux * ux + uy * uy + uz * uz > least:
        inside = min(x - edges.west, edges.east - x)
    vx, vy, vz = scratch[line.YX + q], scratch[line.YY + q], scratch[line.YZ + q]
    if vx * vx + vy * vy + vz * vz > least:
        inside = min(inside, min(y - edges.south, edges.north - y))
    return inside


@kernel_part
def above_ground(x: float, y: float, z: float, block: np.ndarray, ground: np.ndarray, dx: float) -> float:
    """Compute the distance of a place in a block from the plane of the ground at the nearest node [cells].

    Parameters
    ----------
    x, y, z : float [cells]
        The place, from the first node of the block.
    block : int32[3]
        x, y and z of the block.
    ground : float64[rows, columns, GROUND_ENTRIES]
    dx : float [m]
    """
    i, j = int(x + 0.5) + block[0] * BLOCK, int(y + 0.5) + block[1] * BLOCK
    slope_x, slope_y = ground[j, i, GROUND_SLOPE_X], ground[j, i, GROUND_SLOPE_Y]
    surface = ground[j, i, GROUND_HEIGHT] / dx + slope_x * (x + float(block[0] * BLOCK - i))
    surface += slope_y * (y + float(block[1] * BLOCK - j))
    return (z + float(block[2] * BLOCK - GHOSTS) - surface) / sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)


@kernel_part
def filled_share(distance: float) -> float:
    """Compute the share of the full mass at the nodes around a point inside the surface of a half-space [1].

    The integral of a quintic B-spline, to 0.01.

    Parameters
    ----------
    distance : float [cells]
        Of the point from the surface.
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
    """Compute the weighted variance [m2 s-2] of the velocities of the nodes around a point about its own."""
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
