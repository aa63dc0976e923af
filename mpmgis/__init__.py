"""mpmgis: landslides, debris flows, snow and ice avalanches on real terrain with the Material Point Method.

>>> import mpmgis
>>> mpmgis.seed("dtm.tif", "release.shp")  # doctest: +SKIP
>>> mpmgis.run("scene.toml", "results")  # doctest: +SKIP
>>> mpmgis.export_raster("results", cell_size=1, time_step=0.2)  # doctest: +SKIP
>>> mpmgis.plot(mpmgis.open_results("results_gis").h_max, terrain="dtm.tif")  # doctest: +SKIP

`__init__.pyi` lists the names and their modules, for type checkers and for this module, which loads each at its first
use: `import mpmgis` alone loads nothing.
"""

import importlib
import re
from pathlib import Path

__version__ = "0.1.0"
_INDEX = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULES = {name: module for module, name in re.findall(r"^from (\S+) import (\w+) as", _INDEX, re.MULTILINE)}
__all__ = sorted(_MODULES)


def __getattr__(name):
    if name not in _MODULES:
        raise AttributeError(f"module 'mpmgis' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name], __name__), name)


def __dir__():
    return sorted([*globals(), *__all__])
