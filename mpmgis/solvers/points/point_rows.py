"""Points of the 3D MPM in memory: rows of numbers, their stencil, batches of them, and the arrays of a step.

A row has groups of four numbers: place and first number of state; momentum and mass; then the three columns of the
affine momentum, each with one more number of state; four more numbers of state if the material has them.
Places are in cells from the first node of the block of the point: 0.5 to 4.5 in each direction. Single precision
therefore resolves a four-millionth of a cell in any domain.
"""

from typing import NamedTuple

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.jit import jit, kernel_part, law_function
from ...compiled.simd_lanes import get, load, prefetch, put, store, transposed
from ...laws.material import Material
from ...laws.material_choice import volume_ratio
from . import point_batch as line
from .point_batch import BATCH

# entries of a row
(
    X,  # [cells] place from the first node of the block, east
    Y,  # [cells] north
    Z,  # [cells] up
    S0,  # numbers of state of the material
    PX,  # [kg m s-1] momentum, east
    PY,  # [kg m s-1] north
    PZ,  # [kg m s-1] up
    MASS,  # [kg]
    AXX,  # [kg m s-1] affine momentum over a cell: component x, along x
    AYX,  # [kg m s-1] component y
    AZX,  # [kg m s-1] component z
    S1,
    AXY,  # [kg m s-1] component x, along y
    AYY,  # [kg m s-1] component y
    AZY,  # [kg m s-1] component z
    S2,
    AXZ,  # [kg m s-1] component x, along z
    AYZ,  # [kg m s-1] component y
    AZZ,  # [kg m s-1] component z
    S3,
    S4,
    S5,
    S6,
    S7,
) = range(24)
ROW_SHORT = 20  # numbers of a row, for materials with up to 4 numbers of state
ROW_LONG = 24  # numbers of a row, for materials with up to 8 numbers of state
STATE = (S0, S1, S2, S3, S4, S5, S6, S7)

BLOCK = 4  # nodes along a block
TILE = BLOCK + 2  # nodes along a tile, which the points of a block reach
TILE_ROW = 4 * TILE  # numbers of a row of nodes in a tile
TILE_LAYER = TILE * TILE_ROW  # numbers of a layer of nodes in a tile
TILE_SIZE = TILE * TILE_LAYER  # numbers of a tile
BLOCK_SIZE = BLOCK * BLOCK * BLOCK * 4  # numbers of a block of nodes
GHOSTS = BLOCK  # nodes before the domain's corner, in each direction
# entries of a node
(
    NODE_X,  # [m s-1] velocity after the forces, [kg m s-1] momentum before: east
    NODE_Y,  # north
    NODE_Z,  # up
    NODE_MASS,  # [kg]
) = range(4)
INDEX_MASK = 0x7FFFFFFF  # bits of an index, which is never negative
LAST_BASE = BLOCK - 1.0  # first of the three nodes of a point, at most
# as floats, for products with floats
FLOAT_LAYER = float(TILE_LAYER)
FLOAT_ROW = float(TILE_ROW)


def stencil(place: float) -> tuple[float, float, float, float, float]:
    """Compute the three nodes of a point along an axis, and their weights in the quadratic B-spline.

    All results are floats, because a conversion to integers and back prevents vectorisation. A point on the upper side
    of the block by rounding belongs to its last node.

    Parameters
    ----------
    place : float [cells]
        Of the point, from the first node of the block.

    Returns
    -------
    (float, float [cells], float, float, float)
        First node; offset of the point from it, 0.5 to 1.5; weights of the three nodes.
    """
    base = min(max(np.floor(place - 0.5), 0.0), LAST_BASE)
    f = place - base
    return base, f, 0.5 * (1.5 - f) * (1.5 - f), 0.75 - (f - 1.0) * (f - 1.0), 0.5 * (f - 0.5) * (f - 0.5)


law_function(stencil)


@jit
def volume_ratios(rows: np.ndarray, material: Material) -> np.ndarray:
    """Compute the volume of each point over its stress-free volume, float64[n] [1].

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    material : Material
    """
    ratios = np.empty(rows.shape[0])
    for p in range(rows.shape[0]):
        s4, s5, s6, s7 = more_state(rows, p)
        state = rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3], s4, s5, s6, s7
        ratios[p] = volume_ratio(material, state)
    return ratios


@jit
def more_state(rows: np.ndarray, p: int) -> tuple[float, float, float, float]:
    """Return the numbers of state of a point beyond the fourth; 0 in short rows.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    p : int
        Index of the point.
    """
    if rows.shape[1] > S4:
        return rows[p, S4], rows[p, S4 + 1], rows[p, S4 + 2], rows[p, S4 + 3]
    return 0.0, 0.0, 0.0, 0.0


