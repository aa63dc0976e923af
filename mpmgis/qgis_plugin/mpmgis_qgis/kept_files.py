"""Files written whole, or restored if the work fails."""

import os
import shutil
from contextlib import contextmanager


@contextmanager
def kept_unless(paths, undoes):
    """A block that writes files at `paths`, all in one folder.

    If it raises an error for which `undoes(error)` is true, or cannot write, the earlier files are restored. A new
    folder is removed if it is empty.
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
    """Write the bytes `data` to `path` atomically, through a temporary file in the same folder."""
    with _part_of(path) as part, open(part, "wb") as file:
        file.write(data)


def copy_whole(source, path):
    """Copy the file `source` to `path` in the same way."""
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
