"""The verbs of mpmgis, one file each: its options and its Python function."""
