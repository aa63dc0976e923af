"""Cells of a grid that objects on a map lie in: exact lengths of lines, areas of polygons, cells of points."""

import numpy as np
import shapely

from ..maps.averaging.frame_values import cells_of
from ..terrain.grid import Grid

POINT, LINE, POLYGON = range(3)  # dimension of an object
MEASURES = ("1", "m", "m2")  # unit of the size of an object, by its dimension


def dimension_of(shape: shapely.Geometry) -> int:
    """Return the dimension of a shape: POINT, LINE or POLYGON.

    Parameters
    ----------
    shape : shapely.Geometry
    """
    return int(shapely.get_dimensions(shape))


def size_of(shape: shapely.Geometry, dimension: int) -> float:
    """Return the number of points, the length [m] or the area [m2] of a shape, in plan.

    Parameters
    ----------
    shape : shapely.Geometry [m]
    dimension : int
        POINT, LINE or POLYGON; parts of a shape have that of the whole.
    """
    if dimension == POINT:
        return float(shapely.get_num_coordinates(shape))
    return float(shape.length if dimension == LINE else shape.area)


def object_cells(shape: shapely.Geometry, grid: Grid, reached: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the reached cells that a shape lies in, and its size in each of them.

    Parameters
    ----------
    shape : shapely.Geometry [m]
        Points, lines or polygons.
    grid : Grid
    reached : bool[rows, columns]

    Returns
    -------
    cells : int64[k]
        Flat numbers; a line can be in a cell several times.
    sizes : float64[k]
        Number of points, length [m] or area [m2] in plan.
    """
    dimension = dimension_of(shape)
    if dimension == POLYGON:
        return _polygon_cells(shape, grid, reached)
    if dimension == POINT:
        cells = cells_of(grid, *shapely.get_coordinates(shape).T)
        sizes = np.ones(len(cells))
    else:
        cells, sizes = _line_cells(shape, grid)
    kept = cells >= 0
    kept[kept] = reached.reshape(-1)[cells[kept]]
    return cells[kept], sizes[kept]


def _line_cells(shape: shapely.Geometry, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Return the cell of each piece of a line between borders of cells (-1 off the grid), and its length [m]."""
    cells, lengths = [np.empty(0, np.int64)], [np.empty(0)]
    for part in shapely.get_parts(shape):
        xy = shapely.get_coordinates(part)
        places = np.column_stack(grid.rowcol(*xy.T)) + 0.5  # whole numbers are borders of cells
        for place, other, start, end in zip(places[:-1], places[1:], xy[:-1], xy[1:], strict=True):
            shares = np.unique(np.concatenate([[0.0, 1.0], *_crossings(place, other, grid.shape)]))
            middle = start + 0.5 * (shares[1:] + shares[:-1])[:, None] * (end - start)
            cells.append(cells_of(grid, *middle.T))
            lengths.append(np.diff(shares) * float(np.hypot(*(end - start))))
    return np.concatenate(cells), np.concatenate(lengths)


def _crossings(place, other, shape):
    """Yield the shares of a segment at which it crosses rows and columns of the grid."""
    for begin, end, count in zip(place, other, shape, strict=True):
        low, high = min(begin, end), max(begin, end)
        borders = np.arange(max(np.ceil(low), 0), min(np.floor(high), count) + 1)
        if high > low and borders.size:
            yield np.clip((borders - begin) / (end - begin), 0.0, 1.0)


def _polygon_cells(shape: shapely.Geometry, grid: Grid, reached: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the reached cells that a polygon covers a part of, and the area [m2] of that part."""
    rows, columns = grid.window(shape.bounds, 1)
    row, column = np.nonzero(reached[rows, columns])
    row, column = row + rows.start, column + columns.start
    if not row.size:
        return np.empty(0, np.int64), np.empty(0)
    offsets = ((-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5))
    rings = np.stack([np.stack(grid.xy(row + i, column + j), axis=-1) for i, j in offsets], axis=1)
    areas = shapely.area(shapely.intersection(shapely.polygons(rings), shape))
    kept = areas > 0.0
    return (row * grid.shape[1] + column)[kept], areas[kept]
