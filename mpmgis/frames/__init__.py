"""Particles in memory, frame files, the folders of a run, an ensemble and a region."""
