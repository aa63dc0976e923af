"""A point of the 3D MPM as a row of numbers, and the stencil around it.

A row holds four numbers at a time, as they are worked on: place and first number of state; momentum and mass; then the
three columns of the affine momentum, each with one more number of state; four more numbers of state where the material
has them. Places are in cells from the first node of the point's block: 0.5 to 4.5 in each direction. So single
precision resolves a four millionth of a cell, however large the domain.
"""

import numpy as np

from .jit import law_function

(X, Y, Z, S0, PX, PY, PZ, MASS, AXX, AYX, AZX, S1, AXY, AYY, AZY, S2, AXZ, AYZ, AZZ, S3, S4, S5, S6, S7) = range(24)
ROW_SHORT, ROW_LONG = 20, 24  # numbers of a row, for materials with up to 4 and up to 8 numbers of state
STATE = (S0, S1, S2, S3, S4, S5, S6, S7)

BLOCK = 4  # nodes along a block
TILE = BLOCK + 2  # nodes along what the points of a block reach
TILE_ROW = 4 * TILE
TILE_LAYER = TILE * TILE_ROW
TILE_SIZE = TILE * TILE_LAYER
BLOCK_SIZE = BLOCK * BLOCK * BLOCK * 4
GHOSTS = BLOCK  # nodes before the domain's corner, in each direction

NODE_X, NODE_Y, NODE_Z, NODE_MASS = range(4)
INDEX_MASK = 0x7FFFFFFF
LAST_BASE = BLOCK - 1.0


def stencil(place):
    """First of three nodes of the block along an axis, offset from it in cells (0.5 to 1.5), weights of the spline.

    All are floats, for one that is made a whole number and back costs its vector. Who stands on the block's upper side
    by rounding belongs to its last node.
    """
    base = min(max(np.floor(place - 0.5), 0.0), LAST_BASE)
    f = place - base
    return base, f, 0.5 * (1.5 - f) * (1.5 - f), 0.75 - (f - 1.0) * (f - 1.0), 0.5 * (f - 0.5) * (f - 0.5)


law_function(stencil)
