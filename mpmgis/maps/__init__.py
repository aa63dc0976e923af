"""Particles to maps: averages over cells, the folder of an export, QGIS."""
