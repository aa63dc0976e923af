"""The QGIS toolbox: runs in the Python of QGIS and calls the command `mpmgis` of another Python environment.

`mpmgis_qgis` is the plugin as QGIS installs it. It imports nothing of mpmgis, and runs on Python 3.9, the version of
QGIS 3.22 on Windows.
"""
