"""Observed depths, speeds, pressures and arrival times at points, from the columns of a vector file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..terrain.grid import Grid
from .observed import read_points
from .vector_table import read_table

QUANTITIES = ("h_max", "Ut_max", "p_max", "t_arrival")  # columns, as the bands of maxima
DEVIATION = "_sd"  # suffix of the column with standard deviations


@dataclass(frozen=True)
class ObservedValue:
    """A value of a quantity [SI] at a point: cell `row`, `column`, and its standard deviation."""

    point: str
    quantity: str
    row: int
    column: int
    value: float
    deviation: float


def read_values(path: Path, grid: Grid, error: float) -> list[ObservedValue]:
    """The ObservedValues of the points at `path` on the cells of `grid`.

    Parameters
    ----------
    path : Path
    grid : Grid
    error : float
        Relative standard deviation of values without one.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
        No points, none of the columns, a point outside the grid, or a deviation that is not above 0.
    """
    names, x, y = read_points(path, grid)
    table = read_table(path, "Point", "--points ")
    columns = table.where(~table.without_geometry).columns
    given = [name for name in QUANTITIES if name in columns]
    if not given:
        raise InputError(f"{path} has none of the columns {', '.join(QUANTITIES)}; add the observed ones")
    if len(names) != len(columns[given[0]]):
        raise InputError(f"{path} contains multipoints; expected one point in each feature")
    column, row = (np.floor(v).astype(int) for v in ~grid.transform * (x, y))
    inside = (row >= 0) & (row < grid.shape[0]) & (column >= 0) & (column < grid.shape[1])
    if not inside.all():
        raise InputError(f"{path}: point {names[int(np.argmin(inside))]} is outside the DTM; remove it")
    found = []
    for quantity in given:
        values = np.array(columns[quantity], float)
        own = columns.get(quantity + DEVIATION)
        deviations = error * np.abs(values) if own is None else np.array(own, float)
        for k in np.flatnonzero(np.isfinite(values)):
            if not deviations[k] > 0:
                raise InputError(f"{path}: {quantity}{DEVIATION} of point {names[k]} is not above 0; give it")
            found.append(ObservedValue(str(names[k]), quantity, int(row[k]), int(column[k]), values[k], deviations[k]))
    if not found:
        raise InputError(f"{path}: all values of {', '.join(given)} are missing")
    return found
