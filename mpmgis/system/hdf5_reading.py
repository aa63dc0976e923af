"""Safe reading of HDF5 files of unknown origin.

HDF5 follows external links, virtual datasets and external storage to any readable file; a missing source gives the
fill value, a pipe blocks. A few bytes can declare any shape. Therefore all HDF5 files are opened by this module.
References to other files are followed only where the user trusts them (`trusted_files.trusting`) and they exist.
"""

import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from .errors import FormatError, one_line
from .memory import memory_lack
from .trusted_files import is_trusted, require_file

MOST_OBJECTS = 100_000  # far more than any frame has; each costs 0.02 ms
SMALL = 64 * 2**20  # [bytes] below which the memory is not checked: the check would take longer than reading


@contextmanager
def opened(path: str | Path) -> Iterator[h5py.File]:
    """Open an HDF5 file for this block, with all references; check with `reason_elsewhere` before reading.

    Parameters
    ----------
    path : str or Path

    Yields
    ------
    h5py.File

    Raises
    ------
    FormatError
        A pipe, a socket, a device.
    OSError
        HDF5 cannot open the file.
    """
    require_file(path)
    with _library_failures(), h5py.File(path, "r") as file:
        yield file


@contextmanager
def _library_failures() -> Iterator[None]:
    """Raise OSError instead of the SystemError that h5py raises for some damaged files."""
    try:
        yield
    except SystemError as error:
        raise OSError("h5py failed inside the HDF5 library") from error


class WholeFile(h5py.File):
    """An open file without references to other files.

    Attributes
    ----------
    is_small : bool
        All values are numbers, with less than SMALL bytes in total.
    """

    is_small = False


@contextmanager
def opened_whole(path: str | Path) -> Iterator[WholeFile]:
    """Open an HDF5 file that contains all its values, for this block; soft links are followed.

    Parameters
    ----------
    path : str or Path

    Yields
    ------
    WholeFile

    Raises
    ------
    FormatError
        A pipe, a socket, a device, an external link, a virtual dataset, external storage, or more than MOST_OBJECTS
        objects.
    OSError
        HDF5 cannot open the file.
    """
    require_file(path)
    with _library_failures(), WholeFile(path, "r") as file:
        file.is_small = _declared(path, file) <= SMALL and not is_trusted()
        yield file


def _declared(path: str | Path, file: h5py.File) -> float:
    """Return the bytes of all datasets as float64, infinite where one has no numbers; refuse references to other files.

    One visit of the links: 0.02 ms per dataset.
    """
    left, size = MOST_OBJECTS, 0

    def refused(name, info):
        nonlocal left, size
        left -= 1
        if left < 0:
            return name, f"one of more than {MOST_OBJECTS} objects"
        if info.type == h5py.h5l.TYPE_EXTERNAL:
            kind = reason_not_followed(file.get(name, getlink=True), path) if is_trusted() else "an external link"
            return (name, kind) if kind else None
        if info.type != h5py.h5l.TYPE_HARD:
            return None if info.type == h5py.h5l.TYPE_SOFT else (name, "a link of a plugin")
        found = h5py.h5o.open(file.id, name)
        if not isinstance(found, h5py.h5d.DatasetID):
            return None
        size += _bytes_of(found)
        kind = reason_elsewhere(found, path)
        return (name, kind) if kind else None

    found = file.id.links.visit(refused, info=True)
    if found is not None:
        name = one_line(found[0].decode("utf-8", "replace"))[:80]
        raise FormatError(f"{path}: {name} is {found[1]}, expected values in the file itself; get such a file")
    return size


def _bytes_of(dataset: h5py.h5d.DatasetID) -> float:
    """Return the bytes of a dataset as float64 plus one chunk; infinite where it has no numbers."""
    kind, count = dataset.get_type(), math.prod(dataset.shape or ())
    if kind.get_class() not in (h5py.h5t.INTEGER, h5py.h5t.FLOAT):
        return math.inf
    if dataset.get_offset() is not None:
        return 8 * count
    layout = dataset.get_create_plist()
    chunked = layout.get_layout() == h5py.h5d.CHUNKED
    return 8 * count + (8 * math.prod(layout.get_chunk()) if chunked else 0)


