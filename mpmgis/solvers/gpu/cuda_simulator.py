"""Repairs of the CUDA simulator, which the kernels are tested with.

All threads of a block share the arrays that they ask for: numba-cuda 0.30.4 looks an array up by the line that asks
for it, and adds it where it is missing, without a lock. Two threads may each get their own, and their sums are wrong (7
of 3000 launches).

The threads of a block run one after the other, each to its end or to the next `syncthreads`. The unrepaired simulator
runs them at the same time and polls them without a pause, which takes most of the time.

Arrays are those of NumPy in kernels, and numbers of a type (`uint32(1)`) too. The unrepaired simulator wraps each array
twice, to find entries of records, which these kernels do not have; numba looks up NumPy's type for each number.
"""

import sys
import threading
from functools import cache
from threading import Lock
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np
from numba import types
from numba.cuda.simulator import kernel, kernelapi
from numba.np.numpy_support import as_dtype

# functions of numba.cuda at which a thread waits for others
WAITS = {"syncthreads", "syncthreads_count", "syncthreads_and", "syncthreads_or", "syncwarp"}

_making = Lock()
_now = SimpleNamespace(thread=None)  # the simulated thread that runs, where they run one after the other
_hosts = []  # threads of the host, as many as the largest block has had
_back = Lock()  # free while a simulated thread gives its turn back
_back.acquire()


def shared_array(self, shape: int | tuple[int, ...], dtype: Any, alignment: int | None = None) -> np.ndarray:
    """Return the shared array of the line that calls it, the same one for all threads of the block.

    It replaces `cuda.shared.array`, whose `self` is the simulated `cuda.shared`.

    Parameters
    ----------
    shape : int or tuple of int
    dtype : type of numba or NumPy
    alignment : int, optional
        Not used.
    """
    frame = sys._getframe(1)
    line = frame.f_code.co_filename, frame.f_lineno
    with _making:
        if line not in self._allocations:
            kind = as_dtype(dtype) if isinstance(dtype, types.Type) else dtype
            self._allocations[line] = np.empty(shape, kind)
        return self._allocations[line]


class Host(threading.Thread):
    """A thread of the host that runs simulated threads, one after the other: starting it takes as long as a kernel."""

    def __init__(self):
        super().__init__(daemon=True)
        self.turn, self.task = Lock(), None
        self.turn.acquire()
        self.start()

    def run(self) -> None:
        """Run the next task, whenever it has the turn for the first time."""
        while True:
            self.turn.acquire()
            self.task()
            _back.release()


class Turn:
    """A thread of a block that runs while it has the turn, and gives it back at `syncthreads` and at its end.

    Parameters
    ----------
    manager : numba.cuda.simulator.kernel.BlockManager
    block, place : tuple of int
        Indices of the block, and of the thread in it.
    arguments : tuple
        Of the kernel.
    host : Host
        The thread of the host that runs it.
    """

    syncthreads_count = kernel.BlockThread.syncthreads_count
    syncthreads_and = kernel.BlockThread.syncthreads_and
    syncthreads_or = kernel.BlockThread.syncthreads_or

    def __init__(
        self, manager: kernel.BlockManager, block: tuple[int, ...], place: tuple[int, ...], arguments: tuple, host: Host
    ) -> None:
        self._manager, self._arguments, self._host = manager, arguments, host
        self.blockIdx, self.threadIdx = kernel.Dim3(*block), kernel.Dim3(*place)
        self.thread_id = _number(manager, place)
        self.done, self.abort, self.exception = False, False, None
        host.task = self.run

    def run(self) -> None:
        """Run the kernel, from the first turn on."""
        try:
            if not self.abort:
                self._manager._f(*self._arguments)
        except Exception as error:
            self.exception = error
        self.done = True

    def syncthreads(self) -> None:
        """Wait for the next turn, when all others have had theirs.

        Raises
        ------
        RuntimeError
            Another thread of the block failed.
        """
        _back.release()
        self._host.turn.acquire()
        if self.abort:
            raise RuntimeError("another thread of the block failed")

    def take(self) -> None:
        """Let the thread have its turn."""
        _now.thread = self
        self._host.turn.release()
        _back.acquire()
        _now.thread = None


def plain_array(value: Any) -> Any:
    """Return a value with NumPy's array in place of one of the simulator, in records too.

    Parameters
    ----------
    value : array of the simulator, record of such arrays, or anything else
    """
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*map(plain_array, value))
    return getattr(value, "_ary", value)


def run_in_turn(manager: kernel.BlockManager, block: tuple[int, ...], *arguments: Any) -> None:
    """Run the threads of a block one after the other, in the order in which the simulator would begin them.

    Parameters
    ----------
    manager : numba.cuda.simulator.kernel.BlockManager
    block : tuple of int
        Index of the block.
    *arguments
        Of the kernel.
    """
    arguments = tuple(map(plain_array, arguments))
    places = kernel.np.ndindex(*manager._block_dim)  # tests replace it to change the order
    if _waits(manager._f):
        _run_with_turns(manager, block, places, arguments)
        return
    for place in places:
        number = _number(manager, place)
        _now.thread = SimpleNamespace(threadIdx=kernel.Dim3(*place), blockIdx=kernel.Dim3(*block), thread_id=number)
        try:
            manager._f(*arguments)
        finally:
            _now.thread = None


def _number(manager, place):
    """Return the number of the thread at a `place` of its block."""
    (width, height), (x, y, z) = (*manager._block_dim, 1)[:2], (*place, 0, 0)[:3]
    return x + width * (y + height * z)


def _run_with_turns(manager, block, places, arguments):
    """Run the threads of a `block` that wait for each other."""
    places = list(places)
    _hosts.extend(Host() for _ in range(len(places) - len(_hosts)))
    waiting = [Turn(manager, block, place, arguments, host) for place, host in zip(places, _hosts, strict=False)]
    failed = None
    while waiting:
        for thread in waiting:
            thread.abort = failed is not None
            thread.take()
            failed = failed or thread.exception
        waiting = [thread for thread in waiting if not thread.done]
    if failed:
        raise failed


@cache
def _waits(function):
    """Return whether a kernel, or a function of this package that it calls, waits for other threads.

    A function may call a method of its own name.
    """
    names = set(function.__code__.co_names)
    called = (value for name, value in function.__globals__.items() if name in names and value is not function)
    return bool(names & WAITS) or any(_waits(value) for value in called if _is_ours(value))


def _is_ours(value):
    return isinstance(value, FunctionType) and value.__module__.startswith("mpmgis.")


def _current_thread():
    """Return the simulated thread that asks where it is."""
    return threading.current_thread() if _now.thread is None else _now.thread


def plain_number(kind: types.Number) -> type:
    """Return NumPy's type of the numbers of a numba type, which gives the same ones.

    Parameters
    ----------
    kind : numba.types.Number
    """
    return getattr(np, kind.name)


def repair() -> None:
    """Let kernels from now on use `shared_array`, `run_in_turn` and plain arrays."""
    kernel.FakeWithinKernelCUDAArray = lambda array: array._ary
    kernelapi.FakeCUDAShared.array = shared_array
    kernelapi.threading = SimpleNamespace(current_thread=_current_thread, Lock=Lock)
    kernel.BlockManager.run = run_in_turn
