"""Arrays of a run of points that its steps change."""

from typing import Annotated, NamedTuple

import numpy as np

from ...compiled.block_order import LEFT_ENTRIES, WAYS
from ...frames.peaks import PEAK_ENTRIES
from ...frames.state_arrays import PARTICLES, REAL, StateArray
from .ground_contact import YIELD_ENTRIES
from .point_barriers import POINT_BARRIER_SUMS
from .point_report import EDGES, OUT_ENTRIES
from .point_time_step import CLOCK, COUNTS

KINETIC_MOST, LOW_SINCE, REST = range(3)  # [J] peak of the kinetic energy; [s] when it became low, or -1


class PointArrays(NamedTuple):
    """Arrays of a run that change; they belong to the host, and kernels work in them."""

    rows: Annotated[np.ndarray, StateArray(REAL, (PARTICLES, "numbers"))]
    ids: Annotated[np.ndarray, StateArray(np.uint64, (PARTICLES,))]
    keys: Annotated[np.ndarray, StateArray(np.int64, (PARTICLES,))]  # block of each point
    clock: Annotated[np.ndarray, StateArray(float, (CLOCK,), "clock")]
    counts: Annotated[np.ndarray, StateArray(np.int64, (COUNTS,), "counts")]
    ledger: Annotated[np.ndarray, StateArray(float, (EDGES, OUT_ENTRIES), "ledger")]  # what left over each edge
    rest: Annotated[np.ndarray, StateArray(float, (REST,), "rest", on_device=False)]
    left_cells: Annotated[  # where it left
        np.ndarray, StateArray(float, (WAYS, "block_rows", "block_columns", LEFT_ENTRIES))
    ]
    peaks: Annotated[np.ndarray, StateArray(float, ("peak_rows", "peak_columns", PEAK_ENTRIES))]  # at the node columns
    # of the ground, of two steps by turns
    yields: Annotated[np.ndarray, StateArray(float, (2, "node_rows", "node_columns", YIELD_ENTRIES))]
    barrier_sums: Annotated[np.ndarray, StateArray(float, ("barriers", POINT_BARRIER_SUMS + 1), "barriers")]
    # of smooth faces, of two steps by turns, with a rim
    face_yields: Annotated[np.ndarray, StateArray(float, (2, "face_rows", "face_levels", YIELD_ENTRIES), "face_yields")]
