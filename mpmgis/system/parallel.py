"""Parallel work on frames or members: threads, or a Dask cluster.

Anyone who can reach the port of a Dask scheduler can execute code there: on a network or a machine with other users
use TLS (`tls://` addresses, certificates in the configuration of Dask).

Worker processes on this machine, connected by pipes.

No port is used: other users of the machine could send code to a listening process. A process that dies is replaced,
and its work is repeated.
"""

import json
import logging
import os
import pickle
import struct
import subprocess
import sys
import threading
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from contextvars import copy_context
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue

from . import operating_system
from .errors import InputError, one_line
from .optional_libraries import needed_for
from .trusted_files import is_trusted

KEPT_BYTES = 1 << 30  # of freed memory that a worker keeps
LARGEST_KEPT = 32 << 20  # bytes of one array; larger ones are returned to the system at once
RETRIES = 2  # of a piece of work whose worker died
POLL_SECONDS = 0.2  # between checks of progress and Ctrl+C
_END_SECONDS = 5.0  # for a worker to end after a request
_LENGTH = struct.Struct("<Q")
_START = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from mpmgis.system.parallel import serve; serve()"
_ENVIRONMENT = {  # one thread each; glibc keeps freed memory, because page faults are slow
    "OMP_NUM_THREADS": 1,
    "MKL_NUM_THREADS": 1,
    "OPENBLAS_NUM_THREADS": 1,
    "MALLOC_TRIM_THRESHOLD_": KEPT_BYTES,
    "MALLOC_MMAP_THRESHOLD_": LARGEST_KEPT,
}


@contextmanager
def started(count):
    """`count` Workers for this block; they end with the block, or with this process."""
    workers = Workers(count)
    try:
        yield workers
    finally:
        workers.end()


class Workers:
    """Processes of one thread each.

    Work is pickled: functions must be importable by name.
    """

    def __init__(self, count):
        self._done = SimpleQueue()  # of (process, answer), or (process, None) if it died
        self._processes = [_Process(self._done) for _ in range(count)]

    def end(self):
        """End all processes, also during work."""
        for process in self._processes:
            process.end()

    def warm(self, function, *arguments):
        """Call `function(*arguments)` in every worker at the same time; errors are ignored, the work repeats them."""
        for process in self._processes:
            process.send(function, arguments)
        for _ in range(len(self._processes)):
            process, answer = self._done.get()
            if answer is None:
                self._replace(process)

    def worked(self, function, pieces, look=lambda: None, died=lambda piece, again: None):
        """Yield (piece, `function(piece)`) in the order of completion; None for a piece that killed all its workers.

        Every worker has one piece at a time, so that a dying worker loses no other piece. `look()` is called a few
        times a second, `died(piece, again)` when a worker has died, with whether the piece is repeated.
        """
        waiting, deaths, running, idle = list(reversed(pieces)), {}, {}, list(self._processes)
        while waiting or running:
            while waiting and idle:
                process, piece = idle.pop(), waiting.pop()
                running[process] = piece
                process.send(function, (piece,))
            look()
            for process, answer in self._arrived():
                piece = running.pop(process)
                if answer is not None:
                    idle.append(process)
                    yield piece, _value(*answer)
                    continue
                idle.append(self._replace(process))
                number = deaths[piece.number] = deaths.get(piece.number, 0) + 1
                died(piece, number <= RETRIES)
                if number <= RETRIES:
                    waiting.append(piece)
                else:
                    yield piece, None

    def _replace(self, process):
        """Replace a process that died; the new one."""
        process.end()
        self._processes[self._processes.index(process)] = new = _Process(self._done)
        return new

    def _arrived(self):
        """All available answers, after a short wait for a first one."""
        with suppress(Empty):
            yield self._done.get(timeout=POLL_SECONDS)
            while True:
                yield self._done.get_nowait()


def _value(fine, value):
    if fine:
        return value
    if isinstance(value, (ImportError, AttributeError)):
        raise InputError(f"a worker cannot run this program ({one_line(value)[:100]})") from value
    raise value


