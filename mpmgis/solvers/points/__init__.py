"""The 3D step: points, grid, contact with ground and barriers, PointSolver."""
