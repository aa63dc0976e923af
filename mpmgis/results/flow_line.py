"""Measure distances and places along a line: runout, and the common centre line of two flows."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from affine import Affine
from scipy import ndimage, sparse, spatial
from scipy.sparse import csgraph

from ..system.errors import InputError
from ..system.messages import log
from ..system.option import PathLike
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from ..terrain.observations import read_line

_LINE_CELLS = 40_000  # largest number of footprint cells for the centre line search
_LINE_PIECES = 40  # most pieces of the centre line: bands of equal distance
_PIECE_CELLS = 8  # [cells] shortest piece of the centre line
_SMALLEST_PART = 0.1  # [1] of the largest part; smaller separate parts are ignored as splashes
CENTRE_LINE = "centre line of the flow"
_HIGHEST_SHARE = 0.01  # [1] of the drop height: cells within it are the highest


class Runout(NamedTuple):
    """Reach of a footprint: `distance` [m] along the line to its farthest cell, with centre (`x`, `y`) [m]."""

    distance: float
    x: float
    y: float


def positions_along(line: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the distance from the start of `line` to the point on it nearest to each (x, y).

    The line is extended straight at both ends: positions before the start are negative, positions beyond the end
    exceed its length.

    Parameters
    ----------
    line : float[n, 2] [m]
        Vertices, n at least 2.
    x, y : float[k] [m]

    Returns
    -------
    float64[k] [m]
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
    """Return the runout of the True cells of a mask along a line, to cell centres; None without True cells.

    Parameters
    ----------
    mask : bool[rows, columns]
    grid : Grid
        Of the mask.
    line : float[n, 2] [m]

    Returns
    -------
    Runout or None
    """
    row, column = np.nonzero(mask)
    if row.size == 0:
        return None
    x, y = grid.xy(row, column)
    along = positions_along(line, x, y)
    farthest = int(np.argmax(along))
    return Runout(float(along[farthest]), float(x[farthest]), float(y[farthest]))


def line_up_to(line: np.ndarray, distance: float) -> np.ndarray:
    """Return a line from its start to a distance, cut there or extended straight.

    Parameters
    ----------
    line : float[n, 2] [m]
    distance : float [m]
        Above 0.

    Returns
    -------
    float64[n, 2] [m]
    """
    line = np.asarray(line, float)
    along = vertex_distances(line)
    last = min(int(np.searchsorted(along, distance)), len(line) - 1)
    direction = (line[last] - line[last - 1]) / (along[last] - along[last - 1])
    return np.vstack([line[:last], line[last - 1] + (distance - along[last - 1]) * direction])


def vertex_distances(line: np.ndarray) -> np.ndarray:
    """Return the distance of each vertex of a line from its start, along it.

    Parameters
    ----------
    line : float[n, 2] [m]

    Returns
    -------
    float64[n] [m]
    """
    return np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(np.asarray(line, float), axis=0), axis=1))]


def places_along(line: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates of the points at distances from the start of a line.

    Inverse of `positions_along`; the line is extended straight at both ends.

    Parameters
    ----------
    line : float[n, 2] [m]
    along : float[k] [m]
        Distances along the line.

    Returns
    -------
    (float64[k], float64[k]) [m]
        x and y.
    """
    line, along = np.asarray(line, float), np.asarray(along, float)
    vertices = vertex_distances(line)
    piece = np.clip(np.searchsorted(vertices, along, side="right") - 1, 0, len(line) - 2)
    direction = (line[piece + 1] - line[piece]) / (vertices[piece + 1] - vertices[piece])[:, None]
    return tuple((line[piece] + (along - vertices[piece])[:, None] * direction).T)


def distance_to_line(line: np.ndarray, mask: np.ndarray, grid: Grid) -> float:
    """Return the distance [m] from a line to the nearest centre of a True cell; infinite without True cells.

    Parameters
    ----------
    line : float[n, 2] [m]
    mask : bool[rows, columns]
    grid : Grid
    """
    row, column = np.nonzero(mask)
    if row.size == 0:
        return math.inf
    return float(shapely.distance(shapely.LineString(line), shapely.MultiPoint(np.column_stack(grid.xy(row, column)))))


