"""A repair of the CUDA simulator: all threads of a block share the arrays that they ask for.

numba-cuda 0.30.4 looks an array up by the line that asks for it, and adds it where it is missing, without a lock. Two
threads may each get their own, and their sums are wrong (7 of 3000 launches). The simulator is what the kernels are
tested with.
"""

import sys
from threading import Lock

import numpy as np
from numba import types
from numba.cuda.simulator.kernelapi import FakeCUDAShared
from numba.np.numpy_support import as_dtype

_making = Lock()


def shared_array(self, shape, dtype, alignment=None):
    """`cuda.shared.array`: the array of the line that calls it, the same one for all threads of the block."""
    frame = sys._getframe(1)
    line = frame.f_code.co_filename, frame.f_lineno
    with _making:
        if line not in self._allocations:
            kind = as_dtype(dtype) if isinstance(dtype, types.Type) else dtype
            self._allocations[line] = np.empty(shape, kind)
        return self._allocations[line]


def repair():
    """Let kernels from now on use `shared_array`."""
    FakeCUDAShared.array = shared_array
