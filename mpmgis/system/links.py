"""Links, and the real places of files and folders."""

import errno
import os
import shutil
import stat
from contextlib import suppress
from pathlib import Path

from . import operating_system
from .errors import OutputError

_JUNCTIONS = (0xA000000C, 0xA0000003)  # reparse tags of Windows' symbolic links and mount points


def status(path):
    """os.lstat of `path` (of a link, not of its target); None where nothing exists."""
    try:
        return os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None


def is_link(found):
    """Whether a `status` is that of a link or a Windows junction."""
    if found is None:
        return False
    return stat.S_ISLNK(found.st_mode) or getattr(found, "st_reparse_tag", 0) in _JUNCTIONS


def is_folder(path):
    """Whether `path` is a folder and not a link to one."""
    found = status(path)
    return found is not None and stat.S_ISDIR(found.st_mode) and not is_link(found)


def refuse_link(path):
    """Raise OutputError unless `path` is a regular file, a folder or nothing.

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


def refuse_links(folder, patterns=("*",)):
    """As `refuse_link` for `folder` and all entries in it, hidden ones too, that match one of the `patterns`."""
    folder = Path(folder)
    refuse_link(folder)
    if not is_folder(folder):
        return
    for entry in sorted(folder.iterdir()):
        if any(entry.match(pattern) for pattern in patterns):
            refuse_link(entry)


def real_place(path):
    """`path` with all links in its parents resolved; the last name itself may be a link."""
    path = Path(path)
    if path.name in ("", ".."):
        return Path(os.path.realpath(path))
    return Path(os.path.realpath(path.parent)) / path.name


def open_own(path):
    """Descriptor of the regular file `path` for reading and writing, created if missing.

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


def require_free(path, still="nothing has changed"):
    """Raise OutputError where a program has a file at `path`, or in the folder `path`, open.

    Only Windows prevents the replacement of open files. `still` describes the unchanged state, for the message.

    Raises
    ------
    OutputError
    """
    held = operating_system.held_open(path)
    if held is not None:
        raise OutputError(
            f"{held} is open in another program, for example QGIS; {still}; close it there, or give another -o"
        )


def is_above(path, folder):
    """Whether `folder` is `path` or inside it, under any name."""
    for place in (folder, *folder.parents):
        with suppress(OSError):
            if os.path.samefile(place, path):
                return True
    return False


def remove(path):
    """Remove `path`: a file, a folder with its content, or a link but not its target."""
    if is_folder(path):
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            os.unlink(path)


def within(folder, inputs):
    """The first of the paths `inputs` that is in `folder` or its subfolders, under any name; None where none is."""
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


def one_of(path, inputs):
    """The first of the paths `inputs` that is the same file as `path`, under any name; None where none is."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    for other in inputs:
        with suppress(OSError):
            if os.path.samestat(found, os.stat(other)):
                return other
    return None
