"""Columns of equal mass (mode E), and columns at the points of Halton's sequence.

The release is cut into strips, each holding a whole number of column masses and about as high as its columns are
wide; each strip is cut across into pieces of one column mass. A piece's column lies at its centre of mass, so that
total and centroid are kept; other point sets move it within its piece (stratified inverse distribution function).
"""

import numpy as np

from ..errors import InputError
from ..kernels import cell_fill, equal_mass_fill, halton_fill, random_numbers
from .cover import Outline

_FINER = 0.71  # side of the cells that the mass is summed on, over the columns' mean spacing
# Width of a column's displacement over its piece; jittered as far as the centroids of quads with displaced corners are.
# Strips share no cells whose columns could be staggered: such a set lies at the centres of mass like the lattice.
_SPREAD = {"lattice": 0.0, "staggered": 0.0, "jittered": 0.5 * cell_fill.JITTER, "halton": 1.0, "random": 1.0}


class EqualMassColumns:
    """Exactly `count` columns of one polygon; `counts` int64[blocks] is the number in each strip.

    Parameters
    ----------
    polygon : Polygon or MultiPolygon [m]
    count : int
    squares : callable (grid, side) -> Lattice
    grid : Grid
        Of the DTM.
    scene : PartScene
    points : str
    seed : int
    """

    def __init__(self, polygon, count, squares, grid, scene, points, seed):
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
        """Rim pieces whose centroid lies outside the polygon get one of their points inside instead."""
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
        """Borders of the strips [rows of cells] and how many columns each holds."""
        cover = self.cover
        sums = equal_mass_fill.cover_row_sums(
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

    def fill(self, first, last, scene, law, position, columns, at=0):
        """Write the columns of the strips first <= strip < last from `at` on."""
        offsets = at + self._start[first:last] - self._start[first]
        equal_mass_fill.fill_strips(
            first, last, offsets, equal_mass_fill.Strips(self._borders, self.counts, self._start),
            equal_mass_fill.Spread(_SPREAD[self.points], self.points == "halton", self.seed, self._shift), self.cover,
            self.outline.binned_edges, scene.ground(self.lattice, self.window, law),
            cell_fill.Output(True, position, columns),
        )  # fmt: skip


def _inverse(values, edges, wanted):
    """Where piecewise linear, non-decreasing `values` at `edges` reach `wanted` (the first place, inside flat
    parts)."""
    rising = np.concatenate(([True], np.diff(values) > 0))
    before = np.concatenate((np.diff(values) > 0, [False]))
    keep = rising | before
    return np.interp(wanted, _strictly(values[keep]), edges[keep])


def _strictly(values):
    """`values` made strictly increasing by the smallest difference that np.interp resolves."""
    return values + np.arange(len(values)) * (np.abs(values[-1]) * 1e-15)


_CHUNK = 4096  # indices of the sequence
_CHUNKS_AT_ONCE = 256
_MOST_TRIES = 100_000  # indices a point: a region that fills less of its bounding box is no region for this point set


class HaltonColumns:
    """Exactly `count` columns of one polygon; `counts` int64[blocks] is the number from each chunk of the sequence.

    Parameters
    ----------
    polygon : Polygon or MultiPolygon [m]
    count : int
    lattice : Lattice
        Its cells sort the plane into inside, outside and rim.
    beta, slope
        Refinement on steep ground: beta, and (tan of the slope, Grid) or None.
    seed : int
        Shifts the sequence (Cranley and Patterson 1976).
    """

    def __init__(self, polygon, count, lattice, beta, slope, seed):
        self.count, self.lattice, self.beta, self.seed = int(count), lattice, float(beta), int(seed)
        self.outline = Outline.of(polygon, lattice)
        self.cover = self.outline.cover()
        self.window = self.outline.window
        ends = self.outline.edges.reshape(-1, 2)
        low, size = ends.min(axis=0), np.ptp(ends, axis=0)
        self._box = np.concatenate((low, size))
        self._shift = np.array([random_numbers.uniform(self.seed, 1, 0, 0), random_numbers.uniform(self.seed, 1, 0, 1)])
        values, grid = slope if slope is not None else (np.zeros((2, 2)), None)
        self._slope = np.ascontiguousarray(values)
        self._slope_map = lattice.raster_affine(self.window, grid) if grid is not None else np.zeros(6)
        self._count_chunks(polygon.area)
        self.area = polygon.area

    def _count_chunks(self, area):
        """Count inside points chunk by chunk until there are enough; the last chunk gives what is still missing."""
        most = max(_MOST_TRIES * self.count // _CHUNK, _CHUNKS_AT_ONCE)
        counts, weights, found = [], [], 0
        while found < self.count:
            first = len(counts)
            if first > most:
                raise InputError("release: too thin a band for halton points; use --points lattice")
            expected = (self.count - found) * self._box[2] * self._box[3] * self.lattice.cell_area / area / _CHUNK
            batch = int(min(max(1.1 * expected, 1), _CHUNKS_AT_ONCE * 64)) + 1
            sums = self._chunks(first, first + batch, np.full(first + batch, _CHUNK), 1.0)
            counts.extend(sums[:, 3].astype(int).tolist())
            weights.extend(sums[:, 4].tolist())
            found += int(sums[:, 3].sum())
        ends = np.cumsum(counts)
        last = int(np.searchsorted(ends, self.count))
        self.counts = np.array(counts[: last + 1])
        self.counts[last] -= int(ends[last]) - self.count
        weights = weights[:last] + self._chunks(last, last + 1, self.counts, 1.0)[:, 4].tolist()
        self._unit_area = area / sum(weights)

    def _chunks(self, first, last, quota, unit_area, scene=None, law=None, position=None, columns=None, at=0):
        offsets = np.zeros(last - first, np.int64)
        write = position is not None
        if write:
            offsets[1:] = np.cumsum(self.counts[first:last])[:-1]
            offsets += at
        else:
            position, columns, law = np.empty((0, 3)), np.empty((4, 0)), np.zeros(3)
        flat, nowhere = np.ones((2, 2)), np.zeros(6)
        ground = cell_fill.Ground(nowhere, flat, nowhere, flat, nowhere, law)
        if scene is not None:
            ground = scene.ground(self.lattice, self.window, law)
        sequence = halton_fill.Sequence(
            self._shift, self._box, self.beta, self._slope, self._slope_map, self.seed, unit_area
        )
        return halton_fill.halton_chunks(
            first, last, _CHUNK, np.asarray(quota), offsets, sequence, self.cover, self.outline.binned_edges, ground,
            cell_fill.Output(write, position, columns),
        )  # fmt: skip

    def fill(self, first, last, scene, law, position=None, columns=None, at=0):
        """As `LatticeColumns.fill`, over chunks of the sequence."""
        return self._chunks(first, last, self.counts, self._unit_area, scene, law, position, columns, at)[:, :3]
