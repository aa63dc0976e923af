"""Links, which are never followed when output is written, and the real places of files and folders.

A folder from another person may contain links, hard links, pipes and devices under the names that this program uses.
All functions that write or remove files in an output folder check with this module first.
"""

import errno
import os
import shutil
import stat
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from . import operating_system
from .errors import OutputError

_JUNCTIONS = (0xA000000C, 0xA0000003)  # reparse tags of Windows' symbolic links and mount points


def status(path: str | Path) -> os.stat_result | None:
    """Return `os.lstat` of a path (of a link, not of its target); None where nothing exists.

    Parameters
    ----------
    path : str or Path
    """
    try:
        return os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None


def is_link(found: os.stat_result | None) -> bool:
    """Return whether a `status` is that of a link or a Windows junction.

    Parameters
    ----------
    found : os.stat_result or None
    """
    if found is None:
        return False
    return stat.S_ISLNK(found.st_mode) or getattr(found, "st_reparse_tag", 0) in _JUNCTIONS


def is_folder(path: str | Path) -> bool:
    """Return whether `path` is a folder and not a link to one.

    Parameters
    ----------
    path : str or Path
    """
    found = status(path)
    return found is not None and stat.S_ISDIR(found.st_mode) and not is_link(found)


def refuse_link(path: str | Path) -> None:
    """Raise OutputError unless `path` is a regular file, a folder or nothing.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    OutputError
        A link, also a broken one; a pipe, a socket, a device; a name that is invalid on this system.
    """
    wrong = operating_system.wrong_name(path)
    if wrong:
        raise OutputError(f"{path}: {wrong}; give another -o")
    found = status(path)
    if found is None:
        return
    if is_link(found):
        raise OutputError(f"{path} is a link, and output is never written through links; remove it, or give another -o")
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OutputError(f"{path} is a pipe, a socket or a device, expected a file; remove it, or give another -o")


def refuse_links(folder: str | Path, patterns: Iterable[str] = ("*",)) -> None:
    """Raise OutputError unless a folder and its entries, hidden ones too, are regular files or folders.

    Parameters
    ----------
    folder : str or Path
    patterns : iterable of str
        Only entries that match one of these are checked.

    Raises
    ------
    OutputError
        As `refuse_link`.
    """
    folder = Path(folder)
    refuse_link(folder)
    if not is_folder(folder):
        return
    for entry in sorted(folder.iterdir()):
        if any(entry.match(pattern) for pattern in patterns):
            refuse_link(entry)


def real_place(path: str | Path) -> Path:
    """Return `path` with all links in its parents resolved; the last name itself may be a link.

    Parameters
    ----------
    path : str or Path
    """
    path = Path(path)
    if path.name in ("", ".."):
        return Path(os.path.realpath(path))
    return Path(os.path.realpath(path.parent)) / path.name


def open_own(path: str | Path) -> int:
    """Open a regular file for reading and writing, created if missing, and return its descriptor.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    OutputError
        A link, a folder, a pipe, a device, or a file with further hard links.
    """
    refuse_link(path)
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | operating_system.own_flags(), 0o666)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR) or is_folder(path):  # Windows: no permission
            raise OutputError(f"{path} is not a regular file; remove it, or give another -o") from error
        raise
    found = os.fstat(handle)
    followed = operating_system.follows_links() and is_link(status(path))  # a link created since the check above
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1 or followed:
        os.close(handle)
        raise OutputError(f"{path} is another name (hard link) of a file; remove it, or give another -o")
    return handle


def require_free(path: str | Path, still: str = "nothing has changed") -> None:
    """Raise OutputError where a program has a file at `path`, or in the folder `path`, open.

    Only Windows prevents the replacement of open files.

    Parameters
    ----------
    path : str or Path
    still : str
        The unchanged state, for the message.

    Raises
    ------
    OutputError
    """
    held = operating_system.held_open(path)
    if held is not None:
        raise OutputError(
            f"{held} is open in another program, for example QGIS; {still}; close it there, or give another -o"
        )


def is_above(path: Path, folder: Path) -> bool:
    """Return whether `folder` is `path` or inside it, under any name.

    Parameters
    ----------
    path, folder : Path
    """
    for place in (folder, *folder.parents):
        with suppress(OSError):
            if os.path.samefile(place, path):
                return True
    return False


def remove(path: str | Path) -> None:
    """Remove a file, a folder with its content, or a link but not its target.

    Parameters
    ----------
    path : str or Path
    """
    if is_folder(path):
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            os.unlink(path)


def input_inside(folder: str | Path, inputs: Iterable[str | Path]) -> str | Path | None:
    """Find the first input file that is in `folder` or its subfolders, under any name.

    Parameters
    ----------
    folder : str or Path
    inputs : iterable of str or Path

    Returns
    -------
    str, Path or None
        The path of `inputs`; None where none is there.
    """
    if not is_folder(folder):
        return None
    known = {}
    for given in inputs:
        with suppress(OSError):
            found = os.stat(given)
            known.setdefault((found.st_dev, found.st_ino), given)
    for place, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                found = os.stat(os.path.join(place, name))
                if (found.st_dev, found.st_ino) in known:
                    return known[found.st_dev, found.st_ino]
    return None


def input_at(path: str | Path, inputs: Iterable[str | Path]) -> str | Path | None:
    """Find the first input file that is the same file as `path`, under any name.

    Parameters
    ----------
    path : str or Path
    inputs : iterable of str or Path

    Returns
    -------
    str, Path or None
        The path of `inputs`; None where none is the same file.
    """
    try:
        found = os.stat(path)
    except OSError:
        return None
    for other in inputs:
        with suppress(OSError):
            if os.path.samestat(found, os.stat(other)):
                return other
    return None