@kernel_part
def weigh(scratch: np.ndarray, integers: np.ndarray) -> None:
    """Compute the weights and offsets of each point of the batch, and the index of its first node in the tile.

    Parameters
    ----------
    scratch : float[LINES]
    integers : int32[INTEGERS]
    """
    for q in range(BATCH):
        i, fx, wx0, wx1, wx2 = stencil(get(scratch, line.X, q))
        j, fy, wy0, wy1, wy2 = stencil(get(scratch, line.Y, q))
        k, fz, wz0, wz1, wz2 = stencil(get(scratch, line.Z, q))
        put(integers, line.I_PLACE, q, np.int32(k * FLOAT_LAYER + j * FLOAT_ROW + i * 4.0))
        put(scratch, line.FX, q, fx)
        put(scratch, line.FY, q, fy)
        put(scratch, line.FZ, q, fz)
        put(scratch, line.WX0, q, wx0)
        put(scratch, line.WX1, q, wx1)
        put(scratch, line.WX2, q, wx2)
        put(scratch, line.WY0, q, wy0)
        put(scratch, line.WY1, q, wy1)
        put(scratch, line.WY2, q, wy2)
        put(scratch, line.WZ0, q, wz0)
        put(scratch, line.WZ1, q, wz1)
        put(scratch, line.WZ2, q, wz2)


@kernel_part
def _prefetch_batch(rows, order, first):
    """Prefetch the rows of the batch after the one that starts at `first`."""
    row = rows.shape[1]
    for q in range(first + BATCH, min(first + 2 * BATCH, order.size)):
        p = (order[q] & INDEX_MASK) * row
        prefetch(rows, p)
        prefetch(rows, p + 8)
        prefetch(rows, p + row - 1)


@kernel_part
def take_places(rows: np.ndarray, order: np.ndarray, first: int, count: int, scratch: np.ndarray) -> None:
    """Copy the places of the points of a batch into lines; the next batch is prefetched.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    order : int32[n]
    first, count : int
        The batch is order[first : first + count].
    scratch : float[LINES]
    """
    _prefetch_batch(rows, order, first)
    row = rows.shape[1]
    for q in range(count):
        p = (order[first + q] & INDEX_MASK) * row
        put(scratch, line.X, q, get(rows, p, X))
        put(scratch, line.Y, q, get(rows, p, Y))
        put(scratch, line.Z, q, get(rows, p, Z))


@kernel_part
def take_rows(rows: np.ndarray, order: np.ndarray, first: int, count: int, scratch: np.ndarray) -> None:
    """Copy place, mass and state of the points of a batch into lines; the next batch is prefetched.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    order : int32[n]
    first, count : int
        The batch is order[first : first + count].
    scratch : float[LINES]
    """
    _prefetch_batch(rows, order, first)
    row, last = rows.shape[1], count - 1
    for q in range(0, BATCH, 4):  # beyond `count` the last point again
        p0 = (order[first + min(q, last)] & INDEX_MASK) * row
        p1 = (order[first + min(q + 1, last)] & INDEX_MASK) * row
        p2 = (order[first + min(q + 2, last)] & INDEX_MASK) * row
        p3 = (order[first + min(q + 3, last)] & INDEX_MASK) * row
        x, y, z, s0 = transposed(load(rows, p0), load(rows, p1), load(rows, p2), load(rows, p3))
        store(scratch, line.X + q, x)
        store(scratch, line.Y + q, y)
        store(scratch, line.Z + q, z)
        store(scratch, line.S0 + q, s0)
        if row > S4:
            s4, s5, s6, s7 = transposed(
                load(rows, p0 + S4), load(rows, p1 + S4), load(rows, p2 + S4), load(rows, p3 + S4)
            )
            store(scratch, line.S4 + q, s4)
            store(scratch, line.S5 + q, s5)
            store(scratch, line.S6 + q, s6)
            store(scratch, line.S7 + q, s7)
    for q in range(BATCH):
        p = (order[first + min(q, last)] & INDEX_MASK) * row
        put(scratch, line.MASS, q, get(rows, p, MASS))
        put(scratch, line.S1, q, get(rows, p, S1))
        put(scratch, line.S2, q, get(rows, p, S2))
        put(scratch, line.S3, q, get(rows, p, S3))


