"""Start files of other 3D solvers: one module per solver, one entry each in `writer_list`."""
