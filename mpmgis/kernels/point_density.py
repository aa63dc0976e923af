"""Correction of the volumes of fluid points whose density is not that of the nodes around them.

A point of a fluid has J, its volume over the stress-free volume, which follows the divergence of the velocity at the
point. How densely points lie follows their motion. Both drift apart, because the nodes do not resolve how points crowd
within a cell: in front of a wall that stops a stream, and in a pool with a slow circulation, the density reached six
times that of the fluid while J was 0.99.

The mass at the nodes gives the density around a point: the interpolated mass over the interpolated open part of the
nodes' splines, which is above the ground, before barriers and inside walls on the edges. Where its product with J
differs from 1 by more than a band, J relaxes towards the band, evenly over the steps until it is compared again: a
change at once would be a peak of the pressure. A low density may be that of a free surface: J increases
only where all nodes around a point are nearly full. The density of irregular points varies by less than the band.
"""

from math import sqrt

import numpy as np

from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import CHUNKS
from .contact_shares import mass_share, shares_on_slope
from .jit import jit_borrowing, jit_inline, jit_parallel, prange
from .point_barriers import FILLED, FILLED_TOP, SHARE
from .point_contact import YIELD, YIELD_STEP
from .point_ground import GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y, fold_at
from .point_nodes import CORRECTED, CORRECTED_ENERGY
from .point_rows import BLOCK, GHOSTS, INDEX_MASK, MASS, NODE_MASS, S0, S1, S2, TILE, X, Y, Z, stencil

EVERY = 16  # steps for which a rate of correction holds
RELAXATION = 30.0  # time of the relaxation, in cells over the speed of pressure waves
NEARLY_FULL = 0.9  # of the mass of a full node, from which no free surface is near
SMALL_PART = 0.1  # open part of a node behind a wall or under the ground, below which its mass tells nothing
LEAST_OPEN = 0.3  # open part of the splines around a point, below which its density is not known
UNKNOWN = -1.0  # open part of a node on folded ground or in an opening
TILE_NODES = TILE * TILE * TILE


@jit_inline
def relaxation_time(settings):
    """Time [s] in which J would close its gap at the rate of a correction."""
    return RELAXATION * settings.dx / settings.signal_speed


@jit_inline
def full_mass(settings):
    """Mass [kg] of a node around which the fluid is free of stress."""
    return settings.density * settings.dx * settings.dx * settings.dx


@jit_borrowing
def open_part(j, i, level, ground, yields, step, barriers, barred, settings):
    """Part [1] of the spline of node [j, i] at `level` that is open to the flow, UNKNOWN where it is not known.

    `yields` [rows, columns, YIELD_ENTRIES] of the ground are those after `step`; with `barred` there are `barriers`.
    """
    j, i = min(j, ground.nodes.shape[0] - 1), min(i, ground.nodes.shape[1] - 1)
    if fold_at(ground.folds, j, i)[2] > 0:
        return UNKNOWN
    dx, east, north = settings.dx, ground.nodes[j, i, GROUND_SLOPE_X], ground.nodes[j, i, GROUND_SLOPE_Y]
    height, slope2, above = ground.nodes[j, i, GROUND_HEIGHT], east * east + north * north, float(level - GHOSTS)
    if yields[j, i, YIELD_STEP] == float(step + 1):
        height -= yields[j, i, YIELD] * sqrt(1.0 + slope2)
    part = shares_on_slope(height / dx - above, sqrt(slope2))[1]
    if barred:
        if barriers[j, i, SHARE] > 0.0:
            return UNKNOWN
        if barriers[j, i, FILLED] > 0.0:
            part *= 1.0 - barriers[j, i, FILLED] * (1.0 - mass_share(barriers[j, i, FILLED_TOP] / dx - above))
    if settings.wall:
        east, north = float(i - GHOSTS), float(j - GHOSTS)
        part *= mass_share(-east) * mass_share(east - float(settings.cells_x))
        part *= mass_share(-north) * mass_share(north - float(settings.cells_y))
    return part


