"""Files that appear whole or not at all, and never on top of another one unasked."""

import errno
import os
import shutil
from contextlib import contextmanager
from pathlib import Path

from ..errors import OutputError


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
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with open(part, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(part, path)
    except OSError as error:
        _remove(part)
        raise output_error(path, error) from error
    except BaseException:
        _remove(part)
        raise


@contextmanager
def whole_folder(path, overwrite=False):
    """As `whole_file` for a folder: filled under a temporary name, renamed when whole, `path` replaced if asked."""
    path = Path(path)
    refuse_existing(path, overwrite)
    part = path.with_name(f".{path.name}.part{os.getpid()}")
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        yield part
        if path.exists():
            shutil.rmtree(path)
        os.replace(part, path)
    except OSError as error:
        _remove(part)
        raise output_error(path, error) from error
    except BaseException:
        _remove(part)
        raise


def output_error(path, error):
    """The OutputError for an OSError met while writing `path`."""
    if error.errno == errno.ENOSPC:
        return OutputError(f"{path}: the disk is full; free some space or give another -o")
    if error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
        return OutputError(f"{path}: no permission to write there; give another -o")
    return OutputError(f"{path}: cannot be written ({error.strerror or error})")


def _remove(path):
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
