"""Compilation of a loop and of the kernels that it calls: side by side in several processes, with a line on progress.

Numba compiles one function at a time in a process. The kernels that a loop calls are independent: child processes
compile them into the cache on disk, and this process as well. It then compiles the loop, which finds them all there.
Whatever goes wrong in a child, this process compiles what is missing by itself.

Set MPMGIS_COMPILE_PROCESSES to the number of processes; 1: this one alone.
"""

import importlib
import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import copy_context
from typing import Any, NamedTuple

import numba

from ..system import worker_processes
from ..system.messages import log, show_progress
from .called_kernels import argument_types, called_kernels, functions_within
from .checked_cache import has_any, is_kept

MOST_PROCESSES = 4  # of 0.3 GB each; with more the largest kernel is what takes longest
# time to compile on a core of 2026, to begin with the largest and for the first estimate; measured within a factor 2
SECONDS_PER_BYTE = 4e-4  # [s] per byte of the byte code of a kernel and of those that it calls
SECONDS_PER_LOOP = 0.9  # [s] for each of these that is parallel
TRUSTED_SECONDS = 5.0  # [s] of measured work that counts as much as that estimate
SHOW_SECONDS = 1.0  # [s] between two lines on progress
WAIT_SECONDS = 0.1  # [s] between looks at Ctrl+C, which Windows does not let through to a thread that waits


class Piece(NamedTuple):
    """A kernel to compile.

    Parameters
    ----------
    module, name : str
        Where the kernel is found.
    given : tuple of numba types
        Of its arguments.
    """

    module: str
    name: str
    given: tuple

    number = 0  # one piece at a time is given to a worker process


def compile_piece(piece: Piece) -> None:
    """Compile a kernel, or load it from the cache.

    Parameters
    ----------
    piece : Piece
    """
    getattr(importlib.import_module(piece.module), piece.name).compile(piece.given)


def is_first(loop: Any) -> bool:
    """Return whether a loop has never been compiled on this processor, as after an installation.

    Parameters
    ----------
    loop : kernel
    """
    return hasattr(loop, "py_func") and not has_any(loop)


@contextmanager
def begun(calls: Sequence[tuple[Any, tuple]]) -> Iterator[None]:
    """Let child processes compile the kernels of loops during this block; they end with it.

    Parameters
    ----------
    calls : sequence of (loop, tuple of its arguments)
    """
    global _begun
    if not calls or processes() < 2:
        yield
        return
    _begun = Compilation()
    try:
        for loop, arguments in calls:
            _begun.add(loop, argument_types(loop, arguments))
        _begun.begin()
        yield
    finally:
        _begun.end()
        _begun = None


def complete(loop: Any, arguments: tuple) -> None:
    """Compile a loop for a call with these arguments, or load it; the kernels that it calls side by side before it.

    Parameters
    ----------
    loop : kernel
    arguments : tuple of objects
    """
    if not hasattr(loop, "py_func"):  # plain Python
        return
    given = argument_types(loop, arguments)
    if given in loop.overloads or is_kept(loop, given):
        return
    compilation = _begun or Compilation()
    try:
        compilation.add(loop, given)
        compilation.begin()
        compilation.finish(loop, given)
    finally:
        if compilation is not _begun:
            compilation.end()


def processes() -> int:
    """Return the number of processes that compile: one for each core, as far as MOST_PROCESSES.

    One in a worker process, which is one of many; where no cache can be written, which children fill; and in a program
    with Python inside, such as QGIS, which children would start again.
    """
    is_python = "python" in os.path.basename(sys.executable or "").lower()
    if worker_processes.is_worker() or not is_python or not os.access(numba.config.CACHE_DIR, os.W_OK):
        return 1
    told = os.environ.get("MPMGIS_COMPILE_PROCESSES", "")
    return max(1, int(told) if told.isdecimal() else min(numba.config.NUMBA_NUM_THREADS, MOST_PROCESSES))


def seconds_of(kernel: Any) -> float:
    """Estimate the time [s] to compile a kernel with those that it calls.

    Parameters
    ----------
    kernel : numba dispatcher
    """
    within = list(functions_within(kernel))
    loops = sum(bool(getattr(one, "targetoptions", {}).get("parallel")) for one in within)
    size = sum(len(getattr(one, "py_func", one).__code__.co_code) for one in within)
    return SECONDS_PER_LOOP * loops + SECONDS_PER_BYTE * size


