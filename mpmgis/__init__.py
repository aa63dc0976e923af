"""mpmgis: landslides, debris flows, snow and ice avalanches on real terrain with the Material Point Method.

>>> import mpmgis
>>> mpmgis.seed("dtm.tif", "release.shp")  # doctest: +SKIP
>>> mpmgis.run("scene.toml", "results")  # doctest: +SKIP
>>> mpmgis.export_raster("results", cell_size=1, time_step=0.2)  # doctest: +SKIP
>>> mpmgis.open_results("results_gis").h_max.plot()  # doctest: +SKIP

Names come from `mpmgis.api`, each loaded when it is first used: `import mpmgis` alone costs nothing.
"""

import importlib

__version__ = "0.1.0"
__all__ = [
    "Frame", "MpmgisError", "Particles", "depth_average", "export_raster", "open_results", "read_frame", "run", "seed",
    "to_geodataframe",
]  # fmt: skip


def __getattr__(name):
    if name not in __all__:
        raise AttributeError(f"module 'mpmgis' has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.api"), name)


def __dir__():
    return sorted([*globals(), *__all__])