class _Process:
    """One process, and a thread of this process that receives its answers."""

    def __init__(self, done):
        command = [sys.executable, "-P", "-c", _START, json.dumps(sys.path)]
        environment = os.environ | {name: str(value) for name, value in _ENVIRONMENT.items()}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, bufsize=0
        )
        threading.Thread(target=self._listen, args=(done,), daemon=True).start()

    def _listen(self, done):
        with suppress(OSError, ValueError, EOFError, pickle.UnpicklingError):
            while True:
                done.put((self, pickle.loads(_read(self._process.stdout))))
        self._process.stdout.close()
        done.put((self, None))

    def send(self, function, arguments):
        """Call `function(*arguments)` in the process; the listening thread detects a dead process."""
        with suppress(OSError):
            _write(self._process.stdin, pickle.dumps((function, arguments)))

    def end(self):
        with suppress(OSError):
            self._process.stdin.close()
        self._process.terminate()
        try:
            self._process.wait(_END_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def serve():
    """Main loop of a worker: executes calls until its parent process ends or closes the pipe."""
    operating_system.ignore_interrupts()
    calls, answers = os.fdopen(os.dup(0), "rb", buffering=0), os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # text printed by libraries goes to stderr
    waiting = SimpleQueue()
    threading.Thread(target=_receive, args=(calls, waiting), daemon=True).start()
    while True:
        _write(answers, _answer(waiting.get()))


def _receive(calls, waiting):
    """Put calls into the queue `waiting`; end this process when the parent process ends, also during work."""
    try:
        while True:
            waiting.put(_read(calls))
    except (OSError, EOFError):
        os._exit(0)


def _answer(call):
    """The pickle of (success, value or error) of a pickled `call`."""
    try:
        function, arguments = pickle.loads(call)
        answer = True, function(*arguments)
    except BaseException as error:  # SystemExit too: the caller decides
        answer = False, error
    try:
        return pickle.dumps(answer)
    except Exception as error:
        return pickle.dumps((False, RuntimeError(one_line(answer[1] if not answer[0] else error)[:200])))


def _write(pipe, data):
    rest = memoryview(_LENGTH.pack(len(data)) + data)
    while rest:
        rest = rest[pipe.write(rest) :]


def _read(pipe):
    """The bytes of the next message."""
    return _exactly(pipe, *_LENGTH.unpack(_exactly(pipe, _LENGTH.size)))


def _exactly(pipe, count):
    parts = []
    while count:
        part = pipe.read(min(count, 1 << 20))
        if not part:
            raise EOFError
        parts.append(part)
        count -= len(part)
    return b"".join(parts)


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


def require_scheduler(address: str | None) -> None:
    """Refuse the `address` of a Dask cluster where no scheduler answers, before anything is written.

    Raises
    ------
    InputError
        As `connected`.
    """
    if address is not None:
        with connected(address):
            pass


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
    def ended(self):
        """After an error in the block, no thread of the pool works: what has not begun is cancelled.

        A thread that still writes would leave its file in a folder that is being removed.
        """
        try:
            yield
        except BaseException:
            self.threads.shutdown(wait=True, cancel_futures=True)
            raise


@contextmanager
def frame_pool(workers=None, dask=None):
    """A FramePool with `workers` threads (None: one per core), and the Dask scheduler at address `dask` if given.

    Threads are sufficient, because kernels, GDAL and HDF5 release the GIL.

    Raises
    ------
    InputError
        No scheduler answers at that address; or `trust` is on, which does not apply to its workers.
    """
    workers = workers or operating_system.cores()
    if dask is not None and is_trusted():
        raise InputError("`trust` applies to this process and not to a Dask cluster; leave `dask` or `trust` out")
    with nullcontext() if dask is None else connected(dask) as cluster, ThreadPoolExecutor(workers) as threads:
        yield FramePool(threads, cluster, workers)
