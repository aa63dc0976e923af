"""Start the mpmgis toolbox for QGIS: a Processing provider that calls the command `mpmgis` and loads its results."""


def classFactory(iface: object) -> object:
    """Return the plugin, for QGIS.

    Parameters
    ----------
    iface : QgisInterface or None
        The window of QGIS; None in qgis_process.

    Returns
    -------
    Plugin
    """
    from .provider import Plugin

    return Plugin(iface)
