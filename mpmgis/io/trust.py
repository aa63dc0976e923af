"""Whether files from others may lead to other files and to the network: no, unless the user says `--trust`.

What a file may lead to is decided in `gdal_input` and `hdf5_input` alone; they ask here. The word holds for a block of
code and for what is started within it in the threads of a FramePool, not for other processes.
"""

from contextlib import contextmanager
from contextvars import ContextVar

_trusted = ContextVar("mpmgis_trusted", default=False)


@contextmanager
def trusting(trust=True):
    """Follow within this block, where `trust` is true, what scenes, frames and other files name."""
    token = _trusted.set(bool(trust))
    try:
        yield
    finally:
        _trusted.reset(token)


def is_trusted():
    """Whether files from others may lead elsewhere now."""
    return _trusted.get()
