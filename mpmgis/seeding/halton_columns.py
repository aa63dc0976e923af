"""Columns at the points of Halton's sequence, exactly as many as requested."""

import numpy as np
import shapely

from ..system.errors import InputError
from ..terrain.grid import Grid
from . import cell_fill, halton_fill, random_numbers
from .lattice import Lattice, Outline
from .part_scene import PartScene

_CHUNK = 4096  # indices of the sequence that one thread works on
_CHUNKS_AT_ONCE = 256  # [chunks] tried at least before a region is refused; a batch has up to 64 times as many
_MOST_TRIES = 100_000  # [indices a point] a region that needs more fills too little of its bounding box


class HaltonColumns:
    """Exactly `count` columns of one polygon, at points of Halton's sequence.

    Parameters
    ----------
    polygon : Polygon or MultiPolygon [m]
    count : int
    lattice : Lattice
        Its cells sort the plane into inside, outside and rim.
    beta : float
        Refinement on steep ground.
    slope : (float64[rows, columns], Grid) or None
        tan of the slope on its grid.
    seed : int
        Shifts the sequence (Cranley and Patterson 1976).

    Attributes
    ----------
    counts : int64[blocks]
        Number of columns from each chunk of the sequence.
    area : float [m2]
        Area of the polygon.

    Raises
    ------
    InputError
        The polygon fills too little of its bounding box.
    """

    def __init__(
        self,
        polygon: shapely.Geometry,
        count: int,
        lattice: Lattice,
        beta: float,
        slope: tuple[np.ndarray, Grid] | None,
        seed: int,
    ):
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
        sequence = halton_fill.HaltonSequence(
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
        """Evaluate the chunks first <= chunk < last of the sequence; write their columns if `position` is given.

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
            Sum, smallest and largest of thickness times area [m3] of each chunk.
        """
        return self._chunks(first, last, self.counts, self._unit_area, scene, law, position, columns, at)[:, :3]
