"""Records of arrays and laws that functions of the 3D step take together.

A loop of `prange` takes no record with records in it. Kernels with such a loop therefore take laws one by one, and
make their record in each chunk, which costs nothing.
"""

from typing import NamedTuple

import numpy as np

from ...laws.friction import Friction
from .point_ground import Ground


class PointPlaces(NamedTuple):
    """Ground and map of a run."""

    ground: Ground
    lowest: np.ndarray  # see `point_blocks.lowest_blocks`
    inside: np.ndarray  # uint8[cells_y, cells_x], 1 where the terrain has an elevation
    zone_values: np.ndarray  # float64[rows, columns, k] parameters of the contact law
    barriers: np.ndarray  # float64[rows, columns, POINT_BARRIER_ENTRIES]
    faces: np.ndarray  # float64[faces, FACE_ENTRIES]


class ContactLaws(NamedTuple):
    """Laws of what the flow touches, slots of `PointEffects`."""

    contact: Friction  # with the ground
    zones: bool  # whether the parameters of that contact are those of each node
    barrier: bool  # whether there are barriers


class Site(NamedTuple):
    """What stands at the node columns: the arrays of Ground, parameters, barriers."""

    ground: np.ndarray  # float[rows, columns, GROUND_ENTRIES]
    folds: np.ndarray  # int32[rows, columns, FOLD_ENTRIES], or [1, 1, FOLD_ENTRIES] where the ground has none
    exact: np.ndarray  # float[n, EXACT_ENTRIES]
    zone_values: np.ndarray  # float[rows, columns, k] parameters of the contact law
    barriers: np.ndarray  # float[rows, columns, POINT_BARRIER_ENTRIES]


class ColumnSums(NamedTuple):
    """Sums over all node columns in a step; [1, 1, .] where nothing uses them."""

    mass: np.ndarray  # float[rows, columns, COLUMN_MASSES] [kg], see `bed_drag`
    flow: np.ndarray  # float[rows, columns, COLUMN_FLOW] mass and momentum before openings


class NodeReports(NamedTuple):
    """Reports of the chunks of a loop over nodes."""

    nodes: np.ndarray  # float64[CHUNKS, NODE_REPORT] see `point_nodes`
    barriers: np.ndarray  # float64[CHUNKS, barriers, POINT_BARRIER_SUMS] loads on barriers


class FaceArrays(NamedTuple):
    """Barriers' smooth faces (see `point_faces`)."""

    values: np.ndarray  # float[faces, FACE_ENTRIES]
    lines: np.ndarray  # float[faces, COLUMNS + levels + 1, LINE_ENTRIES] work array
    yields: np.ndarray  # float[2, faces + 2, levels + 2, YIELD_ENTRIES] of two steps by turns, with a rim


class NodeColumn(NamedTuple):
    """A node column in a block of nodes and the blocks below and above it."""

    nodes: np.ndarray  # float[touched, BLOCK_SIZE]
    below: int  # touched block, -1 where there is none: the mass is 0 there
    own: int
    above: int
    first: int  # lowest level of block `own`
    column: int  # of the block's node columns, 0 to 15
