"""Call the command `mpmgis` of another Python environment from QGIS: the toolbox as a plugin.

`mpmgis_qgis` is the plugin as QGIS installs it. It imports nothing of mpmgis, and runs on Python 3.9, the version of
QGIS 3.22 on Windows.
"""
