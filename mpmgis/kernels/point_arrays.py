"""Arrays and numbers that the kernels of the 3D MPM take in groups."""

from typing import NamedTuple

import numpy as np


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
