"""Files that appear whole or not at all, and never on top of another one unasked."""

import errno
import os
import re
import shutil
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import OutputError

MARK = ".mpmgis"  # in every folder that `whole_folder` made


def refuse_existing(path, overwrite):
    """Raise OutputError if `path` exists (a folder: and is not empty) and `overwrite` was not asked for."""
    path = Path(path)
    if overwrite or not path.exists():
        return
    if path.is_dir() and not any(path.iterdir()):
        return
    raise OutputError(f"{path} exists already; give another -o, or --overwrite to replace it")


@contextmanager
def whole_file(path):
    """Gives a temporary path beside `path` to write to; it takes the final name when the block ends well.

    On any error the temporary file is removed and nothing appears. The suffix is kept, because libraries look at it.
    """
    path = Path(path)
    part = path.with_name(f".{path.stem}.part{os.getpid()}{path.suffix}")
    new_parents = _missing_parents(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with open(part, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(part, path)
    except OSError as error:
        _remove(part, *new_parents)
        raise output_error(path, error) from error
    except RuntimeError as error:
        _remove(part, *new_parents)
        number = re.search(r"errno = (\d+)", str(error))  # as h5py tells of trouble when it closes a file
        if number is None:
            raise
        raise output_error(path, OSError(int(number[1]), os.strerror(int(number[1])))) from error
    except BaseException:
        _remove(part, *new_parents)
        raise


@contextmanager
def whole_folder(path, overwrite=False):
    """As `whole_file` for a folder: filled under a temporary name, renamed when whole, `path` replaced if asked.

    The folder carries the hidden file MARK. `overwrite` replaces only folders that carry it, so that a mistyped -o
    cannot cost anybody their documents; the old folder goes when the new one is in its place, not before.
    """
    refuse_existing(path, overwrite)
    shown, path = path, Path(os.path.abspath(path))
    _refuse_foreign(shown, path)
    part = path.with_name(f".{path.name}.part{os.getpid()}")
    old = path.with_name(f".{path.name}.old{os.getpid()}")
    new_parents = _missing_parents(path)
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        (part / MARK).touch()
        yield part
        if path.exists():
            os.replace(path, old)
        os.replace(part, path)
    except OSError as error:
        _remove(part, *new_parents)
        _restore(old, path)
        raise output_error(shown, error) from error
    except BaseException:
        _remove(part, *new_parents)
        _restore(old, path)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _refuse_foreign(shown, path):
    """Raise OutputError where replacing `path` would take away what mpmgis did not write."""
    if not path.exists():
        return
    if not path.is_dir():
        raise OutputError(f"{shown} is a file, wanted a folder; give another -o")
    if Path.cwd().is_relative_to(path):
        raise OutputError(f"{shown} holds the folder you are in and cannot be replaced; give -o a folder of its own")
    if any(path.iterdir()) and not (path / MARK).exists():
        raise OutputError(f"{shown} was not written by mpmgis, --overwrite will not remove it; give another -o")


def _restore(old, path):
    """Put the old folder back where it was, if the new one did not get there."""
    if old.exists() and not path.exists():
        os.replace(old, path)


def output_error(path, error):
    """The OutputError for an OSError met while writing `path`."""
    if error.errno == errno.ENOSPC:
        return OutputError(f"{path}: the disk is full; free some space or give another -o")
    if error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
        return OutputError(f"{path}: no permission to write there; give another -o")
    return OutputError(f"{path}: cannot be written ({error.strerror or error})")


def _missing_parents(path):
    """Folders above `path` that are still to be made, innermost first."""
    return [parent for parent in path.parents if not parent.exists()]


def _remove(part, *new_parents):
    """Remove the temporary `part`, and the folders made for it that are empty."""
    if part.is_dir():
        shutil.rmtree(part, ignore_errors=True)
    with suppress(OSError):
        part.unlink(missing_ok=True)
    for parent in new_parents:
        with suppress(OSError):
            parent.rmdir()