@kernel_part
def give_rows(rows: np.ndarray, order: np.ndarray, first: int, count: int, scratch: np.ndarray) -> None:
    """Copy the lines of a batch into the rows of its points.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    order : int32[n]
    first, count : int
        The batch is order[first : first + count].
    scratch : float[LINES]
    """
    row, last = rows.shape[1], count - 1
    for q in range(0, count, 4):
        # beyond `count` the last point again; its own numbers are stored last
        p0 = (order[first + q] & INDEX_MASK) * row
        p1 = (order[first + min(q + 1, last)] & INDEX_MASK) * row
        p2 = (order[first + min(q + 2, last)] & INDEX_MASK) * row
        p3 = (order[first + min(q + 3, last)] & INDEX_MASK) * row
        for group in range(6 if row > S4 else 5):
            head, fourth = _lines_of_group(group)
            a, b, c, d = transposed(
                load(scratch, head + q),
                load(scratch, head + BATCH + q),
                load(scratch, head + 2 * BATCH + q),
                load(scratch, fourth + q),
            )
            store(rows, p3 + 4 * group, d)
            store(rows, p2 + 4 * group, c)
            store(rows, p1 + 4 * group, b)
            store(rows, p0 + 4 * group, a)


@kernel_part
def _lines_of_group(group):
    """Return the lines of the first three numbers and of the fourth of a group of four in a row."""
    head = line.X + group * 4 * BATCH
    fourth = line.MASS
    if group == 0:
        fourth = line.N0
    elif group == 2:
        fourth = line.N1
    elif group == 3:
        fourth = line.N2
    elif group == 4:
        fourth = line.N3
    elif group == 5:
        head, fourth = line.N4, line.N7
    return head, fourth


class Settings(NamedTuple):
    """Settings that are constant during the time integration."""

    dx: float  # [m]
    density: float  # [kg m-3]
    gravity: float  # [m s-2]
    cfl: float
    signal_speed: float  # of pressure waves [m s-1]
    viscous_limit: float  # [s], infinite without viscosity
    fixed_dt: float  # [s]; 0: by the Courant number
    clearance: float  # height above the ground at which a node on a fold is in contact with it [m]
    cells_x: int
    cells_y: int
    leak_stop: float  # share of the mass below the ground in one step
    wall: bool
    holes: bool  # the terrain has cells without elevation
    keep_peaks: bool
    arrival_thickness: float  # for peaks of speed and pressure, and for arrivals [m]
    lone_thickness: float  # largest thickness of a single point at a node [m]
    density_band: float  # deviation of the density at the nodes from that of J, above which J of a fluid is corrected
    slack: float  # 1: layers transfer the friction mu p, 0: the material does


class SortedPoints(NamedTuple):
    """Points, sorted by blocks."""

    rows: np.ndarray  # float[n, ROW_SHORT or ROW_LONG]
    keys: np.ndarray  # int64[n] block of each point
    order: np.ndarray  # int32[n] indices of the points, sorted by block
    start: np.ndarray  # int64[active + 1] first point of each active block in `order`
    bounds: np.ndarray  # int64[CHUNKS + 1] first active block of each chunk


class ActiveBlocks(NamedTuple):
    """Blocks that contain points."""

    places: np.ndarray  # int32[active, 3] x, y, z, counted in blocks
    targets: np.ndarray  # int32[active, 8] node blocks that the tile of each overlaps
    tiles: np.ndarray  # float[active, TILE_SIZE]


class NodeBlocks(NamedTuple):
    """Blocks of nodes that points contribute to."""

    nodes: np.ndarray  # float[touched, BLOCK_SIZE]
    touched: np.ndarray  # int32[touched, 3] row, column and level
    count: int


class BlockWindow(NamedTuple):
    """Range of blocks that contain points."""

    slots: np.ndarray  # int32[height * width * depth] touched block at each place, or -1
    west: int
    south: int
    width: int
    height: int
    depth: int
    lowest: np.ndarray  # see `point_blocks.lowest_blocks`


class Surface(NamedTuple):
    """Ground and domain below the points."""

    ground: np.ndarray  # float[rows, columns, GROUND_ENTRIES]
    lowest: np.ndarray  # see `point_blocks.lowest_blocks`
    inside: np.ndarray  # uint8[cells_y, cells_x], 1 where the terrain has an elevation


class Edges(NamedTuple):
    """Edges of the domain, in cells from the first node of a block."""

    west: float
    south: float
    east: float
    north: float


class StepFactors(NamedTuple):
    """Factors of a step, in the precision of the points."""

    gradient: float  # from moments of the velocity to its gradient, 4 / dx
    dt: float  # [s]
    shift: float  # dt / dx
    push: float  # from stress to affine momentum of the next step
    dense: float  # mass [kg] of the nodes around a point, below which its affine velocity may be limited
    still: float  # squared affine velocity, above which it may be limited
