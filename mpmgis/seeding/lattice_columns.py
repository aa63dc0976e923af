"""Columns on a lattice: whole cells tiled, rim cells cut exactly to the polygon."""

from functools import cached_property

import numpy as np
import shapely

from ..terrain.grid import Grid
from . import cell_fill, polygon_cover, polygon_points, rim_pieces
from .lattice import Lattice, Outline
from .part_scene import PartScene
from .polygon_cover import Cover

KINDS = {
    "lattice": cell_fill.CENTRED,
    "staggered": cell_fill.STAGGERED,
    "jittered": cell_fill.JITTERED,
    "random": cell_fill.RANDOM,
}
_REGULAR = 2.0  # [1] largest ratio of a tile's sides; beyond it the rows of a cell share the tiles unevenly


def tiling_rows(count: int, aspect: float) -> tuple[int, bool]:
    """Return how many rows of tiles cut a cell into equal tiles.

    It is the divisor that makes the tiles squarest; where all are longer than 2 : 1, rows share `count` unevenly.

    Parameters
    ----------
    count : int
        Number of tiles.
    aspect : float
        Height of the cell over its width.

    Returns
    -------
    rows : int
    regular : bool
        Whether all rows have the same number of tiles.
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
    """Number of particles of a cell, and its cut: ``n0 (1 + beta min(tan slope, 1))``.

    Parameters
    ----------
    n0, beta : float
    aspect : float
        Height of a cell over its width.
    """

    def __init__(self, n0: float, beta: float, aspect: float):
        self.n0, self.beta, self.aspect = float(n0), float(beta), aspect
        self.largest = int(n0) if beta == 0 else int(np.ceil(n0 * (1 + beta))) + 1
        lowest = int(n0) if beta == 0 else max(int(n0), 1)
        self.rows = np.ones(self.largest + 1, np.int64)
        for count in range(lowest, self.largest + 1):
            self.rows[count] = tiling_rows(count, aspect)[0]

    def cut(self, count: int) -> tuple[int, int]:
        """Return the regular cut of a rim cell that comes closest to a number of sub-squares.

        Parameters
        ----------
        count : int

        Returns
        -------
        across, down : int
            Number of sub-squares along the cell's sides.
        """
        down = int(self.rows[count])
        return max(1, round(count / down)), down


class LatticeColumns:
    """Columns of one polygon on a lattice, row of cells by row of cells.

    Parameters
    ----------
    polygon : Polygon or MultiPolygon [m]
    lattice : Lattice
    tiling : Tiling
    kind : str
        Arrangement in a cell, a key of KINDS.
    seed : int
        Of the random numbers.
    slope : (float64[rows, columns], Grid), optional
        tan of the slope, for refinement.
    forced : int
        So many of the smallest pieces at the rim are joined to others, whatever their size.

    Attributes
    ----------
    counts : int64[blocks]
        Number of columns in each row of cells.
    mergeable : int
        Number of pieces at the rim.
    joined : int
        Number of slivers that went into them.
    """

    def __init__(
        self,
        polygon: shapely.Geometry,
        lattice: Lattice,
        tiling: Tiling,
        kind: str,
        seed: int,
        slope: tuple[np.ndarray, Grid] | None = None,
        forced: int = 0,
    ):
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
            tiling.n0,
            tiling.beta,
            self._slope,
            self._slope_map,
            self.seed,
            self.window.row,
            self.window.column,
            tiling.largest,
        )

    def _slivers(self, cover: Cover, forced: int) -> np.ndarray:
        """Return which rim cells have pieces that may have to join others beyond the cell, bool[m]."""
        if self.tiling.beta or forced:  # cells of several levels, or pieces joined for their number's sake
            return np.ones(len(cover.rim_key), bool)
        across, down = self.tiling.cut(int(self.tiling.n0))
        fine = self._level(across, down)
        share = np.ascontiguousarray(fine.rim[:, 0])
        return rim_pieces.cells_with_slivers(cover.rim_key, cover.columns, fine.rim_key, share, across, down)

    def _level(self, across: int, down: int) -> Cover:
        """Return the Cover with every cell cut into sub-squares; it is kept until the pieces are cut."""
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
        alive = rim_pieces.merge_slivers(pieces, starts, near, self.window.columns, order, forced)
        self.mergeable, self.joined = int(alive.sum()), int((~alive).sum())
        self._pieces = owner[alive], pieces[alive], alone[alive], cut[alive]
        self.piece_start = polygon_cover.row_starts(near[owner[alive], 0], self.window.rows)
        self._levels.clear()

    def _cut(self, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return owner, pieces and sub-square sizes of all near cells; each number of particles has its own cut."""
        owners, pieces, cuts = [], [], []
        for count in np.unique(counts):
            across, down = self.tiling.cut(count)
            cells = np.flatnonzero(counts == count)
            cover = self._level(across, down)
            owner, piece = rim_pieces.gather_pieces(self._near[cells], across, down, cover)
            owners.append(cells[owner])
            pieces.append(piece)
            cuts.append(np.tile([1.0 / across, 1.0 / down], (len(piece), 1)))
        owner = np.concatenate([np.empty(0, np.int64), *owners])
        order = np.argsort(owner, kind="stable")
        return owner[order], np.vstack([np.empty((0, 5)), *pieces])[order], np.vstack([np.empty((0, 2)), *cuts])[order]

    @cached_property
    def piece(self) -> np.ndarray:
        """Columns of all pieces, inside the polygon: float64[n, 3], u, v, area [cells]."""
        owner, pieces, alone, cut = self._pieces
        self._keep_inside(pieces, alone, cut)
        if self.kind == cell_fill.RANDOM:
            self._scatter(owner, pieces, cut)
        return np.ascontiguousarray(pieces[:, :3])

    def _keep_inside(self, pieces: np.ndarray, alone: np.ndarray, cut: np.ndarray) -> None:
        """Move each centroid outside the polygon to a point of its piece inside.

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
    def count(self) -> int:
        """Number of columns in all."""
        return int(self.counts.sum())

    def fill(
        self,
        first: int,
        last: int,
        scene: PartScene,
        law: np.ndarray,
        position: np.ndarray | None = None,
        columns: np.ndarray | None = None,
        at: int = 0,
    ) -> np.ndarray:
        """Evaluate the rows first <= row < last; write their columns if `position` is given.

        Parameters
        ----------
        first, last : int
        scene : PartScene
        law : float64[3]
            As in Ground.
        position : float64[n, 3], optional [m]
            Filled, as in Output.
        columns : float64[4, n], optional
            Filled, as in Output.
        at : int
            Number of the first column in the arrays.

        Returns
        -------
        float64[last - first, 3]
            Sum, smallest and largest of thickness times area [m3] of each row.
        """
        offsets = at + np.concatenate(([0], np.cumsum(self.counts[first:last])))[:-1]
        write = position is not None
        if not write:
            position, columns = np.empty((0, 3)), np.empty((4, 0))
        return cell_fill.fill_rows(
            first,
            last,
            offsets,
            self.inner,
            self.inner_start,
            self.piece,
            self.piece_start,
            self._counting,
            cell_fill.Tiles(self.kind, self.tiling.rows, self.lattice.cell_area),
            scene.ground(self.lattice, self.window, law),
            cell_fill.Output(write, position, columns),
        )
