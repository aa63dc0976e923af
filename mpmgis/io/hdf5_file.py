"""HDF5 files to write, on a disk that may run full: the library does not survive a write that fails."""

import os
from contextlib import contextmanager

import h5py


@contextmanager
def written(path):
    """An empty h5py.File at `path` for this block.

    HDF5 crashes later on when a write or a close of it has failed. So writing goes through a file of Python's, which
    keeps the first error to itself, takes what comes after it as written, and raises it when all is closed.

    Raises
    ------
    OSError
        What the system said of a write.
    """
    with _Patient(path) as target:
        with h5py.File(target, "w") as file:
            yield file
        target.raise_error()


class _Patient:
    """A binary file for reading and writing whose writes never fail; `raise_error` tells what was wrong."""

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
        """Write all of `data`; answers its length."""
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
        """Bytes from here on; h5py knows a file by this."""
        return self._file.read(size)

    def readinto(self, buffer):
        """Fill `buffer`; with zeros where nothing could be written."""
        count = self._file.readinto(buffer)
        if self._error is not None:
            memoryview(buffer).cast("B")[count:] = bytes(len(buffer) - count)
            return len(buffer)
        return count

    def seek(self, offset, whence=os.SEEK_SET):
        """Go to a place in the file."""
        return self._file.seek(offset, whence)

    def tell(self):
        """The place in the file."""
        return self._file.tell()

    def flush(self):
        """Nothing is held back."""
