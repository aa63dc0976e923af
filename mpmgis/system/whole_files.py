"""Atomic output: a file or folder appears complete or not at all, and is replaced only with --overwrite."""

import errno
import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from . import operating_system
from .errors import MpmgisError, OutputError, has_control_characters
from .links import is_above, is_folder, real_place, refuse_link, remove, require_free, status
from .writer_process import PATTERN, new_token, this_process, written_by

_PROBE_SIZE = 1_000_000  # [bytes] if this does not fit, the disk is full
_LONGEST_NAME = 170  # [bytes] a token and suffixes added by libraries still fit into 255
_LONGEST_SUFFIX = 20  # [bytes] a longer one is no suffix that libraries know
MARK = ".mpmgis"  # file in every folder that `whole_folder` makes


def refuse_existing(path: str | Path, overwrite: bool) -> None:
    """Raise OutputError if `path` exists (a folder: and is not empty) and `overwrite` is false.

    Links, pipes and devices are always refused.

    Parameters
    ----------
    path : str or Path
    overwrite : bool

    Raises
    ------
    OutputError
    """
    if _is_filled(path) and not overwrite:
        raise OutputError(f"{path} exists already; give another -o, or --overwrite to replace it")


def refuse_other(path: str | Path, what: str) -> None:
    """Raise OutputError if `path` exists (a folder: and is not empty), because it has other content than expected.

    Parameters
    ----------
    path : str or Path
    what : str
        The expected content, for the message: "an ensemble".

    Raises
    ------
    OutputError
    """
    if _is_filled(path):
        raise OutputError(
            f"{path} exists and is not the folder of {what}, --overwrite will not remove it; give another -o"
        )


