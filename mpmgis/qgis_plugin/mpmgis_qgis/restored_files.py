"""Write files of the toolbox atomically, and restore earlier ones if the command refuses the new ones."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def kept_unless(paths: tuple[str, ...], undoes: Callable[[BaseException], bool]) -> Iterator[None]:
    """Restore earlier files if the block that writes new ones fails.

    They are restored if the block raises an error for which `undoes(error)` is true, or cannot write. A new folder is
    removed if it is empty.

    Parameters
    ----------
    paths : tuple of str
        Files that the block writes, all in one folder.
    undoes : callable
        Called with an error; returns whether the files are restored.
    """
    folder = os.path.dirname(paths[0])
    made = not os.path.isdir(folder)
    before = {path: _read(path) for path in paths}
    try:
        os.makedirs(folder, exist_ok=True)
        yield
    except Exception as error:
        if not (isinstance(error, OSError) or undoes(error)):
            raise
        for path, data in before.items():
            if data is not None:
                write_whole(path, data)
            elif os.path.exists(path):
                os.remove(path)
        if made and not os.listdir(folder):
            os.rmdir(folder)
        raise


def write_whole(path: str, data: bytes) -> None:
    """Write a file atomically, through a temporary file in the same folder.

    Parameters
    ----------
    path : str
    data : bytes
    """
    with _part_of(path) as part, open(part, "wb") as file:
        file.write(data)


def copy_whole(source: str, path: str) -> None:
    """Copy a file atomically, through a temporary file in the same folder.

    Parameters
    ----------
    source, path : str
    """
    with _part_of(path) as part:
        shutil.copyfile(source, part)


@contextmanager
def _part_of(path):
    if os.path.islink(path):
        raise OSError(f"{path} is a link; links are not followed when writing")
    part = f"{path}.part{os.urandom(8).hex()}"  # a random name, so that no link can exist there
    try:
        yield part
        os.replace(part, path)
    finally:
        if os.path.exists(part):
            os.remove(part)


def _read(path):
    if not os.path.exists(path):
        return None
    with open(path, "rb") as file:
        return file.read()
