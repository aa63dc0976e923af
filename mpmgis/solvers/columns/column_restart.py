"""Restarts: the digest of a run's input, and the checks of a saved state.

The digest of a file detects accidental changes. Compiled kernels do not check indices: an index out of range writes
anywhere in memory. All numbers of a state are therefore checked before use.
"""

from typing import TYPE_CHECKING

import numpy as np

from ...frames.state_check import StateCheck

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from .column_solver import ColumnSolver


def require_column_state(frame: "Frame", solver: "ColumnSolver", changing: dict[str, np.ndarray]) -> None:
    """Raise FormatError unless a frame has a valid state of a solver.

    Parameters
    ----------
    frame : Frame
    solver : ColumnSolver
    changing : dict
        Arrays of that state, by name.

    Raises
    ------
    FormatError
    """
    kernel, state, n = solver.kernel, frame.state, len(frame.particles.id)
    check = StateCheck(frame.time, state)
    ny, nx = solver.grid.inside.shape
    rows = check.array("rows", np.float64, (n, kernel.ROW))
    check.arrays_like(changing)
    check.counts(kernel, n)
    size = solver.grid.cell_size
    check.within("the place of a column east of the domain's corner [m]", rows[:, kernel.X], 0.0, nx * size)
    check.within("the place of a column north of the domain's corner [m]", rows[:, kernel.Y], 0.0, ny * size)
    for name, column in (("mass [kg]", kernel.MASS), ("area [m2]", kernel.AREA)):
        check.within(f"the {name} of a column", rows[:, column], np.nextafter(0.0, 1.0), np.finfo(float).max)
    _require_window(check, kernel, rows, size, state["counts"], ((nx + 2) // kernel.BLOCK, (ny + 2) // kernel.BLOCK))
    nodes = (ny + 3) * (nx + 3)
    check.within("the number of wet nodes", state["counts"][kernel.WET], 0, nodes)
    check.array("reached", np.uint8, (ny + 3, (nx + 3 + 7) // 8))
    check.left(solver.arrays.left_cells)
    check.peaks(solver.arrays.peaks)


def _require_window(check, kernel, rows, size, counts, last):
    """Require that the window of blocks in `counts` contains the columns of `rows` and ends at blocks `last`."""
    if not len(rows):
        return
    keys = np.zeros(len(rows), np.int32)
    west, south, east, north = kernel.initial_keys(np.ascontiguousarray(rows), keys, size)
    check.within("the west of the window of blocks", counts[kernel.WEST], 0, west)
    check.within("the south of the window of blocks", counts[kernel.SOUTH], 0, south)
    check.within("the east of the window of blocks", counts[kernel.EAST], east, last[0])
    check.within("the north of the window of blocks", counts[kernel.NORTH], north, last[1])
