"""Shares of the nodes' squares that areas cover, exact for polygons and for rasters along the axes.

The square of a node has the side of a cell, the node in its middle, and ends at the edge of the domain. So the squares
tile the domain, and what acts by its share acts on the area that was drawn, wherever the nodes are.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely
from scipy.sparse import coo_array

from ...seeding.lattice import Lattice, Outline
from ...terrain.release_parts import polygons_only

if TYPE_CHECKING:
    from ...terrain.grid import Grid
    from ..columns.node_grid import ColumnGrid

WHOLE = 1e-9  # [1] a share that is nearer to 1 is 1, and one that is less is 0: rounding of map coordinates
SAMPLES = 8  # along each side of a square, where a raster is not along the axes
AT_RIM = 1e-6  # [cells] distance from a border within which a node is on it
SAME = 1e-12  # [1] relative difference of a mean from one of its values up to which it is that value


class Area(NamedTuple):
    """An area: a polygon, a raster, or where a raster has values in a polygon.

    Parameters
    ----------
    shape : Polygon or MultiPolygon, optional [m]
    share : float64[ny + 1, nx + 1], optional [1]
        Of the nodes' squares that a raster covers.
    """

    shape: shapely.Geometry | None = None
    share: np.ndarray | None = None


class _Squares(NamedTuple):
    """Squares of the nodes of the domain, without ghosts."""

    x: np.ndarray  # [m] their edges, from west to east
    y: np.ndarray  # [m] from south to north
    west: float  # [m] the domain's south-west corner on the map, which x and y are relative to
    south: float
    size: float  # [m]

    @classmethod
    def of(cls, grid):
        rows, columns = grid.inside.shape
        x, y = (np.clip(np.arange(n + 2) - 0.5, 0, n) * grid.cell_size for n in (columns, rows))
        return cls(x, y, grid.x0, grid.y0 + grid.rest, grid.cell_size)

    @property
    def shape(self):
        return len(self.y) - 1, len(self.x) - 1

    def box(self):
        """The domain as a polygon."""
        return shapely.box(self.west, self.south, self.west + self.x[-1], self.south + self.y[-1])

    def covered(self, shape, domain):
        """((slice, slice) of the nodes, their shares) of a polygon."""
        if not domain.covers(shape):
            shape = polygons_only(shape.intersection(domain))
        if shape.is_empty:
            return (slice(0), slice(0)), np.zeros((0, 0))
        half = 0.5 * self.size
        outline = Outline.of(shape, Lattice.squares((self.west - half, self.south - half), self.size))
        cover, window = outline.cover(), outline.window
        share = np.zeros((cover.rows, cover.columns))
        for row, first, last in cover.spans:
            share[row, first:last] = 1.0
        share.flat[cover.rim_key] = cover.rim[:, 0]
        rows, columns = self.shape
        low, high = max(window.row, 0), min(window.row + window.rows, rows)
        left, right = max(window.column, 0), min(window.column + window.columns, columns)
        share = share[low - window.row : high - window.row, left - window.column : right - window.column]
        height, width = np.diff(self.y)[low:high] / self.size, np.diff(self.x)[left:right] / self.size
        return (slice(low, high), slice(left, right)), _rounded(share / np.outer(height, width))


def domain_shares(shape: shapely.Geometry, grid: "ColumnGrid") -> np.ndarray:
    """Compute the shares of the squares of the nodes that a polygon covers.

    Parameters
    ----------
    shape : Polygon or MultiPolygon [m]
    grid : ColumnGrid

    Returns
    -------
    float64[ny + 1, nx + 1] [1]
    """
    squares = _Squares.of(grid)
    window, share = squares.covered(shape, squares.box())
    found = np.zeros(squares.shape)
    found[window] = share
    return found


def touched_cells(shape: shapely.Geometry, grid: "ColumnGrid") -> np.ndarray:
    """Return the cells of which a polygon covers a part.

    Parameters
    ----------
    shape : Polygon or MultiPolygon [m]
    grid : ColumnGrid

    Returns
    -------
    bool[ny, nx]
    """
    squares, touched = _Squares.of(grid), np.zeros(grid.inside.shape, bool)
    shape = polygons_only(shape.intersection(squares.box()))
    if not shape.is_empty:
        outline = Outline.of(shape, Lattice.squares((squares.west, squares.south), squares.size))
        row, column = outline.cover().cells().T
        touched[row + outline.window.row, column + outline.window.column] = True
    return touched


def square_areas(grid: "ColumnGrid") -> np.ndarray:
    """Compute the areas of the squares of the nodes, which are less than a cell at the edge of the domain.

    Parameters
    ----------
    grid : ColumnGrid

    Returns
    -------
    float64[ny + 1, nx + 1] [m2]
    """
    squares = _Squares.of(grid)
    return np.outer(np.diff(squares.y), np.diff(squares.x))


def covered_nodes(area: Area, grid: "ColumnGrid") -> np.ndarray:
    """Return the nodes of whose squares an area covers a part.

    Parameters
    ----------
    area : Area
    grid : ColumnGrid

    Returns
    -------
    bool[ny + 1, nx + 1]
    """
    if area.shape is None:
        return area.share > 0.0
    share = domain_shares(area.shape, grid)
    return (share if area.share is None else share * area.share) > 0.0


def covers_domain(area: Area, grid: "ColumnGrid") -> bool:
    """Return whether an area covers a part of the domain.

    Parameters
    ----------
    area : Area
    grid : ColumnGrid
    """
    if area.share is None:
        return area.shape.intersection(_Squares.of(grid).box()).area > 0.0
    return bool(covered_nodes(area, grid).any())


def visible_shares(areas: Sequence[Area], grid: "ColumnGrid") -> Iterator[tuple[int, tuple[slice, slice], np.ndarray]]:
    """Yield the shares of areas that later ones leave visible, from the last area to the first.

    Exact for polygons on polygons: where they touch in a square, their shares add up to that of both. A raster within
    a polygon is taken as spread evenly over the square.

    Parameters
    ----------
    areas : sequence of Area
        Each lies on those before it.
    grid : ColumnGrid

    Yields
    ------
    (int, (slice, slice), float64[rows, columns] [1])
        Number of the area, rows and columns of the nodes [ny + 1, nx + 1] in its window, their shares.
    """
    squares = _Squares.of(grid)
    domain = squares.box()
    left = np.ones(squares.shape)  # share that is not under rasters
    drawn = np.zeros(squares.shape)  # share under polygons
    tree = shapely.STRtree([area.shape for area in areas])
    for number in range(len(areas) - 1, -1, -1):
        shape, share = areas[number]
        if shape is None:
            window = slice(None), slice(None)
            yield number, window, _rounded(share * left * (1.0 - drawn))
            left = left * (1.0 - share)
            continue
        above = [k for k in tree.query(shape, predicate="intersects") if k > number and areas[k].share is None]
        if above:
            shape = polygons_only(shape.difference(shapely.union_all([areas[k].shape for k in above])))
        window, part = squares.covered(shape, domain)
        if share is None:
            yield number, window, _rounded(part * left[window])
            drawn[window] = _rounded(drawn[window] + part)
        else:
            part = _rounded(part * share[window])
            yield number, window, part * left[window]
            left[window] = left[window] * (1.0 - part)


def raster_means(
    values: np.ndarray, grid: "Grid", nodes: "ColumnGrid", reciprocal: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the mean of a raster over the square of each node, and the share of the square where it has values.

    Parameters
    ----------
    values : float64[rows, columns]
        NaN for cells without value.
    grid : Grid
        Of the raster.
    nodes : ColumnGrid
    reciprocal : bool
        The mean is that of 1 / value, as 1 / mean.

    Returns
    -------
    (float64[ny + 1, nx + 1], float64[ny + 1, nx + 1] [1])
        The mean is NaN where the share is 0.
    """
    known = np.isfinite(values)
    whole = known.all()
    with np.errstate(divide="ignore"):
        filled = 1.0 / values if reciprocal else values
    if not whole:
        filled = np.where(known, filled, 0.0)
    squares = _Squares.of(nodes)
    t = grid.transform
    sums = _along_axes if t.b == 0.0 and t.d == 0.0 else _sampled
    share, total = sums((np.ones((1, 1)) if whole else known.astype(float), filled), grid, squares)
    share = _rounded(share)
    mean = np.divide(total, share, out=np.full(share.shape, np.nan), where=share > 0.0)
    mean = 1.0 / mean if reciprocal else mean
    middle = _cells_of(squares, grid, *(0.5 * (edges[:-1] + edges[1:]) for edges in (squares.x, squares.y)))
    one = values[middle]
    return np.where(np.abs(mean - one) <= SAME * np.abs(one), one, mean), share


