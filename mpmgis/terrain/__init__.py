"""Grids, terrain, release areas."""