class Compilation:
    """Kernels that this process and its children compile, each process the next one as soon as it is free."""

    def __init__(self) -> None:
        self._since = time.monotonic()
        self._waiting: list[Piece] = []  # the one to be begun next is last
        self._left: dict[object, float] = {}  # piece or loop -> estimated time [s]
        self._count = self._estimated = 0
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._children: list[threading.Thread] = []
        self._shown: threading.Thread | None = None

    def add(self, loop: Any, given: tuple) -> None:
        """Add the kernels that a loop calls and that are neither in the cache nor here; finally the loop itself.

        Parameters
        ----------
        loop : kernel
        given : tuple of numba types
            Of its arguments.
        """
        found = {}
        with suppress(Exception):  # the compilation of `loop` raises it again, or needs no inference of its own
            for kernel, types in called_kernels(loop, given):
                function = kernel.py_func
                named = getattr(sys.modules.get(function.__module__), function.__name__, None)
                if named is kernel and not is_kept(kernel, types):
                    found[Piece(function.__module__, function.__name__, types)] = seconds_of(kernel)
        with self._lock:
            new = {piece: seconds for piece, seconds in found.items() if piece not in self._left}
            self._waiting = sorted([*self._waiting, *new], key=lambda piece: {**self._left, **new}[piece])
            if loop not in self._left:
                new[loop] = SECONDS_PER_LOOP + SECONDS_PER_BYTE * len(loop.py_func.__code__.co_code)
            self._left |= new
            self._count += len(new)
            self._estimated += sum(new.values())

    def begin(self) -> None:
        """Start the line on progress, and children as far as there is work for them."""
        if self._shown is None:
            self._shown = _thread(self._show)
        running = sum(thread.is_alive() for thread in self._children)
        for _ in range(min(processes(), len(self._waiting)) - 1 - running):
            self._children.append(_thread(self._let_child))

    def finish(self, loop: Any, given: tuple) -> None:
        """Compile what nobody has begun, wait until the children have compiled the rest, and compile a loop.

        Parameters
        ----------
        loop : kernel
        given : tuple of numba types
            Of its arguments.
        """
        while (piece := self._taken()) is not None:
            with suppress(Exception):  # the loop compiles what it really calls, and raises its errors
                compile_piece(piece)
            self._left.pop(piece, None)
        for thread in self._children:
            while thread.is_alive():
                thread.join(WAIT_SECONDS)
        loop.compile(given)
        self._left.pop(loop, None)
        if not self._left:
            log.info(f"kernels compiled in {time.monotonic() - self._since:.0f} s; later runs load them")

    def end(self) -> None:
        """End the children, also during work, and the line on progress."""
        self._ended.set()
        for thread in (self._shown, *self._children):
            if thread is not None:
                thread.join()

    def line(self) -> str:
        """Return a line that says how many kernels are left, and about how long they take."""
        left = list(self._left.values())
        done, passed = self._estimated - sum(left), time.monotonic() - self._since
        pace = (passed + TRUSTED_SECONDS) / (done + TRUSTED_SECONDS * processes())
        return (
            f"preparing: kernels are compiled once after an installation, {len(left)} of {self._count} left, "
            f"about {max(1.0, sum(left) * pace):.0f} s"
        )

    def _taken(self):
        """Return a piece that nobody has begun; None where there is none."""
        with self._lock:
            return None if self._ended.is_set() or not self._waiting else self._waiting.pop()

    def _show(self):
        while not self._ended.wait(SHOW_SECONDS):
            if self._left:
                show_progress(self.line())

    def _let_child(self):
        """Let a child compile pieces until there are none; after an error the other processes have the rest."""
        with suppress(_Ended, Exception), worker_processes.started(1) as child:
            while (piece := self._taken()) is not None:
                try:
                    list(child.worked(compile_piece, [piece], self._require_going, _give_up))
                finally:
                    self._left.pop(piece, None)

    def _require_going(self):
        if self._ended.is_set():
            raise _Ended


class _Ended(BaseException):
    """Nobody waits for the kernels any more."""


def _give_up(piece, again):
    """Start no other child in place of one that died: it may be the memory."""
    raise _Ended


def _thread(work):
    """Start a thread for `work` with the context of this one, to which messages go."""
    thread = threading.Thread(target=copy_context().run, args=(work,), daemon=True)
    thread.start()
    return thread


_begun: Compilation | None = None  # by `begun`
