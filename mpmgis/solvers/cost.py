"""What a run will cost, before it is started: time and memory, nominally."""

import os

import numpy as np

from ..fields import GRAVITY
from ..kernels.columns import ROW

BYTES_PER_COLUMN = 2 * ROW * 8 + 2 * 8 + 2 * 4 + 4 + 160  # rows, ids, keys, order; a frame on its way out
BYTES_PER_NODE = 8 * (1 + 2 + 4) + 2  # bed, gradient, node entries; wet and inside
NANOSECONDS_PER_STEP = 50.0  # of one column on one thread: enough to ask before an hour is spent, no promise


def predicted(columns, thickness, nodes, elevation_bytes, cell_size, cfl, end_time, line_speed, threads):
    """(seconds, bytes) that a run will need.

    The number of steps follows from half the energy line's speed `line_speed` [m s-1] and the wave speed of the mean
    `thickness` [m] over `end_time` [s].
    """
    signal = 0.5 * line_speed + np.sqrt(GRAVITY * thickness)
    steps = end_time * signal / (cfl * cell_size)
    memory = columns * BYTES_PER_COLUMN + nodes * BYTES_PER_NODE + 3 * elevation_bytes
    return steps * columns * NANOSECONDS_PER_STEP * 1e-9 / threads, memory


def available_memory():
    """Free memory of this machine [bytes]; infinite where the system does not tell."""
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return float("inf")
