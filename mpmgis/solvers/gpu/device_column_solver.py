"""The depth-averaged solver with its columns on a CUDA device."""

from typing import Any

from ...laws.effect_slots import ColumnEffects
from ..columns.column_solver import ColumnSolver
from .available import require_device
from .device_arrays import OnDevice

BYTES_PER_COLUMN = 350  # [bytes] row, id, key and order; strips and lists of the sort; tiles of blocks with 64 columns
BYTES_PER_COLUMN_IN_FOREST = 100  # [bytes] a second sort, and what columns lose
BYTES_PER_NODE = 48  # [bytes] mass and velocity, and the bed twice, in addition to the arrays of the solver
BYTES_OF_REPORTS = 100_000_000  # [bytes] of all threads, on a device with up to 200 multiprocessors


def device_memory_of_columns(columns: int, nodes: int, bytes_at_nodes: int, effects: ColumnEffects) -> int:
    """Estimate the memory [bytes] on the device of a number of columns, from above.

    Parameters
    ----------
    columns : int
    nodes : int
        Number of nodes.
    bytes_at_nodes : int [bytes]
        Size of the arrays of the solver at its nodes.
    effects : ColumnEffects
    """
    each = BYTES_PER_COLUMN + (BYTES_PER_COLUMN_IN_FOREST if effects.forest else 0)
    return columns * each + bytes_at_nodes + nodes * BYTES_PER_NODE + BYTES_OF_REPORTS


class DeviceColumnSolver(OnDevice, ColumnSolver):
    """ColumnSolver with the steps on a CUDA device.

    Parameters
    ----------
    frame, terrain, effects, numerics, places, grid, gradient
        As for `ColumnSolver`.

    Raises
    ------
    SceneError
        There is no device, or it has too little memory.
    """

    def __init__(self, *given: Any, **named: Any) -> None:
        require_device()
        super().__init__(*given, **named)

    def _take_steps(self, until, max_steps, settings):
        device = self._begin_steps(settings)
        device.settings = settings
        return device.advance(until, max_steps)

    def _on_device(self, settings):
        """Make the DeviceColumns of the present arrays."""
        from . import device_laws  # noqa: F401  (kernels call functions of laws)
        from .device_column_loop import DeviceColumns

        state, fields = self._arrays, self._fields
        at_nodes = sum(array.nbytes for array in (*fields, state.wet, state.peaks, state.left_cells))
        needed = device_memory_of_columns(len(state.rows), fields.bed.size, at_nodes, self.effects)
        require_device(needed, "columns")
        return DeviceColumns(state, settings, fields, self.effects)
