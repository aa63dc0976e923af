"""Ground that a flow can reach: energy line, path of steepest descent, and free flight from an edge."""

import heapq
import itertools
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..laws.quantities import GRAVITY
from .elevation import Terrain, bilinear, continued
from .grid import Grid

SECONDS = 0.5  # [s] of free flight, after which a flow should be clear of the ground
STEP = 0.1  # [s] between two checks of the ground ahead
AHEAD = 2.0  # [s] of the flow's way
MOST_CELLS = 2e6  # [cells] enough for a quantile, whatever the raster's size
MOST_VISITED = 50_000  # [cells] in the search for the downhill path
MOST_SOURCES = 32  # separate areas from which lines are drawn; more are united with their neighbours
FLOW_WIDTHS = 2.0  # [widths of the release] by which reachable ground is enlarged, for cells next to it
SMOOTHING = 2.0  # [pixels] standard deviation of the Gaussian before second derivatives are taken
SMOOTHED = 10  # [pixels] how far a second derivative sees: four standard deviations, and two differences
EIGHT_WAYS = float(np.cos(np.pi / 8.0))  # [1] least ratio of the straight way to the way by eight neighbours
LEAST_GAIN = 1e-3  # [m] gain of energy from which on a cell is expanded again
LEAST_SHARE = 0.01  # [1] the same, in small cells, as a share of the energy lost along a side
BOTTOM_SHARE = 0.02  # [1] of the drop; cells up to here above the lowest one are the bottom
LAYERS = 5000  # into which the terrain's height is divided to follow the flow downhill
_NEIGHBOURS = tuple((i, j, float(np.hypot(i, j))) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


def takes_off(
    terrain: Terrain,
    x: np.ndarray,
    y: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
    depth: np.ndarray,
    ahead: float = AHEAD,
    gravity: float = GRAVITY,
) -> np.ndarray:
    """Return whether flow with this motion is above the ground by more than its depth somewhere ahead.

    From each place on its path it moves freely for half a second along the upstream slope: over ground of
    the curvature k it is then clear by (U^2 k / g - 1) g s^2 / 2, which is the detachment indicator
    in metres. A kink in the terrain counts by how far one falls from it, so that rough ground is no cliff.

    Parameters
    ----------
    terrain : Terrain
    x, y : float64[n] [m]
    u, v : float64[n] [m s-1]
        Horizontal velocity.
    depth : float64[n] [m]
    ahead : float [s]
        Of the way, the flight included.
    gravity : float [m s-2]

    Returns
    -------
    bool[n]
    """
    moments = STEP * np.arange(-1, round(ahead / STEP) + 1)
    bed = terrain.sample(x[:, None] + np.outer(u, moments), y[:, None] + np.outer(v, moments))
    flight = round(SECONDS / STEP)
    start = bed[:, 1:-flight]
    rising = (start - bed[:, : -flight - 1]) / STEP
    clear = start + rising * SECONDS - 0.5 * gravity * SECONDS**2 - bed[:, flight + 1 :]
    with np.errstate(invalid="ignore"):
        return (clear > depth[:, None]).any(axis=1)


class Reach(NamedTuple):
    """Ground that a flow can reach, on every `step`-th row and column of the DTM.

    `line` is the ground below the energy line that is connected with the release. `inside` adds all ground downhill of
    it: a flow at the end of the line still moves where the ground falls.

    Parameters
    ----------
    step : int [pixels]
    line, inside : bool[rows, columns]
    near : bool[rows, columns]
        `line` grown by FLOW_WIDTHS widths of the release, not above the energy of the release.
    height : float64[rows, columns] [m]
        Of the energy over the ground; NaN without ground.
    mu : float [1]
        Slope of the line.
    top : float [m]
        Elevation of the highest ground of the release.
    """

    step: int
    line: np.ndarray
    inside: np.ndarray
    near: np.ndarray
    height: np.ndarray
    mu: float
    top: float

    def at(self, grid: Grid, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return whether map points are on reachable ground, and whether they are near it.

        Parameters
        ----------
        grid : Grid
            Of the DTM.
        x, y : float64[n] [m]

        Returns
        -------
        (bool[n], bool[n])
        """
        there, cell = self._cells(grid, x, y)
        return there & self.inside[cell], there & self.near[cell]

    def below_line(self, grid: Grid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return whether map points are on ground below the energy line.

        Parameters
        ----------
        grid : Grid
            Of the DTM.
        x, y : float64[n] [m]

        Returns
        -------
        bool[n]
        """
        there, cell = self._cells(grid, x, y)
        return there & self.line[cell]

    def _cells(self, grid, x, y):
        row, column = grid.rowcol(np.asarray(x, float), np.asarray(y, float))
        i, j = np.rint(np.asarray(row) / self.step).astype(int), np.rint(np.asarray(column) / self.step).astype(int)
        there = (i >= 0) & (j >= 0) & (i < self.inside.shape[0]) & (j < self.inside.shape[1])
        return there, (np.where(there, i, 0), np.where(there, j, 0))


def reach_of(
    terrain: Terrain, release_xy: np.ndarray, release_bed: np.ndarray, mu: float, head: float | np.ndarray = 0.0
) -> Reach:
    """Find the ground below a line that falls by `mu` from its highest energy, and the ground downhill of it.

    Separate areas of the release have a line each, from the middle of the area.

    Parameters
    ----------
    terrain : Terrain
    release_xy : float[n, 2] [m]
        Some points of the release, of inflow and of later releases.
    release_bed : float[n] [m]
        Elevation of the ground there.
    mu : float [1]
        Smallest friction coefficient.
    head : float or float[n] [m]
        v^2 / 2g of flow that starts there with the speed v.
    """
    grid = terrain.grid
    rows, columns = terrain.elevation.shape
    step = max(1, int(np.sqrt(rows * columns / MOST_CELLS)))
    elevation = terrain.elevation[::step, ::step]
    known = np.isfinite(elevation)
    x, y = grid.xy(*np.meshgrid(np.arange(0, rows, step), np.arange(0, columns, step), indexing="ij"))
    energy_at_start = release_bed + np.broadcast_to(head, np.shape(release_bed))
    energy, width = np.full(elevation.shape, -np.inf), 0.0
    areas = _areas(release_xy, grid.cell_size * step)
    for area in range(areas.max() + 1):
        points = release_xy[areas == area]
        centre = np.average(points, axis=0)
        line = float(np.nanmax(energy_at_start[areas == area])) - mu * np.hypot(x - centre[0], y - centre[1])
        energy = np.maximum(energy, line)
        width = max(width, np.sqrt(12.0) * float(np.std(points, axis=0).max()))
    start = _cells_of(grid, release_xy, step, elevation.shape)
    line = connected(known & (energy > np.where(known, elevation, np.inf)), start)
    line[start] |= known[start]
    grown = FLOW_WIDTHS * width / (grid.cell_size * step)
    near = ndimage.distance_transform_edt(~line) <= grown if line.any() else line
    ground = np.where(known, elevation, np.inf)
    near &= line | (known & (ground <= float(np.nanmax(energy_at_start))))
    downhill = _downhill(elevation, line | near, mu * EIGHT_WAYS * grid.cell_size * step)
    inside = line | (np.isfinite(downhill) & (~near | (downhill > ground)))
    energy = np.where(line, np.fmax(energy, elevation), np.where(inside | near, downhill, energy))
    height = np.where(known, energy - elevation, np.nan)
    return Reach(step, line, inside, near, height, float(mu), float(np.nanmax(release_bed)))


def _areas(xy: np.ndarray, spacing: float) -> np.ndarray:
    """Number the areas of the release from 0; int[n] of each point. Points of one area are adjacent."""
    if len(xy) < 2:
        return np.zeros(len(xy), int)
    apart = max(3.0 * float(np.quantile(cKDTree(xy).query(xy, k=2)[0][:, 1], 0.99)), 2.0 * spacing)
    while True:
        squares, square = np.unique(np.floor(xy / apart), axis=0, return_inverse=True)
        beside = cKDTree(squares).query_pairs(1.0, p=np.inf, output_type="ndarray")
        graph = coo_matrix((np.ones(len(beside), bool), beside.T), shape=(len(squares), len(squares)))
        count, areas = connected_components(graph, directed=False)
        if count <= MOST_SOURCES:
            return areas[square.reshape(-1)]
        apart *= 2.0


def connected(mask: np.ndarray, start: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Keep the parts of a mask that contain a start cell; all of them where none does.

    Parameters
    ----------
    mask : bool[rows, columns]
    start : (int[n], int[n])
        Rows and columns.

    Returns
    -------
    bool[rows, columns]
    """
    labels, count = ndimage.label(mask, structure=np.ones((3, 3)))
    kept = np.zeros(count + 1, bool)
    kept[labels[start]] = True
    kept[0] = False
    return kept[labels] if kept.any() else mask


def _downhill(elevation: np.ndarray, start: np.ndarray, fall: float) -> np.ndarray:
    """Return the energy [m] of a flow that leaves the cells `start` (bool) at rest, wherever it gets; -inf elsewhere.

    It loses `fall` [m] per cell side. It continues wherever its energy is above the ground, and wherever the ground
    falls: there its energy is at least the elevation of the ground. Energy never rises on the way. Cells are therefore
    expanded from high to low energy, in layers of two times `fall` or more: nearly all of them once.
    """
    width = elevation.shape[1] + 2
    ground = np.pad(elevation, 1, constant_values=np.nan).ravel()
    begun = np.pad(start, 1, constant_values=False)
    waiting = np.flatnonzero(begun & ~ndimage.binary_erosion(begun, np.ones((3, 3))))
    begun = begun.ravel()
    waiting = waiting[np.isfinite(ground[waiting])]
    energy = np.where(begun, ground, -np.inf)
    least = min(LEAST_GAIN, LEAST_SHARE * fall) if fall > 0.0 else LEAST_GAIN
    layer = max(2.0 * fall, float(np.ptp(ground[np.isfinite(ground)])) / LAYERS) if waiting.size else 0.0
    while waiting.size:
        high = energy[waiting]
        now = high >= high.max() - layer
        front, changed = waiting[now], [waiting[~now]]
        for i, j, apart in _NEIGHBOURS:
            beside = front + (i * width + j)
            there, falls = ground[beside], ground[beside] < ground[front]
            after = energy[front] - fall * apart
            after = np.where(falls, np.maximum(after, there), after)
            better = (falls | (after > there)) & (after > energy[beside] + least) & ~begun[beside]
            energy[beside[better]] = after[better]
            changed.append(beside[better])
        waiting = np.sort(np.concatenate(changed))  # several times faster than np.unique for so few
        waiting = waiting[np.diff(waiting, prepend=-1) > 0]
    return energy.reshape(-1, width)[1:-1, 1:-1]


def reach_facts(terrain: Terrain, reach: Reach) -> dict[str, float]:
    """Return numbers about reachable ground for `scene.TerrainFacts`.

    Parameters
    ----------
    terrain : Terrain
    reach : Reach

    Returns
    -------
    dict of str to float
        centrifugal_ratio: 95 % quantile of |u^T Hess b u| / g at the line's speed; detachment_ratio: 99 % quantile of
        U^2 curvature / (g cos) along the fall line, convex ground positive; slope_median; slope_steep, the 99 %
        quantile near it; drop [m]; speed [m s-1], the largest of the line; edge_distance [m] of all that is in reach,
        line_edge_distance [m] of the line alone.
    """
    nothing = {"centrifugal_ratio": 0.0, "slope_median": 0.0, "drop": 0.0, "speed": 0.0}
    line = reach.line
    if not line.any():
        return nothing
    every = (slice(None, None, reach.step),) * 2
    grid, elevation = terrain.grid, terrain.elevation
    speed2 = 2.0 * GRAVITY * np.where(line, reach.height, 0.0)
    bending, falling = (a[every] / grid.cell_area for a in _bending(elevation))
    slope = np.hypot(*np.moveaxis(terrain.gradient[every], -1, 0))
    flight = speed2 * np.maximum(-falling, 0.0) / (1.0 + slope * slope) / GRAVITY
    valid = np.pad(np.isfinite(elevation[every]), 1)
    to_edge = (ndimage.distance_transform_edt(valid)[1:-1, 1:-1] - 1.0) * grid.cell_size * reach.step
    known = np.isfinite(slope)
    return nothing | {
        "centrifugal_ratio": _quantile((speed2 * bending / GRAVITY)[line], 0.95),
        "detachment_ratio": _quantile(flight[line & known], 0.99),
        "slope_median": _quantile(slope[line & known], 0.5),
        "slope_steep": _quantile(slope[(reach.near | line) & known], 0.99),
        "drop": reach.top - float(np.nanmin(elevation[every][line])),
        "speed": float(np.sqrt(speed2.max())),
        "edge_distance": float(to_edge[reach.inside].min()),
        "line_edge_distance": float(to_edge[line].min()),
    }


def _quantile(values, share):
    return float(np.quantile(values, share)) if values.size else 0.0


def release_facts(terrain: Terrain, xy: np.ndarray, mass: np.ndarray, thickness: np.ndarray) -> dict[str, float]:
    """Return the mean thickness h0 and the length L0 down the slope of a release, weighted by mass.

    L0 is sqrt(12) standard deviations along the mean slope: the length of a rectangle.

    Parameters
    ----------
    terrain : Terrain
    xy : float64[n, 2] [m]
    mass : float64[n] [kg]
    thickness : float64[n] [m]

    Returns
    -------
    dict of str to float
        release_thickness [m], release_length [m].
    """
    centre = np.average(xy, axis=0, weights=mass)
    row, column = terrain.grid.rowcol(xy[:, 0], xy[:, 1])
    slopes = np.stack([bilinear(terrain.gradient[..., k], row, column) for k in (0, 1)], axis=-1)
    gradient = np.average(np.nan_to_num(slopes), axis=0, weights=mass)
    steepness = float(np.hypot(*gradient))
    along = (xy - centre) @ (gradient / steepness if steepness > 1e-6 else np.array([1.0, 0.0]))
    return {
        "release_thickness": float(np.average(thickness, weights=mass)),
        "release_length": float(np.sqrt(12.0 * np.average(along**2, weights=mass))),
    }


def steepest_profile(
    terrain: Terrain, start_xy: np.ndarray, mu: float, most_points: int = 200, head: float = 0.0
) -> tuple[tuple[float, float], ...]:
    """Find the steepest way down, through pits where they overflow, as far as an energy line allows.

    Parameters
    ----------
    terrain : Terrain
    start_xy : float64[2] [m]
    mu : float [1]
        Slope of the line.
    most_points : int
    head : float [m]
        Height of the line above the ground at the start.

    Returns
    -------
    tuple of (float, float)
        Horizontal distance and elevation [m] along it, at most `most_points`; () where the start has no ground.
    """
    rows, columns = terrain.elevation.shape
    step = max(1, int(np.ceil(max(rows, columns) / 1000)))
    elevation = terrain.elevation[::step, ::step]
    spacing = terrain.grid.cell_size * step
    start = _cell(terrain.grid, start_xy, step, elevation.shape)
    if not np.isfinite(elevation[start]):
        return ()
    visited, parent = _way_down(elevation, start, mu, spacing, head)
    reached = {cell: (way, z) for z, way, cell in visited}
    cell, path = _farthest_at_the_bottom(visited), []
    while cell is not None:
        path.append(reached[cell])
        cell = parent[cell]
    path.reverse()
    thinned = path[: -1 : max(1, -(-len(path) // (most_points - 1)))]
    return (*thinned, path[-1])


def _way_down(
    elevation: np.ndarray, start: tuple[int, int], mu: float, spacing: float, head: float = 0.0
) -> tuple[list, dict]:
    """Visit the cells under the line of `mu` from `start`, always the lowest neighbour first, as rising water does.

    Cells are numbered row by row in the raster with a rim of one cell around it. Plain numbers are compared and looked
    up several times faster than arrays are indexed by pairs. An infinite elevation marks the rim and visited cells.

    Returns
    -------
    list of (float, float, int)
        Elevation [m], way to it [m] and number of the cells, in the order of the visits.
    dict of int to int
        The cell from which each cell was reached.
    """
    walled = np.pad(np.asarray(elevation, float), 1, constant_values=np.inf)
    height, width = walled.ravel().tolist(), walled.shape[1]
    around = [(i * width + j, apart * spacing) for i, j, apart in _NEIGHBOURS]
    first = (start[0] + 1) * width + start[1] + 1
    ground, seen = height[first], np.inf
    top = ground + head
    highest = top + spacing
    parent, height[first] = {first: None}, seen
    waiting, visited = [(ground, 0.0, first)], []  # the lowest first, of these the nearest
    push, pop = heapq.heappush, heapq.heappop
    for _ in range(MOST_VISITED):
        if not waiting:
            break
        lowest = pop(waiting)
        visited.append(lowest)
        _, before, cell = lowest
        for apart, further in around:
            beside = cell + apart
            there = height[beside]
            if there < highest:  # visited cells and NaN are excluded
                way = before + further
                if there < top - mu * way + spacing:  # below the line, or the first cell above
                    parent[beside], height[beside] = cell, seen
                    push(waiting, (there, way, beside))
    return visited, parent


def _farthest_at_the_bottom(visited: list) -> int:
    """Return the cell with the longest path among those at the lowest elevation; flooded cells are excluded."""
    lowest = min(range(len(visited)), key=lambda k: visited[k][0])
    shore = visited[lowest][0] + BOTTOM_SHARE * (visited[0][0] - visited[lowest][0])
    bottom = itertools.takewhile(lambda entry: entry[0] <= shore, visited[lowest:])
    return max(bottom, key=lambda entry: entry[1])[2]


def _cell(grid: Grid, xy: np.ndarray, step: int, shape: tuple[int, int]) -> tuple[int, int]:
    """Return the (row, column) of the thinned raster nearest to the map point `xy`."""
    return tuple(int(np.clip(np.round(v / step), 0, m - 1)) for v, m in zip(grid.rowcol(*xy), shape, strict=True))


def _cells_of(grid: Grid, xy: np.ndarray, step: int, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the (rows, columns) of the thinned raster nearest to the map points `xy` [n, 2]."""
    row, column = grid.rowcol(xy[:, 0], xy[:, 1])
    return tuple(np.clip(np.rint(v / step).astype(int), 0, m - 1) for v, m in zip((row, column), shape, strict=True))


def _bending(elevation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return second derivatives [m per pixel^2]: the largest absolute eigenvalue, and that down the slope.

    The elevation is smoothed over two pixels. Beyond the raster and without data the ground is extended with its slope,
    so that a plane stays a plane.
    """
    smooth = ndimage.gaussian_filter(continued(elevation, SMOOTHED), SMOOTHING, mode="nearest")
    d_row, d_column = np.gradient(smooth)
    own = (slice(SMOOTHED, -SMOOTHED),) * 2
    rr, rc, cc = (np.gradient(a, axis=k)[own] for a, k in ((d_row, 0), (d_row, 1), (d_column, 1)))
    d_row, d_column = d_row[own], d_column[own]
    largest = np.abs(0.5 * (rr + cc)) + np.sqrt(0.25 * (rr - cc) ** 2 + rc**2)
    steepness2 = np.maximum(d_row**2 + d_column**2, 1e-12)
    return largest, (d_row**2 * rr + 2.0 * d_row * d_column * rc + d_column**2 * cc) / steepness2
