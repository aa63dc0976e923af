"""Lattice of cells on the map, and polygons in its coordinates: exact areas and centroids, no supersampling."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ..terrain.grid import Grid
from . import polygon_cover, polygon_points
from .polygon_cover import Cover
from .polygon_points import Edges

_SNAP = 1e-9  # [cells] edges this close to a lattice line lie on it, or as close as map coordinates round
_ULPS = 4.0  # units in the last place by which a map coordinate may be off


@dataclass(frozen=True, eq=False)
class Lattice:
    """Cells that tile the plane: cell (row, column) has its corner at ``origin + matrix @ (column, row)``.

    Parameters
    ----------
    origin : (float, float) [m]
        x, y.
    matrix : float64[2, 2] [m]
        Its columns are the map vectors of one step in column and in row.
    """

    origin: tuple
    matrix: np.ndarray

    @classmethod
    def squares(
        cls, origin: tuple[float, float], side: float, direction: tuple[float, float] = (1.0, 0.0)
    ) -> "Lattice":
        """Return a lattice of squares.

        Parameters
        ----------
        origin : (float, float) [m]
            x, y of a corner.
        side : float [m]
        direction : (float, float)
            Unit vector along the rows, to the east and north.
        """
        east, north = direction
        return cls(tuple(origin), side * np.array([[east, -north], [north, east]]))

    @classmethod
    def of_grid(cls, grid: Grid) -> "Lattice":
        """Return the lattice whose cells are the pixels of a raster.

        Parameters
        ----------
        grid : Grid
            Grid of the raster.
        """
        return cls((grid.transform.c, grid.transform.f), grid.matrix)

    @cached_property
    def cell_area(self) -> float:
        """Plan area of a cell [m2]."""
        return abs(float(np.linalg.det(self.matrix)))

    @cached_property
    def aspect(self) -> float:
        """Height of a cell over its width [1]."""
        return float(np.hypot(*self.matrix[:, 1]) / np.hypot(*self.matrix[:, 0]))

    def to_cells(self, points: np.ndarray) -> np.ndarray:
        """Convert map points to lattice coordinates (u, v).

        Parameters
        ----------
        points : float64[n, 2] [m]

        Returns
        -------
        float64[n, 2] [cells]
        """
        (a, b), (d, e) = self.matrix
        x, y = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        det = a * e - b * d
        if b == 0.0 and d == 0.0:  # by division, so that points on lattice lines stay on them
            return np.column_stack((x / a, y / e))
        return np.column_stack(((e * x - b * y) / det, (a * y - d * x) / det))

    def snap(self, points: np.ndarray) -> float:
        """Return the distance [cells] from a lattice line within which map points lie on it.

        Parameters
        ----------
        points : float64[n, 2] [m]
        """
        ulp = float(np.spacing(max(np.abs(points).max(), *np.abs(self.origin))))
        return max(_SNAP, _ULPS * ulp / float(np.hypot(*self.matrix).min()))

    def map_affine(self, window: "LatticeWindow", reference: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """Return the affine from (u, v) of a window to map coordinates [m].

        Parameters
        ----------
        window : LatticeWindow
        reference : (float, float) [m]
            Map point that the coordinates are relative to.

        Returns
        -------
        float64[6]
        """
        (a, b), (d, e) = self.matrix
        x = (self.origin[0] - reference[0]) + a * window.column + b * window.row
        y = (self.origin[1] - reference[1]) + d * window.column + e * window.row
        return np.array([a, b, x, d, e, y])

    def raster_affine(self, window: "LatticeWindow", grid: Grid) -> np.ndarray:
        """Return the affine from (u, v) of a window to fractional (row, column) of a raster, whole at pixel centres.

        Parameters
        ----------
        window : LatticeWindow
        grid : Grid
            Grid of the raster.

        Returns
        -------
        float64[6]
        """
        a, b, x, d, e, y = self.map_affine(window, (grid.transform.c, grid.transform.f))
        (ga, gb), (gd, ge) = grid.matrix
        det = ga * ge - gb * gd
        row = [(ga * d - gd * a) / det, (ga * e - gd * b) / det, (ga * y - gd * x) / det - 0.5]
        column = [(ge * a - gb * d) / det, (ge * b - gb * e) / det, (ge * x - gb * y) / det - 0.5]
        return np.array(row + column)


@dataclass(frozen=True)
class LatticeWindow:
    """The cells row <= r < row + rows, column <= c < column + columns of a lattice."""

    row: int
    column: int
    rows: int
    columns: int


@dataclass(frozen=True, eq=False)
class Outline:
    """A polygon in the coordinates of a window of a lattice, which has a margin of one cell around it.

    Parameters
    ----------
    lattice : Lattice
    window : LatticeWindow
    edges : float64[n, 4]
        u0, v0, u1, v1.
    orientation : float
        1 or -1, so that the covered area is positive.
    snap : float [cells]
        Ends of edges that are closer than this to a lattice line are on it.
    """

    lattice: Lattice
    window: LatticeWindow
    edges: np.ndarray
    orientation: float
    snap: float = _SNAP

    @classmethod
    def of(cls, polygon: shapely.Geometry, lattice: Lattice) -> "Outline":
        """Return the outline of a polygon.

        Parameters
        ----------
        polygon : Polygon or MultiPolygon [m]
            Valid.
        lattice : Lattice
        """
        rings = shapely.get_rings(shapely.get_parts(shapely.normalize(polygon)))
        points, ring = shapely.get_coordinates(rings, return_index=True)
        snap = lattice.snap(points)
        cells = _snapped(lattice.to_cells(points), snap)
        low = np.floor(cells.min(axis=0)).astype(int) - 1
        high = np.ceil(cells.max(axis=0)).astype(int) + 1
        window = LatticeWindow(int(low[1]), int(low[0]), int(high[1] - low[1]), int(high[0] - low[0]))
        cells = cells - low
        joined = ring[1:] == ring[:-1]
        edges = np.ascontiguousarray(np.hstack((cells[:-1][joined], cells[1:][joined])))
        area = 0.5 * np.sum((edges[:, 0] + edges[:, 2]) * (edges[:, 3] - edges[:, 1]))
        return cls(lattice, window, edges, -1.0 if area > 0 else 1.0, snap)

    def cover(self, across: int = 1, down: int = 1) -> Cover:
        """Return what the polygon covers of the lattice with every cell cut into sub-squares.

        Parameters
        ----------
        across, down : int
            Number of sub-squares along the cell's sides.
        """
        columns, rows = self.window.columns * across, self.window.rows * down
        fine = np.array([across, down, across, down], dtype=float)
        edges = _snapped(self.edges * fine, self.snap * fine)
        key, terms = polygon_cover.cut_edges(edges, columns)
        order = np.argsort(key, kind="stable")
        rim_key, rim, spans = polygon_cover.accumulate_cover(key, order, terms, columns, self.orientation)
        rim_start = polygon_cover.row_starts(rim_key // columns, rows)
        return Cover(rows, columns, rim_key, rim, rim_start, spans, polygon_cover.row_starts(spans[:, 0], rows))

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return which points lie inside the polygon.

        Parameters
        ----------
        points : float64[n, 2]
            (u, v) of the window.

        Returns
        -------
        bool[n]
        """
        return polygon_points.are_inside(np.ascontiguousarray(points), *self.binned_edges)

    def points_in_squares(self, corners: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Return a point inside the polygon in each square.

        Parameters
        ----------
        corners : float64[n, 2]
            Lower corners of the squares.
        sizes : float64[n, 2]
            Sides of the squares.

        Returns
        -------
        float64[n, 2]
            NaN where none is found.
        """
        corners, sizes = np.ascontiguousarray(corners), np.ascontiguousarray(sizes)
        return polygon_points.points_in_squares(corners, sizes, *self.binned_edges)

    @cached_property
    def binned_edges(self) -> Edges:
        """Edges by row of cells."""
        return Edges(self.edges, *polygon_points.edges_by_row(self.edges, self.window.rows))


def _snapped(values, snap):
    nearest = np.round(values)
    return np.where(np.abs(values - nearest) <= snap, nearest, values)
