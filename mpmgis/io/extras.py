"""Libraries that few need and that `pip install mpmgis` leaves out: Arrow for Parquet, Dask's clusters."""

from contextlib import contextmanager

from ..errors import InputError, one_line

LIBRARIES = {  # extra of pyproject.toml: what it installs
    "parquet": "pyarrow",
    "cluster": "dask[distributed]",
    "animation": "imageio[ffmpeg]",
    "pointcloud": "laspy",
}


@contextmanager
def needed_for(what, extra):
    """Import a library of the `extra` within this block; where it cannot be, the error has the command to install it.

    Parameters
    ----------
    what : str
        What needs the library, for the message.
    extra : str
        A key of LIBRARIES.

    Raises
    ------
    InputError
    """
    try:
        yield
    except ImportError as error:
        raise InputError(
            f"{what} needs {LIBRARIES[extra]}, which cannot be imported ({one_line(error)[:80]}); install it: "
            f'pip install "mpmgis[{extra}]"'
        ) from error
