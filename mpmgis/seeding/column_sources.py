"""Sources of columns: one for each release part, at the requested resolution.

Columns of equal mass (mode E), and columns at the points of Halton's sequence.

The release is cut into strips, each holding a whole number of column masses and about as high as its columns are
wide; each strip is cut across into pieces of one column mass. A piece's column lies at its centre of mass, so that
total and centroid are kept; other point sets move it within its piece (stratified inverse distribution function).
"""

import numpy as np

from ..system.errors import InputError
from ..terrain.release_parts import ThicknessRaster
from . import cell_fill, column_placements, random_numbers
from .lattice import Outline
from .lattice_columns import LatticeColumns, Tiling, tiling_rows
from .release_bed import integral

_FINER = 0.71  # side of the cells that the mass is summed on, over the columns' mean spacing
# Width of a column's displacement over its piece; jittered as far as the centroids of quads with displaced corners are.
# Strips share no cells whose columns could be staggered: such a set lies at the centres of mass like the lattice.
_SPREAD = {"lattice": 0.0, "staggered": 0.0, "jittered": 0.5 * cell_fill.JITTER, "halton": 1.0, "random": 1.0}
_CHUNK = 4096  # indices of the sequence
_CHUNKS_AT_ONCE = 256
_MOST_TRIES = 100_000  # indices a point: a region that fills less of its bounding box is no region for this point set
_BLOCK = 4  # sub-squares along a cell's side where spacing or count set the lattice: 4 x 4 to a cell
_TOLERANCE = 0.01  # of a requested count
_GOOD_ENOUGH = 0.004


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
        sums = column_placements.cover_row_sums(
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
        column_placements.fill_strips(
            first,
            last,
            offsets,
            column_placements.Strips(self._borders, self.counts, self._start),
            column_placements.Spread(_SPREAD[self.points], self.points == "halton", self.seed, self._shift),
            self.cover,
            self.outline.binned_edges,
            scene.ground(self.lattice, self.window, law),
            cell_fill.Output(True, position, columns),
        )


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
        sequence = column_placements.Sequence(
            self._shift, self._box, self.beta, self._slope, self._slope_map, self.seed, unit_area
        )
        return column_placements.halton_chunks(
            first,
            last,
            _CHUNK,
            np.asarray(quota),
            offsets,
            sequence,
            self.cover,
            self.outline.binned_edges,
            ground,
            cell_fill.Output(write, position, columns),
        )

    def fill(self, first, last, scene, law, position=None, columns=None, at=0):
        """As `LatticeColumns.fill`, over chunks of the sequence."""
        return self._chunks(first, last, self.counts, self._unit_area, scene, law, position, columns, at)[:, :3]


def column_sources(grid, release, deposits, scenes, slope, options):
    """A source of columns per release part: `counts` int64[blocks], `count`, and `fill` over a range of blocks.

    Parameters
    ----------
    grid : Grid
        Of the DTM.
    release : ReleaseArea
    deposits, scenes : lists of Deposit and PartScene, one a part
    slope : (float64[rows, columns], Grid) or None
        tan of the slope, for refinement.
    options : SeedOptions
    """
    polygons = release.polygons
    expected = options.expected(grid, release.area)
    if options.mass == "equal":
        shares = shared_out(expected, [deposit.volume for deposit in deposits])
        return [
            EqualMassColumns(polygon, n, options.squares, grid, scene, options.points, options.seed)
            for polygon, n, scene in zip(polygons, shares, scenes, strict=True)
        ]
    if options.points == "halton":
        mean = 1.0 if slope is None else 1.0 + options.refine_slope * _mean_steepness(slope, polygons)
        shares = shared_out(expected * (1.0 if options.count else mean), [polygon.area for polygon in polygons])
        return [
            HaltonColumns(polygon, n, options.cells(grid), options.refine_slope, slope, options.seed)
            for polygon, n in zip(polygons, shares, strict=True)
        ]
    return _lattice_sources(grid, polygons, slope, options, expected)


def shared_out(total, weights):
    """Whole numbers that sum to `total` (rounded) in proportion to `weights`, at least 1 each."""
    weights = np.asarray(weights, dtype=float)
    total = max(round(total), len(weights))
    wanted = (total - len(weights)) * weights / weights.sum()
    shares = np.floor(wanted).astype(int)
    largest = np.argsort(shares - wanted, kind="stable")[: total - len(weights) - shares.sum()]
    shares[largest] += 1
    return (shares + 1).tolist()


def _mean_steepness(slope, polygons):
    """Mean of min(tan slope, 1) over the polygons."""
    raster = ThicknessRaster(np.minimum(slope[0], 1.0), slope[1])
    totals = [integral(polygon, raster) for polygon in polygons]
    return sum(total for total, _, _ in totals) / sum(area for _, _, area in totals)


def _lattice_sources(grid, polygons, slope, options, expected):
    """Columns on the cells' own tiling, on a lattice of free spacing, or with the requested count."""
    beta = options.refine_slope

    def make(cells, n0, forced=None):
        tiling = Tiling(n0, beta, cells.aspect)
        forced = forced or [0] * len(polygons)
        return [
            LatticeColumns(polygon, cells, tiling, options.points, options.seed, slope, extra)
            for polygon, extra in zip(polygons, forced, strict=True)
        ]

    cells = options.cells(grid)
    if options.per_cell is not None:
        _require_regular(options, cells)
        return make(cells, options.per_cell)
    if beta:
        per_cell = expected / sum(polygon.area for polygon in polygons) * cells.cell_area
        if options.spacing is not None:
            return make(cells, per_cell)
        return _meet_count(lambda n0, forced=None: make(cells, n0, forced), per_cell, 1.0, options.count)
    if options.spacing is not None:
        return make(options.squares(grid, _BLOCK * options.spacing), _BLOCK**2)
    start = np.sqrt(sum(polygon.area for polygon in polygons) / options.count)
    return _meet_count(
        lambda spacing, forced=None: make(options.squares(grid, _BLOCK * spacing), _BLOCK**2, forced),
        start,
        -0.5,
        options.count,
    )


def _require_regular(options, cells):
    if options.points == "jittered" and not tiling_rows(options.per_cell, cells.aspect)[1]:
        raise InputError(
            f"jittered points need a cell that is cut regularly, {options.per_cell} a cell is not; use 4, 6, 9, 12, "
            "16 or 25"
        )


def _meet_count(make, start, power, wanted):
    """Sources whose columns number `wanted` within 1 %: `make(x)` has about const * x^(1 / power) of them.

    The rim makes the number jump, so secant steps are followed by a scan; where no lattice fits (few columns), the
    smallest pieces of one that has slightly more are joined to their neighbours.
    """
    tried = {}

    def number(x):
        if x not in tried:
            tried[x] = sum(source.count for source in make(x))
        return tried[x]

    x = start
    for _ in range(10):
        n = number(x)
        if abs(n - wanted) <= _GOOD_ENOUGH * wanted:
            return make(x)
        x *= (wanted / n) ** power
    best = min(tried, key=lambda x: abs(tried[x] - wanted))
    if abs(tried[best] - wanted) > _TOLERANCE * wanted:
        for share in np.linspace(0.85, 1.15, 41).tolist():
            number(best * share)
        best = min(tried, key=lambda x: abs(tried[x] - wanted))
    if abs(tried[best] - wanted) <= _TOLERANCE * wanted:
        return make(best)
    return _joined_to(make, tried, wanted)


def _joined_to(make, tried, wanted):
    """The smallest pieces joined until `wanted` columns are left."""
    more = [x for x in tried if tried[x] > wanted]
    best = min(more, key=lambda x: tried[x]) if more else min(tried, key=lambda x: abs(tried[x] - wanted))
    sources = make(best)
    extra = sum(source.count for source in sources) - wanted
    pieces = np.array([source.mergeable for source in sources])
    if extra > 0 and pieces.sum() > extra:
        shares = np.minimum(np.floor(extra * pieces / pieces.sum()).astype(int), pieces - 1)
        for i in np.argsort(-pieces):
            shares[i] += max(min(extra - shares.sum(), pieces[i] - 1 - shares[i]), 0)
        forced = [source.joined + int(share) for source, share in zip(sources, shares, strict=True)]
        sources = make(best, forced)
    got = sum(source.count for source in sources)
    if abs(got - wanted) > _TOLERANCE * wanted:
        raise InputError(
            f"--count {wanted} cannot be met within {100 * _TOLERANCE:g} % on this release; the nearest is {got}: ask "
            f"for that, or for more"
        )
    return sources
