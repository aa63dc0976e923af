"""Areas of columns with which they are as thick as the grid sees all of them together."""

import numpy as np

from ...compiled.jit import jit
from .column_rows import AREA, GX, GY, MASS, U, V, X, Y
from .spline_weights import weights


@jit
def grid_areas(rows: np.ndarray, shape: tuple, dx: float) -> np.ndarray:
    """Compute the area with which each column would have the thickness of the grid at its place: m / (rho h_g).

    Parameters
    ----------
    rows : float64[columns, ROW]
    shape : (int, int)
        Of the nodes.
    dx : float [m]

    Returns
    -------
    float64[columns] [m2]
    """
    mass = np.zeros(shape)
    share = np.zeros((2, 3))
    areas = np.empty(rows.shape[0])
    for reading in range(2):
        for p in range(rows.shape[0]):
            i0, _, share[0, 0], share[0, 1], share[0, 2] = weights(rows[p, X], 1.0 / dx)
            j0, _, share[1, 0], share[1, 1], share[1, 2] = weights(rows[p, Y], 1.0 / dx)
            here = 0.0
            for j in range(3):
                for i in range(3):
                    if reading:
                        here += share[0, i] * share[1, j] * mass[j0 + j, i0 + i]
                    else:
                        mass[j0 + j, i0 + i] += share[0, i] * share[1, j] * rows[p, MASS]
            if reading:
                areas[p] = rows[p, MASS] * dx * dx / here
    return areas


@jit
def settle_areas(
    rows: np.ndarray,
    keys: np.ndarray,
    gone: int,
    marked: np.ndarray,
    first_row: int,
    first_column: int,
    mirrors: np.ndarray,
    dx: float,
    density: float,
    least: float,
    tilted: bool,
) -> tuple[float, float, float]:
    """Set the area of the columns in marked cells to m / (rho h_g): as thick as the grid sees all of them together.

    Overlapping columns are each too thin and push too little (the push is the sum of A h^2).

    Parameters
    ----------
    rows : float64[columns, ROW]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    gone : int
        Key of a column that has left.
    marked : uint8[a, b]
        A window of cells from [first_row, first_column] on.
    first_row, first_column : int
    mirrors : int64[4]
        Indices of the ghost nodes behind walls, west, south, east, north; far outside where the edge is open.
    dx : float [m]
    density : float [kg m-3]
    least : float [1]
        Only columns that become at least so many times as thick; 0 for all.
    tilted : bool
        Thickness is normal to the bed: the middle of a column is c^2 h / 2 above the bed, not h / 2.

    Returns
    -------
    (float, float, float)
        The thickest of these columns [m], its |u| [m s-1] at most, and the sum of m c^2 (h after - h before) [kg m].
    """
    height, width = marked.shape[0] + 8, marked.shape[1] + 8
    south, west = first_row - 2, first_column - 2  # nodes, and base nodes of columns, that affect the window
    mass = np.zeros((height, width))
    share = np.zeros((2, 3))
    thickest, fastest, lifted = 0.0, 0.0, 0.0
    for reading in range(2):
        for p in range(rows.shape[0]):
            if keys[p] == gone:
                continue
            i0, _, share[0, 0], share[0, 1], share[0, 2] = weights(rows[p, X], 1.0 / dx)
            j0, _, share[1, 0], share[1, 1], share[1, 2] = weights(rows[p, Y], 1.0 / dx)
            i0, j0 = i0 - west, j0 - south
            if i0 < 0 or j0 < 0 or i0 + 2 >= width or j0 + 2 >= height:
                continue
            if not reading:
                for j in range(3):
                    for i in range(3):
                        mass[j0 + j, i0 + i] += share[0, i] * share[1, j] * rows[p, MASS]
                continue
            cell_row, cell_column = int(rows[p, Y] / dx) - first_row, int(rows[p, X] / dx) - first_column
            if cell_row < 0 or cell_column < 0 or cell_row >= marked.shape[0] or cell_column >= marked.shape[1]:
                continue
            if marked[cell_row, cell_column]:
                here = 0.0
                for j in range(3):
                    for i in range(3):
                        here += share[0, i] * share[1, j] * mass[j0 + j, i0 + i]
                before, after = rows[p, MASS] / (density * rows[p, AREA]), here / (density * dx * dx)
                if after >= least * before:
                    rows[p, AREA] = rows[p, MASS] / (density * after)
                    steep = rows[p, GX] ** 2 + rows[p, GY] ** 2 if tilted else 0.0
                    lifted += rows[p, MASS] * (after - before) / (1.0 + steep)
                    thickest = max(thickest, after)
                    fastest = max(fastest, np.hypot(rows[p, U], rows[p, V]))
        if not reading:
            _mirror_mass(mass.T, mirrors[0] - west, 1)
            _mirror_mass(mass, mirrors[1] - south, 1)
            _mirror_mass(mass.T, mirrors[2] - west, -1)
            _mirror_mass(mass, mirrors[3] - south, -1)
    return thickest, fastest, lifted


@jit
def _mirror_mass(lines, ghost, inwards):
    """Fold the mass of one wall's ghost nodes inwards and mirror it, as the grid does at walls each step."""
    if min(ghost, ghost + 2 * inwards) >= 0 and max(ghost, ghost + 2 * inwards) < lines.shape[0]:
        for k in range(lines.shape[1]):
            lines[ghost + inwards, k] *= 2.0
            lines[ghost + 2 * inwards, k] += lines[ghost, k]
            lines[ghost, k] = lines[ghost + 2 * inwards, k]
