"""Records of arrays and laws that kernels of the 3D solver on a device take together."""

from typing import NamedTuple

import numpy as np

from ...laws.material import Material
from ...laws.softening import Softening


class TouchedBlocks(NamedTuple):
    """Blocks of nodes that points contribute to, and where they are."""

    nodes: np.ndarray  # real[touched, BLOCK_SIZE]
    touched: np.ndarray  # int32[touched, 3] row, column and level
    slots: np.ndarray  # int32[places of the window] touched block at each place, or -1
    lowest: np.ndarray  # see `point_blocks.lowest_blocks`


class PointsInBlocks(NamedTuple):
    """Points, sorted by blocks, and these blocks."""

    rows: np.ndarray  # real[n, ROW_SHORT or ROW_LONG]
    keys: np.ndarray  # int64[n] block of each point
    order: np.ndarray  # int32[n] indices of the points, sorted by block
    start: np.ndarray  # int64[active + 1] first point of each active block in `order`
    blocks: np.ndarray  # int32[active, 3] x, y, z of each block, counted in blocks
    targets: np.ndarray  # int32[active, 8] node blocks that the tile of each overlaps


class RarePoints(NamedTuple):
    """Points that `rare_points` moves, and the reports of all moved points."""

    marked: np.ndarray  # uint8[n] 1 for such a point, in the order of blocks
    blocks: np.ndarray  # uint8[active] 1 for a block with such points
    marks: np.ndarray  # real[threads, RARE_MARKS] reports of the threads, in `device_point_steps`
    counts: np.ndarray  # int32[threads, RARE_COUNTS]


class PointMap(NamedTuple):
    """Ground in short and domain below the points."""

    planes: np.ndarray  # real[rows, columns, PLANE_ENTRIES]
    lowest: np.ndarray  # see `point_blocks.lowest_blocks`
    inside: np.ndarray  # uint8[cells_y, cells_x], 1 where the terrain has an elevation


class MotionLaws(NamedTuple):
    """Laws of the motion of points, slots of `PointEffects` in the precision of the points."""

    material: Material
    softening: Softening
    transfer: int


class Shared(NamedTuple):
    """Arrays in the shared memory of a thread block that moves points."""

    lines: np.ndarray  # real[WIDEST, PITCH] rows of the points
    tile: np.ndarray  # real[TILE_SIZE] nodes that the points reach
    marks: np.ndarray  # real[WIDEST, MARKS] reports of the threads
