"""One writer in a folder at a time: a lock that the system takes back when its holder ends, in whatever way."""

import errno
import os
import socket
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import OutputError

try:
    import fcntl
except ImportError:  # Windows has no such locks: nothing is held there
    fcntl = None

LOCK_FILE = ".lock"
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)  # of file systems without


@contextmanager
def sole_writer(folder):
    """Hold `folder`, which is there, for this block; gives a Hold.

    The lock is that of the system on the file LOCK_FILE and not the file: what a killed process leaves holds nobody
    up, and no process number can be mistaken for that of another one. The file names its holder, for messages.

    Raises
    ------
    OutputError
        Another process, or another run of this one, holds it.
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
        os.write(self._handle, f"process {os.getpid()} on {socket.gethostname()}".encode())

    def _locked(self):
        """Descriptor of the lock's file, locked; tried again if its holder let go and removed it meanwhile."""
        while True:
            handle = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                self._lock(handle)
                if self._is(handle):
                    return handle
            except BaseException:
                os.close(handle)
                raise
            os.close(handle)

    def _lock(self, handle):
        if fcntl is None:
            return
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.read(handle, 200).decode("utf-8", "replace") or "another process"
            raise OutputError(
                f"{self.folder} is being written by {holder}; wait for it to end, or give another -o"
            ) from error
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise

    def _is(self, handle):
        """True where the lock's name still means the file that is open as `handle`."""
        try:
            return os.path.samestat(os.stat(self._path), os.fstat(handle))
        except FileNotFoundError:
            return False

    def require(self):
        """Raise OutputError if the folder was removed, moved or replaced since."""
        if not self._is(self._handle):
            raise OutputError(f"{self.folder} was removed or replaced while it was written to; run it again")

    def release(self):
        """Remove the file, while it is still held, and let go."""
        if self._is(self._handle):
            with suppress(OSError):
                self._path.unlink()
        os.close(self._handle)