def raster_lowest(values: np.ndarray, grid: "Grid", nodes: "ColumnGrid") -> np.ndarray:
    """Return the value of the raster's cell at each node, on the border of cells the lowest; NaN without value.

    Parameters
    ----------
    values : float64[rows, columns]
        NaN for cells without value.
    grid : Grid
        Of the raster.
    nodes : ColumnGrid

    Returns
    -------
    float64[ny + 1, nx + 1]
    """
    squares = _Squares.of(nodes)
    rows, columns = squares.shape
    x, y = np.meshgrid(squares.west + np.arange(columns) * squares.size, squares.south + np.arange(rows) * squares.size)
    row, column = grid.rowcol(x, y)
    lowest = np.full(squares.shape, np.inf)
    for a in (-AT_RIM, AT_RIM):
        for b in (-AT_RIM, AT_RIM):
            i, j = (np.floor(place + 0.5 + aside).astype(int) for place, aside in ((row, a), (column, b)))
            there = (i >= 0) & (i < grid.shape[0]) & (j >= 0) & (j < grid.shape[1])
            own = values[np.clip(i, 0, grid.shape[0] - 1), np.clip(j, 0, grid.shape[1] - 1)]
            lowest = np.where(there & (own < lowest), own, lowest)
    return np.where(np.isfinite(lowest), lowest, np.nan)


