"""What a solver does on the host when its steps are taken on a CUDA device.

Arrays are copied from the device when they are read after a step, and to it before a step once the host changed them:
a frame costs one copy, a step none.
"""

from typing import Any

from ...frames.particle_store import ParticleStore


class OnDevice(ParticleStore):
    """Mixin, before a solver of the processor, which takes the steps of that solver on a device.

    A solver has `_on_device`, which makes what takes the steps: DeviceColumns or DevicePoints.
    """

    _device: Any = None
    _ahead = False  # whether arrays of the device are newer than those of the host

    def _fetch(self):
        if self._ahead:
            self._ahead = False
            self._device.download()

    def _before_change(self):
        self._fetch()
        self._device = None
        super()._before_change()

    def _begin_steps(self, settings):
        """Return what takes the steps, which works on the present arrays."""
        if self._device is None:
            self._device = self._on_device(settings)
        self._ahead = True
        return self._device
