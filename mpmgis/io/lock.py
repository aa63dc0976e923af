"""One writer in a folder at a time: a lock that the system takes back when its holder ends, in whatever way."""

import errno
import os
import re
import socket
from contextlib import contextmanager, suppress
from pathlib import Path

from .. import system
from ..errors import OutputError
from .links import open_own, status
from .writer import PATTERN, new_token, written_by

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
    the folder as long as the process that it names may be alive (`io.writer`).

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
