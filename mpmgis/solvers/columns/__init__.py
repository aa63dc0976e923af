"""The depth-averaged step: columns, grid, laws at nodes, ColumnSolver."""
