"""What other 3D solvers start from: their own input files, one module a solver, a row each in `solvers`."""