def reason_elsewhere(dataset: h5py.h5d.DatasetID, path: str | Path) -> str:
    """Return the reason why the values of a dataset are in other files and not read; "" where they are read.

    They are read where they are in this file, or in existing files that the user trusts. HDF5 reads the fill value
    where the source of a virtual dataset is missing, and blocks on a pipe.

    Parameters
    ----------
    dataset : h5py.h5d.DatasetID
    path : str or Path
        Its file.
    """
    if dataset.get_offset() is not None:  # contiguous, in this file
        return ""
    layout = dataset.get_create_plist()
    if layout.get_layout() == h5py.h5d.VIRTUAL:
        names = (layout.get_virtual_filename(k) for k in range(layout.get_virtual_count()))
        return _not_read("a virtual dataset", path, names)
    names = (os.fsdecode(layout.get_external(k)[0]) for k in range(layout.get_external_count()))
    return _not_read("a dataset in external storage", path, names) if layout.get_external_count() else ""


def reason_not_followed(link: h5py.HardLink | h5py.SoftLink | h5py.ExternalLink, path: str | Path) -> str:
    """Return the reason why a link is not followed; "" where it is followed.

    Parameters
    ----------
    link : h5py.HardLink, h5py.SoftLink or h5py.ExternalLink
        From h5py with `getlink`.
    path : str or Path
        Its file.
    """
    if isinstance(link, h5py.HardLink):
        return ""
    return _not_read("an external link", path, [link.filename]) if isinstance(link, h5py.ExternalLink) else "a link"


def _not_read(kind: str, path: str | Path, names: Iterable[str]) -> str:
    """Return `kind` and why the files `names` that `path` refers to are not read; "" where they are read.

    "." is the file itself.
    """
    if not is_trusted():
        return kind
    for name in dict.fromkeys(names):
        place = Path(path) if name == "." else Path(path).parent / name
        if not place.is_file():
            lack = "not a regular file" if place.exists() else "missing"
            return f"{kind} of {one_line(name)[:120]}, which is {lack}"
    return ""


def require_memory(where: str, rows: int, bytes_each: float, *datasets: h5py.Dataset) -> None:
    """Refuse datasets that do not fit into the memory of this machine, before they are read.

    Parameters
    ----------
    where : str
        File and dataset, for the message.
    rows : int
    bytes_each : float [bytes]
        Per row, in all arrays that are created from it.
    *datasets : h5py.Dataset
        Datasets to read: one chunk of each is decompressed at a time.

    Raises
    ------
    FormatError
    """
    chunk = max((math.prod(some.chunks) * some.dtype.itemsize for some in datasets if some.chunks), default=0)
    if lack := memory_lack(max(rows * bytes_each, chunk)):
        raise FormatError(f"{where} of {rows:.6g} rows needs {lack}; it is damaged, or needs a larger machine")


def require_numbers_that_fit(path: str | Path, file: WholeFile, name: str) -> None:
    """Refuse a group whose datasets do not fit into memory or are not numbers.

    Text of variable length is refused: its size in memory is unknown.

    Parameters
    ----------
    path : str or Path
        For the message.
    file : WholeFile
    name : str
        Of the group.

    Raises
    ------
    FormatError
    """
    if file.is_small or name not in file:
        return
    datasets = {key: some for key, some in file[name].items() if isinstance(some, h5py.Dataset)}
    for key, some in datasets.items():
        if some.dtype.hasobject:
            raise FormatError(f"{path}: {name}/{one_line(key)} has type {some.dtype}, expected numbers")
    rows = max((some.shape[0] if some.shape else 1 for some in datasets.values() if some.size), default=0)
    size = sum(some.nbytes for some in datasets.values() if some.size)
    if rows:
        require_memory(f"{path}: {name}", rows, size / rows, *datasets.values())
