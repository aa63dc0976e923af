"""Frames processed in parallel, by threads or by a Dask cluster."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from contextvars import copy_context
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from . import operating_system
from .dask_workers import dask_client
from .errors import InputError
from .trusted_files import is_trusted

if TYPE_CHECKING:
    from distributed import Client


@dataclass(frozen=True)
class FramePool:
    """Threads, and maybe a Dask cluster, that process the frames of a run.

    Parameters
    ----------
    threads : ThreadPoolExecutor
        For local files.
    cluster : distributed.Client or None
        For frames, instead of the threads.
    workers : int
        Frames at a time.
    """

    threads: ThreadPoolExecutor
    cluster: "Client | None"
    workers: int

    def map(self, function: Callable, entries: Iterable, *shared: Any) -> Iterator:
        """Yield `function(entry, *shared)` for every frame's entry, in order.

        Only a few results wait at a time, so that memory does not grow with the number of frames.

        Parameters
        ----------
        function : callable
        entries : iterable of FrameEntry
        *shared : objects
            The same for all frames.
        """
        ahead = self.workers

        def submit(*work):
            return self.threads.submit(copy_context().run, *work)  # with the setting of `trust`

        if self.cluster is not None:
            # workers read the frames, so that the paths must be valid there
            entries = [replace(entry, path=entry.path.resolve()) for entry in entries]
            # in a list of one, because a collection would be scattered element by element
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
    def ended(self) -> Iterator[None]:
        """End all threads of the pool after an error in this block; cancel what has not begun.

        A thread that still writes would leave its file in a folder that is being removed.
        """
        try:
            yield
        except BaseException:
            self.threads.shutdown(wait=True, cancel_futures=True)
            raise


@contextmanager
def frame_pool(workers: int | None = None, dask: str | None = None) -> Iterator[FramePool]:
    """Yield a FramePool for this block.

    Threads are sufficient, because kernels, GDAL and HDF5 release the GIL.

    Parameters
    ----------
    workers : int, optional
        Number of threads; without it one per core.
    dask : str, optional
        Address of a Dask scheduler.

    Yields
    ------
    FramePool

    Raises
    ------
    InputError
        No scheduler answers at that address; or `trust` is on, which does not apply to its workers.
    """
    workers = workers or operating_system.cores()
    if dask is not None and is_trusted():
        raise InputError("`trust` applies to this process and not to a Dask cluster; leave `dask` or `trust` out")
    with nullcontext() if dask is None else dask_client(dask) as cluster, ThreadPoolExecutor(workers) as threads:
        yield FramePool(threads, cluster, workers)
