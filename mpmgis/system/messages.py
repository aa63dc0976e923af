"""Messages for the user: the logger `mpmgis`, and contexts that drop, collect or delay what is logged in them.

Progress is a text that the next one replaces. A program with a terminal shows it there; otherwise it is logged now and
then.

From Python, `logging.basicConfig(level="INFO")` shows the messages; the command prints them on stderr.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

log = logging.getLogger("mpmgis")
Progress = Callable[[int, int], None]  # called with (steps done, steps in all)
PROGRESS_SECONDS = 10.0  # [s] between two logged texts on progress
_display: ContextVar[Callable[[str], None] | None] = ContextVar("display", default=None)
_logged = [-PROGRESS_SECONDS]  # [s] when the last text on progress was logged
_sinks: ContextVar[tuple[Callable[[str], bool], ...]] = ContextVar("sinks", default=())


def unwatched(done: int, total: int) -> None:
    """Ignore progress.

    Parameters
    ----------
    done, total : int
        Number of steps.
    """


def _passes_sinks(record: logging.LogRecord) -> bool:
    """Pass a message to the open contexts, the innermost first; one that returns False stops it."""
    return all(sink(record.getMessage()) for sink in reversed(_sinks.get()))


log.addFilter(_passes_sinks)


@contextmanager
def _sink(take: Callable[[str], bool]) -> Iterator[None]:
    token = _sinks.set((*_sinks.get(), take))
    try:
        yield
    finally:
        _sinks.reset(token)


@contextmanager
def muted() -> Iterator[None]:
    """Drop the messages that are logged in this block, in this thread."""
    with _sink(lambda text: False):
        yield


@contextmanager
def collected() -> Iterator[list[str]]:
    """Collect the messages that are logged in this block, in this thread; they are also logged if the level allows."""
    notes: list[str] = []
    level, shown = log.level, log.isEnabledFor(logging.INFO)
    if not shown:
        log.setLevel(logging.INFO)
    try:
        with _sink(lambda text: notes.append(text) is None and shown):
            yield notes
    finally:
        log.setLevel(level)


@contextmanager
def logged_once() -> Iterator[None]:
    """Log each distinct message of this block once, in this thread."""
    seen: set[str] = set()
    with _sink(lambda text: not (text in seen or seen.add(text))):
        yield


@contextmanager
def logged_after_success() -> Iterator[None]:
    """Log the messages of this block after it, each once; none of them where the block raises an error."""
    notes: list[str] = []
    with _sink(lambda text: notes.append(text) is not None):
        yield
    for note in dict.fromkeys(notes):
        log.info(note)


@contextmanager
def details() -> Iterator[None]:
    """Log the messages of this block only where level DEBUG is enabled (`-v` of the command)."""
    with _sink(lambda text: log.isEnabledFor(logging.DEBUG)):
        yield


@contextmanager
def progress_shown(show: Callable[[str], None]) -> Iterator[None]:
    """Show progress in this block, in this thread, with a function instead of the log.

    Parameters
    ----------
    show : callable
        Called with the text.
    """
    token = _display.set(show)
    try:
        yield
    finally:
        _display.reset(token)


def show_progress(text: str) -> None:
    """Show how far some work is: as `progress_shown` says, else as a message every PROGRESS_SECONDS.

    Parameters
    ----------
    text : str
    """
    show, now = _display.get(), time.monotonic()
    if show is not None:
        show(text)
    elif now - _logged[0] >= PROGRESS_SECONDS:
        _logged[0] = now
        log.info(text)
