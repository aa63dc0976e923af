"""Columns at the points of Halton's sequence."""

import numpy as np

from ..system.errors import InputError
from . import cell_fill, halton_fill, random_numbers
from .lattice import Outline

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
