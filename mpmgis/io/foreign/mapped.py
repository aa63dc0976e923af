"""A file's bytes without reading them all: mapped into memory while they are looked at."""

import mmap
from contextlib import contextmanager

from ...errors import FormatError, one_line
from .file import require_readable


@contextmanager
def mapped(path):
    """The bytes of the file at `path` as a read-only mmap; what is taken of it must be copied.

    Raises
    ------
    FormatError
        Missing, empty, or not to be opened.
    """
    require_readable(path)
    with open(path, "rb") as file:
        try:
            content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise FormatError(f"{path}: {one_line(error)}") from error
        with content:
            yield content
