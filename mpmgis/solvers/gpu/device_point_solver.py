"""The 3D solver with its points on a CUDA device.

The arrays of the host are those of `PointSolver`. They are copied from the device when they are read after a step, and
to it before a step once they were changed: a frame costs one copy, a step none.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...laws.material import Material
from ...laws.material_choice import SHORT_STATE, state_count
from ..points.point_rows import ROW_LONG, ROW_SHORT
from ..points.point_solver import PointSolver
from .available import require_device
from .device_arrays import OnDevice

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from ...laws.effect_slots import PointEffects
    from ...terrain.elevation import Terrain
    from ..features.walls import Wall
    from ..points.point_numerics import PointNumerics

ROW_COPIES = 1.4  # copies of the rows on the device: the rows themselves, and strips of the sort
BYTES_PER_POINT = 46  # [bytes] ids, keys, names, order and cells of points on the device
BYTES_PER_BLOCK = 12_000  # [bytes] tile, nodes and lists of a block, in float32; twice as much in float64
BYTES_OF_REPORTS = 100_000_000  # [bytes] reports of all threads, on a device with up to 200 multiprocessors
POINTS_PER_BLOCK = 100  # fewest points of a block, in a flow that is thin


def device_memory(points: int, precision: str, material: Material) -> float:
    """Estimate the memory on the device of a run from above [bytes].

    Parameters
    ----------
    points : int
        Number of points.
    precision : str
        "float64" or "float32".
    material : Material
    """
    size, numbers = 4 if precision == "float32" else 8, ROW_SHORT if state_count(material) == SHORT_STATE else ROW_LONG
    blocks = points / POINTS_PER_BLOCK * BYTES_PER_BLOCK * size / 4
    return points * (ROW_COPIES * numbers * size + BYTES_PER_POINT) + blocks + BYTES_OF_REPORTS


class DevicePointSolver(PointSolver):
    """Time integration of points with the steps on a CUDA device.

    Parameters
    ----------
    frame, terrain, effects, numerics, stress, zone_values, walls, affine
        Those of `PointSolver`.

    Raises
    ------
    SceneError
        There is no device, or it has too little memory; otherwise as in `PointSolver`.
    """

    _device, _ahead = None, False  # DevicePoints, and whether its arrays are newer than those of the host
    _rows, _ids, _keys, _ledger, _left, _peaks, _yields, _barrier_sums, _face_yields = (OnDevice() for _ in range(9))

    def __init__(
        self,
        frame: "Frame",
        terrain: "Terrain",
        effects: "PointEffects",
        numerics: "PointNumerics",
        stress: np.ndarray | None = None,
        zone_values: np.ndarray | None = None,
        walls: "Sequence[Wall]" = (),
        affine: np.ndarray | None = None,
    ) -> None:
        require_device(device_memory(len(frame.particles), numerics.precision, effects.material), "points")
        super().__init__(frame, terrain, effects, numerics, stress, zone_values, walls, affine)

    def download(self) -> None:
        """Copy what the device has computed into the arrays of the host."""
        if self._ahead:
            self._ahead = False
            self._device.download()

    def _forget(self):
        """Leave the device with what it has computed, because the host is about to change arrays or settings."""
        self.download()
        self._device = None

    def _take_steps(self, until, after, max_steps):
        if self._device is None:
            self._device = self._on_device()
        self._ahead = True
        return self._device.advance(until, after, max_steps)

    def _on_device(self):
        """Make the DevicePoints of the present arrays."""
        from . import device_laws  # noqa: F401  (kernels call functions of laws)
        from .device_point_loop import DevicePoints

        return DevicePoints(self._kernel_state(), self._kernel_places(), self._settings, self._effects)

    def _give_impulses(self):
        self._forget()
        super()._give_impulses()

    def _update_mass_limits(self):
        self._forget()
        super()._update_mass_limits()

    def share_step(self, share: float) -> None:
        """Use steps of a share of their normal length, see `ParticleStore.share_step`.

        Parameters
        ----------
        share : float [1]
        """
        self._forget()
        super().share_step(share)

    def restore(self, frame: "Frame", known: bool = False) -> None:
        """Continue from a frame of this run, see `PointSolver.restore`; the frame may be of a run on the processor.

        Parameters
        ----------
        frame : Frame
        known : bool
            Whether the state never left this process.
        """
        self._forget()
        super().restore(frame, known)

    def insert(self, frame: "Frame", stress: np.ndarray | None = None, affine: np.ndarray | None = None) -> None:
        """Insert the points of a frame, see `PointSolver.insert`.

        Parameters
        ----------
        frame : Frame
        stress : float64[n, 6], optional [Pa]
        affine : float64[n, 3, 3], optional [s-1]
        """
        self._forget()
        super().insert(frame, stress, affine)
