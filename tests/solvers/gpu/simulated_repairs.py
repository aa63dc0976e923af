"""What `cuda_simulator` repairs, with and without the repair, in the CUDA simulator; prints what it found as JSON.

Run as `simulated_points.py`.
"""

import json
from functools import partial
from threading import Barrier, Thread
from time import sleep
from timeit import repeat
from types import SimpleNamespace

import numpy as np
from numba import cuda, types
from numba.cuda.simulator import kernel, kernelapi

OWN = {  # of the simulator, before it is repaired
    "array": kernelapi.FakeCUDAShared.array,
    "run": kernel.BlockManager.run,
    "wrapped": kernel.FakeWithinKernelCUDAArray,
    "threading": kernelapi.threading,
}

from mpmgis.solvers.gpu import cuda_simulator  # noqa: E402
from mpmgis.solvers.gpu.device_functions import Kernel  # noqa: E402  (it repairs)


def share_an_array(array, module):
    """Return whether a thread that asks for a shared array while another one makes it gets the same one."""

    def slow_empty(shape, kind):
        sleep(0.1)
        return np.empty(shape, kind)

    shared, got, both = kernelapi.FakeCUDAShared(0), [], Barrier(2)

    def ask():
        both.wait()
        got.append(array(shared, 4, np.dtype(np.float64)))

    module.np = SimpleNamespace(empty=slow_empty)
    try:
        threads = [Thread(target=ask) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10.0)
    finally:
        module.np = np
    return len(got) == 2 and got[0] is got[1]


def launched():
    """Threads that the host starts for a block of four that do not wait, and the type of an array in a kernel."""
    started, kinds, start = [], [], Thread.start

    def note(values):
        values[cuda.threadIdx.x] = 1
        kinds.append(type(values).__name__)

    def counted(thread):
        started.append(thread)
        start(thread)

    Thread.start = counted
    try:
        cuda.jit(note)[1, 4](np.zeros(4))
    finally:
        Thread.start = start
    return {"started": len(started), "kinds": sorted(set(kinds))}


def launched_without_repair():
    """The same, with what the simulator has of its own."""
    repaired = kernel.BlockManager.run, kernel.FakeWithinKernelCUDAArray, kernelapi.threading
    kernel.BlockManager.run, kernel.FakeWithinKernelCUDAArray = OWN["run"], OWN["wrapped"]
    kernelapi.threading = OWN["threading"]
    try:
        return launched()
    finally:
        kernel.BlockManager.run, kernel.FakeWithinKernelCUDAArray, kernelapi.threading = repaired


def turns():
    """What threads read after they waited for each other, and the error of a kernel that fails in one thread."""

    @Kernel
    def rotate(values, seen):
        shared = cuda.shared.array(4, np.int64)
        t = cuda.threadIdx.x
        shared[t] = values[t]
        cuda.syncthreads()
        seen[cuda.blockIdx.x, t] = shared[(t + 1) % 4]

    @Kernel
    def number(seen):
        seen[cuda.grid(1)] = cuda.grid(1)

    @Kernel
    def fail(values):
        if cuda.threadIdx.x == 2:
            raise ValueError("the third")
        cuda.syncthreads()
        values[cuda.threadIdx.x] = -1

    values, seen, numbers, errors = np.arange(4), np.zeros((3, 4), int), np.zeros(6, int), []
    rotate.of(np.float64)[3, 4](values, seen)
    number.of(np.float64)[2, 3](numbers)
    try:
        fail.of(np.float64)[1, 4](values)
    except ValueError as error:
        errors.append(str(error))
    return {"seen": seen.tolist(), "numbers": numbers.tolist(), "errors": errors, "values": values.tolist()}


def slowness_of_numbers():
    """Return how many times as long numba's type takes to make a number as what the repair puts in its place."""
    plain = cuda_simulator.plain_number(types.uint32)
    assert type(plain(1)) is type(types.uint32(1)) is np.uint32
    own, repaired = (min(repeat(partial(kind, 1), number=1000, repeat=20)) for kind in (types.uint32, plain))
    return own / repaired


if __name__ == "__main__":
    found = {
        "same array": share_an_array(cuda_simulator.shared_array, cuda_simulator),
        "same array without repair": share_an_array(OWN["array"], kernelapi),
        "launch": launched(),
        "launch without repair": launched_without_repair(),
        "slowness of numbers": slowness_of_numbers(),
        "turns": turns(),
    }
    print(json.dumps(found))
