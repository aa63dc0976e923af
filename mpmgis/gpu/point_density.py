"""Correction of the volumes of fluid points on the device (see `kernels.point_density`)."""

from numba import cuda, int32

from ..kernels import point_density
from ..kernels.point_clock import STEP
from ..kernels.point_density import (
    EVERY,
    TILE_NODES,
    correct_point,
    full_mass,
    node_of_tile,
    open_part,
    place_in_tile,
    relaxation_time,
)
from ..kernels.point_ground import Ground
from ..kernels.point_rows import BLOCK, NODE_MASS
from .compiled import capped, real, stand_in
from .launch import ACTIVE, STATUS
from .point_steps import stencil

stand_in((point_density,), {"stencil": stencil})  # there is no floor of NumPy on the device


@capped()
def correct_density(
    run, counts, rows, order, start, blocks, targets, nodes, free, ground_nodes, folds, exact, yields, barriers,
    reports, settings, material, barrier,
):  # fmt: skip
    """Set the rates of correction of all volumes in every EVERY-th step; a thread block per block of points."""
    if run[STATUS] != 0 or counts[STEP] % EVERY != 0:
        return
    thread, threads, step = int32(cuda.threadIdx.x), int32(cuda.blockDim.x), counts[STEP] + 1
    masses = cuda.shared.array(TILE_NODES, real)
    parts = cuda.shared.array(TILE_NODES, real)  # on a line of its own, by which the simulator tells arrays apart
    after = yields[step % 2]
    ground, barred, mine = Ground(ground_nodes, folds, exact), barrier.barrier_active(), reports[cuda.grid(1)]
    time, full = relaxation_time(settings), full_mass(settings)
    for a in range(int32(cuda.blockIdx.x), int32(run[ACTIVE]), int32(cuda.gridDim.x)):
        for n in range(thread, TILE_NODES, threads):
            t, node = node_of_tile(n, targets[a])
            masses[n], parts[n] = nodes[t, 4 * node + NODE_MASS], real(1.0)
            if free[t] == 0:
                i, j, k = place_in_tile(n)
                j, i, k = blocks[a, 1] * BLOCK + j, blocks[a, 0] * BLOCK + i, blocks[a, 2] * BLOCK + k
                parts[n] = open_part(j, i, k, ground, after, step, barriers, barred, settings)
        cuda.syncthreads()
        for s in range(int32(start[a]) + thread, int32(start[a + 1]), threads):
            correct_point(
                rows, order[s], masses, parts, (False, False), full, settings.density_band, time, settings, material,
                mine,
            )  # fmt: skip
        cuda.syncthreads()
