"""Files that the user trusts (`--trust`), and the refusal of what is no regular file."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from .errors import FormatError

_trusted = ContextVar("mpmgis_trusted", default=False)


@contextmanager
def trusting(trust: bool = True) -> Iterator[None]:
    """Within this block, where `trust` is true, files may refer to other files and to the network.

    This holds for the threads of a FramePool that start within the block, not for other processes. `gdal_input` and
    `hdf5` decide which references are followed.
    """
    token = _trusted.set(bool(trust))
    try:
        yield
    finally:
        _trusted.reset(token)


def is_trusted() -> bool:
    """Whether files may refer to other files and to the network now; false unless the user gives `--trust`."""
    return _trusted.get()


def require_file(path):
    """Refuse a pipe, a socket, a device or a folder; the caller reports missing files.

    Raises
    ------
    FormatError
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FormatError(f"{path} is a {'folder' if path.is_dir() else 'device or pipe'}, expected a file")


def require_file_or_folder(path):
    """As `require_file`, folders are accepted too.

    Raises
    ------
    FormatError
    """
    if not Path(path).is_dir():
        require_file(path)
