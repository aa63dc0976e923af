"""Features of the map on the grid of a solver: zones, walls, openings, forest, lakes."""
