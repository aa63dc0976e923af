"""Parallel work on frames or members: threads, or a Dask cluster.

Anyone who can reach the port of a Dask scheduler can execute code there: on a network or a machine with other users
use TLS (`tls://` addresses, certificates in the configuration of Dask).
"""

import logging
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from contextvars import copy_context
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue

from .. import system
from ..errors import InputError, one_line
from ..io.input_files import is_trusted
from ..io.libraries import needed_for
from .workers import POLL_SECONDS, RETRIES


@contextmanager
def connected(address):
    """A Dask client of the scheduler at `address`.

    Raises
    ------
    InputError
        No scheduler answers, or Dask's scheduler is not installed.
    """
    with needed_for(f"`dask={address}`", "cluster"):
        from distributed import Client

    _silence_dask()
    try:
        client = Client(address, timeout="5s", set_as_default=False)
    except (OSError, ValueError, TimeoutError, ImportError) as error:
        raise InputError(
            f"`dask={address}`: no scheduler answers there ({one_line(error)[:80]}); start one with: dask scheduler"
        ) from error
    with client:
        yield client


class DaskWorkers:
    """The workers of the Dask `client`, with the interface of `workers.Workers`."""

    def __init__(self, client):
        self._client = client

    def warm(self, function, *arguments):
        """Call `function(*arguments)` in every worker at the same time; errors are ignored, the work repeats them."""
        futures = [
            self._client.submit(function, *arguments, workers=[address], pure=False)
            for address in self._client.nthreads()
        ]
        for future in futures:
            with suppress(Exception):
                future.result()

    def worked(self, function, pieces, look=lambda: None, died=lambda piece, again: None):
        """Yield (piece, `function(piece)`) in the order of completion; None for a piece that killed all its workers.

        At most one piece per thread is submitted, so that a dying worker loses no other piece. `look()` is called a few
        times a second, `died(piece, again)` when a worker has died, with whether the piece is repeated.

        Raises
        ------
        InputError
            The connection to the cluster is lost, or its workers cannot run this program.
        """
        from distributed import CancelledError, KilledWorker

        waiting, deaths, running, done = list(reversed(pieces)), {}, {}, SimpleQueue()
        try:
            while waiting or running:
                while waiting and len(running) < max(1, sum(self._client.nthreads().values())):
                    piece = waiting.pop()
                    future = self._client.submit(function, piece, pure=False)
                    running[future.key] = future, piece
                    future.add_done_callback(done.put)
                look()
                for future in _arrived(done):
                    _, piece = running.pop(future.key)
                    try:
                        yield piece, future.result()
                    except KilledWorker:
                        number = deaths[piece.number] = deaths.get(piece.number, 0) + 1
                        died(piece, number <= RETRIES)
                        if number <= RETRIES:
                            waiting.append(piece)
                        else:
                            yield piece, None
                    except CancelledError as error:
                        raise _gone(error) from error
                    except (ImportError, AttributeError) as error:
                        raise InputError(
                            f"the workers cannot run this program ({one_line(error)[:100]}); install the same version "
                            "of mpmgis there"
                        ) from error
        except OSError as error:
            raise _gone(error) from error
        finally:
            with suppress(Exception):  # the cluster may be gone
                self._client.cancel([future for future, _ in running.values()])


def _gone(error):
    return InputError(
        f"the connection to the Dask cluster is lost ({one_line(error)[:80]}); start again: finished work is kept"
    )


def _arrived(done):
    """All futures in the queue `done`, after a short wait for a first one."""
    with suppress(Empty):
        yield done.get(timeout=POLL_SECONDS)
        while True:
            yield done.get_nowait()


def _silence_dask():
    """Suppress log messages of Dask: mpmgis prints one line."""
    import distributed

    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == distributed.__name__]
    for name in ("tornado", *names):
        logging.getLogger(name).setLevel(logging.CRITICAL)


@dataclass(frozen=True)
class FramePool:
    """`threads` for local files, `cluster` (a Dask client, or None) for frames, `workers` of them at a time."""

    threads: ThreadPoolExecutor
    cluster: object
    workers: int

    def map(self, function, entries, *shared):
        """Yield `function(entry, *shared)` for every frame's entry, in order.

        Only a few results wait at a time, so that memory does not grow with the number of frames.
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
def frame_pool(workers=None, dask=None):
    """A FramePool with `workers` threads (None: one per core), and the Dask scheduler at address `dask` if given.

    Threads are sufficient, because kernels, GDAL and HDF5 release the GIL.

    Raises
    ------
    InputError
        No scheduler answers at that address; or `trust` is on, which does not apply to its workers.
    """
    workers = workers or system.cores()
    if dask is not None and is_trusted():
        raise InputError("`trust` applies to this process and not to a Dask cluster; leave `dask` or `trust` out")
    with nullcontext() if dask is None else connected(dask) as cluster, ThreadPoolExecutor(workers) as threads:
        yield FramePool(threads, cluster, workers)
