"""The page about a run, and facts about any file for `mpmgis info`."""
