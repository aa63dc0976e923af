"""The 3D solver with its points on a CUDA device.

The arrays of the host are those of `PointSolver`. They are copied from the device when they are read after a step, and
to it before a step once they were changed: a frame costs one copy, a step none.
"""

from ..points.point_rows import ROW_LONG, ROW_SHORT
from ..points.point_solver import PointSolver
from .available import require_device
from .device_arrays import OnDevice

ROW_COPIES = 1.4  # of the rows on the device: the rows themselves, and strips of the sort
BYTES_PER_POINT = 46  # ids, keys, names, order and cells of points on the device
BYTES_PER_BLOCK = 12_000  # tile, nodes and lists of a block, in float32; twice as much in float64
BYTES_OF_REPORTS = 100_000_000  # of all threads, on a device with up to 200 multiprocessors
POINTS_PER_BLOCK = 100  # fewest, of a flow that is thin


def device_memory(points, precision, material):
    """Memory [bytes] on the device of a number of `points` of a `material` in `precision`, estimated from above."""
    size, numbers = 4 if precision == "float32" else 8, ROW_SHORT if material.state_count() <= 4 else ROW_LONG
    blocks = points / POINTS_PER_BLOCK * BYTES_PER_BLOCK * size / 4
    return points * (ROW_COPIES * numbers * size + BYTES_PER_POINT) + blocks + BYTES_OF_REPORTS


class DevicePointSolver(PointSolver):
    """As `PointSolver`, with the steps on a CUDA device.

    Parameters
    ----------
    frame, terrain, effects, numerics, ...
        As of `PointSolver`.

    Raises
    ------
    SceneError
        There is no device, or it has too little memory.
    """

    _device, _ahead = None, False  # DevicePoints, and whether its arrays are newer than those of the host
    _rows, _ids, _keys, _ledger, _left, _peaks, _yields, _barrier_sums, _face_yields = (OnDevice() for _ in range(9))

    def __init__(self, frame, terrain, effects, numerics, stress=None, zone_values=None, walls=(), affine=None):
        require_device(device_memory(len(frame.particles), numerics.precision, effects.material), "points")
        super().__init__(frame, terrain, effects, numerics, stress, zone_values, walls, affine)

    def download(self):
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
        """The DevicePoints of the present arrays."""
        from . import device_laws  # noqa: F401  (kernels call methods of laws)
        from .device_point_loop import DevicePoints

        return DevicePoints(self._kernel_state(), self._kernel_places(), self._settings, self._effects)

    def _give_impulses(self):
        self._forget()
        super()._give_impulses()

    def _integrate_with(self, effects, places, walls):
        self._forget()
        super()._integrate_with(effects, places, walls)

    def _mark_watched(self):
        self._forget()
        super()._mark_watched()

    def _update_mass_limits(self):
        self._forget()
        super()._update_mass_limits()

    def share_step(self, share):
        """As of `PointSolver`."""
        self._forget()
        super().share_step(share)

    def restore(self, frame, known=False):
        """As of `PointSolver`; the frame may be of a run on the processor."""
        self._forget()
        super().restore(frame, known)

    def insert(self, frame, stress=None, affine=None):
        """As of `PointSolver`."""
        self._forget()
        super().insert(frame, stress, affine)
