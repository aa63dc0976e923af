"""Files for QGIS and other viewers: project, styles, mesh, outlines, KMZ, STAC."""
