"""The QGIS toolbox: what runs in QGIS' own Python and calls the command `mpmgis`, which lives elsewhere.

`mpmgis_qgis` is the plugin as QGIS installs it. Nothing in it imports anything of mpmgis, and it keeps to Python 3.9,
which QGIS 3.22 brings on Windows.
"""
