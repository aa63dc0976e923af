"""Plots, maps, tables and HTML pages; facts about files for `mpmgis info`."""
