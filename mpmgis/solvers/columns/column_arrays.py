"""Arrays of a run of columns that its steps change."""

from typing import Annotated, NamedTuple

import numpy as np

from ...compiled.block_order import LEFT_ENTRIES, WAYS
from ...frames.state_arrays import PARTICLES, StateArray
from ...laws.effect_slots import ColumnEffects
from ...laws.entrainment import NO_EROSION
from .column_barriers import BARRIER_SUMS
from .column_report import EDGES, OUT_ENTRIES
from .column_rows import ROW
from .column_time_step import CLOCK, COUNTS

# what came in after the start
(
    INSERTED_COLUMNS,  # number of columns
    INSERTED_KINETIC,  # [J] their kinetic energy when they came in
    INSERTED_POTENTIAL,  # [J] their potential energy
    INSERTED,
) = range(4)
KEPT_FIELDS = {"forest_state": "forest"}  # fields of NodeFields whose name in the state of a frame differs


class ColumnArrays(NamedTuple):
    """Arrays of a run that change; the solver owns them, and kernels work in them."""

    rows: Annotated[np.ndarray, StateArray(float, (PARTICLES, ROW))]
    ids: Annotated[np.ndarray, StateArray(np.uint64, (PARTICLES,))]
    keys: Annotated[np.ndarray, StateArray(np.int32, (PARTICLES,))]  # block of each column, GONE for one that has left
    wet: Annotated[np.ndarray, StateArray(np.uint8, ("node_rows", "node_columns"))]  # marks of the nodes
    ledger: Annotated[np.ndarray, StateArray(float, (EDGES, OUT_ENTRIES), "ledger")]  # outflow over each edge
    clock: Annotated[np.ndarray, StateArray(float, (CLOCK,), "clock")]
    counts: Annotated[np.ndarray, StateArray(np.int64, (COUNTS,), "counts")]
    inserted: Annotated[np.ndarray, StateArray(float, (INSERTED,), "inserted", on_device=False)]
    peaks: Annotated[np.ndarray, StateArray(float, ("node_rows", "node_columns", "peaks"))]
    barrier_sums: Annotated[np.ndarray, StateArray(float, ("barriers", BARRIER_SUMS + 1), "barriers")]
    left_cells: Annotated[  # where mass left
        np.ndarray, StateArray(float, (WAYS, "block_rows", "block_columns", LEFT_ENTRIES))
    ]


def changing_fields(effects: ColumnEffects) -> list[str]:
    """Return the names of the NodeFields that steps with some effects change.

    Parameters
    ----------
    effects : ColumnEffects
    """
    erodes, lowers = effects.entrainment.kind != NO_EROSION, effects.entrainment.lowering > 0.0
    names = ["erodible"] if erodes else []
    names += ["bed", "gradient"] if erodes and lowers else []
    return names + (["forest_state", "forest_sums"] if effects.forest else [])
