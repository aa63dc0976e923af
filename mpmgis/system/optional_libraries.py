"""Imports of optional libraries, and of pyogrio without the libraries that it only detects."""

import importlib
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import metadata, util
from types import ModuleType

from .errors import InputError, one_line

LIBRARIES = {  # extra of pyproject.toml: what it installs
    "parquet": "pyarrow",
    "cluster": "dask[distributed]",
    "animation": "imageio[ffmpeg]",
    "pointcloud": "laspy",
    "player": "bokeh",
}
GEOPACKAGE = {"VERSION": "1.2"}  # of a new GeoPackage: older readers warn of what GDAL writes by default
DETECTED_BY_PYOGRIO = ("pandas", "geopandas", "pyarrow")


@contextmanager
def needed_for(what: str, extra: str) -> Iterator[None]:
    """Import an optional library within this block; on failure the error has the command to install it.

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


def pyogrio() -> ModuleType:
    """Import the module pyogrio without pandas, geopandas and pyarrow.

    Pyogrio imports these libraries where they are installed, only to know their versions: 0.6 s of the 0.8 s of a short
    command. While pyogrio is imported, empty modules with a version stand in for those that are installed and not yet
    imported; they are removed afterwards. Pyogrio imports the libraries themselves in the functions that use them. In a
    process with several threads the usual import is used, because another thread could import one of them.
    """
    if "pyogrio" in sys.modules or threading.active_count() > 1:
        return importlib.import_module("pyogrio")
    placed = {}
    try:
        for name in DETECTED_BY_PYOGRIO:
            with suppress(ImportError):  # not found, or not installed by a package manager
                if name not in sys.modules and util.find_spec(name) is not None:
                    placed[name] = sys.modules[name] = _of_version(name)
        return importlib.import_module("pyogrio")
    finally:
        for name, module in placed.items():
            if sys.modules.get(name) is module:
                del sys.modules[name]


def _of_version(name: str) -> ModuleType:
    """Return an empty module with the version of the library `name`."""
    module = ModuleType(name)
    module.__version__ = metadata.version(name)
    return module
