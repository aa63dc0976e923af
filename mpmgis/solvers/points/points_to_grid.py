"""Points to grid: mass and momentum with the impulse of the stress.

Each block sums its points into a private tile; the grid adds the tiles that overlap a node in a fixed order. Loops
share nothing and every sum has a fixed order: results are bitwise identical for any number of threads.
"""

import numpy as np

from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_parallel, kernel_part, law_function, prange
from ...compiled.simd_lanes import get, load, multiply_add, store, without_last
from . import point_batch as line
from .point_batch import BATCH, INTEGERS, LINES
from .point_rows import AXX, AXY, AXZ, INDEX_MASK, PX, TILE_LAYER, TILE_ROW, SortedPoints, take_places, weigh


def _spread_one(rows, p, scratch, integers, q, tile):
    """Add a point's mass and momentum to its 27 nodes: node gets w (m v + A (x_node - x_point))."""
    t = integers[line.I_PLACE + q]
    along_x, along_y = without_last(load(rows, p + AXX)), without_last(load(rows, p + AXY))
    along_z = without_last(load(rows, p + AXZ))
    wx0, wx1, wx2 = get(scratch, line.WX0, q), get(scratch, line.WX1, q), get(scratch, line.WX2, q)
    corner = multiply_add(-get(scratch, line.FX, q), along_x, load(rows, p + PX))
    corner = multiply_add(-get(scratch, line.FY, q), along_y, corner)
    corner = multiply_add(-get(scratch, line.FZ, q), along_z, corner)
    for k in range(3):
        wz = get(scratch, line.WZ0 + k * BATCH, q)
        near = corner
        for j in range(3):
            w = wz * get(scratch, line.WY0 + j * BATCH, q)
            middle = multiply_add(1.0, along_x, near)
            store(tile, t, multiply_add(w * wx0, near, load(tile, t)))
            store(tile, t + 4, multiply_add(w * wx1, middle, load(tile, t + 4)))
            store(tile, t + 8, multiply_add(w * wx2, multiply_add(1.0, along_x, middle), load(tile, t + 8)))
            near = multiply_add(1.0, along_y, near)
            t += TILE_ROW
        corner = multiply_add(1.0, along_z, corner)
        t += TILE_LAYER - 3 * TILE_ROW


law_function(_spread_one)


@kernel_part
def _spread(rows, order, first, count, scratch, integers, tile):
    """Spread the batch, alternating between its halves: consecutive points would wait for sums at the same nodes."""
    row = rows.shape[1]
    half = (count + 1) // 2
    for q in range(half):
        _spread_one(rows, (order[first + q] & INDEX_MASK) * row, scratch, integers, q, tile)
        if q + half < count:
            _spread_one(rows, (order[first + q + half] & INDEX_MASK) * row, scratch, integers, q + half, tile)


@jit_borrowing
def _sum_blocks(points, tiles, first_block, end_block, scratch, integers):
    """Sum the points of the active blocks `first_block` to `end_block` into their tiles."""
    rows, order, start = points.rows, points.order, points.start
    for a in range(first_block, end_block):
        tile = tiles[a]
        tile[:] = 0.0
        for first in range(start[a], start[a + 1], BATCH):
            count = min(BATCH, start[a + 1] - first)
            take_places(rows, order, first, count, scratch)
            weigh(scratch, integers)
            _spread(rows, order, first, count, scratch, integers, tile)


@jit_parallel
def points_to_grid(points: SortedPoints, tiles: np.ndarray) -> None:
    """Sum mass and momentum, with the impulse of the stress, of the points of each block into its tile.

    MLS-MPM of Hu et al. 2018.

    Parameters
    ----------
    points : SortedPoints
    tiles : float[active, TILE_SIZE]
        Is set: momentum [kg m s-1] and mass [kg] at the nodes of each tile.
    """
    for c in prange(CHUNKS):
        scratch, integers = np.zeros(LINES, points.rows.dtype), np.zeros(INTEGERS, np.int32)
        _sum_blocks(points, tiles, points.bounds[c], points.bounds[c + 1], scratch, integers)
