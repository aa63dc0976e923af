"""Files that the user trusts (`--trust`), and the refusal of pipes and devices."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from .errors import FormatError

_trusted = ContextVar("mpmgis_trusted", default=False)


@contextmanager
def trusting(trust: bool = True) -> Iterator[None]:
    """Allow files to refer to other files and to the network within this block.

    This holds for the threads of a FramePool that start within the block, not for other processes. The modules
    `file_references` and `hdf5_reading` decide which references are followed.

    Parameters
    ----------
    trust : bool
        False refuses these references.
    """
    token = _trusted.set(bool(trust))
    try:
        yield
    finally:
        _trusted.reset(token)


def is_trusted() -> bool:
    """Return whether files may refer to other files and to the network now; false unless the user gives `--trust`."""
    return _trusted.get()


def require_file(path: str | Path) -> None:
    """Refuse a pipe, a socket, a device or a folder; the caller reports missing files.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FormatError(f"{path} is a {'folder' if path.is_dir() else 'device or pipe'}, expected a file")


def require_file_or_folder(path: str | Path) -> None:
    """Refuse a pipe, a socket or a device; the caller reports missing files.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
    """
    if not Path(path).is_dir():
        require_file(path)
