"""Work on the particles of a frame in slices, on the threads that kernels use.

Slices have a fixed number of particles: sums over them have the same bits with any number of threads.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .jit import threads_in_use

SLICE = 1 << 16  # particles


def in_slices(work, count):
    """List of `work(slice)` for the slices of `count` particles, in their order.

    `work` runs in several threads at the same time. It releases the GIL where it calls NumPy or serial kernels.
    """
    slices = [slice(first, min(first + SLICE, count)) for first in range(0, count, SLICE)]
    threads = min(threads_in_use(), len(slices))
    if threads < 2:
        return [work(some) for some in slices]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, slices))


def copied(array):
    """A copy of `array`."""
    copy = np.empty_like(array)

    def fill(some):
        copy[some] = array[some]

    in_slices(fill, len(array))
    return copy


def taken(array, index):
    """`array[index]` for whole numbers `index`."""
    rows = np.empty((len(index), *array.shape[1:]), array.dtype)

    def fill(some):
        np.take(array, index[some], axis=0, out=rows[some], mode="clip")  # "raise" would copy `out`

    in_slices(fill, len(index))
    return rows
