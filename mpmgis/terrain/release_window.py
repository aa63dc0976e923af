"""Automatic window of a release on a large DTM: the pixels below its energy line, read by part."""

from collections.abc import Callable, Collection
from math import ceil
from typing import NamedTuple

import numpy as np
import shapely

from ..system.errors import InputError
from .elevation import Terrain
from .flow_reach import FLOW_WIDTHS, connected
from .grid import Grid

FIRST_MARGIN = 64  # [pixels] around a release in the first part of the DTM that is read
RIM = 8  # [pixels] between the reach and the edge of the window
MOST_PIXELS = 40_000_000  # [pixels] of a part that is read for the energy line; a longer line is cut there
MOST_SAMPLES = 2000  # points of a release from which the line is drawn
SIDES = ("north", "south", "west", "east")  # of pixels: first row, last row, first column, last column


class ReleaseWindow(NamedTuple):
    """Rows and columns of a DTM, the ends excluded.

    Parameters
    ----------
    top, bottom, left, right : int [pixels]
        First row, row after the last one, first column, column after the last one.
    """

    top: int
    bottom: int
    left: int
    right: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slice of rows and slice of columns."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.bottom - self.top, self.right - self.left

    def grown(self, sides: Collection[str], shape: tuple[int, int]) -> "ReleaseWindow":
        """Return this window, larger by half its height or width beyond some sides, within the DTM.

        Parameters
        ----------
        sides : collection of str
            Some of SIDES.
        shape : (int, int)
            Rows and columns of the DTM.
        """
        rows, columns = (max(RIM, -(-n // 2)) for n in self.shape)
        return ReleaseWindow(
            max(0, self.top - rows * ("north" in sides)),
            min(shape[0], self.bottom + rows * ("south" in sides)),
            max(0, self.left - columns * ("west" in sides)),
            min(shape[1], self.right + columns * ("east" in sides)),
        )

    def inner_sides(self, shape: tuple[int, int]) -> tuple[str, ...]:
        """Return the sides that are not an edge of the DTM.

        Parameters
        ----------
        shape : (int, int)
            Rows and columns of the DTM.
        """
        inner = (self.top > 0, self.bottom < shape[0], self.left > 0, self.right < shape[1])
        return tuple(side for side, there in zip(SIDES, inner, strict=True) if there)

    def sides_reached(self, extent: tuple[int, int, int, int], rim: int) -> tuple[str, ...]:
        """Return the sides that are near an extent.

        Parameters
        ----------
        extent : (int, int, int, int)
            First row, row after the last one, first column, column after the last one, counted in the window.
        rim : int [pixels]
            A distance below this is near.
        """
        top, bottom, left, right = extent
        rows, columns = self.shape
        near = (top < rim, bottom > rows - rim, left < rim, right > columns - rim)
        return tuple(side for side, there in zip(SIDES, near, strict=True) if there)


def reach_window(
    grid: Grid, part: Callable[[slice, slice], Terrain], polygon: shapely.Geometry, mu: float, head: float = 0.0
) -> ReleaseWindow:
    """Find the window of all pixels below the energy line of a release, connected with it, and a rim around.

    The part of the DTM in which the line is drawn is enlarged until the line ends inside it or at the DTM's edge.

    Parameters
    ----------
    grid : Grid
        Of the whole DTM.
    part : callable (rows, columns) -> Terrain
        Reads a slice of rows and a slice of columns.
    polygon : shapely.Geometry
        In the CRS of the DTM.
    mu : float [1]
        Slope of the line, tan of the travel angle.
    head : float [m]
        v^2 / 2g of the release.

    Raises
    ------
    InputError
        The release has no ground.
    """
    window = _pixels(grid, polygon.bounds, FIRST_MARGIN)
    while True:
        terrain = part(*window.slices)
        extent = _extent(terrain, polygon, mu, head)
        sides = set(window.sides_reached(extent, 2)) & set(window.inner_sides(grid.shape))
        larger = window.grown(sides, grid.shape)
        if not sides or np.prod(larger.shape) > MOST_PIXELS:
            break
        window = larger
    top, bottom, left, right = extent
    rows, columns = grid.shape
    return ReleaseWindow(
        max(0, window.top + top - RIM),
        min(rows, window.top + bottom + RIM),
        max(0, window.left + left - RIM),
        min(columns, window.left + right + RIM),
    )


def _pixels(grid: Grid, bounds: tuple[float, float, float, float], margin: int) -> ReleaseWindow:
    rows, columns = grid.window(bounds, margin)
    return ReleaseWindow(rows.start, rows.stop, columns.start, columns.stop)


def _extent(terrain: Terrain, polygon: shapely.Geometry, mu: float, head: float) -> tuple[int, int, int, int]:
    """Return (first row, end, first column, end) of the pixels of `terrain` that the energy line reaches."""
    xy = _samples(terrain.grid, polygon)
    bed = terrain.sample(*xy.T)
    known = np.isfinite(bed)
    if not known.any():
        raise InputError("the release area has no ground: the DTM has no data there")
    grid, (rows, columns) = terrain.grid, terrain.grid.shape
    line = np.zeros((rows, columns), bool)
    ground = np.where(np.isfinite(terrain.elevation), terrain.elevation, np.inf)
    x, y = grid.xy(*np.ogrid[:rows, :columns])
    for part in shapely.get_parts(polygon):
        own = known & (shapely.distance(part, shapely.points(xy)) < grid.cell_size)
        if own.any():
            top, (east, north) = float(bed[own].max()) + head, xy[own].mean(axis=0)
            line |= top - mu * np.hypot(x - east, y - north) > ground
    start = tuple(np.rint(np.stack(grid.rowcol(*xy[known].T))).astype(int).clip(0, [[rows - 1], [columns - 1]]))
    line = connected(line, start)
    line[start] = True
    row, column = np.nonzero(line)
    west, south, east, north = polygon.bounds
    more = ceil(FLOW_WIDTHS * max(east - west, north - south) / grid.cell_size)  # as `Reach.near`
    return (
        max(0, int(row.min()) - more),
        min(rows, int(row.max()) + 1 + more),
        max(0, int(column.min()) - more),
        min(columns, int(column.max()) + 1 + more),
    )


def _samples(grid: Grid, polygon: shapely.Geometry) -> np.ndarray:
    """Return pixel centres in the polygon, at most about MOST_SAMPLES, and points of its outline: float64[n, 2] [m]."""
    (i0, j0), (i1, j1) = grid.pixel_range(polygon.bounds)
    step = max(1, int(np.sqrt((i1 - i0) * (j1 - j0) / MOST_SAMPLES)))
    row, column = np.meshgrid(np.arange(i0, i1, step), np.arange(j0, j1, step), indexing="ij")
    x, y = grid.xy(row.ravel(), column.ravel())
    inside = shapely.contains_xy(polygon, x, y)
    outline = shapely.get_coordinates(polygon)
    outline = outline[:: max(1, len(outline) // MOST_SAMPLES)]
    return np.vstack([np.column_stack([x, y])[inside], outline])
