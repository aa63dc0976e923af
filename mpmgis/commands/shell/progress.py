"""Show progress on stderr (simulated time, speed, wall time left), and stop by signals."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ...system import operating_system
from ...system.messages import progress_shown
from ...system.parent_process import end_with_parent
from . import terminal

STOPPING = "stopping at the end of this step, or of the preparation; a second Ctrl+C stops immediately"
SIGNALS = operating_system.stop_signals()
REPEAT_SECONDS = 1.0  # [s] `timeout` and shells send one signal to a process and to its group: it arrives twice
LINE_SECONDS = 10.0  # [s] between progress lines without a terminal
BEFORE = "before the first step"


class Interrupted(KeyboardInterrupt):
    """Stopped by a signal; `exit_code` follows the convention of shells.

    Parameters
    ----------
    number : int
        Of the signal.
    """

    def __init__(self, number):
        super().__init__()
        self.exit_code = 128 + number


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Raise Interrupted at Ctrl+C and SIGTERM within this block, so that incomplete files are removed.

    A second signal within REPEAT_SECONDS is ignored: it is a repetition, and would interrupt the clean-up.
    """
    last = -REPEAT_SECONDS

    def end(number, frame):
        nonlocal last
        echo, last = time.monotonic() - last < REPEAT_SECONDS, time.monotonic()
        if not echo:
            raise Interrupted(number)

    before = {}
    try:
        for number in SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:  # a background job may ignore Ctrl+C
                before[number] = signal.signal(number, end)
    except ValueError:  # not the main thread, which alone handles signals
        yield
        return
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interruptible(*watches: Callable[..., Any], done: bool = True) -> Iterator[Any]:
    """Yield watches that raise Interrupted after Ctrl+C or SIGTERM, or when QGIS, which started the work, has ended.

    The first signal has effect at their next call, the second immediately. A signal after the last call has no effect
    if the work is `done` then; else it stops at the end.

    A KeyboardInterrupt that Python raises inside a callback of a library would be lost.

    Parameters
    ----------
    *watches : callable
        Functions that the work calls from time to time.
    done : bool
        Whether the work is complete at the end of the block.

    Yields
    ------
    callable, or list of callable
        One for each watch.

    Raises
    ------
    Interrupted
    """
    end_with_parent()
    asked = []

    def remember(number, frame):
        if asked:
            raise Interrupted(number)
        asked.append(number)
        terminal.note(STOPPING)

    def stopping(watch):
        def watching(*state):
            if asked:
                raise Interrupted(asked[0])
            return watch(*state)

        return watching

    def given(made):
        return made[0] if len(made) == 1 else made

    before = {}
    try:
        for number in SIGNALS:
            before[number] = signal.signal(number, remember)
    except ValueError:  # not the main thread, which alone handles signals
        yield given(watches)
        return
    try:
        yield given([stopping(watch) for watch in watches])
        if asked and not done:
            raise Interrupted(asked[0])
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def run_progress() -> Iterator[Callable[[Any, float, str], None]]:
    """Yield a function that shows the progress of a run.

    Yields
    ------
    callable
        Called with (solver, end time [s], wall time left in words).
    """
    if terminal.volume < 0:
        with progress_shown(lambda text: None):
            yield lambda solver, end_time, left: None
    elif sys.stderr.isatty():
        yield from _bar()
    else:
        yield from _lines()


def _bar():
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[speed]}"),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress, _drawn(progress):
        task = progress.add_task(BEFORE, total=None, speed="", left="")

        def watch(solver, end_time, left):
            progress.update(
                task,
                description=f"t = {solver.time:.1f} of {end_time:g} s",
                total=end_time,
                completed=solver.time,
                speed=f"fastest {solver.speed_max:.1f} m/s",
                left=left,
            )

        with progress_shown(lambda text: progress.update(task, description=text)):
            yield watch


_bars = []  # on the terminal now


@contextmanager
def _drawn(bar):
    _bars.append(bar)
    try:
        yield
    finally:
        _bars.remove(bar)


@contextmanager
def without_bar() -> Iterator[None]:
    """Draw no bar within this block, so that a question on the terminal is visible."""
    bars = tuple(_bars)
    for bar in bars:
        bar.stop()
    yield
    for bar in bars:
        bar.start()


class _NowAndThen:
    """Whether a progress line is due: every LINE_SECONDS, counted from the first call."""

    def __init__(self):
        self._last = None

    def start_again(self):
        """Count from the next call."""
        self._last = None

    def is_due(self):
        now = time.monotonic()
        if self._last is None:
            self._last = now
        due = now - self._last >= LINE_SECONDS
        if due:
            self._last = now
        return due


_export_lines = _NowAndThen()


def _lines():
    """A line every LINE_SECONDS, for logs."""
    lines = _NowAndThen()
    lines.is_due()

    def watch(solver, end_time, left):
        if lines.is_due():
            words = f"t = {solver.time:.1f} of {end_time:g} s, fastest {solver.speed_max:.1f} m/s"
            terminal.note(f"{words}, {left}" if left else words)

    def show(text):
        if lines.is_due():
            terminal.note(text)

    with progress_shown(show):
        yield watch


def show_count(what: str, done: int, total: int) -> None:
    """Show how many things are done: on a terminal in one line that is rewritten, in a log every LINE_SECONDS.

    Parameters
    ----------
    what : str
        A frame, a block of a DTM, ...
    done, total : int
    """
    if done <= 1:
        _export_lines.start_again()
    if terminal.volume >= 0 and sys.stderr.isatty():
        print(f"\r{what} {done} of {total}", end="" if done < total else "\n", file=sys.stderr, flush=True)
    elif _export_lines.is_due():
        terminal.note(f"{what} {done} of {total}")


@contextmanager
def member_progress() -> Iterator[Callable[[int, int, int], None]]:
    """Yield a function that shows the progress of many runs, as `show_count`.

    Yields
    ------
    callable
        Called with (runs done, runs in all, runs left out).
    """
    on_terminal, lines, shown = sys.stderr.isatty(), _NowAndThen(), [None]
    lines.is_due()

    def look(done, total, left_out):
        text = f"run {done} of {total}" + (f", {left_out} left out" if left_out else "")
        if terminal.volume < 0 or text == shown[0]:
            return
        if on_terminal:
            print(f"\r{text}", end="", file=sys.stderr, flush=True)
            shown[0] = text
        elif lines.is_due():
            terminal.note(text)
            shown[0] = text

    yield look
    if on_terminal and shown[0] is not None:
        print(file=sys.stderr)
