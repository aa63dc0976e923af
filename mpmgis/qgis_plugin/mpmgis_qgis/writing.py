"""Files that the toolbox writes itself: whole or not at all, and back as they were where the command refuses them."""

from __future__ import annotations

import os
import shutil
from contextlib import contextmanager


@contextmanager
def kept_unless(paths, undoes):
    """Within this block files may be written at `paths`, all in one folder.

    Where it raises what `undoes(error)`, or cannot write, they are as they were before. A folder that was made for them
    goes too if nothing else is in it.
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


def write_whole(path, data):
    """Write the bytes `data` to `path`, by a file beside it that takes its place when it is whole."""
    with _beside(path) as part, open(part, "wb") as file:
        file.write(data)


def copy_whole(source, path):
    """Copy the file `source` to `path` in the same way."""
    with _beside(path) as part:
        shutil.copyfile(source, part)


@contextmanager
def _beside(path):
    if os.path.islink(path):
        raise OSError(f"{path} is a link, and links are not followed where something is written")
    part = f"{path}.part{os.urandom(8).hex()}"  # a name that nobody has put a link under
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
