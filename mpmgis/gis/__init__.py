"""Files for QGIS: project, styles, mesh, outlines."""
