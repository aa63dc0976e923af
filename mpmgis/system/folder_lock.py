"""Locks of folders: one process at a time writes into a folder."""

import errno
import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import OutputError
from .links import open_own, status

LOCK_FILE = ".lock"
PATIENCE = 0.1  # [s] a process that ends its lock may take
# errors of file systems without locks; macOS has two numbers for one of them, Windows returns EINVAL
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL)
_FIRST = b"p"  # first byte of the file
_HOLDER = re.compile(r"process \d+( on .*)?", re.DOTALL)
_LONGEST = 1000  # [bytes] read from the file


@contextmanager
def sole_writer(folder: str | Path) -> "Iterator[Hold]":
    """Lock an existing folder for this block.

    The lock is that of `filelock.FileLock` on the file LOCK_FILE: the file of a killed process does not block other
    processes. It is removed at the end. Where the file system has no locks, nothing is locked.

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
    import filelock  # 30 ms, needed only by commands that write a run

    path = Path(folder) / LOCK_FILE
    holder = _holder(path)
    lock = filelock.FileLock(path, timeout=PATIENCE, on_acquired=_sign)
    try:
        lock.acquire()
    except filelock.Timeout as error:
        raise OutputError(
            f"{folder} is being written by {holder or 'another process'}; wait for it to end, or give another -o"
        ) from error
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    hold = Hold(Path(folder), os.lstat(path))
    try:
        yield hold
    finally:
        if hold.is_there():
            with suppress(OSError):  # Windows cannot remove open files; there `release` does it
                path.unlink()
        lock.release()


class Hold:
    """Exclusive lock on a folder.

    Parameters
    ----------
    folder : Path
    file : os.stat_result
        Of the file that is locked.
    """

    def __init__(self, folder: Path, file: os.stat_result):
        self._folder, self._file = folder, file

    def is_there(self) -> bool:
        """Return whether the path of the lock is still the file that is locked."""
        found = status(self._folder / LOCK_FILE)
        return found is not None and os.path.samestat(found, self._file)

    def require_folder(self) -> None:
        """Raise OutputError if the folder was removed, moved or replaced.

        Raises
        ------
        OutputError
        """
        if not self.is_there():
            raise OutputError(f"{self._folder} was removed or replaced while it was written; run the command again")


def _holder(path):
    """Return who is named in the lock file, which is created if missing; refuse one that mpmgis did not write.

    On Windows the first byte cannot be read while another process has locked it.
    """
    handle = open_own(path)
    try:
        try:
            text = os.read(handle, _LONGEST)
        except PermissionError:
            os.lseek(handle, len(_FIRST), os.SEEK_SET)
            text = _FIRST + os.read(handle, _LONGEST)
    finally:
        os.close(handle)
    holder = text.decode("utf-8", "replace")
    if holder and _HOLDER.fullmatch(holder) is None:
        raise OutputError(f"{path} was not written by mpmgis; move it away, or give another -o")
    return holder


def _sign(handle):
    """Write this process into the locked file."""
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    os.write(handle, f"process {os.getpid()} on {socket.gethostname()}".encode())
