"""Files that appear whole or not at all, and never on top of another one unasked."""

import errno
import os
import re
import shutil
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import MpmgisError, OutputError

_PROBE_SIZE = 1_000_000  # [bytes] where so little does not fit, the disk is full
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
    What a process that was killed left of the same file goes too.
    """
    path = Path(path)
    _sweep(path, path.stem, path.suffix)
    part = path.with_name(f".{path.stem}.part{os.getpid()}{path.suffix}")
    new_parents = _missing_parents(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with open(part, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(part, path)
    except BaseException as error:
        cause = _cause(part, error)
        _remove(part, *new_parents)
        if cause is not None:
            raise output_error(path, cause) from error
        raise


@contextmanager
def whole_folder(path, overwrite=False):
    """As `whole_file` for a folder: filled under a temporary name, renamed when whole, `path` replaced if asked.

    The folder carries the hidden file MARK. `overwrite` replaces only folders that carry it, so that a mistyped -o
    cannot cost anybody their documents; the old folder goes when the new one is in its place, not before. What a
    process that was killed left goes too; an old folder that it had put aside comes back first.
    """
    shown, path = path, Path(os.path.abspath(path))
    _sweep(path, path.name)
    refuse_existing(shown, overwrite)
    _refuse_foreign(shown, path)
    part = path.with_name(f".{path.name}.part{os.getpid()}")
    old = path.with_name(f".{path.name}.old{os.getpid()}")
    new_parents = _missing_parents(path)
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        (part / MARK).touch()
        yield part
        refuse_existing(shown, overwrite)  # another process may have been quicker
        if path.exists():
            os.replace(path, old)
        os.replace(part, path)
    except BaseException as error:
        cause = _cause(part, error)
        _remove(part, *new_parents)
        _restore(old, path)
        if cause is not None:
            raise output_error(shown, cause) from error
        raise
    shutil.rmtree(old, ignore_errors=True)


def _sweep(path, stem, suffix=""):
    """Remove what processes that are no more left half done of `path`; bring back what they had put aside."""
    if os.name != "posix":  # elsewhere a process cannot be asked whether it is alive
        return
    left = re.compile(rf"\.{re.escape(stem)}\.(part|old)(\d+){re.escape(suffix)}(-\w+)?")  # and SQLite's journal
    with suppress(OSError):
        for name in os.listdir(path.parent):
            found = left.fullmatch(name)
            if found is None or _is_alive(int(found[2])):
                continue
            if found[1] == "old":
                _restore(path.parent / name, path)
            _remove(path.parent / name)


def _is_alive(number):
    """Whether the process of that number runs on this machine; this one itself counts as over with what it left."""
    try:
        os.kill(number, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return number != os.getpid()


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


def _cause(part, error):
    """The OSError that `error` is, or that it comes from, met while writing `part`; None where it is of another kind.

    Libraries have their own words and kinds for a disk that is full. Whether it is shows when a little is written.
    """
    if isinstance(error, MpmgisError) or not isinstance(error, Exception):
        return None
    if isinstance(error, OSError) and error.errno is not None:
        return error
    probe = part.with_name(f"{part.name}.probe")
    try:
        with open(probe, "wb", buffering=0) as handle:
            rest = bytes(_PROBE_SIZE)
            while rest:
                rest = rest[handle.write(rest) :]
    except OSError as trouble:
        return trouble
    finally:
        _remove(probe)
    return error if isinstance(error, OSError) else None


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
