"""Files that appear whole or not at all, and never on top of another one unasked."""

import errno
import hashlib
import os
import re
import unicodedata
from contextlib import contextmanager, suppress
from pathlib import Path

from .. import system
from ..errors import MpmgisError, OutputError
from .links import is_above, is_folder, real_place, refuse_link, remove, require_free, status
from .lock import PATTERN, new_token, this_process, written_by

_PROBE_SIZE = 1_000_000  # [bytes] where so little does not fit, the disk is full
_LONGEST_NAME, _LONGEST_SUFFIX = 170, 20  # [bytes] beside which a token and what libraries add fit into 255
MARK = ".mpmgis"  # in every folder that `whole_folder` made


def refuse_existing(path, overwrite):
    """Raise OutputError if `path` exists (a folder: and is not empty) and `overwrite` was not asked for.

    A link there is refused in any case, and so is a pipe or a device.
    """
    path = Path(path)
    refuse_link(path)
    if overwrite or not path.exists():
        return
    if path.is_dir() and not any(path.iterdir()):
        return
    raise OutputError(f"{path} exists already; give another -o, or --overwrite to replace it")


@contextmanager
def whole_file(path):
    """Gives a temporary path beside `path` to write to; it takes the final name when the block ends well.

    On any error the temporary file is removed and nothing appears. The suffix is kept, because libraries look at it.
    What a process that was killed left of the same file goes too. A link at `path` is refused.
    """
    path = Path(path)
    refuse_link(path)
    require_free(path)
    _sweep(path, path.stem, path.suffix)
    part = _beside(path, path.stem, "part", path.suffix)
    new_parents = _missing_parents(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with open(part, "r+b") as handle:
            system.flush(handle.fileno())
        refuse_link(path)
        system.replace(part, path)
    except BaseException as error:
        told = _told(part, path, error)
        _remove(part, *new_parents)
        if told is not None:
            raise told from error
        raise


@contextmanager
def whole_folder(path, overwrite=False):
    """As `whole_file` for a folder: filled under a temporary name, renamed when whole, `path` replaced if asked.

    The folder carries the hidden file MARK. `overwrite` replaces only folders that carry it, so that a mistyped -o
    cannot cost anybody their documents; the old folder goes when the new one is in its place, not before. What a
    process that was killed left goes too; an old folder that it had put aside comes back first.
    """
    shown, path = path, real_place(path)
    _refuse_control(path.name)
    refuse_link(shown)
    _sweep(path, path.name)
    refuse_existing(shown, overwrite)
    _refuse_foreign(shown, path)
    require_free(path)
    part, old = _beside(path, path.name, "part"), _beside(path, path.name, "old")
    new_parents = _missing_parents(path)
    try:
        part.mkdir(parents=True)
        (part / MARK).touch()
        yield part
        refuse_existing(shown, overwrite)  # another process may have been quicker
        if path.exists():
            system.replace(path, old)
        system.replace(part, path)
    except BaseException as error:
        told = _told(part, shown, error)
        _remove(part, *new_parents)
        _restore(old, path)
        if told is not None:
            raise told from error
        raise
    remove(old)


def _refuse_control(name):
    """Refuse names of folders that no XML can hold: QGIS projects and databases name the folder that they lie in."""
    if any(unicodedata.category(letter) in ("Cc", "Cs") for letter in name):
        raise OutputError(f"{name!r} holds control characters or bytes that are no text; give another name by -o")


def _beside(path, stem, kind, suffix=""):
    """A new temporary name of that `kind` ("part", "old") beside `path`, which tells who gave it."""
    stem, suffix = _short(stem, suffix)
    return path.with_name(f".{stem}.{kind}{new_token()}{suffix}")


def _short(stem, suffix):
    """`stem` and `suffix` as they are, or where a temporary name would be longer than a name may be, a digest."""
    if len(os.fsencode(stem + suffix)) <= _LONGEST_NAME:
        return stem, suffix
    suffix = suffix if len(os.fsencode(suffix)) <= _LONGEST_SUFFIX else ""
    return hashlib.sha256(os.fsencode(stem)).hexdigest()[:16], suffix


def _sweep(path, stem, suffix=""):
    """Remove what processes that are no more left half done of `path`; bring back what they had put aside.

    What a process on another machine or in another container may still be writing stays (`io.lock`).
    """
    stem, suffix = _short(stem, suffix)
    left = re.compile(rf"\.{re.escape(stem)}\.(part|old)({PATTERN}){re.escape(suffix)}(-\w+)?")  # and SQLite's journal
    with suppress(OSError):
        for name in os.listdir(path.parent):
            found = left.fullmatch(name)
            if found is None or not is_left_over(found[2]):
                continue
            if found[1] == "old":
                _restore(path.parent / name, path)
            remove(path.parent / name)


def is_left_over(token):
    """Whether the process that gave a temporary file this `token` is over; this one counts as over."""
    writer = written_by(token)
    return writer is not None and (writer == this_process() or writer.is_over())


def _refuse_foreign(shown, path):
    """Raise OutputError where replacing `path` would take away what mpmgis did not write."""
    if not path.exists():
        return
    if not path.is_dir():
        raise OutputError(f"{shown} is a file, wanted a folder; give another -o")
    if is_above(path, Path.cwd()):
        raise OutputError(f"{shown} holds the folder you are in and cannot be replaced; give -o a folder of its own")
    if any(path.iterdir()) and status(path / MARK) is None:
        raise OutputError(f"{shown} was not written by mpmgis, --overwrite will not remove it; give another -o")


def _restore(old, path):
    """Put the old folder back where it was, if the new one did not get there."""
    if is_folder(old) and status(path) is None:
        system.replace(old, path)


def output_error(path, error):
    """The OutputError for an OSError met while writing `path`."""
    if error.errno == errno.ENOSPC:
        return OutputError(f"{path}: the disk is full; free some space or give another -o")
    held = system.held_open(path) if system.is_held_open(error) else None
    if held is not None:
        return OutputError(f"{held} is open in another program, for example QGIS; close it there, or give another -o")
    if system.is_held_open(error) and is_folder(path):
        return OutputError(
            f"{path}: no permission to replace it, or a terminal or file manager stands in it; leave it there, or give "
            "another -o"
        )
    if error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
        return OutputError(f"{path}: no permission to write there; give another -o")
    return OutputError(f"{path}: cannot be written ({error.strerror or error})")


def _told(part, shown, error):
    """The OutputError in place of `error`, met while writing `part` of `shown`; None where `error` is good as it is."""
    cause = _cause(part, error)
    if cause is not None:
        return output_error(shown, cause)
    if isinstance(error, OutputError) and str(part) in str(error):
        return OutputError(str(error).replace(str(part), str(shown)))
    return None


def _cause(part, error):
    """The OSError that `error` is, or that it comes from, met while writing `part`; None where it is of another kind.

    Libraries have their own words and kinds for a disk that is full. Whether it is shows when a little is written.
    """
    ours = isinstance(error, MpmgisError) and str(part) not in str(error)
    if ours or not isinstance(error, Exception):
        return None
    if isinstance(error, OSError) and error.errno is not None:
        return error
    probe = part.with_name(f"{part.name}.probe")
    try:
        with open(probe, "xb", buffering=0) as handle:
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
    remove(part)
    for parent in new_parents:
        with suppress(OSError):
            parent.rmdir()
