"""Repeat a sequence of launches many times: the device repeats it from a CUDA graph.

A launch from Python takes several tens of microseconds on the host, as long as a kernel takes for some hundred thousand
points. The sequence is therefore recorded once; the device then starts its kernels without the host.
"""

import weakref
from types import MethodType

from numba import cuda

from .device_functions import SIMULATED

FEW = 2  # largest number of repetitions that are launched from the host: to record takes as long as to launch


class Repeated:
    """A sequence of launches whose kernels and arguments do not change between two calls of `forget`.

    Parameters
    ----------
    launches : bound method
        Launches the kernels on `stream`, without copies between host and device and without waiting. It is not kept
        alive: its object, which has this one, releases its arrays as soon as nothing else refers to it.
    """

    def __init__(self, launches: MethodType) -> None:
        self._launches, self._graph, self._compiled = weakref.WeakMethod(launches), None, False
        self.stream = 0 if SIMULATED else cuda.stream()

    def forget(self) -> None:
        """Record the launches again before they are repeated, because their arguments have changed."""
        self._graph = None

    def launches(self) -> None:
        """Launch the sequence once, from the host."""
        self._launches()()

    def __call__(self, times: int) -> None:
        """Launch the sequence that many `times`, one after the other, and wait for it."""
        if SIMULATED:
            for _ in range(times):
                self.launches()
            return
        cuda.synchronize()  # copies to the device may be on another stream than this one
        direct = times if self._graph is None and times <= FEW else min(times, 0 if self._compiled else 1)
        for _ in range(direct):  # kernels are compiled at their first launch
            self.launches()
            self._compiled = True
        if direct < times and self._graph is None:
            self._graph = _Graph(self.launches, self.stream)
        for _ in range(times - direct):
            self._graph.launch()
        cuda.synchronize()


class _Graph:
    """Launches on a stream, recorded."""

    def __init__(self, launches, stream):
        from cuda.bindings import driver

        self._driver, self._stream = driver, driver.CUstream(int(stream.handle))
        _checked(driver.cuStreamBeginCapture(self._stream, driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_RELAXED))
        try:
            launches()
        finally:
            ended = driver.cuStreamEndCapture(self._stream)
        graph = _checked(ended)
        try:
            self._graph = _checked(driver.cuGraphInstantiate(graph, 0))
        finally:
            driver.cuGraphDestroy(graph)
        weakref.finalize(self, driver.cuGraphExecDestroy, self._graph)

    def launch(self) -> None:
        """Start the recorded kernels."""
        _checked(self._driver.cuGraphLaunch(self._graph, self._stream))


def _checked(answer):
    """Return the result of a call of the driver.

    Raises
    ------
    RuntimeError
        The driver reports an error.
    """
    status, *result = answer
    if int(status) != 0:
        raise RuntimeError(f"CUDA: the driver reports {status.name} while steps are recorded or repeated")
    return result[0] if result else None
