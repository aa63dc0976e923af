"""Where: grids, terrain, release areas."""