def centre_line(masks: Sequence, weights: Sequence, elevation: np.ndarray, grid: Grid) -> np.ndarray | None:
    """Find the common centre line of two flows, from the highest part of their footprints downwards.

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


def _blocks(values: np.ndarray, cut: int, of: Callable) -> np.ndarray:
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


def _highest(mask: np.ndarray, weight: np.ndarray, elevation: np.ndarray, grid: Grid) -> np.ndarray | None:
    """(x, y) [m] of the cell nearest to the middle of the highest cells; None without elevations."""
    known = mask & np.isfinite(elevation)
    if not known.any():
        return None
    top, bottom = elevation[known].max(), elevation[known].min()
    row, column = np.nonzero(known & (elevation >= top - _HIGHEST_SHARE * (top - bottom)))
    middle = np.average(np.column_stack([row, column]), axis=0, weights=weight[row, column])
    at = int(np.argmin((row - middle[0]) ** 2 + (column - middle[1]) ** 2))
    return np.array(grid.xy(row[at], column[at]))


def _distance_within(mask: np.ndarray, grid: Grid, start: np.ndarray, bridges: tuple = ()) -> np.ndarray:
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


def _through_bands(
    start: np.ndarray, places: np.ndarray, distance: np.ndarray, weight: np.ndarray, cell_size: float
) -> np.ndarray | None:
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


class Place(NamedTuple):
    """A point of the flow: distance `along` the line, map position (`x`, `y`), elevation `z`, all [m]."""

    along: float
    x: float
    y: float
    z: float


def highest_place(mask: np.ndarray, elevation: np.ndarray, grid: Grid, line: np.ndarray) -> Place | None:
    """Return the Place of the highest True cell with an elevation; None without such a cell.

    Parameters
    ----------
    mask : bool[rows, columns]
    elevation : float64[rows, columns] [m]
        NaN if unknown.
    grid : Grid
    line : float[n, 2] [m]
    """
    return _place(np.where(mask & np.isfinite(elevation), elevation, -np.inf), elevation, grid, line)


def farthest_place(mask: np.ndarray, elevation: np.ndarray, grid: Grid, line: np.ndarray) -> Place | None:
    """Return the Place of the True cell with an elevation farthest along a line; None without such a cell.

    Parameters
    ----------
    mask : bool[rows, columns]
    elevation : float64[rows, columns] [m]
        NaN if unknown.
    grid : Grid
    line : float[n, 2] [m]
    """
    there = mask & np.isfinite(elevation)
    along = np.full(mask.shape, -np.inf)
    along[there] = positions_along(line, *grid.xy(*np.nonzero(there)))
    return _place(along, elevation, grid, line)


def _place(score: np.ndarray, elevation: np.ndarray, grid: Grid, line: np.ndarray) -> Place | None:
    at = np.unravel_index(np.argmax(score), score.shape)
    if score[at] == -np.inf:
        return None
    x, y = (float(value) for value in grid.xy(*at))
    return Place(float(positions_along(line, [x], [y])[0]), x, y, float(elevation[at]))


def heights_under(mask: np.ndarray, grid: Grid, terrain: Terrain) -> np.ndarray:
    """Return the elevation of the terrain under the True cells of a mask; NaN elsewhere.

    Parameters
    ----------
    mask : bool[rows, columns]
    grid : Grid
    terrain : Terrain

    Returns
    -------
    float64[rows, columns] [m]
    """
    elevation = np.full(grid.shape, np.nan)
    elevation[mask] = terrain.sample(*grid.xy(*np.nonzero(mask)))
    return elevation


def ends_along(
    mask: np.ndarray, elevation: np.ndarray, grid: Grid, line: np.ndarray
) -> tuple[Place | None, Place | None]:
    """Return the highest Place and the farthest Place along `line` of the True cells; each None if missing.

    `runout` and `compare` measure the runout between them: horizontally, along the line, between cell centres.

    Parameters
    ----------
    mask : bool[rows, columns]
        Cells with flow.
    elevation : float64[rows, columns] [m]
        NaN if unknown; such cells are ignored.
    grid : Grid
    line : float[n, 2] [m]

    Returns
    -------
    (Place or None, Place or None)
    """
    return highest_place(mask, elevation, grid, line), farthest_place(mask, elevation, grid, line)


def line_profile(
    line: np.ndarray, terrain: Terrain, begin: float, end: float, spacing: float
) -> tuple[np.ndarray, ...]:
    """Sample the terrain along a line, at its vertices and at equal distances between them.

    Parameters
    ----------
    line : float[n, 2] [m]
    terrain : Terrain
    begin, end : float [m]
        Distances along the line.
    spacing : float [m]

    Returns
    -------
    (along, x, y, elevation, ground) : float64[n] [m]
        `ground` is the length along the terrain from the first point, interpolated over nodata.
    """
    count = max(2, math.ceil((end - begin) / spacing) + 1)
    vertices = vertex_distances(line)
    along = np.union1d(np.linspace(begin, end, count), vertices[(vertices > begin) & (vertices < end)])
    x, y = places_along(line, along)
    elevation = terrain.sample(x, y)
    return along, x, y, elevation, ground_lengths(along, elevation)


def ground_lengths(along: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Return the length along the terrain up to each position on a line.

    Parameters
    ----------
    along, elevation : float64[n] [m]

    Returns
    -------
    float64[n] [m]
    """
    known = np.isfinite(elevation)
    heights = np.interp(along, along[known], elevation[known]) if known.any() else np.zeros(len(along))
    return np.r_[0.0, np.cumsum(np.hypot(np.diff(along), np.diff(heights)))]


