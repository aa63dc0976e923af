"""A repair of the CUDA simulator: all threads of a block share the arrays that they ask for.

It looks an array up and then makes it, without a lock: two threads may each make their own, and their sums are wrong
(7 of 3000 launches, numba-cuda 0.30.4). The simulator is what the kernels are tested with.
"""

from threading import Lock

from numba.cuda.simulator import kernelapi


class _Arrays(dict):
    """Shared arrays of a launch by the line that asks for them; who finds none there is alone until it has made it."""

    def __init__(self):
        super().__init__()
        self._making = Lock()

    def get(self, line):
        """The array of a `line`, or None."""
        self._making.acquire()
        found = super().get(line)
        if found is not None:
            self._making.release()
        return found

    def __setitem__(self, line, array):
        super().__setitem__(line, array)
        self._making.release()


def repair():
    """Let launches from now on use `_Arrays`."""
    begin = kernelapi.FakeCUDAShared.__init__

    def begin_with_lock(shared, *sizes):
        begin(shared, *sizes)
        shared._allocations = _Arrays()

    kernelapi.FakeCUDAShared.__init__ = begin_with_lock
