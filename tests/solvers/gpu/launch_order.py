"""Another order of thread blocks and threads in the CUDA simulator."""

import sys
from contextlib import contextmanager
from threading import Condition

import numpy as np

OFTEN = 1e-5  # [s] between two looks whether another thread of the host may run


@contextmanager
def shuffled():
    """Begin thread blocks and threads in a random order, and let the threads of a block run at the same time."""
    from numba.cuda.simulator import kernel

    rng, run, interval = np.random.default_rng(3), kernel.BlockManager.run, sys.getswitchinterval()

    class Shuffled:
        def __getattr__(self, name):
            return getattr(np, name)

        @staticmethod
        def ndindex(*shape):
            places = list(np.ndindex(*shape))
            rng.shuffle(places)
            return [tuple(place) for place in places]

    kernel.np, kernel.BlockManager.run = Shuffled(), at_once
    sys.setswitchinterval(OFTEN)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        kernel.np, kernel.BlockManager.run = np, run


def at_once(manager, block, *arguments):
    """Run the threads of a `block` at the same time. The simulator does so too, but polls them without a pause."""
    from numba.cuda.simulator import kernel

    met, counts = Condition(), {"alive": 0, "waiting": 0, "round": 0}

    def go_on():
        if counts["waiting"] == counts["alive"]:
            counts["waiting"], counts["round"] = 0, counts["round"] + 1
            met.notify_all()

    class Together(kernel.BlockThread):
        def run(self):
            super().run()
            with met:
                counts["alive"] -= 1
                go_on()

        def syncthreads(self):
            with met:
                counts["waiting"], now = counts["waiting"] + 1, counts["round"]
                go_on()
                met.wait_for(lambda: counts["round"] > now)

    places = kernel.np.ndindex(*manager._block_dim)
    threads = [Together(lambda: manager._f(*arguments), manager, block, place, False) for place in places]
    counts["alive"] = len(threads)
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for thread in threads:
        if thread.exception:
            raise thread.exception[0].with_traceback(thread.exception[1])
