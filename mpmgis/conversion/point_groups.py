"""Points over ground, and the columns that they are grouped into."""

from typing import TYPE_CHECKING

import numpy as np

from ..system.errors import InputError

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..terrain.elevation import Terrain
    from ..terrain.grid import Grid
    from .conversion_options import ColumnOptions

SPREAD = 2.0  # [footprints of a column] over which its points can be spread and still belong together
APART = 0.01  # [1] share of the mass in columns that moved apart, above which parents are not used
_DENSE = 16  # [1] names per point, up to which columns are found in a table of all names


class PointsOverGround:
    """Points over ground.

    Parameters
    ----------
    frame : Frame
    index : int64[n]
        Rows of the points in the frame.
    bed : float64[n] [m]
        Elevation of the ground below each point; `height` [m] is that of the point over it.
    slope_east, slope_north : float64[n] [1]
        Gradient of the ground there.
    """

    def __init__(
        self, frame: "Frame", index: np.ndarray, bed: np.ndarray, slope_east: np.ndarray, slope_north: np.ndarray
    ):
        self.frame, self.index, self.bed = frame, index, bed
        self.slope_east, self.slope_north = slope_east, slope_north
        particles = frame.particles
        self.position, self.velocity = particles.position[index], particles.velocity[index]
        self.mass, self.volume = particles.mass[index], particles.volume[index]
        self.height = self.position[:, 2] + (frame.origin[2] - bed)

    def take(self, mask: np.ndarray) -> "PointsOverGround":
        """Return some of the points.

        Parameters
        ----------
        mask : bool[n]
        """
        return PointsOverGround(
            self.frame, self.index[mask], self.bed[mask], self.slope_east[mask], self.slope_north[mask]
        )


class Groups:
    """Points by column: `key` is the name of each column, `of` int64[n] the number of each point's column.

    Parameters
    ----------
    labels : int[n]
        Name of each point's column.
    """

    def __init__(self, labels: np.ndarray):
        low = labels.min()
        number = (labels - low).astype(np.int64)
        if number.max() > _DENSE * len(labels):
            self.key, self.of = np.unique(labels, return_inverse=True)
            return
        there = np.zeros(int(number.max()) + 1, bool)  # a table instead of a sort
        there[number] = True
        self.key = np.flatnonzero(there).astype(labels.dtype) + low
        self.of = (np.cumsum(there) - 1)[number]

    def __len__(self):
        return len(self.key)

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Sum values over each column's points.

        Parameters
        ----------
        values : float64[n]

        Returns
        -------
        float64[m]
        """
        return np.bincount(self.of, values, len(self))

    def least(self, values: np.ndarray) -> np.ndarray:
        """Find the least value among each column's points.

        Parameters
        ----------
        values : float64[n]

        Returns
        -------
        float64[m]
        """
        low = np.full(len(self), np.inf)
        np.minimum.at(low, self.of, values)
        return low

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Return the value of each point's column.

        Parameters
        ----------
        values : array[m]

        Returns
        -------
        array[n]
        """
        return values[self.of]

    def without(self, gone: np.ndarray) -> "Groups":
        """Return the groups without some columns and their points.

        Parameters
        ----------
        gone : bool[m]
        """
        left = object.__new__(Groups)
        left.key = self.key[~gone]
        number = np.cumsum(~gone) - 1
        left.of = number[self.of[~gone[self.of]]]
        return left


def grouped(
    over: PointsOverGround, x: np.ndarray, y: np.ndarray, terrain: "Terrain", options: "ColumnOptions"
) -> tuple[Groups, str, float | None, float]:
    """Group points into columns, by parent where that is asked for or possible, else by cell.

    Parameters
    ----------
    over : PointsOverGround
    x, y : float64[n] [m]
        Places of the points.
    terrain : Terrain
    options : ColumnOptions

    Returns
    -------
    (Groups, str, float or None, float)
        The groups, "parent" or "cell", area of a cell [m2] or None, share of the mass in columns that moved apart.

    Raises
    ------
    InputError
        By parent, without parents.
    """
    parent, by, apart = over.frame.particles.parent, options.by, 0.0
    if by == "parent" and parent is None:
        raise InputError("these points have no parent identities; bin them on cells (by cell)")
    if parent is not None and by != "cell":
        groups = Groups(parent[over.index])
        apart = _apart(over, groups)
        if by == "parent" or apart <= APART:
            return groups, "parent", None, apart
    labels, cell_area = cells_of(x, y, terrain.grid, options.cell)
    return Groups(labels), "cell", cell_area, apart


def _apart(over, groups):
    """Share of the mass in columns whose points are below the bed or spread over more than their footprint."""
    mass = groups.sum(over.mass)
    thickness = 2.0 * groups.sum(over.mass * over.height) / mass
    spread = np.zeros(len(groups))
    for axis in (0, 1):
        off = over.position[:, axis] - groups.spread(groups.sum(over.mass * over.position[:, axis]) / mass)
        spread += groups.sum(over.mass * off**2) / mass
    sunk = thickness <= 0
    area = groups.sum(over.volume) / np.where(sunk, 1.0, thickness)
    return float(mass[sunk | (spread > SPREAD**2 * area / 6.0)].sum() / mass.sum())


def cells_of(x: np.ndarray, y: np.ndarray, grid: "Grid", cell: float | None) -> tuple[np.ndarray, float]:
    """Number the cells that points lie in: the terrain's pixels, or squares.

    Parameters
    ----------
    x, y : float64[n] [m]
    grid : Grid
        Of the terrain.
    cell : float or None [m]
        Side of the squares; None: pixels.

    Returns
    -------
    (int64[n], float)
        Number of each point's cell, area of a cell [m2].
    """
    if cell is None:
        row, column = grid.rowcol(x, y)
        row, column, area = np.floor(row + 0.5), np.floor(column + 0.5), grid.cell_area
    else:
        west, _, _, north = grid.bounds
        row, column, area = np.floor((north - y) / cell), np.floor((x - west) / cell), cell**2
    row, column = row.astype(np.int64), column.astype(np.int64)
    return row * (int(column.max()) + 1) + column, float(area)
