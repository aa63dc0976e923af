"""The depth-averaged solver with its columns on a CUDA device.

The arrays of the host are those of `ColumnSolver`. They are copied from the device when they are read after a step, and
to it before a step once they were changed: a frame costs one copy, a step none.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ...laws.effect_slots import ColumnEffects
from ..columns.column_solver import ColumnNumerics, ColumnSolver
from .available import require_device
from .device_arrays import OnDevice

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from ...terrain.elevation import Terrain
    from ..columns.feature_arrays import Places
    from ..columns.node_grid import CellWindow, ColumnGrid

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


class DeviceColumnSolver(ColumnSolver):
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

    _device, _ahead = None, False  # DeviceColumns, and whether its arrays are newer than those of the host
    _rows, _ids, _keys, _wet, _ledger, _left, _peaks, _barrier_sums, fields = (OnDevice() for _ in range(9))

    def __init__(
        self,
        frame: "Frame",
        terrain: "Terrain",
        effects: ColumnEffects,
        numerics: ColumnNumerics,
        places: "Places | None" = None,
        grid: "ColumnGrid | None" = None,
        gradient: np.ndarray | None = None,
    ) -> None:
        require_device()
        super().__init__(frame, terrain, effects, numerics, places, grid, gradient)

    def download(self) -> None:
        """Copy what the device has computed into the arrays of the host."""
        if self._ahead:
            self._ahead = False
            self._device.download()

    def _forget(self):
        """Leave the device with what it has computed, because the host is about to change arrays or effects."""
        self.download()
        self._device = None

    def _take_steps(self, until, max_steps, settings):
        if self._device is None:
            self._device = self._on_device(settings)
        self._device.settings, self._ahead = settings, True
        return self._device.advance(until, max_steps)

    def _on_device(self, settings):
        """Make the DeviceColumns of the present arrays."""
        from . import device_laws  # noqa: F401  (kernels call functions of laws)
        from .device_column_loop import DeviceColumns

        at_nodes = sum(array.nbytes for array in (*self.fields, self._wet, self._peaks, self._left))
        needed = device_memory_of_columns(len(self._rows), self.fields.bed.size, at_nodes, self.effects)
        require_device(needed, "columns")
        return DeviceColumns(self._arrays(), settings, self.fields, self.effects)

    def insert(self, frame: "Frame", window: "CellWindow", slab: bool = True) -> None:
        """Insert columns at the present time (see `ColumnSolver.insert`).

        Parameters
        ----------
        frame : Frame
        window : CellWindow
        slab : bool
        """
        self._forget()
        super().insert(frame, window, slab)

    def take_out(self, chosen: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> "Frame | None":
        """Take columns out of the flow, now (see `ColumnSolver.take_out`).

        Parameters
        ----------
        chosen : callable
        """
        self._forget()
        return super().take_out(chosen)

    def arm(self, number: int, nodes: tuple[np.ndarray, np.ndarray], thickness: float | None) -> None:
        """Let `advance` stop when the flow reaches one of some nodes (see `ColumnSolver.arm`).

        Parameters
        ----------
        number : int
        nodes : (int[n], int[n])
        thickness : float or None [m]
        """
        self._forget()
        super().arm(number, nodes, thickness)

    def fired(self, number: int, nodes: tuple[np.ndarray, np.ndarray]) -> bool:
        """Return whether the flow has reached an armed area (see `ColumnSolver.fired`).

        Parameters
        ----------
        number : int
        nodes : (int[n], int[n])
        """
        fired = super().fired(number, nodes)
        if fired:  # its marks have changed on the host
            self._device = None
        return fired

    def restore(self, frame: "Frame", known: bool = False) -> None:
        """Go on from a frame (see `ColumnState.restore`), which may be of a run on the processor.

        Parameters
        ----------
        frame : Frame
        known : bool
        """
        self._forget()
        super().restore(frame, known)
