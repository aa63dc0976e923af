"""Columns on a lattice: whole cells tiled, rim cells cut exactly to the polygon.

Lattices, and what a polygon covers of them: exact areas and centroids, no supersampling.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from . import cell_fill, polygon_cover, polygon_points
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
        return polygon_points.inside(np.ascontiguousarray(points), *self.binned_edges)

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


KINDS = {
    "lattice": cell_fill.CENTRED,
    "staggered": cell_fill.STAGGERED,
    "jittered": cell_fill.JITTERED,
    "random": cell_fill.RANDOM,
}
_REGULAR = 2.0  # longest side over shortest that a regular tiling may have


def tiling_rows(count, aspect):
    """(rows, regular?): how many rows of tiles cut a cell of height over width `aspect` into `count` equal tiles.

    The divisor that makes the tiles squarest; where all are longer than 2 : 1, rows that share `count` unevenly.
    """
    small = np.arange(1, int(np.sqrt(count)) + 1)
    small = small[count % small == 0]
    divisors = np.unique(np.concatenate((small, count // small)))
    shape = np.abs(np.log(aspect * count / divisors.astype(float) ** 2))
    best = int(np.argmin(shape))
    if shape[best] <= np.log(_REGULAR) + 1e-12:
        return int(divisors[best]), True
    return int(min(max(round(np.sqrt(count * aspect)), 1), count)), False


class Tiling:
    """How many particles a cell gets, and how it is cut: ``n0 (1 + beta min(tan slope, 1))``."""

    def __init__(self, n0, beta, aspect):
        self.n0, self.beta, self.aspect = float(n0), float(beta), aspect
        self.largest = int(n0) if beta == 0 else int(np.ceil(n0 * (1 + beta))) + 1
        lowest = int(n0) if beta == 0 else max(int(n0), 1)
        self.rows = np.ones(self.largest + 1, np.int64)
        for count in range(lowest, self.largest + 1):
            self.rows[count] = tiling_rows(count, aspect)[0]

    def cut(self, count):
        """(across, down): the regular cut of a rim cell that comes closest to `count` sub-squares."""
        down = int(self.rows[count])
        return max(1, round(count / down)), down


class LatticeColumns:
    """The columns of one polygon on a lattice, row of cells by row of cells.

    `counts` int64[blocks] is the number of columns in each row; `mergeable` is the number of pieces at the rim,
    `joined` how many slivers went into them.
    """

    def __init__(self, polygon, lattice, tiling, kind, seed, slope=None, forced=0):
        self.lattice, self.tiling, self.kind, self.seed = lattice, tiling, KINDS[kind], int(seed)
        self.outline = Outline.of(polygon, lattice)
        self.window = self.outline.window
        self._levels = {}
        self._set_slope(slope)
        cover = self.outline.cover()
        share = np.ascontiguousarray(cover.rim[:, 0])
        self.inner, self._near = polygon_cover.split_cells(cover, share, self._slivers(cover, forced))
        self.inner_start = polygon_cover.row_starts(self.inner[:, 0], cover.rows)
        self._set_pieces(forced)
        inner_counts = cell_fill.count_rows(self.window.rows, self.inner, self.inner_start, self._counting)
        self.counts = inner_counts + np.diff(self.piece_start)

    def _set_slope(self, slope):
        """`slope` is None or (tan of the slope float64[rows, columns], its Grid)."""
        values, grid = slope if slope is not None else (np.zeros((2, 2)), None)
        self._slope = np.ascontiguousarray(values)
        self._slope_map = self.lattice.raster_affine(self.window, grid) if grid is not None else np.zeros(6)

    @property
    def _counting(self):
        tiling = self.tiling
        return cell_fill.Counting(
            tiling.n0, tiling.beta, self._slope, self._slope_map, self.seed, self.window.row, self.window.column,
            tiling.largest,
        )  # fmt: skip

    def _slivers(self, cover, forced):
        """bool[m]: rim cells whose pieces may have to join others beyond the cell."""
        if self.tiling.beta or forced:  # cells of several levels, or pieces joined for their number's sake
            return np.ones(len(cover.rim_key), bool)
        across, down = self.tiling.cut(int(self.tiling.n0))
        fine = self._level(across, down)
        share = np.ascontiguousarray(fine.rim[:, 0])
        return cell_fill.cells_with_slivers(cover.rim_key, cover.columns, fine.rim_key, share, across, down)

    def _level(self, across, down):
        """The Cover with every cell cut into `across` x `down` sub-squares, kept until the pieces are cut."""
        if (across, down) not in self._levels:
            self._levels[across, down] = self.outline.cover(across, down)
        return self._levels[across, down]

    def _set_pieces(self, forced):
        """Cut the cells at and near the rim, and join slivers."""
        near = self._near
        counts = cell_fill.cell_counts(near, self._counting)
        owner, pieces, cut = self._cut(counts)
        starts = polygon_cover.row_starts(owner, len(near))
        alone = pieces[:, :2].copy()
        order = np.argsort(pieces[:, 2], kind="stable")
        alive = cell_fill.merge_slivers(pieces, starts, near, self.window.columns, order, forced)
        self.mergeable, self.joined = int(alive.sum()), int((~alive).sum())
        self._pieces = owner[alive], pieces[alive], alone[alive], cut[alive]
        self.piece_start = polygon_cover.row_starts(near[owner[alive], 0], self.window.rows)
        self._levels.clear()

    def _cut(self, counts):
        """(owner, pieces, sub-square sizes) of all near cells; cells of another count are cut at another level."""
        owners, pieces, cuts = [], [], []
        for count in np.unique(counts):
            across, down = self.tiling.cut(count)
            cells = np.flatnonzero(counts == count)
            cover = self._level(across, down)
            owner, piece = cell_fill.gather_pieces(self._near[cells], across, down, cover)
            owners.append(cells[owner])
            pieces.append(piece)
            cuts.append(np.tile([1.0 / across, 1.0 / down], (len(piece), 1)))
        owner = np.concatenate([np.empty(0, np.int64), *owners])
        order = np.argsort(owner, kind="stable")
        return owner[order], np.vstack([np.empty((0, 5)), *pieces])[order], np.vstack([np.empty((0, 2)), *cuts])[order]

    @cached_property
    def piece(self):
        """float64[n, 3]: (u, v, area [cells]) of the columns of all pieces, inside the polygon."""
        owner, pieces, alone, cut = self._pieces
        self._keep_inside(pieces, alone, cut)
        if self.kind == cell_fill.RANDOM:
            self._scatter(owner, pieces, cut)
        return np.ascontiguousarray(pieces[:, :3])

    def _keep_inside(self, pieces, alone, cut):
        """A centroid outside the polygon goes to a point of its piece inside.

        `alone` float64[n, 2] are the centroids before slivers joined.
        """
        doubtful = np.flatnonzero(pieces[:, 4] >= 2)
        outside = doubtful[~self.outline.contains(pieces[doubtful, :2])]
        pieces[outside, :2] = alone[outside]
        outside = outside[~self.outline.contains(pieces[outside, :2])]
        if not len(outside):
            return
        corners = np.floor(pieces[outside, :2] / cut[outside]) * cut[outside]
        points = self.outline.points_in_squares(corners, cut[outside])
        found = np.isfinite(points[:, 0])
        pieces[outside[found], :2] = points[found]

    def _scatter(self, owner, pieces, cut):
        points = np.ascontiguousarray(pieces[:, :2])
        number = np.arange(len(owner)) - np.searchsorted(owner, owner)
        cell = self._near[owner]
        keys = np.column_stack((cell[:, 1] + self.window.column, cell[:, 0] + self.window.row, number))
        polygon_points.scatter_in_pieces(
            points, cut[:, 0].copy(), cut[:, 1].copy(), keys, self.seed, *self.outline.binned_edges
        )
        pieces[:, :2] = points

    @cached_property
    def count(self):
        """How many columns in all."""
        return int(self.counts.sum())

    def fill(self, first, last, scene, law, position=None, columns=None, at=0):
        """Evaluate the rows first <= row < last; write them from `at` on if `position` is given.

        `scene` is a `PartScene`; `law`, `position`, `columns` as in `Ground` and `Output`. Returns
        float64[last - first, 3]: sum, smallest and largest of thickness times area [m3].
        """
        offsets = at + np.concatenate(([0], np.cumsum(self.counts[first:last])))[:-1]
        write = position is not None
        if not write:
            position, columns = np.empty((0, 3)), np.empty((4, 0))
        return cell_fill.fill_rows(
            first, last, offsets, self.inner, self.inner_start, self.piece, self.piece_start, self._counting,
            cell_fill.Tiles(self.kind, self.tiling.rows, self.lattice.cell_area),
            scene.ground(self.lattice, self.window, law), cell_fill.Output(write, position, columns),
        )  # fmt: skip
