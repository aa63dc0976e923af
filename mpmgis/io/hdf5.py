"""HDF5 files: writing on a disk that may fill up, and reading files of unknown origin safely.

HDF5 follows external links, virtual datasets and external storage to any file that the user may read; a source that is
missing becomes the fill value, and one that is a pipe is waited for. A few bytes declare any shape. All that reads HDF5
here opens it by this module. Where the user trusts what the file names (`io.trust`), it is read from files that are
there.
"""

import math
import os
from contextlib import contextmanager
from pathlib import Path

import h5py

from ..errors import FormatError, one_line
from ..machine import memory_lack
from .input_files import is_trusted, require_file


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


MOST_OBJECTS = 100_000
SMALL = 64 * 2**20  # [bytes] that are not held against the memory: asking each dataset takes longer than reading it


@contextmanager
def opened(path):
    """The h5py.File at `path` for this block, whatever it refers to: look with `elsewhere` before something is read.

    Raises
    ------
    FormatError
        A pipe, a socket, a device.
    OSError
        What HDF5 says of a file that it cannot open.
    """
    require_file(path)
    with _library_failures(), h5py.File(path, "r") as file:
        yield file


@contextmanager
def _library_failures():
    """OSError where h5py itself fails on a damaged file: its lock then raises SystemError, not the first error."""
    try:
        yield
    except SystemError as error:
        raise OSError("h5py failed inside the HDF5 library") from error


class WholeFile(h5py.File):
    """An open file whose values lie in itself; `is_small` where all of them are numbers that any machine holds."""

    is_small = False


@contextmanager
def opened_whole(path):
    """As `opened`, a WholeFile: all that the file names lies in it; soft links lead to something in the file.

    Raises
    ------
    FormatError
        Also an external link, a virtual dataset, one in external storage, or more objects than any of our files has.
    """
    require_file(path)
    with _library_failures(), WholeFile(path, "r") as file:
        file.is_small = _declared(path, file) <= SMALL and not is_trusted()
        yield file


def _declared(path, file):
    """Bytes that the datasets take as float64, infinite where one holds no numbers; refuses what `opened_whole` does.

    One visit of the links: 0.02 ms a dataset.
    """
    left, size = MOST_OBJECTS, 0

    def foreign(name, info):
        nonlocal left, size
        left -= 1
        if left < 0:
            return name, f"one of more than {MOST_OBJECTS} objects"
        if info.type == h5py.h5l.TYPE_EXTERNAL:
            kind = not_followed(file.get(name, getlink=True), path) if is_trusted() else "an external link"
            return (name, kind) if kind else None
        if info.type != h5py.h5l.TYPE_HARD:
            return None if info.type == h5py.h5l.TYPE_SOFT else (name, "a link of a plugin")
        found = h5py.h5o.open(file.id, name)
        if not isinstance(found, h5py.h5d.DatasetID):
            return None
        size += _bytes_of(found)
        kind = elsewhere(found, path)
        return (name, kind) if kind else None

    found = file.id.links.visit(foreign, info=True)
    if found is not None:
        name = one_line(found[0].decode("utf-8", "replace"))[:80]
        raise FormatError(f"{path}: {name} is {found[1]}, wanted values in the file itself; ask for such a file")
    return size


def _bytes_of(dataset):
    """Bytes of a dataset (h5py.h5d.DatasetID) as float64, and of a chunk of it; infinite where it has no numbers."""
    kind, count = dataset.get_type(), math.prod(dataset.shape or ())
    if kind.get_class() not in (h5py.h5t.INTEGER, h5py.h5t.FLOAT):
        return math.inf
    if dataset.get_offset() is not None:
        return 8 * count
    layout = dataset.get_create_plist()
    chunked = layout.get_layout() == h5py.h5d.CHUNKED
    return 8 * count + (8 * math.prod(layout.get_chunk()) if chunked else 0)


def elsewhere(dataset, path):
    """In words why the values of a dataset (h5py.h5d.DatasetID) in the file at `path` lie in others that are not read.

    "" where they lie in its own, or in others that are there and that the user trusts. HDF5 reads the fill value where
    the source of a virtual dataset is missing, and waits for a pipe.
    """
    if dataset.get_offset() is not None:  # contiguous, in this file
        return ""
    layout = dataset.get_create_plist()
    if layout.get_layout() == h5py.h5d.VIRTUAL:
        names = (layout.get_virtual_filename(k) for k in range(layout.get_virtual_count()))
        return _not_read("a virtual dataset", path, names)
    names = (os.fsdecode(layout.get_external(k)[0]) for k in range(layout.get_external_count()))
    return _not_read("a dataset in external storage", path, names) if layout.get_external_count() else ""


def not_followed(link, path):
    """In words why a link (of h5py, with getlink) in the file at `path` is not followed; "" where it is."""
    if isinstance(link, h5py.HardLink):
        return ""
    return _not_read("an external link", path, [link.filename]) if isinstance(link, h5py.ExternalLink) else "a link"


def _not_read(kind, path, names):
    """`kind` with why the files `names` that the one at `path` leads to are not read; "" where they are.

    "." is the file itself.
    """
    if not is_trusted():
        return kind
    for name in dict.fromkeys(names):
        place = Path(path) if name == "." else Path(path).parent / name
        if not place.is_file():
            lack = "no plain file" if place.exists() else "not there"
            return f"{kind} of {one_line(name)[:120]}, which is {lack}"
    return ""


def require_room(where, rows, bytes_each, *datasets):
    """Refuse what this machine cannot hold, before it is read.

    Parameters
    ----------
    where : str
        File and dataset, for the message.
    rows : int
    bytes_each : int
        Of a row, in all arrays that are made of it.
    *datasets : h5py.Dataset
        What is read: a chunk of each is unpacked as a whole.

    Raises
    ------
    FormatError
    """
    chunk = max((math.prod(some.chunks) * some.dtype.itemsize for some in datasets if some.chunks), default=0)
    if lack := memory_lack(max(rows * bytes_each, chunk)):
        raise FormatError(f"{where} of {rows:.6g} rows needs {lack}; it is damaged, or for a larger machine")


def require_numbers_that_fit(path, file, name):
    """Refuse the group `name` of a WholeFile whose datasets together are more than this machine holds, or no numbers.

    Texts of any length may each be the same long one.
    """
    if file.is_small or name not in file:
        return
    datasets = {key: some for key, some in file[name].items() if isinstance(some, h5py.Dataset)}
    for key, some in datasets.items():
        if some.dtype.hasobject:
            raise FormatError(f"{path}: {name}/{one_line(key)} holds {some.dtype}, wanted numbers")
    rows = max((some.shape[0] if some.shape else 1 for some in datasets.values() if some.size), default=0)
    size = sum(some.nbytes for some in datasets.values() if some.size)
    if rows:
        require_room(f"{path}: {name}", rows, size / rows, *datasets.values())
