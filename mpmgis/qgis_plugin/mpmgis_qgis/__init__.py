"""The mpmgis toolbox for QGIS: a Processing provider that calls the command `mpmgis` and loads what it wrote."""


def classFactory(iface):
    """Give the plugin to QGIS; `iface` is its window, or None in qgis_process."""
    from .plugin import Plugin

    return Plugin()
