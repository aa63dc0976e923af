"""Repairs of the CUDA simulator, which the kernels are tested with.

All threads of a block share the arrays that they ask for: numba-cuda 0.30.4 looks an array up by the line that asks
for it, and adds it where it is missing, without a lock. Two threads may each get their own, and their sums are wrong (7
of 3000 launches).

The threads of a block run one after the other, each to its end or to the next `syncthreads`. The simulator runs them at
the same time and polls them without a pause, which takes most of the time.
"""

import sys
import threading
from functools import cache
from threading import Lock
from types import FunctionType, SimpleNamespace

import numpy as np
from numba import types
from numba.cuda.simulator import kernel, kernelapi
from numba.np.numpy_support import as_dtype

WAITS = {"syncthreads", "syncthreads_count", "syncthreads_and", "syncthreads_or", "syncwarp"}
run_at_once = kernel.BlockManager.run  # that of the simulator

_making = Lock()
_now = SimpleNamespace(thread=None)  # the simulated thread that runs in the thread of the host


def shared_array(self, shape, dtype, alignment=None):
    """`cuda.shared.array`: the array of the line that calls it, the same one for all threads of the block."""
    frame = sys._getframe(1)
    line = frame.f_code.co_filename, frame.f_lineno
    with _making:
        if line not in self._allocations:
            kind = as_dtype(dtype) if isinstance(dtype, types.Type) else dtype
            self._allocations[line] = np.empty(shape, kind)
        return self._allocations[line]


class Turn(kernel.BlockThread):
    """A thread of a block that runs while it has the turn, and gives it back at `syncthreads` and at its end."""

    def __init__(self, target, manager, block, place, back):
        super().__init__(target, manager, block, place, False)
        self.mine, self.back, self.done = Lock(), back, False
        self.mine.acquire()

    def run(self):
        """Run the kernel, from the first turn on."""
        self.mine.acquire()
        super().run()
        self.done = True
        self.back.release()

    def syncthreads(self):
        """Wait for the next turn, when all others have had theirs."""
        self.back.release()
        self.mine.acquire()
        if self.abort:
            raise RuntimeError("another thread of the block failed")

    def take(self):
        """Let the thread have its turn."""
        self.mine.release()
        self.back.acquire()


def run_in_turn(manager, block, *arguments):
    """Run the threads of a `block` one after the other, in the order in which the simulator would begin them."""
    places = kernel.np.ndindex(*manager._block_dim)  # tests replace it to change the order
    if _waits(manager._f):
        _run_with_turns(manager, block, places, arguments)
        return
    width, height = (*manager._block_dim, 1)[:2]
    for place in places:
        x, y, z = (*place, 0, 0)[:3]
        number = x + width * (y + height * z)
        _now.thread = SimpleNamespace(threadIdx=kernel.Dim3(*place), blockIdx=kernel.Dim3(*block), thread_id=number)
        try:
            manager._f(*arguments)
        finally:
            _now.thread = None


def _run_with_turns(manager, block, places, arguments):
    """Run the threads of a `block` that wait for each other."""
    back = Lock()
    back.acquire()
    waiting = [Turn(lambda: manager._f(*arguments), manager, block, place, back) for place in places]
    for thread in waiting:
        thread.start()
    failed = None
    while waiting:
        for thread in waiting:
            thread.abort = failed is not None
            thread.take()
            failed = failed or thread.exception
        waiting = [thread for thread in waiting if not thread.done]
    if failed:
        raise failed[0].with_traceback(failed[1])


@cache
def _waits(function):
    """Whether a kernel, or a function of this package that it calls, waits for other threads."""
    names = set(function.__code__.co_names)
    called = (value for name, value in function.__globals__.items() if name in names)
    return bool(names & WAITS) or any(_waits(value) for value in called if _is_ours(value))


def _is_ours(value):
    return isinstance(value, FunctionType) and value.__module__.startswith("mpmgis.")


def _current_thread():
    """The simulated thread that asks where it is."""
    return threading.current_thread() if _now.thread is None else _now.thread


def repair():
    """Let kernels from now on use `shared_array` and `run_in_turn`."""
    kernelapi.FakeCUDAShared.array = shared_array
    kernelapi.threading = SimpleNamespace(current_thread=_current_thread, Lock=Lock)
    kernel.BlockManager.run = run_in_turn
