"""Grid, elevation, CRS; rasters and vector files in and out; reach of a flow."""
