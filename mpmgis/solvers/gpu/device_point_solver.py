"""The 3D solver with its points on a CUDA device."""

from typing import TYPE_CHECKING, Any

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


class DevicePointSolver(OnDevice, PointSolver):
    """PointSolver with the steps on a CUDA device.

    Parameters
    ----------
    frame, terrain, effects, numerics, stress, zone_values, walls, affine
        As for `PointSolver`.

    Raises
    ------
    SceneError
        There is no device, or it has too little memory; otherwise as in `PointSolver`.
    """

    def __init__(
        self,
        frame: "Frame",
        terrain: "Terrain",
        effects: "PointEffects",
        numerics: "PointNumerics",
        *given: Any,
        **named: Any,
    ) -> None:
        require_device(device_memory(len(frame.particles), numerics.precision, effects.material), "points")
        super().__init__(frame, terrain, effects, numerics, *given, **named)

    def _take_steps(self, until, after, max_steps):
        return self._begin_steps(self._settings).advance(until, after, max_steps)

    def _on_device(self, settings):
        """Make the DevicePoints of the present arrays."""
        from . import device_laws  # noqa: F401  (kernels call functions of laws)
        from .device_point_loop import DevicePoints

        return DevicePoints(self._arrays, self._kernel_places(), settings, self._effects)
