"""Zip archives of unknown origin: refused where they are damaged or larger than the free memory."""

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import FormatError, one_line
from .memory import memory_lack
from .trusted_files import require_file

MAGIC = b"PK\x03\x04"  # first bytes of an archive
MOST_MEMBERS = 100_000  # far more than any format needs; the list of members is read into memory
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # other methods decompress without a limit
DAMAGE = (zipfile.BadZipFile, EOFError, zlib.error, OSError, NotImplementedError, KeyError, ValueError, RuntimeError)


@contextmanager
def opened_zip(path: str | Path, kind: str) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive for this block.

    Parameters
    ----------
    path : str or Path
    kind : str
        Type of the file, for messages.

    Yields
    ------
    zipfile.ZipFile

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


def members(path: str | Path) -> list[str]:
    """Return the names of the files in a zip archive; [] for other files.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        Damaged, or more than MOST_MEMBERS.
    """
    if not is_zip(path):
        return []
    with opened_zip(path, "zip archive") as archive:
        return [member.filename for member in archive.infolist() if not member.is_dir()]


def is_zip(path: str | Path) -> bool:
    """Return whether a file begins as a zip archive.

    Parameters
    ----------
    path : str or Path
    """
    path = Path(path)
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def head_of(path: str | Path, name: str, size: int) -> bytes:
    """Return the first `size` bytes of a member of a zip archive; b"" for one that is not there.

    Parameters
    ----------
    path : str or Path
    name : str
    size : int [bytes]

    Raises
    ------
    FormatError
        Damaged.
    """
    with opened_zip(path, "zip archive") as archive:
        if name not in archive.namelist():
            return b""
        with archive.open(name) as file:
            return file.read(size)


def require_unpacked(where: str, size: int, most: float) -> None:
    """Refuse a member whose declared uncompressed size is too large; zipfile decompresses no more than that.

    Parameters
    ----------
    where : str
        Archive and member, for the message.
    size : int [bytes]
    most : float [bytes]

    Raises
    ------
    FormatError
    """
    if size > most:
        raise FormatError(
            f"{where} has {size / 1e6:.0f} MB uncompressed, expected at most {most / 1e6:.0f} MB; it is damaged"
        )


def require_zip_fits(path: str | Path) -> None:
    """Refuse a zip archive larger than the free memory, before a library decompresses it.

    Parameters
    ----------
    path : str or Path
        Any file; other files than zip archives are accepted.

    Raises
    ------
    FormatError
    """
    if not is_zip(path):
        return
    with opened_zip(path, "zip archive") as archive:
        require_unpacked_fits(path, sum(member.file_size for member in archive.infolist()))


def require_unpacked_fits(where: str | Path, size: int) -> None:
    """Refuse members that need more than the free memory uncompressed.

    Parameters
    ----------
    where : str or Path
        For the message.
    size : int [bytes]

    Raises
    ------
    FormatError
    """
    if lack := memory_lack(size):
        raise FormatError(f"{where} uncompressed needs {lack}; it is damaged, or needs a larger machine")
