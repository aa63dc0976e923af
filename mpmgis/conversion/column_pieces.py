"""Cut columns sideways into pieces, so that their points leave no gaps."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    from .column_footprints import Footprints
    from .ground_below import GroundBelow

_WELL = 1e-12  # [1] share of a piece in the next cell, below which it is rounding
_LONGER = 1e-6  # [1] share by which a piece may be longer than requested, or [cells] by which a place may miss a border
_DENSE = 16  # [1] cells per point, up to which points are counted in a table of all cells


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of columns, on which stacks of points are set: a whole column each, or a rectangle that it is cut into.

    Parameters
    ----------
    column : int64[k]
        Row of the column in its frame.
    east, north : float64[k] [m]
        Middle of the piece, from the column's.
    side : float64[k] [m]
        Of the square of its area.
    share : float64[k]
        Of the column's mass, volume and area.
    bed : float64[k] [m]
        Elevation of the ground under the middle.
    gradient_east, gradient_north : float64[k] [1]
        Of the ground there.
    """

    column: np.ndarray
    east: np.ndarray
    north: np.ndarray
    side: np.ndarray
    share: np.ndarray
    bed: np.ndarray
    gradient_east: np.ndarray
    gradient_north: np.ndarray

    def __len__(self):
        return len(self.column)

    def take(self, index: np.ndarray) -> "Pieces":
        """Return some of the pieces.

        Parameters
        ----------
        index : bool[k] or int64[m]
        """
        return Pieces(**{name: values[index] for name, values in vars(self).items()})