def mask_share(raster: tuple, grid: "ColumnGrid") -> np.ndarray:
    """Compute the share of the squares of the nodes where a raster is neither 0 nor without value.

    Parameters
    ----------
    raster : (float64[rows, columns], Grid)
    grid : ColumnGrid

    Returns
    -------
    float64[ny + 1, nx + 1] [1]
    """
    values, placed = raster
    return raster_means(np.where(np.nan_to_num(values) != 0.0, 1.0, np.nan), placed, grid)[1]


def _rounded(share):
    """Shares without what only rounding makes of 0 and 1."""
    return np.where(share > 1.0 - WHOLE, 1.0, np.where(share < WHOLE, 0.0, share))


def _along_axes(rasters, grid, squares):
    """Means of rasters over the squares: along one axis after the other, by the lengths that overlap.

    A raster of one number has it everywhere.
    """
    t = grid.transform
    rows = _overlaps((t.f - squares.south) + t.e * np.arange(grid.shape[0] + 1), squares.y)
    columns = _overlaps((t.c - squares.west) + t.a * np.arange(grid.shape[1] + 1), squares.x)
    ones = np.outer(rows.sum(axis=1), columns.sum(axis=1))
    return [raster * ones if raster.size == 1 else np.asarray(rows @ raster @ columns.T) for raster in rasters]


def _overlaps(cells, squares):
    """Sparse [squares, cells]: share of each interval between the edges `squares` that lies in each of the `cells`."""
    falling = cells[-1] < cells[0]
    low = cells[::-1] if falling else cells
    edges = np.unique(np.concatenate([squares, low[(low > squares[0]) & (low < squares[-1])]]))
    middle, length = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    square = np.searchsorted(squares, middle) - 1
    cell = np.searchsorted(low, middle) - 1
    there = (cell >= 0) & (cell < len(low) - 1)
    cell = len(low) - 2 - cell if falling else cell
    share = length / np.diff(squares)[square]
    shape = len(squares) - 1, len(low) - 1
    return coo_array((share[there], (square[there], cell[there])), shape=shape).tocsr()


def _sampled(rasters, grid, squares):
    """Means of rasters over the squares, from SAMPLES x SAMPLES places in each."""
    sums = [np.zeros(squares.shape) for _ in rasters]
    for a in (np.arange(SAMPLES) + 0.5) / SAMPLES:
        for b in (np.arange(SAMPLES) + 0.5) / SAMPLES:
            x, y = (edges[:-1] + share * np.diff(edges) for edges, share in ((squares.x, a), (squares.y, b)))
            row, column = _cells_of(squares, grid, x, y)
            there = _on_raster(squares, grid, x, y)
            for total, raster in zip(sums, rasters, strict=True):
                total += np.where(there, raster if raster.size == 1 else raster[row, column], 0.0)
    return [total / SAMPLES**2 for total in sums]


def _places(squares, grid, x, y):
    east, north = np.meshgrid(squares.west + x, squares.south + y)
    return (np.floor(place + 0.5) for place in grid.rowcol(east, north))


def _cells_of(squares, grid, x, y):
    """(rows, columns) of the raster's cells at places from the domain's corner; the nearest one outside it."""
    places = zip(_places(squares, grid, x, y), grid.shape, strict=True)
    return tuple(np.clip(place, 0, n - 1).astype(int) for place, n in places)


def _on_raster(squares, grid, x, y):
    row, column = _places(squares, grid, x, y)
    return (row >= 0) & (row < grid.shape[0]) & (column >= 0) & (column < grid.shape[1])
