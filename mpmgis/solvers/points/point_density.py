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

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_inline, jit_parallel, prange
from ...laws.fluid_material import gap_at_density
from .contact_shares import mass_share, mass_share_on_slope
from .ground_contact import YIELD, YIELD_STEP
from .point_barriers import FILLED, FILLED_TOP, SHARE
from .point_ground import GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y, Ground, fold_at
from .point_nodes import CORRECTED, CORRECTED_ENERGY
from .point_rows import (
    BLOCK,
    GHOSTS,
    INDEX_MASK,
    MASS,
    NODE_MASS,
    S0,
    S1,
    S2,
    TILE,
    ActiveBlocks,
    NodeBlocks,
    Settings,
    SortedPoints,
    X,
    Y,
    Z,
    stencil,
)

EVERY = 16  # [steps] for which a rate of correction holds
RELAXATION = 20.0  # [1] time of the relaxation, over that of a pressure wave through a cell
NEARLY_FULL = 0.9  # [1] mass of a node over that of a full one, from which no free surface is near
SMALL_PART = 0.1  # [1] open part of a node behind a wall or under the ground, below which its mass is not used
LEAST_OPEN = 0.3  # [1] open part of the splines around a point, below which its density is not known
UNKNOWN = -1.0  # open part of a node on folded ground or in an opening
TILE_NODES = TILE * TILE * TILE  # nodes of a tile


@jit_inline
def relaxation_time(settings: Settings) -> float:
    """Compute the time in which J would close its gap at the rate of a correction [s].

    Parameters
    ----------
    settings : Settings
    """
    return RELAXATION * settings.dx / settings.signal_speed


@jit_inline
def full_mass(settings: Settings) -> float:
    """Compute the mass of a node around which the fluid is free of stress [kg].

    Parameters
    ----------
    settings : Settings
    """
    return settings.density * settings.dx * settings.dx * settings.dx


@jit_inline
def open_part(
    j: int,
    i: int,
    level: int,
    ground: Ground,
    yields: np.ndarray,
    step: int,
    barriers: np.ndarray,
    barred: bool,
    settings: Settings,
) -> float:
    """Compute the part of a node's spline that is open to the flow [1]; UNKNOWN where it is not known.

    Parameters
    ----------
    j, i, level : int
        Row, column and level of the node.
    ground : Ground
    yields : float64[rows, columns, YIELD_ENTRIES]
        Of the ground, after `step`.
    step : int
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    barred : bool
        Whether there are barriers.
    settings : Settings
    """
    j, i = min(j, ground.nodes.shape[0] - 1), min(i, ground.nodes.shape[1] - 1)
    if fold_at(ground.folds, j, i)[2] > 0:
        return UNKNOWN
    dx, east, north = settings.dx, ground.nodes[j, i, GROUND_SLOPE_X], ground.nodes[j, i, GROUND_SLOPE_Y]
    height, slope2, above = ground.nodes[j, i, GROUND_HEIGHT], east * east + north * north, float(level - GHOSTS)
    if yields[j, i, YIELD_STEP] == float(step + 1):
        height -= yields[j, i, YIELD] * sqrt(1.0 + slope2)
    part = mass_share_on_slope(height / dx - above, sqrt(slope2))
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


@jit_inline
def _line(values, n, w0, w1, w2):
    return w0 * values[n] + w1 * values[n + 1] + w2 * values[n + 2]


@jit_inline
def _plane(values, n, wx0, wx1, wx2, wy0, wy1, wy2):
    first, second = _line(values, n, wx0, wx1, wx2), _line(values, n + TILE, wx0, wx1, wx2)
    return wy0 * first + wy1 * second + wy2 * _line(values, n + 2 * TILE, wx0, wx1, wx2)


