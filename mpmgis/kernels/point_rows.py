"""A point of the 3D MPM as a row of numbers, and the stencil around it.

A row has groups of four numbers: place and first number of state; momentum and mass; then the three columns of the
affine momentum, each with one more number of state; four more numbers of state if the material has them.
Places are in cells from the first node of the block of the point: 0.5 to 4.5 in each direction. Single precision
therefore resolves a four-millionth of a cell in any domain.
"""

import numpy as np

from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .jit import jit, law_function

(X, Y, Z, S0, PX, PY, PZ, MASS, AXX, AYX, AZX, S1, AXY, AYY, AZY, S2, AXZ, AYZ, AZZ, S3, S4, S5, S6, S7) = range(24)
ROW_SHORT, ROW_LONG = 20, 24  # numbers of a row, for materials with up to 4 and up to 8 numbers of state
STATE = (S0, S1, S2, S3, S4, S5, S6, S7)

BLOCK = 4  # nodes along a block
TILE = BLOCK + 2  # nodes along a tile, which the points of a block reach
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

    All are floats, because a conversion to integers and back prevents vectorisation. A point on the upper side of the
    block by rounding belongs to its last node.
    """
    base = min(max(np.floor(place - 0.5), 0.0), LAST_BASE)
    f = place - base
    return base, f, 0.5 * (1.5 - f) * (1.5 - f), 0.75 - (f - 1.0) * (f - 1.0), 0.5 * (f - 0.5) * (f - 0.5)


law_function(stencil)


@jit
def volume_ratios(rows, material):
    """float64[n]: volume of each point over its stress-free volume [1]."""
    ratios = np.empty(rows.shape[0])
    for p in range(rows.shape[0]):
        s4, s5, s6, s7 = _more_state(rows, p)
        ratios[p] = material.volume_ratio(rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3], s4, s5, s6, s7)
    return ratios


@jit
def stored_energy(rows, density, material):
    """Elastic energy of all points [J]."""
    total = 0.0
    for p in range(rows.shape[0]):
        s4, s5, s6, s7 = _more_state(rows, p)
        total += (
            rows[p, MASS]
            / density
            * material.stored_energy(rows[p, S0], rows[p, S1], rows[p, S2], rows[p, S3], s4, s5, s6, s7)
        )
    return total


@jit
def _more_state(rows, p):
    """Numbers of state beyond the fourth; 0 in short rows."""
    if rows.shape[1] > S4:
        return rows[p, S4], rows[p, S4 + 1], rows[p, S4 + 2], rows[p, S4 + 3]
    return 0.0, 0.0, 0.0, 0.0
