"""Runout distances along a line, and the common centre line of two flows.

Summaries of a footprint for its comparison with a mapped outline: areas along the flow path, and the runout.

The path is divided into bands of equal length. The area covered in each band to the left and to the right of the path,
and the farthest position along it, vary smoothly with the parameters of a flow, which missed and over-covered areas do
not: these have a kink where the model agrees with the outline.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from affine import Affine
from scipy import ndimage, sparse, spatial
from scipy.sparse import csgraph

from ..terrain.grid import Grid

_LINE_CELLS = 40_000  # largest number of footprint cells for the centre line search
_LINE_PIECES = 40
_PIECE_CELLS = 8  # shortest piece of the centre line, in cells
_SMALLEST_PART = 0.1  # of the largest part; smaller separate parts are ignored as splashes
_HIGHEST_SHARE = 0.01  # of the drop height: cells within it are the highest
BANDS = 6
SIDES = ("left", "right")


class Runout(NamedTuple):
    """Reach of a footprint: `distance` [m] along the line to its farthest cell, with centre (`x`, `y`) [m]."""

    distance: float
    x: float
    y: float


def positions_along(line: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """float64[k]: distance [m] from the start of `line` to the point on it nearest to each (x, y).

    The line is extended straight at both ends: positions before the start are negative, positions beyond the end
    exceed its length.

    Parameters
    ----------
    line : float[n, 2] [m]
        Vertices, n at least 2.
    x, y : float[k] [m]
    """
    line = np.asarray(line, float)
    points = np.column_stack([x, y])
    path = shapely.LineString(line)
    along = shapely.line_locate_point(path, shapely.points(points))
    for end, before, sign in ((line[-1], line[-2], 1.0), (line[0], line[1], -1.0)):
        direction = (end - before) / np.linalg.norm(end - before)
        beyond = (points - end) @ direction
        at_end = along >= path.length * (1 - 1e-12) if sign > 0 else along <= path.length * 1e-12
        along = np.where(at_end & (beyond > 0), along + sign * beyond, along)
    return along


def runout(mask: np.ndarray, grid: Grid, line: np.ndarray) -> Runout | None:
    """Runout of the True cells of `mask` on `grid` along `line`, to cell centres; None without True cells."""
    row, column = np.nonzero(mask)
    if row.size == 0:
        return None
    x, y = grid.xy(row, column)
    along = positions_along(line, x, y)
    farthest = int(np.argmax(along))
    return Runout(float(along[farthest]), float(x[farthest]), float(y[farthest]))


def up_to(line: np.ndarray, distance: float) -> np.ndarray:
    """float64[n, 2]: `line` from its start to `distance` [m] (above 0), cut there or extended straight."""
    line = np.asarray(line, float)
    along = vertex_distances(line)
    last = min(int(np.searchsorted(along, distance)), len(line) - 1)
    direction = (line[last] - line[last - 1]) / (along[last] - along[last - 1])
    return np.vstack([line[:last], line[last - 1] + (distance - along[last - 1]) * direction])


def vertex_distances(line: np.ndarray) -> np.ndarray:
    """float64[n]: distance [m] of each vertex of `line` from its start, along it."""
    return np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(np.asarray(line, float), axis=0), axis=1))]


def places_along(line: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(x, y) float64[k] [m] of the points at the distances `along` [m] from the start of `line`.

    Inverse of `positions_along`; the line is extended straight at both ends.
    """
    line, along = np.asarray(line, float), np.asarray(along, float)
    vertices = vertex_distances(line)
    piece = np.clip(np.searchsorted(vertices, along, side="right") - 1, 0, len(line) - 2)
    direction = (line[piece + 1] - line[piece]) / (vertices[piece + 1] - vertices[piece])[:, None]
    return tuple((line[piece] + (along - vertices[piece])[:, None] * direction).T)


def distance_to_line(line: np.ndarray, mask: np.ndarray, grid: Grid) -> float:
    """Distance [m] from `line` to the nearest centre of a True cell; infinite without True cells."""
    row, column = np.nonzero(mask)
    if row.size == 0:
        return math.inf
    return float(shapely.distance(shapely.LineString(line), shapely.MultiPoint(np.column_stack(grid.xy(row, column)))))