@jit_inline
def interpolated(values: np.ndarray, x: float, y: float, z: float) -> float:
    """Interpolate values at the nodes of a tile to a place in its block.

    Parameters
    ----------
    values : float[TILE_NODES]
    x, y, z : float [cells]
        The place, from the first node of the block.
    """
    i, _, wx0, wx1, wx2 = stencil(x)
    j, _, wy0, wy1, wy2 = stencil(y)
    k, _, wz0, wz1, wz2 = stencil(z)
    n = (int(k) * TILE + int(j)) * TILE + int(i)
    first = _plane(values, n, wx0, wx1, wx2, wy0, wy1, wy2)
    second = _plane(values, n + TILE * TILE, wx0, wx1, wx2, wy0, wy1, wy2)
    third = _plane(values, n + 2 * TILE * TILE, wx0, wx1, wx2, wy0, wy1, wy2)
    return wz0 * first + wz1 * second + wz2 * third


@jit_borrowing
def density_at(
    masses: np.ndarray, parts: np.ndarray, surely: tuple[bool, bool], full: float, x: float, y: float, z: float
) -> float:
    """Compute the density over that of the fluid at a place in a block [1]; 0 where it is not known.

    Parameters
    ----------
    masses : float[TILE_NODES] [kg]
        Of the nodes of the block's tile.
    parts : float[TILE_NODES] [1]
        Open parts of these nodes.
    surely : (bool, bool)
        Whether all parts are 1, and whether all are known, where this was found before.
    full : float [kg]
        Mass of an open node that is full.
    x, y, z : float [cells]
        The place, from the first node of the block.
    """
    all_open, all_known = surely
    mass = interpolated(masses, x, y, z)
    if all_open:
        return mass / full
    part = interpolated(parts, x, y, z)
    if part < LEAST_OPEN or not (all_known or are_known(parts, x, y, z)):
        return 0.0 * mass
    return mass / (part * full)


@jit_borrowing
def _first_node(x, y, z):
    """Return the index of the first of the 27 nodes around a place in a block, in its tile."""
    return (int(stencil(z)[0]) * TILE + int(stencil(y)[0])) * TILE + int(stencil(x)[0])


@jit_borrowing
def are_known(parts: np.ndarray, x: float, y: float, z: float) -> bool:
    """Return whether the open parts of all nodes around a place are known.

    Parameters
    ----------
    parts : float[TILE_NODES] [1]
    x, y, z : float [cells]
        The place, from the first node of the block.
    """
    first = _first_node(x, y, z)
    for c in range(3):
        for b in range(3):
            for a in range(3):
                if parts[first + (c * TILE + b) * TILE + a] < 0.0:
                    return False
    return True


@jit_borrowing
def are_nearly_full(masses: np.ndarray, parts: np.ndarray, full: float, x: float, y: float, z: float) -> bool:
    """Return whether all nodes around a place are nearly full, or behind a wall or under the ground.

    Parameters
    ----------
    masses : float[TILE_NODES] [kg]
    parts : float[TILE_NODES] [1]
        Open parts of the nodes.
    full : float [kg]
        Mass of an open node that is full.
    x, y, z : float [cells]
        The place, from the first node of the block.
    """
    first = _first_node(x, y, z)
    for c in range(3):
        for b in range(3):
            for a in range(3):
                n = first + (c * TILE + b) * TILE + a
                if masses[n] < NEARLY_FULL * full * parts[n] and parts[n] >= SMALL_PART:
                    return False
    return True


@jit_borrowing
def correct_point(
    rows: np.ndarray,
    p: int,
    masses: np.ndarray,
    parts: np.ndarray,
    surely: tuple[bool, bool],
    full: float,
    band: float,
    time: float,
    settings: Settings,
    mine: np.ndarray,
) -> None:
    """Set the rate at which J of a point relaxes, and book the energy that the last correction supplied.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    p : int
        Index of the point.
    masses : float[TILE_NODES] [kg]
    parts : float[TILE_NODES] [1]
    surely : (bool, bool)
    full : float [kg]
        Four arguments as in `density_at`.
    band : float [1]
        Deviation of J times the density from 1 that is not corrected.
    time : float [s]
        Of the relaxation.
    settings : Settings
    mine : float64[NODE_REPORT]
        Report of the chunk of the point.
    """
    x, y, z = rows[p, X], rows[p, Y], rows[p, Z]
    density = density_at(masses, parts, surely, full, x, y, z)
    low = rows[p, S0] * density < 1.0 - band  # a free surface may be near
    inside = density > 0.0 and (not low or are_nearly_full(masses, parts, full, x, y, z))
    gap = gap_at_density(rows[p, S0], density, inside, band)
    mine[CORRECTED] += 1.0 if gap != 0.0 else 0.0
    mine[CORRECTED_ENERGY] += rows[p, MASS] / settings.density * rows[p, S2]
    rows[p, S1], rows[p, S2] = gap / time, 0.0


