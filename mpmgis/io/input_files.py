"""Input files of unknown origin: trust (`--trust`), no pipes or devices, zip archives within the free memory."""

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from ..errors import FormatError, one_line
from ..machine import memory_lack

_trusted = ContextVar("mpmgis_trusted", default=False)


@contextmanager
def trusting(trust: bool = True) -> Iterator[None]:
    """Within this block, where `trust` is true, files may refer to other files and to the network.

    This holds for the threads of a FramePool that start within the block, not for other processes. `gdal_input` and
    `hdf5` decide which references are followed.
    """
    token = _trusted.set(bool(trust))
    try:
        yield
    finally:
        _trusted.reset(token)


def is_trusted() -> bool:
    """Whether files may refer to other files and to the network now; false unless the user gives `--trust`."""
    return _trusted.get()


def require_file(path):
    """Refuse a pipe, a socket, a device or a folder; the caller reports missing files.

    Raises
    ------
    FormatError
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FormatError(f"{path} is a {'folder' if path.is_dir() else 'device or pipe'}, expected a file")


def require_file_or_folder(path):
    """As `require_file`, folders are accepted too.

    Raises
    ------
    FormatError
    """
    if not Path(path).is_dir():
        require_file(path)


MAGIC = b"PK\x03\x04"
MOST_MEMBERS = 100_000
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # other methods decompress without a limit
DAMAGE = (zipfile.BadZipFile, EOFError, zlib.error, OSError, NotImplementedError, KeyError, ValueError, RuntimeError)


@contextmanager
def opened_zip(path, kind):
    """The zipfile.ZipFile at `path` for this block; `kind` is the type of file for messages.

    Raises
    ------
    FormatError
        A pipe, no archive, damaged, too many members, another compression than deflate.
    """
    require_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) > MOST_MEMBERS:
                raise FormatError(
                    f"{path} holds {len(members)} files, expected at most {MOST_MEMBERS}; it is not a {kind}"
                )
            other = next((member for member in members if member.compress_type not in METHODS), None)
            if other is not None:
                name = one_line(other.filename)[:80]
                raise FormatError(f"{path}: {name} is not compressed by deflate, as a {kind} is; compress it again")
            yield archive
    except DAMAGE as error:
        raise FormatError(f"{path} is not a readable {kind} ({one_line(error)[:100]}); it is damaged") from error


def require_unpacked(where, size, most):
    """Refuse a declared uncompressed `size` [bytes] of a member above `most`; zipfile decompresses no more than that.

    Raises
    ------
    FormatError
    """
    if size > most:
        raise FormatError(
            f"{where} has {size / 1e6:.0f} MB uncompressed, expected at most {most / 1e6:.0f} MB; it is damaged"
        )


def require_zip_fits(path):
    """Refuse a zip archive larger than the free memory, before a library decompresses it.

    Raises
    ------
    FormatError
    """
    with open(path, "rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return
    with opened_zip(path, "zip archive") as archive:
        require_unpacked_fits(path, sum(member.file_size for member in archive.infolist()))


def require_unpacked_fits(where, size):
    """Refuse members that need more than the free memory uncompressed: `size` [bytes].

    Raises
    ------
    FormatError
    """
    if lack := memory_lack(size):
        raise FormatError(f"{where} uncompressed needs {lack}; it is damaged, or needs a larger machine")