def centre_line(masks: Sequence, weights: Sequence, elevation: np.ndarray, grid: Grid) -> np.ndarray | None:
    """Common centre line of two flows: float64[n, 2] [m], from the highest part of their footprints downwards.

    Distances are path lengths within the union of the footprints, from its highest part (the middle of the cells
    within 1 % of the drop). Bands of equal distance are replaced by their centres, weighted by thickness, with equal
    weight of both results; this approximates a line drawn by hand along the thalweg. Separate parts of the union
    (from frames far apart in time) of at least a tenth of the largest are joined by the shortest connections.

    Parameters
    ----------
    masks : sequence of bool[rows, columns]
    weights : sequence of float[rows, columns]
        One for each mask, of any unit; NaN counts as 0.
    elevation : float[rows, columns] [m]
    grid : Grid
        Grid of all arrays.

    Returns
    -------
    float64[n, 2] or None
        None without elevations, or with fewer than two points.
    """
    weight = sum(_share(mask, weight) for mask, weight in zip(masks, weights, strict=True))
    cut = max(1, math.ceil(math.sqrt(np.count_nonzero(weight) / _LINE_CELLS)))
    weight, elevation = _blocks(weight, cut, np.sum), _blocks(elevation, cut, _mean)
    grid = Grid(grid.crs, grid.transform * Affine.scale(cut), weight.shape)
    main, parts = _large_parts(weight > 0)
    start = _highest(main, weight, elevation, grid)
    if start is None:
        return None
    row, column = np.nonzero(main)
    distance = _distance_within(main, grid, start, _bridges(parts[main], grid.xy(row, column)))
    return _through_bands(start, np.column_stack(grid.xy(row, column)), distance, weight[main], grid.cell_size)


def _share(mask, weight):
    """`weight` within `mask`, divided by its mean there; 0 elsewhere."""
    weight = np.where(mask, np.nan_to_num(weight, nan=0.0), 0.0)
    total = weight.sum()
    return weight * (np.count_nonzero(mask) / total) if total > 0 else weight


