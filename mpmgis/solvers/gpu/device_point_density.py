"""Correction of the volumes of fluid points on the device (see `point_density`)."""

import numpy as np
from numba import cuda, int32

from ..points import point_density
from ..points.point_density import (
    EVERY,
    TILE_NODES,
    correct_point,
    full_mass,
    node_of_tile,
    open_part,
    place_in_tile,
    relaxation_time,
)
from ..points.point_ground import Ground
from ..points.point_rows import BLOCK, NODE_MASS, TILE, Settings
from ..points.point_time_step import STEP
from .device_functions import Part, capped, real, stand_in
from .device_point_steps import stencil
from .device_records import PointsInBlocks
from .launch import ACTIVE, STATUS


@Part
def _interpolated(values, x, y, z):
    """Return the result of `point_density.interpolated`, in loops, which need half of its registers."""
    i, _, wx0, wx1, wx2 = stencil(x)
    j, _, wy0, wy1, wy2 = stencil(y)
    k, _, wz0, wz1, wz2 = stencil(z)
    wx, wy, wz = (wx0, wx1, wx2), (wy0, wy1, wy2), (wz0, wz1, wz2)
    first, total = (int32(k) * TILE + int32(j)) * TILE + int32(i), real(0.0)
    for c in range(3):
        for b in range(3):
            share, n = wz[c] * wy[b], first + (c * TILE + b) * TILE
            for a in range(3):
                total += share * wx[a] * values[n + a]
    return total


# there is no floor of NumPy on the device
stand_in((point_density,), {"stencil": stencil, "interpolated": _interpolated})


@capped()
def correct_density(
    run: np.ndarray,
    counts: np.ndarray,
    points: PointsInBlocks,
    nodes: np.ndarray,
    free: np.ndarray,
    ground: Ground,
    yields: np.ndarray,
    barriers: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    barred: bool,
) -> None:
    """Set the rates of correction of all volumes in every EVERY-th step, a thread block for each block of points.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    points : PointsInBlocks
    nodes : real[touched, BLOCK_SIZE]
    free : uint8[touched]
        1 for blocks whose nodes touch nothing.
    ground : Ground
    yields : real[2, rows, columns, YIELD_ENTRIES]
    barriers : real[rows, columns, POINT_BARRIER_ENTRIES]
    reports : real[threads, NODE_REPORT]
    settings : Settings
    barred : bool
        Whether there are barriers.
    """
    if run[STATUS] != 0 or counts[STEP] % EVERY != 0:
        return
    start, blocks = points.start, points.blocks
    thread, threads, step = int32(cuda.threadIdx.x), int32(cuda.blockDim.x), counts[STEP] + 1
    masses = cuda.shared.array(TILE_NODES, real)
    parts = cuda.shared.array(TILE_NODES, real)  # on a line of its own, by which the simulator tells arrays apart
    after = yields[step % 2]
    mine = reports[cuda.grid(1)]
    time, full = relaxation_time(settings), full_mass(settings)
    for a in range(int32(cuda.blockIdx.x), int32(run[ACTIVE]), int32(cuda.gridDim.x)):
        for n in range(thread, TILE_NODES, threads):
            t, node = node_of_tile(n, points.targets[a])
            masses[n], parts[n] = nodes[t, 4 * node + NODE_MASS], real(1.0)
            if free[t] == 0:
                i, j, k = place_in_tile(n)
                j, i, k = blocks[a, 1] * BLOCK + j, blocks[a, 0] * BLOCK + i, blocks[a, 2] * BLOCK + k
                parts[n] = open_part(j, i, k, ground, after, step, barriers, barred, settings)
        cuda.syncthreads()
        for s in range(int32(start[a]) + thread, int32(start[a + 1]), threads):
            correct_point(
                points.rows,
                points.order[s],
                masses,
                parts,
                (False, False),
                full,
                settings.density_band,
                time,
                settings,
                mine,
            )
        cuda.syncthreads()
