"""Work mapped over frames: on threads of this machine, or on a Dask cluster. The same values either way."""

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from contextvars import copy_context
from dataclasses import dataclass, replace

from .. import system
from ..errors import InputError
from ..io.trust import is_trusted
from .cluster import connected


@dataclass(frozen=True)
class FramePool:
    """`threads` for files here, `cluster` (a Dask client, or None) for frames, `workers` of them at a time."""

    threads: ThreadPoolExecutor
    cluster: object
    workers: int

    def map(self, function, entries, *shared):
        """Yield `function(entry, *shared)` for every frame's entry, in order.

        Only a few results are ever waiting, so that memory does not grow with the number of frames.
        """
        ahead = self.workers

        def submit(*work):
            return self.threads.submit(copy_context().run, *work)  # what the user trusts, threads know, too

        if self.cluster is not None:
            # frames are read where the work is done, so that their paths must hold there too
            entries = [replace(entry, path=entry.path.resolve()) for entry in entries]
            # in a list of one, since a collection would be scattered entry by entry
            shared = [self.cluster.scatter([value], broadcast=True, hash=False)[0] for value in shared]
            ahead = max(2, 2 * sum(self.cluster.nthreads().values()))

            def submit(*work):
                return self.cluster.submit(*work, pure=False)

        waiting = deque()
        try:
            for entry in entries:
                waiting.append(submit(function, entry, *shared))
                if len(waiting) > ahead:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


@contextmanager
def frame_pool(workers=None, dask=None):
    """A FramePool with `workers` threads (None: one per core), and the Dask scheduler at address `dask` if given.

    Threads do, because kernels, GDAL and HDF5 let go of the interpreter's lock.

    Raises
    ------
    InputError
        No scheduler answers at that address; --trust does not reach its workers.
    """
    workers = workers or system.cores()
    if dask is not None and is_trusted():
        raise InputError("--trust holds in this process and not on a Dask cluster; leave --dask or --trust out")
    with nullcontext() if dask is None else connected(dask) as cluster, ThreadPoolExecutor(workers) as threads:
        yield FramePool(threads, cluster, workers)