@jit_inline
def place_in_tile(n: int) -> tuple[int, int, int]:
    """Return column, row and level of a node in a tile.

    Parameters
    ----------
    n : int
        Index of the node.
    """
    return n % TILE, (n // TILE) % TILE, n // (TILE * TILE)


@jit_inline
def node_of_tile(n: int, targets: np.ndarray) -> tuple[int, int]:
    """Return the block of a node of a tile, and the index of the node in it.

    Parameters
    ----------
    n : int
        Index of the node in the tile.
    targets : int32[8]
        Blocks that the tile overlaps.
    """
    i, j, k = place_in_tile(n)
    t = targets[(i // BLOCK) + 2 * (j // BLOCK) + 4 * (k // BLOCK)]
    return t, ((k % BLOCK) * BLOCK + j % BLOCK) * BLOCK + i % BLOCK


@jit_parallel
def _open_parts(parts, grid, free, ground, yields, step, barriers, barred, settings):
    """Compute the `open_part` of all nodes, into `parts` float[touched blocks, nodes of a block]."""
    for c in prange(CHUNKS):
        for t in range(c * grid.count // CHUNKS, (c + 1) * grid.count // CHUNKS):
            row, column, level = grid.touched[t, 0], grid.touched[t, 1], grid.touched[t, 2]
            for n in range(BLOCK * BLOCK * BLOCK):
                i, j, k = n % BLOCK, (n // BLOCK) % BLOCK, n // (BLOCK * BLOCK)
                part = 1.0
                if free[t] == 0:
                    part = open_part(
                        row * BLOCK + j,
                        column * BLOCK + i,
                        level * BLOCK + k,
                        ground,
                        yields,
                        step,
                        barriers,
                        barred,
                        settings,
                    )
                parts[t, n] = part


@jit_parallel
def correct_density(
    points: SortedPoints,
    blocks: ActiveBlocks,
    grid: NodeBlocks,
    free: np.ndarray,
    ground: Ground,
    yields: np.ndarray,
    step: int,
    barriers: np.ndarray,
    report: np.ndarray,
    settings: Settings,
    barred: bool,
) -> None:
    """Set the rates at which the volumes of all points are corrected in EVERY steps, the first of which is this one.

    Parameters
    ----------
    points : SortedPoints
    blocks : ActiveBlocks
    grid : NodeBlocks
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
    settings : Settings
    barred : bool
        Whether there are barriers.
    """
    real, after = points.rows.dtype.type, yields[step % 2]
    parts_of = np.empty((grid.count, BLOCK * BLOCK * BLOCK), points.rows.dtype)
    _open_parts(parts_of, grid, free, ground, after, step, barriers, barred, settings)
    time, full, band = real(relaxation_time(settings)), real(full_mass(settings)), real(settings.density_band)
    for c in prange(CHUNKS):
        masses, parts = np.zeros(TILE_NODES, points.rows.dtype), np.zeros(TILE_NODES, points.rows.dtype)
        for a in range(points.bounds[c], points.bounds[c + 1]):
            all_open = all_known = True
            for n in range(TILE_NODES):
                t, node = node_of_tile(n, blocks.targets[a])
                masses[n], parts[n] = grid.nodes[t, 4 * node + NODE_MASS], parts_of[t, node]
                all_open, all_known = all_open and parts[n] == 1.0, all_known and parts[n] >= 0.0
            for s in range(points.start[a], points.start[a + 1]):
                correct_point(
                    points.rows,
                    points.order[s] & INDEX_MASK,
                    masses,
                    parts,
                    (all_open, all_known),
                    full,
                    band,
                    time,
                    settings,
                    report[c],
                )
