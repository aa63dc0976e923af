"""Coordinates along and across a path: s from its start, l to its left, as in AIMEC (Fischer 2013).

Areas are not transformed: each cell of a map keeps its own area, and belongs to the part of the path nearest to it. So
an area is the same in both systems, also in a bend, where (s, l) are not true to area.

Fischer, J.-T. (2013): A novel approach to evaluate and compare computational snow avalanche simulation. Natural Hazards
and Earth System Sciences 13, 1655-1667.
"""

from dataclasses import dataclass

import numpy as np

from ..system.errors import InputError
from .flow_line import places_along, positions_along, vertex_distances

AT_A_VERTEX = 1e-9  # [lengths of the line] within which the nearest point of the line is a vertex
MOST_BINS = 200_000  # along a path; more are a wrong `spacing`


def path_coordinates(line: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates of map points along and across a path.

    Parameters
    ----------
    line : float[n, 2] [m]
        The path, extended straight at both ends.
    x, y : float[k] [m]

    Returns
    -------
    (float64[k], float64[k]) [m]
        s, the distance along the path to its point nearest to each; l, the distance to that point, positive to the left
        of the path.
    """
    line = np.asarray(line, float)
    points = np.column_stack([x, y])
    along = positions_along(line, x, y)
    offset = points - np.column_stack(places_along(line, along))
    east, north = _directions(line, along).T
    across = np.copysign(np.hypot(*offset.T), east * offset[:, 1] - north * offset[:, 0])
    return along, across


def _directions(line: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the direction of a line at distances along it, [k, 2]; at a vertex the sum of those before and after."""
    vertices = vertex_distances(line)
    steps = np.diff(line, axis=0) / np.diff(vertices)[:, None]
    last = len(steps) - 1
    piece = np.clip(np.searchsorted(vertices, along, side="right") - 1, 0, last)
    near = AT_A_VERTEX * vertices[-1]
    direction = steps[piece].copy()
    at_begin = (piece > 0) & (along - vertices[piece] <= near)
    at_end = (piece < last) & (vertices[piece + 1] - along <= near)
    direction[at_begin] += steps[piece[at_begin] - 1]
    direction[at_end] += steps[piece[at_end] + 1]
    return direction


@dataclass(frozen=True)
class PathBins:
    """Parts of a path of equal length.

    Parameters
    ----------
    first : int
        Number of the first part; part 0 begins at the start of the path.
    count : int
    spacing : float [m]
        Length of a part.
    """

    first: int
    count: int
    spacing: float

    @classmethod
    def over(cls, begin: float, end: float, spacing: float) -> "PathBins":
        """Divide a path into parts that contain both ends.

        Parameters
        ----------
        begin, end : float [m]
            Positions along the path.
        spacing : float [m]

        Returns
        -------
        PathBins

        Raises
        ------
        InputError
            More than MOST_BINS parts.
        """
        first, last = (int(np.floor(place / spacing)) for place in (begin, end))
        count = last - first + 1
        if count > MOST_BINS:
            raise InputError(
                f"`spacing`: {end - begin:.6g} m along the path with a spacing of {spacing:g} m make {count} parts, "
                f"expected at most {MOST_BINS}; give a larger `spacing`"
            )
        return cls(first, count, spacing)

    @property
    def middles(self) -> np.ndarray:
        """Position of the middle of each part, float64[count] [m]."""
        return (self.first + np.arange(self.count) + 0.5) * self.spacing

    @property
    def edges(self) -> np.ndarray:
        """Positions of the ends of the parts, float64[count + 1] [m]."""
        return (self.first + np.arange(self.count + 1)) * self.spacing

    def of(self, along: np.ndarray) -> np.ndarray:
        """Return the number of the part, from 0, of each position.

        Parameters
        ----------
        along : float[k] [m]

        Returns
        -------
        int64[k]
        """
        return np.clip(np.floor(along / self.spacing).astype(np.int64) - self.first, 0, self.count - 1)

    def largest(self, part: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the largest value in each part; NaN without one.

        Parameters
        ----------
        part : int64[k]
        values : float[k]

        Returns
        -------
        float64[count]
        """
        found = np.full(self.count, np.nan)
        np.fmax.at(found, part, values)
        return found

    def areas(self, part: np.ndarray, cell_area: float) -> np.ndarray:
        """Return the area of the cells in each part.

        Parameters
        ----------
        part : int64[k]
            Of each cell.
        cell_area : float [m2]

        Returns
        -------
        float64[count] [m2]
        """
        return np.bincount(part, minlength=self.count) * cell_area
