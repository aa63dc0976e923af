"""The door to pyogrio, GDAL's vector files: imported without the libraries that it only looks for.

Importing pyogrio imports pandas, geopandas and pyarrow where they are installed, to know that they are there and their
versions: 0.6 s of the 0.8 s that a short command has. None of what we ask of it needs them.
"""

import importlib
import sys
import threading
from contextlib import suppress
from importlib import metadata, util
from types import ModuleType

LOOKED_FOR = ("pandas", "geopandas", "pyarrow")


def pyogrio():
    """The module pyogrio.

    While it is imported, libraries that are installed and not yet imported are represented by modules with nothing but
    their version; these go as soon as it is there. So pyogrio knows what it would know otherwise, and imports the
    libraries themselves in the functions that use them. In a process with several threads, another of which might
    import one of them meanwhile, it is imported as usual.
    """
    if "pyogrio" in sys.modules or threading.active_count() > 1:
        return importlib.import_module("pyogrio")
    placed = {}
    try:
        for name in LOOKED_FOR:
            with suppress(ImportError):  # not to be found, or installed in another way than by a package manager
                if name not in sys.modules and util.find_spec(name) is not None:
                    placed[name] = sys.modules[name] = _of_version(name)
        return importlib.import_module("pyogrio")
    finally:
        for name, module in placed.items():
            if sys.modules.get(name) is module:
                del sys.modules[name]


def _of_version(name):
    """A module that knows no more than the version of the library `name`."""
    module = ModuleType(name)
    module.__version__ = metadata.version(name)
    return module
