"""A lattice of cells on the map, and polygons in its coordinates."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from . import polygon_cover, polygon_points
from .polygon_cover import Cover
from .polygon_points import Edges

_SNAP = 1e-9  # [cells] edges this close to a lattice line lie on it, or as close as map coordinates round
_ULPS = 4.0  # units in the last place by which a map coordinate may be off


@dataclass(frozen=True, eq=False)
class Lattice:
    """Cells that tile the plane: cell (row, column) has its corner at ``origin + matrix @ (column, row)``.

    `origin` (x, y) [m]; `matrix` float64[2, 2], its columns the map vectors [m] of one step in column and in row.
    """

    origin: tuple
    matrix: np.ndarray

    @classmethod
    def squares(cls, origin, side, direction=(1.0, 0.0)):
        """Squares of `side` [m] whose rows run along `direction` (a unit vector)."""
        east, north = direction
        return cls(tuple(origin), side * np.array([[east, -north], [north, east]]))

    @classmethod
    def of_grid(cls, grid):
        """The pixels of a raster as cells."""
        return cls((grid.transform.c, grid.transform.f), grid.matrix)

    @cached_property
    def cell_area(self):
        """Plan area of a cell [m2]."""
        return abs(float(np.linalg.det(self.matrix)))

    @cached_property
    def aspect(self):
        """Height of a cell over its width [1]."""
        return float(np.hypot(*self.matrix[:, 1]) / np.hypot(*self.matrix[:, 0]))

    def to_cells(self, points):
        """float64[n, 2] lattice coordinates (u, v) of map points float64[n, 2] [m]."""
        (a, b), (d, e) = self.matrix
        x, y = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        det = a * e - b * d
        if b == 0.0 and d == 0.0:  # by division, so that points on lattice lines stay on them
            return np.column_stack((x / a, y / e))
        return np.column_stack(((e * x - b * y) / det, (a * y - d * x) / det))

    def snap(self, points):
        """Distance [cells] from a lattice line within which map points float64[n, 2] [m] lie on it."""
        ulp = float(np.spacing(max(np.abs(points).max(), *np.abs(self.origin))))
        return max(_SNAP, _ULPS * ulp / float(np.hypot(*self.matrix).min()))

    def map_affine(self, window, reference=(0.0, 0.0)):
        """Six numbers that take (u, v) of `window` to map coordinates [m] relative to `reference`."""
        (a, b), (d, e) = self.matrix
        x = (self.origin[0] - reference[0]) + a * window.column + b * window.row
        y = (self.origin[1] - reference[1]) + d * window.column + e * window.row
        return np.array([a, b, x, d, e, y])

    def raster_affine(self, window, grid):
        """Six numbers that take (u, v) of `window` to fractional (row, column) of `grid`, whole = pixel centre."""
        a, b, x, d, e, y = self.map_affine(window, (grid.transform.c, grid.transform.f))
        (ga, gb), (gd, ge) = grid.matrix
        det = ga * ge - gb * gd
        row = [(ga * d - gd * a) / det, (ga * e - gd * b) / det, (ga * y - gd * x) / det - 0.5]
        column = [(ge * a - gb * d) / det, (ge * b - gb * e) / det, (ge * x - gb * y) / det - 0.5]
        return np.array(row + column)


@dataclass(frozen=True)
class Window:
    """The cells row <= r < row + rows, column <= c < column + columns of a lattice."""

    row: int
    column: int
    rows: int
    columns: int


@dataclass(frozen=True, eq=False)
class Outline:
    """A polygon in the coordinates of a window of a lattice, which has a margin of one cell around it.

    `edges` float64[n, 4] (u0, v0, u1, v1); `orientation` 1 or -1 makes the covered area positive. Ends of edges within
    `snap` [cells] of a lattice line are on it.
    """

    lattice: Lattice
    window: Window
    edges: np.ndarray
    orientation: float
    snap: float = _SNAP

    @classmethod
    def of(cls, polygon, lattice):
        """The outline of a valid Polygon or MultiPolygon [m]."""
        rings = shapely.get_rings(shapely.get_parts(shapely.normalize(polygon)))
        points, ring = shapely.get_coordinates(rings, return_index=True)
        snap = lattice.snap(points)
        cells = _snapped(lattice.to_cells(points), snap)
        low = np.floor(cells.min(axis=0)).astype(int) - 1
        high = np.ceil(cells.max(axis=0)).astype(int) + 1
        window = Window(int(low[1]), int(low[0]), int(high[1] - low[1]), int(high[0] - low[0]))
        cells = cells - low
        joined = ring[1:] == ring[:-1]
        edges = np.ascontiguousarray(np.hstack((cells[:-1][joined], cells[1:][joined])))
        area = 0.5 * np.sum((edges[:, 0] + edges[:, 2]) * (edges[:, 3] - edges[:, 1]))
        return cls(lattice, window, edges, -1.0 if area > 0 else 1.0, snap)

    def cover(self, across=1, down=1):
        """What the polygon covers of the lattice with every cell cut into `across` x `down` sub-squares."""
        columns, rows = self.window.columns * across, self.window.rows * down
        fine = np.array([across, down, across, down], dtype=float)
        edges = _snapped(self.edges * fine, self.snap * fine)
        key, terms = polygon_cover.cut_edges(edges, columns)
        order = np.argsort(key, kind="stable")
        rim_key, rim, spans = polygon_cover.accumulate_cover(key, order, terms, columns, self.orientation)
        rim_start = polygon_cover.row_starts(rim_key // columns, rows)
        return Cover(rows, columns, rim_key, rim, rim_start, spans, polygon_cover.row_starts(spans[:, 0], rows))

    def contains(self, points):
        """bool[n]: which points float64[n, 2] in (u, v) of the window lie inside."""
        return polygon_points.are_inside(np.ascontiguousarray(points), *self.binned_edges)

    def points_in_squares(self, corners, sizes):
        """float64[n, 2]: a point inside the polygon in each square of lower corner and size float64[n, 2], or NaN."""
        corners, sizes = np.ascontiguousarray(corners), np.ascontiguousarray(sizes)
        return polygon_points.points_in_squares(corners, sizes, *self.binned_edges)

    @cached_property
    def binned_edges(self):
        """The Edges, by row of cells."""
        return Edges(self.edges, *polygon_points.edges_by_row(self.edges, self.window.rows))


def _snapped(values, snap):
    nearest = np.round(values)
    return np.where(np.abs(values - nearest) <= snap, nearest, values)
