"""The mpmgis toolbox for QGIS: a Processing provider that calls the command `mpmgis` and loads its results."""


def classFactory(iface):
    """The plugin, for QGIS; `iface` is its window, or None in qgis_process."""
    from .provider import Plugin

    return Plugin()
