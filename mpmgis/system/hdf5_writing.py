"""HDF5 files written so that a full disk raises one error."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py


@contextmanager
def written(path: str | Path) -> Iterator[h5py.File]:
    """Create an empty HDF5 file for this block.

    HDF5 crashes after a failed write or close. Therefore a Python file object stores the first error, ignores later
    writes, and raises the error when the file is closed.

    Parameters
    ----------
    path : str or Path

    Yields
    ------
    h5py.File

    Raises
    ------
    OSError
        The first error of a write.
    """
    with _DeferredErrorFile(path) as target:
        with h5py.File(target, "w") as file:
            yield file
        target.raise_error()


class _DeferredErrorFile:
    """A binary file whose writes do not raise; `raise_error` raises the first error."""

    def __init__(self, path):
        self._file, self._error = open(path, "w+b", buffering=0), None  # noqa: SIM115 (closed by __exit__)

    def __enter__(self):
        return self

    def __exit__(self, *raised):
        self._file.close()

    def raise_error(self):
        """Raise the first error of a write, if there was one."""
        if self._error is not None:
            raise self._error

    def write(self, data):
        """Write all of `data`, and return its length."""
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while rest and self._error is None:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._error = error
        return size

    def truncate(self, size=None):
        """Cut or extend the file."""
        try:
            return self._file.truncate(size)
        except OSError as error:
            self._error = self._error or error
            return size

    def read(self, size=-1):
        """Read bytes; h5py recognises a file object by this method."""
        return self._file.read(size)

    def readinto(self, buffer):
        """Fill `buffer`; with zeros after a failed write."""
        count = self._file.readinto(buffer)
        if self._error is not None:
            memoryview(buffer).cast("B")[count:] = bytes(len(buffer) - count)
            return len(buffer)
        return count

    def seek(self, offset, whence=os.SEEK_SET):
        """Move to a position in the file."""
        return self._file.seek(offset, whence)

    def tell(self):
        """Return the position in the file."""
        return self._file.tell()

    def flush(self):
        """Do nothing: the file is not buffered."""
