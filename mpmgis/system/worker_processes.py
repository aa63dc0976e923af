"""Worker processes on this machine, connected by pipes.

No port is used: other users of the machine could send code to a listening process. A process that dies is replaced,
and its work is repeated.
"""

import json
import os
import pickle
import struct
import subprocess
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import IO, Any

from . import operating_system
from .errors import InputError, one_line

KEPT_BYTES = 1 << 30  # [bytes] of freed memory that a worker keeps
LARGEST_KEPT = 32 << 20  # [bytes] of one array; larger ones are returned to the system at once
RETRIES = 2  # of a piece of work whose worker died
POLL_SECONDS = 0.2  # [s] between checks of progress and Ctrl+C
_END_SECONDS = 5.0  # [s] for a worker to end after a request
_LENGTH = struct.Struct("<Q")  # [bytes] of a message, written before it
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from mpmgis.system.worker_processes import serve; serve()"
)
_ENVIRONMENT = {  # one thread each; glibc keeps freed memory, because page faults are slow
    "OMP_NUM_THREADS": 1,
    "MKL_NUM_THREADS": 1,
    "OPENBLAS_NUM_THREADS": 1,
    "MALLOC_TRIM_THRESHOLD_": KEPT_BYTES,
    "MALLOC_MMAP_THRESHOLD_": LARGEST_KEPT,
}
_serving = []  # True in a worker process


@contextmanager
def started(count: int) -> "Iterator[Workers]":
    """Start worker processes for this block; they end with the block, or with this process.

    Parameters
    ----------
    count : int

    Yields
    ------
    Workers
    """
    workers = Workers(count)
    try:
        yield workers
    finally:
        workers.end()


class WorkerPool(ABC):
    """Workers that do pieces of work in any order; each has at most as many as it has threads.

    So a dying worker loses no piece that another could have begun. A piece whose worker died is repeated.
    """

    @abstractmethod
    def warm(self, function: Callable, *arguments: Any) -> None:
        """Call `function(*arguments)` in every worker at the same time; errors are ignored, the work repeats them.

        Parameters
        ----------
        function : callable
        *arguments : objects
        """

    @abstractmethod
    def _has_room(self, running: int) -> bool:
        """Return whether a worker is idle while so many pieces are being done."""

    @abstractmethod
    def _begin(self, function: Callable, piece: Any) -> Any:
        """Let an idle worker do a piece; return a key of this work."""

    @abstractmethod
    def _ended(self) -> Iterator[tuple]:
        """Wait a moment; yield (key, a tuple of the value, or None if the worker died) of work that has ended."""

    def worked(
        self,
        function: Callable,
        pieces: Sequence,
        look: Callable = lambda: None,
        died: Callable = lambda piece, again: None,
    ) -> Iterator[tuple]:
        """Yield (piece, `function(piece)`) in the order of completion; None for a piece that killed all its workers.

        Parameters
        ----------
        function : callable
        pieces : sequence of objects with a `number`
        look : callable () -> None
            Called a few times a second.
        died : callable (piece, again) -> None
            Called when a worker has died; `again` is whether the piece is repeated.
        """
        waiting, deaths, running = list(reversed(pieces)), {}, {}
        while waiting or running:
            while waiting and self._has_room(len(running)):
                piece = waiting.pop()
                running[self._begin(function, piece)] = piece
            look()
            for key, value in self._ended():
                piece = running.pop(key)
                if value is not None:
                    yield piece, *value
                    continue
                number = deaths[piece.number] = deaths.get(piece.number, 0) + 1
                died(piece, number <= RETRIES)
                if number <= RETRIES:
                    waiting.append(piece)
                else:
                    yield piece, None


class Workers(WorkerPool):
    """Processes of one thread each.

    Work is pickled: functions must be importable by name.

    Parameters
    ----------
    count : int
    """

    def __init__(self, count: int):
        self._done = SimpleQueue()  # of (process, answer), or (process, None) if it died
        self._processes = [_Process(self._done) for _ in range(count)]
        self._idle = list(self._processes)

    def end(self) -> None:
        """End all processes, also during work."""
        for process in self._processes:
            process.end()

    def warm(self, function: Callable, *arguments: Any) -> None:
        """Call `function(*arguments)` in every worker at the same time; errors are ignored, the work repeats them.

        Parameters
        ----------
        function : callable
        *arguments : objects
        """
        self._idle.clear()
        for process in self._processes:
            process.send(function, arguments)
        for _ in range(len(self._processes)):
            self._idle_again(*self._done.get())

    def _has_room(self, running):
        return bool(self._idle)

    def _begin(self, function, piece):
        process = self._idle.pop()
        process.send(function, (piece,))
        return process

    def _ended(self):
        for process, answer in arrived(self._done):
            self._idle_again(process, answer)
            yield process, None if answer is None else (_value(*answer),)

    def _idle_again(self, process, answer):
        """Add a process with an answer to the idle ones; replace one that died."""
        if answer is None:
            process.end()
            dead, process = process, _Process(self._done)
            self._processes[self._processes.index(dead)] = process
        self._idle.append(process)


def arrived(queue: SimpleQueue) -> Iterator:
    """Yield all available items of a `queue`, after a wait of at most POLL_SECONDS for a first one.

    Parameters
    ----------
    queue : SimpleQueue
    """
    with suppress(Empty):
        yield queue.get(timeout=POLL_SECONDS)
        while True:
            yield queue.get_nowait()


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


def is_worker() -> bool:
    """Return whether this process is a worker process."""
    return bool(_serving)


def serve() -> None:
    """Execute calls in a worker process until its parent process ends or closes the pipe."""
    _serving.append(True)
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


def _answer(call: bytes) -> bytes:
    """Return the pickle of (success, value or error) of a pickled `call`."""
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


def _read(pipe: IO[bytes]) -> bytes:
    """Read the bytes of the next message."""
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