def cut(x: np.ndarray, y: np.ndarray, footprints: "Footprints", size: float | None, ground: "GroundBelow") -> Pieces:
    """Cut columns on the ground into adjacent rectangles.

    A piece without ground below its middle is put in the middle of its column, so that no mass is lost at the
    rim of the terrain; columns that have none there themselves make no piece.

    Parameters
    ----------
    x, y : float64[n] [m]
        Places of the columns.
    footprints : Footprints
        Of the columns.
    size : float or None [m]
        No piece is longer than that (None: columns stay whole).
    ground : GroundBelow

    Returns
    -------
    Pieces
    """
    bed, on_ground = _bed(ground, x, y)
    columns = np.flatnonzero(on_ground)
    length, width, along_east, along_north = (values[columns] for values in footprints)
    lengthwise, across = pieces_along(length, size), pieces_along(width, size)
    if (lengthwise * across == 1).all():
        zero = np.zeros(len(columns))
        slopes = ground.gradient(x[columns], y[columns])
        side = np.sqrt(length * width)
        return Pieces(columns, zero, zero.copy(), side, np.ones(len(columns)), bed[columns], *slopes)
    of, number = runs(lengthwise * across)
    m, n = lengthwise[of], across[of]
    s = ((number % m + 0.5) / m - 0.5) * length[of]
    t = ((number // m + 0.5) / n - 0.5) * width[of]
    east, north = s * along_east[of] - t * along_north[of], s * along_north[of] + t * along_east[of]
    column = columns[of]
    height, there = _bed(ground, x[column] + east, y[column] + north)
    east, north = np.where(there, east, 0.0), np.where(there, north, 0.0)
    height = np.where(there, height, bed[column])
    slopes = ground.gradient(x[column] + east, y[column] + north)
    side = np.sqrt((length * width)[of] / (m * n))
    return Pieces(column, east, north, side, 1.0 / (m * n), height, *slopes)


def pieces_along(side: np.ndarray, size: float | None) -> np.ndarray:
    """Count the pieces that a side is cut into.

    Parameters
    ----------
    side : float64[n] [m]
    size : float or None [m]
        No piece is longer than that, but for rounding (None: one piece).

    Returns
    -------
    int64[n]
    """
    if size is None:
        return np.ones(len(side), np.int64)
    return np.maximum(np.ceil(side / size * (1.0 - _LONGER)), 1.0).astype(np.int64)


def _bed(ground, x, y):
    height = ground.height(x, y)
    return height, np.isfinite(height)


def runs(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number the entries of runs of given lengths.

    Parameters
    ----------
    counts : int64[n]
        Length of each run.

    Returns
    -------
    (int64[k], int64[k])
        Run of each entry, and number of the entry in its run; k is the sum of `counts`.
    """
    of = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    return of, np.arange(len(of)) - starts[of]


def within(pieces: Pieces, x: np.ndarray, y: np.ndarray, window: shapely.Polygon | None) -> np.ndarray:
    """Find the pieces whose middle is in a window.

    Parameters
    ----------
    pieces : Pieces
    x, y : float64[n] [m]
        Places of the columns.
    window : shapely.Polygon or None
        None: everywhere.

    Returns
    -------
    bool[k]
    """
    if window is None:
        return np.ones(len(pieces), bool)
    shapely.prepare(window)
    return shapely.contains_xy(window, x[pieces.column] + pieces.east, y[pieces.column] + pieces.north)


def piece_velocity(pieces: Pieces, velocity: np.ndarray, gradient: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Compute the horizontal velocity of pieces from that of their columns.

    With a velocity gradient the pieces of a column move by it, about a mean that stays the column's.

    Parameters
    ----------
    pieces : Pieces
    velocity : float64[n, 3] [m s-1]
    gradient : float64[n, 2, 2] or None [s-1]
        None: unknown.

    Returns
    -------
    (float64[k], float64[k])
        East and north [m s-1].
    """
    u, v = velocity[pieces.column, 0], velocity[pieces.column, 1]
    if gradient is None or not (pieces.east.any() or pieces.north.any()):
        return u, v
    size = len(velocity)
    count = np.maximum(np.bincount(pieces.column, minlength=size), 1)
    east = pieces.east - (np.bincount(pieces.column, pieces.east, size) / count)[pieces.column]
    north = pieces.north - (np.bincount(pieces.column, pieces.north, size) / count)[pieces.column]
    c = gradient[pieces.column]
    return u + c[:, 0, 0] * east + c[:, 0, 1] * north, v + c[:, 1, 0] * east + c[:, 1, 1] * north


@dataclass(frozen=True)
class Cover:
    """How pieces cover the cells of a square lattice.

    Parameters
    ----------
    covered : float64[k] [1]
        Area of all pieces in a piece's cell over the cell's area.
    thickness : float64[k] [m]
        Of their volume there, over the whole cell.
    """

    covered: np.ndarray
    thickness: np.ndarray


def cover(pieces: Pieces, x: np.ndarray, y: np.ndarray, volume: np.ndarray, cell: float) -> Cover:
    """Compute how pieces cover a square lattice, by exact shares of their squares.

    Parameters
    ----------
    pieces : Pieces
        Narrower than a cell.
    x, y : float64[n] [m]
        Places of the columns.
    volume : float64[k] [m3]
        Of the pieces.
    cell : float [m]
    """
    west, south = (at - 0.5 * pieces.side for at in (x[pieces.column] + pieces.east, y[pieces.column] + pieces.north))
    column, right = _first_cell(west - west.min(), pieces.side, cell)
    row, upper = _first_cell(south - south.min(), pieces.side, cell)
    width = int(column.max()) + 2
    keys, shares = [], []
    for j, by_row in ((0, 1.0 - upper), (1, upper)):
        for i, by_column in ((0, 1.0 - right), (1, right)):
            keys.append((row + j) * width + column + i)
            shares.append(by_row * by_column)
    cells, cell_of = np.unique(np.concatenate(keys), return_inverse=True)
    share = np.concatenate(shares)
    area = np.bincount(cell_of, share * np.tile(pieces.side**2, 4), len(cells)) / cell**2
    thickness = np.bincount(cell_of, share * np.tile(volume, 4), len(cells)) / cell**2
    own = cell_of.reshape(4, -1)[2 * (upper > 0.5) + (right > 0.5), np.arange(len(pieces))]
    return Cover(area[own], thickness[own])


def _first_cell(start, side, cell):
    """Cell in which a piece starts, and its share in the next one."""
    first = np.floor(start / cell)
    beyond = np.clip((start + side - (first + 1.0) * cell) / side, 0.0, 1.0)
    return first.astype(np.int64), np.where(beyond < _WELL, 0.0, beyond)


def count_by_cell(x: np.ndarray, y: np.ndarray, z: np.ndarray, cell: float) -> np.ndarray:
    """Count the points in each cube of a lattice that is not empty.

    Parameters
    ----------
    x, y, z : float64[n] [m]
    cell : float [m]

    Returns
    -------
    int64[m]
    """
    rank = [np.floor((at - at.min()) / cell + _LONGER).astype(np.int64) for at in (x, y, z)]
    size = [int(r.max()) + 1 for r in rank]
    key = (rank[2] * size[1] + rank[1]) * size[0] + rank[0]
    if size[0] * size[1] * size[2] > _DENSE * len(x):
        return np.unique(key, return_counts=True)[1]
    counts = np.bincount(key)  # a table instead of a sort
    return counts[counts > 0]
