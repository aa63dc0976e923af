"""What the flow can reach, by the energy line, in seconds: numbers that decide which effects a scene calls for."""

import heapq
import itertools
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ..fields import GRAVITY
from .terrain import bilinear

MOST_CELLS = 2e6  # enough for a quantile, whatever the raster's size
MOST_VISITED = 50_000  # cells that the search for the way down looks at
FLOW_WIDTHS = 2.0  # by which reachable ground is grown, for what is beside it
_NEIGHBOURS = tuple((i, j, float(np.hypot(i, j))) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


class Reach(NamedTuple):
    """Ground below the energy line and connected with the release, on every `step`-th row and column of the DTM."""

    step: int
    inside: np.ndarray  # bool[rows, columns]
    near: np.ndarray  # bool[rows, columns], grown by FLOW_WIDTHS widths of the release
    height: np.ndarray  # float64[rows, columns], of the energy line over the ground [m]; NaN without ground
    mu: float  # [1] by which the line falls

    def at(self, grid, x, y):
        """Whether map points x, y [m] lie on reachable ground or near it: (bool[n], bool[n])."""
        row, column = grid.rowcol(np.asarray(x, float), np.asarray(y, float))
        i, j = np.rint(np.asarray(row) / self.step).astype(int), np.rint(np.asarray(column) / self.step).astype(int)
        there = (i >= 0) & (j >= 0) & (i < self.inside.shape[0]) & (j < self.inside.shape[1])
        i, j = np.where(there, i, 0), np.where(there, j, 0)
        return there & self.inside[i, j], there & self.near[i, j]


def reach_of(terrain, release_xy, release_bed, mu):
    """The `Reach` of a release: what lies below a line that falls by `mu` from its highest point.

    Parameters
    ----------
    terrain : Terrain
    release_xy : float[n, 2] [m]
        Some points of the release.
    release_bed : float[n] [m]
    mu : float
        Smallest friction coefficient (design notes 8).
    """
    grid = terrain.grid
    rows, columns = terrain.elevation.shape
    step = max(1, int(np.sqrt(rows * columns / MOST_CELLS)))
    elevation = terrain.elevation[::step, ::step]
    x, y = grid.xy(*np.meshgrid(np.arange(0, rows, step), np.arange(0, columns, step), indexing="ij"))
    centre = np.average(release_xy, axis=0)
    height = float(np.max(release_bed)) - mu * np.hypot(x - centre[0], y - centre[1]) - elevation
    with np.errstate(invalid="ignore"):
        inside = height > 0
    labels, _ = ndimage.label(inside, structure=np.ones((3, 3)))
    i, j = _cell(grid, centre, step, labels.shape)
    if labels[i, j]:
        inside = labels == labels[i, j]
    width = np.sqrt(12.0) * float(np.std(release_xy, axis=0).max())
    grown = FLOW_WIDTHS * width / (grid.cell_size * step)
    near = ndimage.distance_transform_edt(~inside) <= grown if inside.any() else inside
    return Reach(step, inside, near & np.isfinite(elevation), height, float(mu))


def reach_facts(terrain, reach):
    """Numbers about reachable ground for `scene.TerrainFacts` (design notes 8).

    Returns
    -------
    dict
        centrifugal_ratio: 95 % quantile of |u^T Hess b u| / g at the line's speed; detachment_ratio: 99 % quantile of
        U^2 curvature / (g cos) along the fall line, convex ground positive; slope_median; slope_steep, the 99 %
        quantile near it; speed [m s-1], the largest of the line; edge_distance [m].
    """
    nothing = {"centrifugal_ratio": 0.0, "slope_median": 0.0, "drop": 0.0, "speed": 0.0}
    if not reach.inside.any():
        return nothing
    every = (slice(None, None, reach.step),) * 2
    grid, elevation = terrain.grid, terrain.elevation
    speed2 = 2.0 * GRAVITY * np.where(reach.inside, reach.height, 0.0)
    bending, falling = (a[every] / grid.cell_area for a in _bending(elevation))
    slope = np.hypot(*np.moveaxis(terrain.gradient[every], -1, 0))
    flight = speed2 * np.maximum(-falling, 0.0) / (1.0 + slope * slope) / GRAVITY
    start = float(np.nanmax(np.where(reach.inside, elevation[every] + reach.height, -np.inf)))
    valid = np.pad(np.isfinite(elevation[every]), 1)
    to_edge = ndimage.distance_transform_edt(valid)[1:-1, 1:-1]
    return nothing | {
        "centrifugal_ratio": float(np.nanquantile((speed2 * bending / GRAVITY)[reach.inside], 0.95)),
        "detachment_ratio": float(np.nanquantile(flight[reach.inside], 0.99)),
        "slope_median": float(np.nanmedian(slope[reach.inside])),
        "slope_steep": float(np.nanquantile(slope[reach.near | reach.inside], 0.99)),
        "drop": start - float(np.nanmin(elevation[every][reach.inside])),
        "speed": float(np.sqrt(speed2.max())),
        "edge_distance": float((to_edge[reach.inside].min() - 1.0) * grid.cell_size * reach.step),
    }


def release_facts(terrain, xy, mass, thickness):
    """Mean thickness h0 and length L0 down the slope of a release, weighted by `mass`: a dict [m, m].

    L0 is sqrt(12) standard deviations along the mean slope: the length of a rectangle.
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


def steepest_profile(terrain, start_xy, mu, most_points=200):
    """The steepest way down from `start_xy`, through pits where they overflow, as far as a line of `mu` allows.

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
    visited, parent = _way_down(elevation, start, mu, spacing)
    reached = {cell: (way, z) for z, way, cell in visited}
    cell, path = _farthest_at_the_bottom(visited), []
    while cell is not None:
        path.append(reached[cell])
        cell = parent[cell]
    path.reverse()
    thinned = path[: -1 : max(1, -(-len(path) // (most_points - 1)))]
    return (*thinned, path[-1])


def _way_down(elevation, start, mu, spacing):
    """Cells under the line of `mu` from `start`, the lowest beside those before first: water that rises and overflows.

    Cells are numbered row by row in the raster with a rim of one cell around it. Plain numbers are compared and looked
    up several times faster than arrays are indexed by pairs, and a cell as high as the sky needs no other mark.

    Returns
    -------
    (list of (elevation [m], way to it [m], cell), dict)
        The cells as they were visited; where from each was come to.
    """
    walled = np.pad(np.asarray(elevation, float), 1, constant_values=np.inf)
    height, width = walled.ravel().tolist(), walled.shape[1]
    around = [(i * width + j, apart * spacing) for i, j, apart in _NEIGHBOURS]
    first = (start[0] + 1) * width + start[1] + 1
    top, seen = height[first], np.inf
    highest = top + spacing
    parent, height[first] = {first: None}, seen
    waiting, visited = [(top, 0.0, first)], []  # the lowest first, of these the nearest
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
            if there < highest:  # what was seen is not, nor is NaN
                way = before + further
                if there < top - mu * way + spacing:  # below the line, or the first cell above
                    parent[beside], height[beside] = cell, seen
                    push(waiting, (there, way, beside))
    return visited, parent


def _farthest_at_the_bottom(visited):
    """Of the cells at the lowest elevation the one with the longest way; what is flooded from there upwards is none."""
    lowest = min(range(len(visited)), key=lambda k: visited[k][0])
    shore = visited[lowest][0] + 0.02 * (visited[0][0] - visited[lowest][0])
    bottom = itertools.takewhile(lambda entry: entry[0] <= shore, visited[lowest:])
    return max(bottom, key=lambda entry: entry[1])[2]


def _cell(grid, xy, step, shape):
    """(row, column) of the thinned raster nearest to the map point `xy`."""
    return tuple(int(np.clip(np.round(v / step), 0, m - 1)) for v, m in zip(grid.rowcol(*xy), shape, strict=True))


def _bending(elevation):
    """Second derivatives [m per pixel^2], smoothed over two pixels: largest absolute eigenvalue, and down the slope."""
    filled = np.where(np.isfinite(elevation), elevation, np.nanmean(elevation))
    smooth = ndimage.gaussian_filter(filled, 2.0, mode="nearest")
    d_row, d_column = np.gradient(smooth)
    rr, rc = np.gradient(d_row)
    _, cc = np.gradient(d_column)
    largest = np.abs(0.5 * (rr + cc)) + np.sqrt(0.25 * (rr - cc) ** 2 + rc**2)
    steepness2 = np.maximum(d_row**2 + d_column**2, 1e-12)
    return largest, (d_row**2 * rr + 2.0 * d_row * d_column * rc + d_column**2 * cc) / steepness2
