"""One writer in a folder at a time, and which process on which host writes a file.

A folder may be shared by machines, and by containers whose process numbers mean nothing outside. A process is known by
its machine, the start of that machine, its number and its own start. Where any of this cannot be known, the process
counts as alive: what it left half done is left alone.
"""

import errno
import hashlib
import os
import re
import secrets
import socket
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

from .. import system
from ..errors import OutputError
from .links import open_own, status

_INITIAL_SPACE = "pid:[4026531836]"  # of process numbers: that of a Linux machine itself, not of a container
_TEXT = re.compile(r"(\d{1,10})-([0-9a-f]{8})([0-9a-f]{8})-([0-9a-f]{1,16})")
PATTERN = r"\d{1,10}-[0-9a-f]{16}-[0-9a-f]{1,16}-[0-9a-f]{8}"  # of `new_token`
UNKNOWN = system.UNKNOWN


class Writer(NamedTuple):
    """A process: its `number`, digests of its `host` and of the `boot` of that, and its `start` (UNKNOWN: not told)."""

    number: int
    host: str
    boot: str
    start: int

    def __str__(self):
        return f"{self.number}-{self.host}{self.boot}-{self.start:x}"

    def is_over(self):
        """Whether this process has certainly ended."""
        if self.host != host():
            return False
        if self.boot != boot():
            return _is_no_container()  # the machine was started again; of containers only their own start is known
        return not _runs(self.number, self.start)


def this_process():
    """The Writer of this process."""
    return Writer(os.getpid(), host(), boot(), started(os.getpid()))


def new_token():
    """Text for the names of temporary files: this process, and eight digits that nobody foresees."""
    return f"{this_process()}-{secrets.token_hex(4)}"


def written_by(text):
    """The Writer that the text of one, or a token, begins with; None where it is none."""
    found = _TEXT.match(text)
    return None if found is None else Writer(int(found[1]), found[2], found[3], int(found[4], 16))


@cache
def host():
    """Eight digits of this machine and, in a container, of its space of process numbers."""
    return _digest(socket.gethostname(), system.machine_number(), _space())


@cache
def boot():
    """Eight digits of the start of this machine; the same at any time where processes tell the date of their start."""
    return _digest(system.start_of_machine())


def started(number):
    """When process `number` was started, in the system's own count; UNKNOWN where nothing tells it."""
    return system.process_start(number)


def _runs(number, start):
    """Whether process `number` that began at `start` may still run on this machine."""
    if not system.runs(number):
        return False
    now = started(number)
    return UNKNOWN in (now, start) or now == start


def _is_no_container():
    return _space() == _INITIAL_SPACE and bool(system.machine_number())


@cache
def _space():
    return system.process_space()


def _digest(*texts):
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:8]


LOCK_FILE = ".lock"
# of file systems without locks; macOS has two numbers for one of them, Windows answers EINVAL
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL)
_FIRST = b"p"  # of all that is written to the file
_HOLDER = re.compile(rf"process \d+( on [^,]*)?(, ({PATTERN}))?", re.DOTALL)  # of this version, and of those before
_LONGEST = 1000  # [bytes] that are read of the file


@contextmanager
def sole_writer(folder):
    """Hold `folder`, which is there, for this block; gives a Hold.

    The lock is that of the system on the file LOCK_FILE and not the file: what a killed process leaves holds nobody
    up, and no process number can be mistaken for that of another one. Where the system has no locks, the file holds
    the folder as long as the process that it names may be alive (`io.lock`).

    The library filelock knows the locks of each system: flock, LockFileEx. It is handed the file that was opened here.
    A lock that it opens by name itself tells nobody who holds it, and not that the folder was removed or replaced.

    Raises
    ------
    OutputError
        Another process, or another run of this one, holds it; LOCK_FILE is a link or something else of the user's.
    """
    hold = Hold(Path(folder))
    try:
        yield hold
    finally:
        hold.release()


class Hold:
    """A folder that nobody else writes to until `release`."""

    def __init__(self, folder):
        self.folder, self._path = folder, folder / LOCK_FILE
        self._handle = self._locked()
        os.ftruncate(self._handle, 0)
        os.lseek(self._handle, 0, os.SEEK_SET)
        os.write(self._handle, f"process {os.getpid()} on {socket.gethostname()}, {new_token()}".encode())

    def _locked(self):
        """Descriptor of the lock's file, locked; tried again if its holder let go and removed it meanwhile."""
        while True:
            handle = open_own(self._path)
            try:
                holder = _read(handle)
                self._require_own(holder)
                self._lock(handle, holder)
                if self._is(handle):
                    return handle
            except BaseException:
                os.close(handle)
                raise
            os.close(handle)

    def _require_own(self, holder):
        """Refuse a file of that name that is somebody's and not a lock of this program."""
        if holder and _HOLDER.fullmatch(holder) is None:
            raise OutputError(f"{self._path} was not written by mpmgis; move it away, or give another -o")

    def _lock(self, handle, holder):
        from filelock import lock_descriptor  # 30 ms of the start of a verb that writes no run

        try:
            locked = lock_descriptor(handle, blocking=False)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            self._lock_by_name(holder)
        else:
            if not locked:
                raise self._held(holder, "wait for it to end")

    def _lock_by_name(self, holder):
        """Where the system has no locks: the file is one as long as the process that it names may be alive."""
        found = _HOLDER.fullmatch(holder)
        if found is not None and found[3] is not None and not written_by(found[3]).is_over():
            raise self._held(holder, f"wait for it to end, remove {self._path} if it has ended")

    def _held(self, holder, cure):
        """The error that tells who holds the folder."""
        who = holder.partition(",")[0] or "another process"
        return OutputError(f"{self.folder} is being written by {who}; {cure}, or give another -o")

    def _is(self, handle):
        """True where the lock's name still means the file that is open as `handle`."""
        found = status(self._path)
        return found is not None and os.path.samestat(found, os.fstat(handle))

    def require(self):
        """Raise OutputError if the folder was removed, moved or replaced since."""
        if not self._is(self._handle):
            raise OutputError(f"{self.folder} was removed or replaced while it was written to; run it again")

    def release(self):
        """Remove the file, while it is still held, and let go."""
        own = self._is(self._handle)
        if own:
            with suppress(OSError):
                os.ftruncate(self._handle, 0)  # it names nobody, also where it cannot be removed
                self._path.unlink()
        os.close(self._handle)
        if own and system.WINDOWS:  # no open file can be removed there: not this one before, not that of another now
            with suppress(OSError):
                self._path.unlink()


def _read(handle):
    """The text of the lock's file. Windows lets nobody read the byte that another process has locked, the first."""
    try:
        text = os.read(handle, _LONGEST)
    except PermissionError:
        os.lseek(handle, len(_FIRST), os.SEEK_SET)
        text = _FIRST + os.read(handle, _LONGEST)
    return text.decode("utf-8", "replace")