@jit_borrowing
def density_at(masses, parts, full, x, y, z):
    """(density over that of the fluid, whether all nodes around are nearly full) at a place in a block.

    The density is 0 where it is not known. `masses` [kg] and `parts` are those of the nodes of the block's tile; an
    open node of the mass `full` [kg] is full.
    """
    i, _, wx0, wx1, wx2 = stencil(x)
    j, _, wy0, wy1, wy2 = stencil(y)
    k, _, wz0, wz1, wz2 = stencil(z)
    wx, wy, wz = (wx0, wx1, wx2), (wy0, wy1, wy2), (wz0, wz1, wz2)
    first = (int(k) * TILE + int(j)) * TILE + int(i)
    mass, part, inside = 0.0, 0.0, True
    for c in range(3):
        for b in range(3):
            share = wz[c] * wy[b]
            for a in range(3):
                n = first + (c * TILE + b) * TILE + a
                if parts[n] < 0.0:
                    return 0.0, False
                mass += share * wx[a] * masses[n]
                part += share * wx[a] * parts[n]
                inside = inside and (masses[n] >= NEARLY_FULL * full * parts[n] or parts[n] < SMALL_PART)
    if part < LEAST_OPEN:
        return 0.0, False
    return mass / (part * full), inside


@jit_borrowing
def correct_point(rows, p, masses, parts, full, band, time, settings, material, mine):
    """Set the rate at which J of point `p` relaxes in `time` [s], and book the energy that the last one supplied.

    `masses` and `parts` are those of the nodes of its block, `mine` is the report of its chunk.
    """
    density, inside = density_at(masses, parts, full, float(rows[p, X]), float(rows[p, Y]), float(rows[p, Z]))
    gap = material.gap_at_density(rows[p, S0], density, inside, band)
    mine[CORRECTED] += 1.0 if gap != 0.0 else 0.0
    mine[CORRECTED_ENERGY] += rows[p, MASS] / settings.density * rows[p, S2]
    rows[p, S1], rows[p, S2] = gap / time, 0.0


@jit_borrowing
def node_of_tile(n, targets, place, nodes, free, ground, yields, step, barriers, barred, settings):
    """(mass [kg], open part) of node `n` of the tile of a block at `place`, whose tile overlaps blocks `targets`."""
    i, j, k = n % TILE, (n // TILE) % TILE, n // (TILE * TILE)
    t = targets[(i // BLOCK) + 2 * (j // BLOCK) + 4 * (k // BLOCK)]
    mass = nodes[t, (((k % BLOCK) * BLOCK + j % BLOCK) * BLOCK + i % BLOCK) * 4 + NODE_MASS]
    if free[t] != 0:
        return mass, 1.0
    j, i, level = place[1] * BLOCK + j, place[0] * BLOCK + i, place[2] * BLOCK + k
    return mass, open_part(j, i, level, ground, yields, step, barriers, barred, settings)


@jit_parallel
def correct_density(
    points, blocks, nodes, free, ground, yields, step, barriers, report, settings, material, barrier
):  # fmt: skip
    """Set the rates at which the volumes of all points are corrected in EVERY steps, the first of which is this one.

    Parameters
    ----------
    points : SortedPoints
    blocks : ActiveBlocks
    nodes : float[n_touched, BLOCK_SIZE]
        With the masses of this step.
    free : uint8[n_touched]
        1 for blocks whose nodes touch nothing.
    ground : Ground
    yields : float64[2, rows, columns, YIELD_ENTRIES]
        Yield of the ground after this and after the last step.
    step : int
        Number of this step.
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    report : float64[CHUNKS, NODE_REPORT]
    """
    time, full, after = relaxation_time(settings), full_mass(settings), yields[step % 2]
    barred = barrier.barrier_active()
    for c in prange(CHUNKS):
        masses, parts = np.zeros(TILE_NODES), np.zeros(TILE_NODES)
        for a in range(points.bounds[c], points.bounds[c + 1]):
            for n in range(TILE_NODES):
                masses[n], parts[n] = node_of_tile(
                    n, blocks.targets[a], blocks.places[a], nodes, free, ground, after, step, barriers, barred, settings
                )  # fmt: skip
            for s in range(points.start[a], points.start[a + 1]):
                correct_point(
                    points.rows, points.order[s] & INDEX_MASK, masses, parts, full, settings.density_band, time,
                    settings, material, report[c],
                )  # fmt: skip