def _blocks(values, cut, of):
    """Blocks of `cut` x `cut` values reduced with `of` (over the last axis); incomplete blocks are filled with NaN."""
    if cut == 1:
        return values
    rows, columns = (-(-n // cut) * cut for n in values.shape)
    filled = np.full((rows, columns), np.nan)
    filled[: values.shape[0], : values.shape[1]] = values
    blocks = filled.reshape(rows // cut, cut, columns // cut, cut).swapaxes(1, 2).reshape(rows // cut, -1, cut * cut)
    return of(blocks if of is not np.sum else np.nan_to_num(blocks), axis=-1)


def _mean(blocks, axis):
    """Mean of the finite values along the last axis; NaN without finite values."""
    known = np.isfinite(blocks)
    count = known.sum(axis=axis)
    return np.where(count > 0, np.where(known, blocks, 0.0).sum(axis=axis) / np.maximum(count, 1), np.nan)


def _large_parts(mask):
    """(large connected parts of `mask`, with 8 neighbours; number of the part of each cell)."""
    labels, count = ndimage.label(mask, structure=np.ones((3, 3)))
    if count <= 1:
        return mask, labels
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return mask & (sizes >= _SMALLEST_PART * sizes.max())[labels], labels


def _bridges(parts, places):
    """(cells, cells, lengths [m]) of the shortest links that join all `parts` [k], with cells at `places`."""
    joined, left = parts == parts[0], list(dict.fromkeys(parts[parts != parts[0]]))
    places, found = np.column_stack(places), []
    while left:
        tree, known = spatial.cKDTree(places[joined]), np.flatnonzero(joined)
        nearest = []
        for part in left:
            cells = np.flatnonzero(parts == part)
            distance, other = tree.query(places[cells])
            k = int(np.argmin(distance))
            nearest.append((float(distance[k]), int(cells[k]), int(known[other[k]]), part))
        length, cell, other, part = min(nearest)
        found.append((other, cell, length))
        joined |= parts == part
        left.remove(part)
    return tuple(np.array(column) for column in zip(*found, strict=True)) if found else ()


def _highest(mask, weight, elevation, grid):
    """(x, y) [m] of the cell nearest to the middle of the highest cells; None without elevations."""
    known = mask & np.isfinite(elevation)
    if not known.any():
        return None
    top, bottom = elevation[known].max(), elevation[known].min()
    row, column = np.nonzero(known & (elevation >= top - _HIGHEST_SHARE * (top - bottom)))
    middle = np.average(np.column_stack([row, column]), axis=0, weights=weight[row, column])
    at = int(np.argmin((row - middle[0]) ** 2 + (column - middle[1]) ** 2))
    return np.array(grid.xy(row[at], column[at]))


def _distance_within(mask, grid, start, bridges=()):
    """float[k]: length [m] of the shortest path from `start` to each True cell, from cell to cell in 16 directions.

    `bridges` are additional links between cells (`_bridges`).
    """
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(np.count_nonzero(mask))
    begins, ends, lengths = [], [], []
    for step in ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1)):
        before, after = _shifted(number, step)
        linked = (before >= 0) & (after >= 0)
        begins.append(before[linked])
        ends.append(after[linked])
        lengths.append(np.full(np.count_nonzero(linked), np.linalg.norm(grid.matrix @ step[::-1])))
    if bridges:
        begins, ends, lengths = ([*own, more] for own, more in zip((begins, ends, lengths), bridges, strict=True))
    count = np.count_nonzero(mask)
    links = (np.concatenate(lengths), (np.concatenate(begins), np.concatenate(ends)))
    graph = sparse.coo_matrix(links, shape=(count, count)).tocsr()
    row, column = (round(float(v)) for v in grid.rowcol(*start))
    return csgraph.dijkstra(graph, directed=False, indices=int(number[row, column]))


def _shifted(number, step):
    """Views of `number` on each cell and on the cell at the offset `step` (rows, columns)."""
    down, right = step
    rows, columns = number.shape
    before = number[: rows - down, max(-right, 0) : columns - max(right, 0)]
    after = number[down:, max(right, 0) : columns - max(-right, 0)]
    return before, after


def _through_bands(start, places, distance, weight, cell_size):
    """The line from `start` through the weighted centres of bands of equal distance, smoothed once."""
    reach = distance[np.isfinite(distance)].max(initial=0.0)
    pieces = int(np.clip(reach / (_PIECE_CELLS * cell_size), 1, _LINE_PIECES))
    if reach <= 0:
        return None
    band = np.minimum(distance / reach * pieces, pieces - 1).astype(int)
    total = np.bincount(band, weight, pieces)
    there = total > 0
    centres = np.column_stack([np.bincount(band, weight * places[:, k], pieces)[there] for k in (0, 1)])
    centres /= total[there, None]
    if len(centres) > 2:
        centres[1:-1] = 0.25 * centres[:-2] + 0.5 * centres[1:-1] + 0.25 * centres[2:]
    line = np.vstack([start, centres])
    apart = np.r_[True, np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-9 * cell_size]
    return line[apart] if np.count_nonzero(apart) > 1 else None


@dataclass(frozen=True)
class PathBands:
    """Cells of a grid by band along a path and side of it.

    Parameters
    ----------
    place : int64[rows, columns]
        Band times 2, plus 1 to the right of the path; -1 where no flow is compared.
    along : float64[rows, columns] [m]
        Position along the path; NaN where no flow is compared.
    edges : float64[BANDS + 1] [m]
        Along the path.
    cell_area, cell_size : float [m2], [m]
    """

    place: np.ndarray
    along: np.ndarray
    edges: np.ndarray
    cell_area: float
    cell_size: float

    @classmethod
    def of(cls, line: np.ndarray, grid: Grid, compared: np.ndarray) -> "PathBands":
        """For the cells that are True in `compared` (bool[rows, columns]); `line` is float64[n, 2] [m]."""
        row, column = np.nonzero(compared)
        x, y = grid.xy(row, column)
        at = positions_along(line, x, y)
        edges = np.linspace(at.min(), at.max() + 0.5 * grid.cell_size, BANDS + 1)
        band = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, BANDS - 1)
        step = 0.5 * grid.cell_size
        (x0, y0), (x1, y1) = places_along(line, at - step), places_along(line, at + step)
        right = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) < 0
        place = np.full(grid.shape, -1)
        place[row, column] = 2 * band + right
        along = np.full(grid.shape, np.nan)
        along[row, column] = at
        return cls(place, along, edges, grid.cell_area, grid.cell_size)

    @property
    def names(self) -> list[str]:
        """Names of the summaries of `of_mask`."""
        areas = [f"area_{k + 1}_{side}" for k in range(BANDS) for side in SIDES]
        return [*areas, "runout"]

    def of_mask(self, mask: np.ndarray) -> np.ndarray:
        """float64[2 BANDS + 1]: covered areas [m2] and runout [m] of a footprint bool[rows, columns]."""
        inside = mask & (self.place >= 0)
        areas = np.bincount(self.place[inside], minlength=2 * BANDS) * self.cell_area
        runout = self.along[inside].max() if inside.any() else self.edges[0]
        return np.r_[areas, runout]

    def of_volume(self, thickness: np.ndarray) -> np.ndarray:
        """float64[BANDS] [m3] of a vertical `thickness` float[rows, columns] [m], NaN counts as 0."""
        inside = (self.place >= 0) & np.isfinite(thickness)
        volumes = np.bincount(self.place[inside] // 2, thickness[inside], minlength=BANDS)
        return volumes * self.cell_area

    def deviations(self, smaller: np.ndarray, larger: np.ndarray, error: float) -> np.ndarray:
        """float64[2 BANDS + 1]: standard deviations of the summaries of an outline with an error of position [m].

        Half the difference of the summaries of the outline moved inwards (`smaller`) and outwards (`larger`) by the
        error; at least an edge of the length of a band that is displaced by it.
        """
        half = 0.5 * np.abs(self.of_mask(larger) - self.of_mask(smaller))
        least = np.r_[np.full(2 * BANDS, error * (self.edges[1] - self.edges[0])), np.hypot(error, self.cell_size / 2)]
        return np.maximum(half, least)
