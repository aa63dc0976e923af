"""Locks of folders: one process at a time writes into a folder."""

import errno
import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from . import operating_system
from .errors import OutputError
from .links import open_own, status
from .writer_process import PATTERN, new_token, written_by

LOCK_FILE = ".lock"
# errors of file systems without locks; macOS has two numbers for one of them, Windows returns EINVAL
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL)
_FIRST = b"p"  # first byte of the file
_HOLDER = re.compile(rf"process \d+( on [^,]*)?(, ({PATTERN}))?", re.DOTALL)  # of this and earlier versions
_LONGEST = 1000  # [bytes] read from the file


@contextmanager
def sole_writer(folder: str | Path) -> "Iterator[Hold]":
    """Lock an existing folder for this block.

    The lock is a system lock on the file LOCK_FILE, not the existence of this file: the file of a killed process does
    not block other processes. Where the file system has no locks, the folder is locked as long as the process named
    in the file may be alive.

    The library filelock provides the system locks (flock, LockFileEx). It gets the descriptor of the file opened
    here, so that the holder can be reported and a removed or replaced folder is detected.

    Parameters
    ----------
    folder : str or Path

    Yields
    ------
    Hold

    Raises
    ------
    OutputError
        Another process, or another run of this process, has locked it; LOCK_FILE is a link or another file.
    """
    hold = Hold(Path(folder))
    try:
        yield hold
    finally:
        hold.release()


class Hold:
    """Exclusive lock on a folder until `release`.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    OutputError
        As `sole_writer`.
    """

    def __init__(self, folder: Path):
        self.folder, self._path = folder, folder / LOCK_FILE
        self._handle = self._locked()
        os.ftruncate(self._handle, 0)
        os.lseek(self._handle, 0, os.SEEK_SET)
        os.write(self._handle, f"process {os.getpid()} on {socket.gethostname()}, {new_token()}".encode())

    def _locked(self) -> int:
        """Return the descriptor of the locked lock file; try again if its holder has just released and removed it."""
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
        """Refuse a file of this name that is not a lock of this program."""
        if holder and _HOLDER.fullmatch(holder) is None:
            raise OutputError(f"{self._path} was not written by mpmgis; move it away, or give another -o")

    def _lock(self, handle, holder):
        from filelock import lock_descriptor  # 30 ms, needed only by commands that write a run

        try:
            locked = lock_descriptor(handle, blocking=False)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            self._lock_by_name(holder)
        else:
            if not locked:
                raise self._held(holder, "wait for it to end")

    def _lock_by_name(self, holder: str) -> None:
        """Lock where the file system has no locks: refuse while the process named in the file may be alive."""
        found = _HOLDER.fullmatch(holder)
        if found is not None and found[3] is not None and not written_by(found[3]).is_over():
            raise self._held(holder, f"wait for it to end, remove {self._path} if it has ended")

    def _held(self, holder: str, fix: str) -> OutputError:
        """Return the error that names the holder of the lock."""
        who = holder.partition(",")[0] or "another process"
        return OutputError(f"{self.folder} is being written by {who}; {fix}, or give another -o")

    def _is(self, handle: int) -> bool:
        """Return whether the path of the lock is still the file that is open as `handle`."""
        found = status(self._path)
        return found is not None and os.path.samestat(found, os.fstat(handle))

    def require_folder(self) -> None:
        """Raise OutputError if the folder was removed, moved or replaced.

        Raises
        ------
        OutputError
        """
        if not self._is(self._handle):
            raise OutputError(f"{self.folder} was removed or replaced while it was written; run the command again")

    def release(self) -> None:
        """Remove the file while it is locked, then unlock it."""
        own = self._is(self._handle)
        if own:
            with suppress(OSError):
                os.ftruncate(self._handle, 0)  # without a holder, also where it cannot be removed
                self._path.unlink()
        os.close(self._handle)
        if own and operating_system.WINDOWS:  # Windows cannot remove open files
            with suppress(OSError):
                self._path.unlink()


def _read(handle: int) -> str:
    """Return the text of the lock file.

    On Windows the first byte cannot be read while another process has locked it.
    """
    try:
        text = os.read(handle, _LONGEST)
    except PermissionError:
        os.lseek(handle, len(_FIRST), os.SEEK_SET)
        text = _FIRST + os.read(handle, _LONGEST)
    return text.decode("utf-8", "replace")
