"""Libraries that read settings from the current folder do not, where mpmgis imports them.

The current folder may be one that was received: `.numba_config.yaml` there could replace any file or crash the
program, `matplotlibrc` changes maps, `.ncrc` the NetCDF library. Imported by `mpmgis.system` and `mpmgis.compiled`,
so in every process, before numba, matplotlib and the NetCDF library.
"""

import os
import sys

SETTINGS = {  # module: the file that it looks for in the current folder when it is imported
    "numba.core.config": ".numba_config.yaml",
    "numba_cuda.numba.cuda.core.config": ".numba_config.yaml",
    "numba.cuda.core.config": ".numba_config.yaml",
    "matplotlib": "matplotlibrc",
}
_LATER = "_config_fname"  # name in these modules of the file that they look for again at each compilation
os.environ.setdefault("NCRCENV_IGNORE", "1")  # of the NetCDF library


class _WithoutFile:
    """Runs a module while a file seems not to exist."""

    def __init__(self, loader, file):
        self._loader, self._file = loader, file

    def create_module(self, spec):
        return self._loader.create_module(spec)

    def exec_module(self, module):
        exists, file = os.path.exists, self._file
        os.path.exists = lambda path: path != file and exists(path)
        try:
            self._loader.exec_module(module)
        finally:
            os.path.exists = exists
        _forget(module)


class _Finder:
    """Finds the modules of SETTINGS as usual, and loads them without their file."""

    def find_spec(self, fullname, path=None, target=None):
        if fullname not in SETTINGS:
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        found = (finder.find_spec(fullname, path, target) for finder in others)
        spec = next((spec for spec in found if spec is not None), None)
        if spec is not None and spec.loader is not None:
            spec.loader = _WithoutFile(spec.loader, SETTINGS[fullname])
        return spec


def _forget(module):
    """Let a module that looks for its file later find none."""
    if hasattr(module, _LATER):
        setattr(module, _LATER, os.devnull)


if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
    sys.meta_path.insert(0, _Finder())
    for _name in SETTINGS:
        if _name in sys.modules:
            _forget(sys.modules[_name])
