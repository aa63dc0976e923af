"""Points after a step: walls on the edges, outflow, points below the ground, blocks of the next step."""

from math import sqrt

import numpy as np

from ...compiled.block_order import GONE
from ...compiled.jit import jit_borrowing, kernel_part
from ...compiled.simd_lanes import get, put
from . import point_batch as line
from . import point_report as entry
from .point_batch import BATCH
from .point_blocks import packed
from .point_ground import GROUND_DEEP, GROUND_HEIGHT, GROUND_SLOPE_X, GROUND_SLOPE_Y
from .point_rows import BLOCK, GHOSTS, INDEX_MASK, TILE, Edges, Settings, SortedPoints, Surface

FAR_BLOCKS = 1e5  # [blocks] no point moves further in one step; keeps the conversion to integers valid
INSIDE = 1e-6  # [cells] distance from a wall of a point that is stopped there: resolved in single precision
FLOAT_BLOCK = float(BLOCK)  # [nodes] for products with floats


@kernel_part
def keep_inside(scratch: np.ndarray, count: int, edges: Edges) -> int:
    """Stop points at the walls on the edges, and return the number of points that were stopped.

    Parameters
    ----------
    scratch : float[LINES]
    count : int
        Number of points in the batch.
    edges : Edges
    """
    west, south, east, north, held = edges.west, edges.south, edges.east, edges.north, 0
    for q in range(BATCH):
        x, y = get(scratch, line.X, q), get(scratch, line.Y, q)
        passed = (x < west + INSIDE) | (x > east - INSIDE) | (y < south + INSIDE) | (y > north - INSIDE)
        held += passed & (q < count)
        put(scratch, line.X, q, min(max(x, west + INSIDE), east - INSIDE))
        put(scratch, line.Y, q, min(max(y, south + INSIDE), north - INSIDE))
    return held


@kernel_part
def all_inside(scratch: np.ndarray, integers: np.ndarray, edges: Edges) -> bool:
    """Return whether all points are finite and inside the edges of the domain; set that all stay in it.

    Parameters
    ----------
    scratch : float[LINES]
    integers : int32[INTEGERS]
    edges : Edges
    """
    west, south, east, north, within = edges.west, edges.south, edges.east, edges.north, 0
    for q in range(BATCH):
        x, y, z = get(scratch, line.X, q), get(scratch, line.Y, q), get(scratch, line.Z, q)
        within += (x >= west) & (y >= south) & (x < east) & (y < north) & (z * 0.0 == 0.0)
        put(integers, line.I_STAYS, q, np.int32(1))
    return within == BATCH


@kernel_part
def find_blocks(scratch: np.ndarray, integers: np.ndarray) -> None:
    """Find the nearest node and the new block of each point, and its place in that block.

    Parameters
    ----------
    scratch : float[LINES]
    integers : int32[INTEGERS]
    """
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
def book_out(
    scratch: np.ndarray,
    integers: np.ndarray,
    count: int,
    block: np.ndarray,
    inside: np.ndarray,
    edges: Edges,
    settings: Settings,
    report: np.ndarray,
) -> None:
    """Record points that left over an edge or onto nodata, or are not finite; they keep their last place.

    Parameters
    ----------
    scratch : float[LINES]
    integers : int32[INTEGERS]
    count : int
        Number of points in the batch.
    block : int32[3]
        x, y and z of the block.
    inside : uint8[cells_y, cells_x]
        1 where the terrain has an elevation.
    edges : Edges
    settings : Settings
    report : float64[REPORT]
        Of the chunk.
    """
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
def give_keys(
    scratch: np.ndarray,
    integers: np.ndarray,
    points: SortedPoints,
    first: int,
    count: int,
    block: np.ndarray,
    surface: Surface,
    deepest: float,
    settings: Settings,
    report: np.ndarray,
) -> None:
    """Set the blocks of the next step and widen the window; points below the ground are moved onto it.

    Parameters
    ----------
    scratch : float[LINES]
    integers : int32[INTEGERS]
    points : SortedPoints
    first : int
        Place of the batch in the order of the points.
    count : int
        Number of points in the batch.
    block : int32[3]
        x, y and z of the block.
    surface : Surface
    deepest : float [cells]
        Level from the first node of the block, below which points can be below the ground, see `deepest_level`.
    settings : Settings
    report : float64[REPORT]
        Of the chunk.
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
def widen_window(report: np.ndarray, row: int, column: int, tall: int) -> None:
    """Widen the window of a chunk to a block.

    Parameters
    ----------
    report : float64[REPORT]
        Of the chunk.
    row, column : int [blocks]
    tall : int [blocks]
        Height above the lowest block near it.
    """
    report[entry.BLOCK_WEST] = min(report[entry.BLOCK_WEST], float(column))
    report[entry.BLOCK_EAST] = max(report[entry.BLOCK_EAST], float(column))
    report[entry.BLOCK_SOUTH] = min(report[entry.BLOCK_SOUTH], float(row))
    report[entry.BLOCK_NORTH] = max(report[entry.BLOCK_NORTH], float(row))
    report[entry.BLOCK_TALL] = max(report[entry.BLOCK_TALL], float(tall))


@jit_borrowing
def deepest_level(ground: np.ndarray, block: np.ndarray, dx: float) -> float:
    """Find the level below which a point near a block can be below the ground [cells from the first node of the block].

    Parameters
    ----------
    ground : float64[rows, columns, GROUND_ENTRIES]
    block : int32[3]
        x, y and z of the block.
    dx : float [m]
    """
    deep = -np.inf
    for j in range(max(block[1] * BLOCK, 0), min(block[1] * BLOCK + TILE, ground.shape[0])):
        for i in range(max(block[0] * BLOCK, 0), min(block[0] * BLOCK + TILE, ground.shape[1])):
            deep = max(deep, ground[j, i, GROUND_DEEP])
    return deep / dx + (GHOSTS - BLOCK * block[2]) + INSIDE
