"""Another order of thread blocks and threads in the CUDA simulator."""

from contextlib import contextmanager

import numpy as np


@contextmanager
def shuffled():
    """Begin thread blocks and threads in a random order, and let the threads of a block run at the same time."""
    from numba.cuda.simulator import kernel

    from mpmgis.gpu import simulator

    rng, run = np.random.default_rng(3), kernel.BlockManager.run

    class Shuffled:
        def __getattr__(self, name):
            return getattr(np, name)

        @staticmethod
        def ndindex(*shape):
            places = list(np.ndindex(*shape))
            rng.shuffle(places)
            return [tuple(place) for place in places]

    kernel.np, kernel.BlockManager.run = Shuffled(), simulator.run_at_once
    try:
        yield
    finally:
        kernel.np, kernel.BlockManager.run = np, run
