"""The verbs of mpmgis: one module each, with the table of its options and the Python function."""