def given_line(path: PathLike, flowed: np.ndarray, grid: Grid, terrain: Terrain | None) -> np.ndarray:
    """Return the line in the file `path`, from its upper end.

    Parameters
    ----------
    path : path
    flowed : bool[rows, columns]
        Cells of `grid` that the flow reached; the line must pass within two cells of one.
    grid : Grid
    terrain : Terrain or None
        Without it the direction is not changed.

    Returns
    -------
    float64[n, 2] [m]

    Raises
    ------
    MpmgisError
    """
    line = read_line(path, grid)
    distance = distance_to_line(line, flowed, grid)
    if distance > 2 * grid.cell_size:
        raise InputError(f"{path} is {distance:.0f} m away from the flow; give the path of the flow")
    if terrain is not None:
        begin, end = terrain.sample(*line[[0, -1]].T)
        if begin < end:
            log.info(f"{path} runs uphill, from {begin:.0f} to {end:.0f} m; it is reversed")
            return line[::-1]
    return line


def line_or_centre(
    path: PathLike | None,
    name: str,
    flowed: np.ndarray,
    depth: np.ndarray,
    elevation: np.ndarray,
    grid: Grid,
    terrain: Terrain | None,
) -> tuple[np.ndarray, str]:
    """Return the path of a flow from its upper end, the given one or its centre line, and words for its source.

    Parameters
    ----------
    path : path or None
        None: the centre line.
    name : str
        Of the flow.
    flowed : bool[rows, columns]
        Cells that it reached.
    depth : float[rows, columns] [m]
    elevation : float64[rows, columns] [m]
        In these cells; NaN if unknown.
    grid : Grid
    terrain : Terrain or None
        Without it the direction of a given path is not changed.

    Returns
    -------
    (float64[n, 2] [m], str)

    Raises
    ------
    MpmgisError
        An unreadable or distant line, or no centre line.
    """
    if path is not None:
        return given_line(path, flowed, grid, terrain), str(path)
    line = centre_line([flowed], [depth], elevation, grid)
    if line is None:
        raise InputError(
            f"{name}: the flow is one cell, or has no elevations under it; give `line`, or smaller `cell_size`"
        )
    return line, CENTRE_LINE