def _is_filled(path: str | Path) -> bool:
    """Return whether `path` exists (a folder: and is not empty); refuse a link."""
    path = Path(path)
    refuse_link(path)
    return path.exists() and not (path.is_dir() and not any(path.iterdir()))


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`; it is renamed to `path` when the block succeeds.

    On any error the temporary file is removed. The suffix is kept, because libraries read it. Temporary files of the
    same name that a killed process left are removed too. A link at `path` is refused.

    Parameters
    ----------
    path : str or Path
        Of the finished file; missing parent folders are created.

    Yields
    ------
    Path

    Raises
    ------
    OutputError
        It is a link or open in another program, the disk is full, or it cannot be written.
    """
    path = Path(path)
    refuse_link(path)
    require_free(path)
    _sweep(path, path.stem, path.suffix)
    part = _temporary_name(path, path.stem, "part", path.suffix)
    new_parents = _missing_parents(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with open(part, "r+b") as handle:
            operating_system.flush(handle.fileno())
        refuse_link(path)
        operating_system.replace(part, path)
    except BaseException as error:
        translated = _output_error(part, path, error)
        _remove(part, *new_parents)
        if translated is not None:
            raise translated from error
        raise


@contextmanager
def whole_folder(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """Yield a temporary folder next to `path`; it is renamed to `path` when the block succeeds.

    The folder contains the hidden file MARK. `overwrite` replaces only folders with this file, so that a mistyped -o
    cannot delete other documents. The old folder is removed after the new one is in place. Temporary folders of a
    killed process are removed; an old folder that it had moved away is restored first.

    Parameters
    ----------
    path : str or Path
        Of the finished folder; missing parent folders are created.
    overwrite : bool

    Yields
    ------
    Path

    Raises
    ------
    OutputError
        As `whole_file`, and where `path` exists and must not be replaced, or its name has control characters.
    """
    shown, path = path, real_place(path)
    _refuse_control(path.name)
    refuse_link(shown)
    _sweep(path, path.name)
    refuse_existing(shown, overwrite)
    _refuse_other_content(shown, path)
    require_free(path)
    part, old = _temporary_name(path, path.name, "part"), _temporary_name(path, path.name, "old")
    new_parents = _missing_parents(path)
    try:
        part.mkdir(parents=True)
        (part / MARK).touch()
        yield part
        refuse_existing(shown, overwrite)  # another process may have written it meanwhile
        if path.exists():
            operating_system.replace(path, old)
        operating_system.replace(part, path)
    except BaseException as error:
        translated = _output_error(part, shown, error)
        _remove(part, *new_parents)
        _restore(old, path)
        if translated is not None:
            raise translated from error
        raise
    remove(old)


def _refuse_control(name):
    """Refuse folder names that XML cannot store: QGIS projects and databases contain the name of their folder."""
    if has_control_characters(name):
        raise OutputError(f"{name!r} contains control characters or bytes that are not text; give another name with -o")


def _temporary_name(path: Path, stem: str, kind: str, suffix: str = "") -> Path:
    """Return a new temporary name of a `kind` ("part", "old") next to `path`, with the token of this process."""
    stem, suffix = _short(stem, suffix)
    return path.with_name(f".{stem}.{kind}{new_token()}{suffix}")


def _short(stem: str, suffix: str) -> tuple[str, str]:
    """Return `stem` and `suffix`, or a digest of `stem` where the temporary name would be too long."""
    if len(os.fsencode(stem + suffix)) <= _LONGEST_NAME:
        return stem, suffix
    suffix = suffix if len(os.fsencode(suffix)) <= _LONGEST_SUFFIX else ""
    return hashlib.sha256(os.fsencode(stem)).hexdigest()[:16], suffix


def _sweep(path: Path, stem: str, suffix: str = "") -> None:
    """Remove incomplete copies of `path` that ended processes left; restore folders that they had moved away.

    Copies that a process on another machine or in another container may still be writing are kept (`writer_process`).
    """
    stem, suffix = _short(stem, suffix)
    left = rf"\.{re.escape(stem)}\.(part|old)({PATTERN}){re.escape(suffix)}(-\w+)?"  # and SQLite's journal
    with suppress(OSError):
        for name in os.listdir(path.parent):
            found = re.fullmatch(left, name) if name.startswith(f".{stem}.") else None  # few need the slow comparison
            if found is None or not is_left_over(found[2]):
                continue
            if found[1] == "old":
                _restore(path.parent / name, path)
            remove(path.parent / name)


def is_left_over(token: str) -> bool:
    """Return whether the process that created the temporary file with this `token` has ended.

    This process counts as ended.

    Parameters
    ----------
    token : str
        `writer_process.new_token`.
    """
    writer = written_by(token)
    return writer is not None and (writer == this_process() or writer.is_over())


def _refuse_other_content(shown, path):
    """Raise OutputError where replacing `path` would remove files that mpmgis did not write."""
    if not path.exists():
        return
    if not path.is_dir():
        raise OutputError(f"{shown} is a file, expected a folder; give another -o")
    if is_above(path, Path.cwd()):
        raise OutputError(f"{shown} contains the current working folder and cannot be replaced; give another -o")
    if any(path.iterdir()) and status(path / MARK) is None:
        raise OutputError(f"{shown} was not written by mpmgis, --overwrite will not remove it; give another -o")


def _restore(old, path):
    """Restore the old folder if the new one is not in place."""
    if is_folder(old) and status(path) is None:
        operating_system.replace(old, path)


def output_error(path: str | Path, error: OSError) -> OutputError:
    """Return the OutputError for an OSError met while writing `path`.

    Parameters
    ----------
    path : str or Path
    error : OSError
    """
    if error.errno == errno.ENOSPC:
        return OutputError(f"{path}: the disk is full; free some space or give another -o")
    held = operating_system.held_open(path) if operating_system.is_held_open(error) else None
    if held is not None:
        return OutputError(f"{held} is open in another program, for example QGIS; close it there, or give another -o")
    if operating_system.is_held_open(error) and is_folder(path):
        return OutputError(
            f"{path}: no permission to replace it, or a terminal or file manager has it open; close it, or give "
            "another -o"
        )
    if error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
        return OutputError(f"{path}: no permission to write there; give another -o")
    return OutputError(f"{path}: cannot be written ({error.strerror or error})")


def _output_error(part: Path, shown: str | Path, error: BaseException) -> OutputError | None:
    """Return the OutputError that replaces `error` while writing `part` of `shown`; None where `error` can stay."""
    cause = _cause(part, error)
    if cause is not None:
        return output_error(shown, cause)
    if isinstance(error, OutputError) and str(part) in str(error):
        return OutputError(str(error).replace(str(part), str(shown)))
    return None


def _cause(part: Path, error: BaseException) -> OSError | None:
    """Return the OSError behind `error` while writing `part`; None where the cause is another one.

    Libraries report a full disk in different ways. A small test write detects it.
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


def _missing_parents(path: Path) -> list[Path]:
    """Return the parent folders of `path` that do not exist yet, innermost first."""
    return [parent for parent in path.parents if not parent.exists()]


def _remove(part, *new_parents):
    """Remove the temporary `part` and the empty folders that were created for it."""
    remove(part)
    for parent in new_parents:
        with suppress(OSError):
            parent.rmdir()
