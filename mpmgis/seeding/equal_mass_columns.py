"""Columns of equal mass.

The release is cut into strips, each holding a whole number of column masses and about as high as its columns are
wide; each strip is cut across into pieces of one column mass. A piece's column lies at its centre of mass, so that
total and centroid are kept; other point sets move it within its piece (stratified inverse distribution function).
"""

from collections.abc import Callable

import numpy as np
import shapely

from ..terrain.grid import Grid
from . import cell_fill, random_numbers, strip_fill
from .lattice import Lattice, Outline
from .part_scene import PartScene

_FINER = 0.71  # [mean spacings of the columns] side of the cells on which the mass is summed
# Width of a column's displacement over its piece; jittered as far as the centroids of quads with displaced corners are.
# Strips share no cells whose columns could be staggered: such a set lies at the centres of mass like the lattice.
_SPREAD = {"lattice": 0.0, "staggered": 0.0, "jittered": 0.5 * cell_fill.JITTER, "halton": 1.0, "random": 1.0}


class EqualMassColumns:
    """Exactly `count` columns of equal mass in one polygon.

    Parameters
    ----------
    polygon : Polygon or MultiPolygon [m]
    count : int
    squares : callable
        (grid, side [m]) -> Lattice of squares.
    grid : Grid
        Grid of the DTM.
    scene : PartScene
    points : str
        Point set, as in SeedOptions.
    seed : int
        Of the random numbers.

    Attributes
    ----------
    counts : int64[blocks]
        Number of columns in each strip.
    area : float [m2]
        Area of the polygon.
    """

    def __init__(
        self,
        polygon: shapely.Geometry,
        count: int,
        squares: Callable[[Grid, float], Lattice],
        grid: Grid,
        scene: PartScene,
        points: str,
        seed: int,
    ):
        self.count, self.points, self.seed = int(count), points, int(seed)
        self.lattice = squares(grid, _FINER * float(np.sqrt(polygon.area / count)))
        self.outline = Outline.of(polygon, self.lattice)
        self.window = self.outline.window
        self.cover = self.outline.cover()
        self._keep_centroids_inside()
        self._shift = np.array([random_numbers.uniform(self.seed, 2, 0, 0), random_numbers.uniform(self.seed, 2, 0, 1)])
        self._set_strips(scene)
        self.area = polygon.area

    def _keep_centroids_inside(self):
        """Move the centroid of each rim piece that lies outside the polygon to a point of the piece inside."""
        rim, columns = self.cover.rim, self.cover.columns
        doubtful = np.flatnonzero(rim[:, 3] >= 2)
        corner = np.column_stack((self.cover.rim_key % columns, self.cover.rim_key // columns)).astype(float)
        outside = doubtful[~self.outline.contains(corner[doubtful] + rim[doubtful, 1:3])]
        if not len(outside):
            return
        points = self.outline.points_in_squares(corner[outside], np.ones((len(outside), 2)))
        found = np.isfinite(points[:, 0])
        rim[outside[found], 1:3] = points[found] - corner[outside[found]]

    def _set_strips(self, scene):
        """Set the borders of the strips [rows of cells] and the number of columns in each."""
        cover = self.cover
        sums = strip_fill.cover_row_sums(
            cover, scene.thickness, self.lattice.raster_affine(self.window, scene.thickness_grid)
        )
        mass, width = sums.T
        each = mass.sum() / self.count
        filled = mass > 0
        height = np.sqrt(each * width[filled] / mass[filled])  # of a square column at the row's mean thickness
        rows = np.zeros(cover.rows)
        rows[filled] = 1.0 / height
        edges = np.arange(cover.rows + 1.0)
        strips = np.concatenate(([0.0], np.cumsum(rows)))
        held = np.concatenate(([0.0], np.cumsum(mass)))
        number = max(round(strips[-1]), 1)
        tentative = _inverse(strips, edges, np.linspace(0.0, strips[-1], number + 1))
        whole = np.unique(np.round(np.interp(tentative, edges, held) / each).astype(int))
        whole = np.unique(np.concatenate(([0], np.clip(whole, 0, self.count), [self.count])))
        self._borders = _inverse(held, edges, whole * (held[-1] / self.count))
        self.counts = np.diff(whole)
        self._start = whole[:-1].copy()

    def fill(
        self,
        first: int,
        last: int,
        scene: PartScene,
        law: np.ndarray,
        position: np.ndarray,
        columns: np.ndarray,
        at: int = 0,
    ) -> None:
        """Write the columns of the strips first <= strip < last.

        Parameters
        ----------
        first, last : int
        scene : PartScene
        law : float64[3]
            As in Ground.
        position : float64[n, 3] [m]
            Filled, as in Output.
        columns : float64[4, n]
            Filled, as in Output.
        at : int
            Number of the first column in the arrays.
        """
        offsets = at + self._start[first:last] - self._start[first]
        strip_fill.fill_strips(
            first,
            last,
            offsets,
            strip_fill.Strips(self._borders, self.counts, self._start),
            strip_fill.Spread(_SPREAD[self.points], self.points == "halton", self.seed, self._shift),
            self.cover,
            self.outline.binned_edges,
            scene.ground(self.lattice, self.window, law),
            cell_fill.Output(True, position, columns),
        )


def _inverse(values: np.ndarray, edges: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return where piecewise linear, non-decreasing `values` at `edges` reach `wanted`.

    In flat parts this is the first place.
    """
    rising = np.concatenate(([True], np.diff(values) > 0))
    before = np.concatenate((np.diff(values) > 0, [False]))
    keep = rising | before
    return np.interp(wanted, _strictly(values[keep]), edges[keep])


def _strictly(values: np.ndarray) -> np.ndarray:
    """Return `values` made strictly increasing by the smallest difference that np.interp resolves."""
    return values + np.arange(len(values)) * (np.abs(values[-1]) * 1e-15)
