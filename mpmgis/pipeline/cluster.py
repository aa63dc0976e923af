"""Where work is spread over processes: the Dask cluster at an address, or one on the cores of this machine."""

import logging
import os
import signal
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue

from ..errors import InputError, one_line

KEPT_BYTES = 1 << 30  # of freed memory that a worker keeps
LARGEST_KEPT = 32 << 20  # bytes of one array, above which the system has it back at once
RETRIES = 2  # of a piece of work whose worker died, before it is given up
START_SECONDS = 120.0  # for the workers of this machine to be there
POLL_SECONDS = 0.2  # between two looks at progress and Ctrl+C


def cores():
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def connected(address):
    """A Dask client of the scheduler at `address`.

    Raises
    ------
    InputError
        No scheduler answers there.
    """
    from distributed import Client

    _hush()
    try:
        client = Client(address, timeout="5s", set_as_default=False)
    except (OSError, ValueError, TimeoutError, ImportError) as error:
        raise InputError(
            f"--dask {address}: no scheduler answers there ({one_line(error)[:80]}); start one with: dask scheduler"
        ) from error
    with client:
        yield client


@contextmanager
def started(workers):
    """A Dask client of `workers` processes of one thread each on this machine, which end with the block.

    A process that dies is replaced. What it worked on fails, and `worked` runs it again.
    """
    import dask
    from distributed import Client, LocalCluster

    _hush()
    settings = {
        "distributed.scheduler.allowed-failures": 0,
        "distributed.worker.memory.terminate": False,
        # Dask has workers give freed memory back at once, to take it anew page by page: efficiency 0.76, without 0.89
        "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": KEPT_BYTES,
        "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": LARGEST_KEPT,
        "distributed.worker.profile.enabled": False,  # a look at every stack a hundred times a second
    }
    with dask.config.set(settings):
        cluster = LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", memory_limit=0,
            silence_logs=logging.CRITICAL, worker_dashboard_address=None,
        )  # fmt: skip
        try:
            with Client(cluster, set_as_default=False) as client:
                client.register_plugin(_deaf_to_ctrl_c(), name="deaf to Ctrl+C")
                client.wait_for_workers(workers, timeout=START_SECONDS)
                yield client
        finally:
            with suppress(TimeoutError):
                cluster.close(timeout=10)


def warm(client, function, *arguments):
    """Let every worker call `function(*arguments)`, all at the same time: what it does first takes longer than later.

    What goes wrong with that is left to the work that follows, which tells it in its own words.
    """
    futures = [client.submit(function, *arguments, workers=[address], pure=False) for address in client.nthreads()]
    for future in futures:
        with suppress(Exception):
            future.result()


def worked(client, function, pieces, look=lambda: None, died=lambda piece, again: None):
    """Yield (piece, `function(piece)`) as they are done, in whatever order; None for one that no worker survived.

    As many pieces are handed out as there are threads, so that a worker that dies costs no other piece. `look()` is
    called a few times a second, `died(piece, again)` when a worker has died over a piece, with whether that is tried
    again.

    Raises
    ------
    InputError
        The cluster went away, or cannot run this program.
    """
    from distributed import CancelledError, KilledWorker

    waiting, deaths, running, done = list(reversed(pieces)), {}, {}, SimpleQueue()
    try:
        while waiting or running:
            while waiting and len(running) < max(1, sum(client.nthreads().values())):
                piece = waiting.pop()
                future = client.submit(function, piece, pure=False)
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
                        f"the workers cannot run this program ({one_line(error)[:100]}); install the same version of "
                        "mpmgis there"
                    ) from error
    except OSError as error:
        raise _gone(error) from error
    finally:
        with suppress(Exception):  # the cluster may be gone
            client.cancel([future for future, _ in running.values()])


def _gone(error):
    return InputError(f"the Dask cluster went away ({one_line(error)[:80]}); start again: what is done is kept")


def _arrived(done):
    """All futures in the queue `done`, after a short wait for a first one."""
    with suppress(Empty):
        yield done.get(timeout=POLL_SECONDS)
        while True:
            yield done.get_nowait()


def _hush():
    """One line is ours, not a page of theirs; their loggers have levels of their own, one by one."""
    import distributed

    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == distributed.__name__]
    for name in ("tornado", *names):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def _deaf_to_ctrl_c():
    """A plugin that lets workers go on when the terminal sends Ctrl+C to all: the program that started them decides."""
    from distributed import WorkerPlugin

    class DeafToCtrlC(WorkerPlugin):
        def setup(self, worker):
            with suppress(ValueError):  # not in the main thread: nothing is sent there
                signal.signal(signal.SIGINT, signal.SIG_IGN)

    return DeafToCtrlC()
