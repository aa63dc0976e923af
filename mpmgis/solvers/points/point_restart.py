"""Check the state from which a 3D run continues."""

from typing import TYPE_CHECKING

import numpy as np

from ...frames.state_check import YIELD_STATE, StateCheck
from .ground_contact import MOST_YIELD
from .point_rows import BLOCK, GHOSTS, MASS, X

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from .point_solver import PointSolver


def require_point_state(frame: "Frame", solver: "PointSolver", changing: dict[str, np.ndarray]) -> None:
    """Raise unless the state in a frame is one from which a 3D run can continue.

    Parameters
    ----------
    frame : Frame
    solver : PointSolver
    changing : dict of arrays
        Name -> array of the state other than the rows, of this solver.

    Raises
    ------
    FormatError
        An array is missing, has another type or shape, or has values out of their range.
    """
    kernel, state, n, like = solver.kernel, frame.state, len(frame.particles.id), solver.arrays.rows
    check = StateCheck(frame.time, state)
    rows = check.array("rows", like.dtype, (n, like.shape[-1]))
    keys = check.array("keys", np.int64, (n,))
    check.arrays_like(changing)
    check.counts(kernel, n)
    for axis in range(3):
        check.within("the place of a point in its block [cells]", rows[:, X + axis], 0.0, BLOCK + 1.0)
    tiny = np.finfo(like.dtype).smallest_subnormal
    check.within("the mass of a point [kg]", rows[:, MASS], tiny, np.finfo(like.dtype).max)
    row, column = kernel.rows_and_columns(keys)
    for name, blocks, cells in (
        ("row", row, solver.grid.inside.shape[0]),
        ("column", column, solver.grid.inside.shape[1]),
    ):
        check.within(f"the block {name} of a point", blocks, 0, (cells + GHOSTS) // BLOCK)
    check.left(solver.arrays.left_cells)
    _require_yields(check, solver)
    if solver.numerics.maxima:
        check.peaks(solver.arrays.peaks)
    for name, shape in (("stress", (n, 6)), ("affine", (n, 3, 3))):
        if name in state:
            check.array(name, np.float64, shape)


def _require_yields(check, solver):
    """Check the yields [m] of the ground at some node columns, from 0 to the largest possible yield."""
    where, yields = YIELD_STATE
    columns = check.indices(where, solver.arrays.yields[0, ..., 0].size)
    values = check.array(yields, np.float64, (len(columns),))
    most = MOST_YIELD * solver.grid.cell_size * (1.0 + 1e-6)
    check.within("the yield of the ground [m]", values, 0.0, most)
