"""Work on the particles of a frame in slices, on the threads that kernels use.

Slices have a fixed number of particles: sums over them have the same bits with any number of threads.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from .jit import threads_in_use

SLICE = 1 << 16  # [particles] in a slice


def in_slices(work: Callable[[slice], Any], count: int) -> list:
    """Call `work` for each slice of the particles; return the results in the order of the slices.

    `work` runs in several threads at the same time. It releases the GIL where it calls NumPy or serial kernels.

    Parameters
    ----------
    work : callable
        Of one slice.
    count : int
        Number of particles.
    """
    slices = [slice(first, min(first + SLICE, count)) for first in range(0, count, SLICE)]
    threads = min(threads_in_use(), len(slices))
    if threads < 2:
        return [work(some) for some in slices]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, slices))


def copied(array: np.ndarray) -> np.ndarray:
    """Copy an array.

    Parameters
    ----------
    array : array[n, ...]
    """
    copy = np.empty_like(array)

    def fill(some):
        copy[some] = array[some]

    in_slices(fill, len(array))
    return copy


def taken(array: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Take the rows `array[index]`.

    Parameters
    ----------
    array : array[n, ...]
    index : int64[m]
    """
    rows = np.empty((len(index), *array.shape[1:]), array.dtype)

    def fill(some):
        np.take(array, index[some], axis=0, out=rows[some], mode="clip")  # "raise" would copy `out`

    in_slices(fill, len(index))
    return rows
