"""Features of the map (zones, barriers, lakes, erodible ground) on the nodes of a solver's grid."""
