"""Integrate fields between the nodes of a square lattice over raster cells.

Columns give their sums to the nodes of the lattice with quadratic B-splines, as their solver does (Steffen et al.
2008). Between the nodes the sums are bilinear. Each raster cell takes the exact integral of that field, so that the
cells together have the mass of the columns, for any cell size.

Places are in lattice units: `across` counts along the raster's columns, `down` along its rows, one per node spacing.
"""

from typing import NamedTuple

import numpy as np

from ...compiled.jit import jit, jit_inline
from .binning import MASS, SUMS, VOLUME, add_motion
from .cell_places import ROUNDING, upward_part_of_normal

LEVEL = 1e-9  # [1] relative difference of two nodes up to which they are equal: rounding


class Parts(NamedTuple):
    """The parts of raster cells along the rows or the columns of a raster.

    Cells are cut into parts that are no wider than the node spacing.

    Parameters
    ----------
    owner : int64[a]
        Row (or column) of cells that each row of parts belongs to.
    first : int64[a]
        First of the three nodes whose hat functions reach the part.
    weight : float64[a, 3]
        Integral of the hat function of each of these nodes over the part [node spacings].
    """

    owner: np.ndarray
    first: np.ndarray
    weight: np.ndarray


@jit_inline
def spline(place: float) -> tuple[int, float, float, float]:
    """Compute the quadratic B-spline weights of a column at the three nodes of its stencil.

    Parameters
    ----------
    place : float
        Of the column along one axis, in node spacings.

    Returns
    -------
    (int, float, float, float)
        First node, and the weights of the three.
    """
    first = int(np.floor(place + 0.5)) - 1
    f = place - first
    return first, 0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2


@jit
def lattice_places(
    position: np.ndarray, row: np.ndarray, matrix: np.ndarray, shift: np.ndarray, place: np.ndarray, window: np.ndarray
) -> None:
    """Find the places of columns on the lattice, and the window of nodes that they give to.

    Parameters
    ----------
    position : float[n, 3] [m]
    row : int32[n]
        Below 0 for columns that are left out.
    matrix, shift : float64[2, 2] [m-1], float64[2]
        (across, down) = matrix (east, north) + shift.
    place : float64[n, 2], out
    window : int64[4], out
        First row, row after the last, first column, column after the last of the nodes.
    """
    top, bottom, left, right = 2**62, -(2**62), 2**62, -(2**62)
    for p in range(position.shape[0]):
        if row[p] < 0:
            continue
        x, y = position[p, 0], position[p, 1]
        across = matrix[0, 0] * x + matrix[0, 1] * y + shift[0]
        down = matrix[1, 0] * x + matrix[1, 1] * y + shift[1]
        place[p, 0], place[p, 1] = across, down
        i, j = int(np.floor(down + 0.5)), int(np.floor(across + 0.5))
        top, bottom = min(top, i - 1), max(bottom, i + 2)
        left, right = min(left, j - 1), max(right, j + 2)
    window[0], window[1], window[2], window[3] = top, bottom, left, right


@jit
def spread_columns(
    place: np.ndarray,
    row: np.ndarray,
    window: np.ndarray,
    share: np.ndarray,
    gain: np.ndarray,
    pixel: np.ndarray,
    gradient: np.ndarray,
    velocity: np.ndarray,
    mass: np.ndarray,
    volume: np.ndarray,
    nodes: np.ndarray,
) -> None:
    """Give the sums of every column to its nine nodes.

    A column gives only to ground that the raster has, and all of its mass. Beside ground that is left out its weights
    are multiplied by the nodes' `gain`, so that a sheet keeps its depth there, and then scaled to the whole mass.

    Parameters
    ----------
    place : float64[n, 2]
    row : int32[n]
    window : int64[4]
        These three as in `lattice_places`.
    share : float64[rows, columns]
        Part of the bilinear hat function of each node on cells of the raster that can contain flow.
    gain : float64[rows, columns]
        One over the part of each node's spline that lies there; 1 inside the flow's ground.
    pixel : int64[n]
        Flat number of the DTM pixel under each column.
    gradient : float64[pixels, 2] [1]
        Slopes of the pixels.
    velocity : float[n, 3] [m s-1]
    mass : float[n] [kg]
    volume : float[n] [m3]
    nodes : float64[rows, columns, SUMS], out
        Starts at zero; columns of `binning`.
    """
    sums = np.zeros((1, SUMS))
    wx, wy = np.empty(3), np.empty(3)
    for p in range(row.shape[0]):
        if row[p] < 0:
            continue
        i0, wy[0], wy[1], wy[2] = spline(place[p, 1])
        j0, wx[0], wx[1], wx[2] = spline(place[p, 0])
        i0, j0 = i0 - window[0], j0 - window[2]
        there = 0.0
        for i in range(3):
            for j in range(3):
                there += wy[i] * wx[j] * gain[i0 + i, j0 + j] * share[i0 + i, j0 + j]
        for s in range(SUMS):
            sums[0, s] = 0.0
        weight = mass[p] / there
        sums[0, MASS], sums[0, VOLUME] = weight, volume[p] / there
        q = pixel[p]
        slope_east, slope_north = gradient[q, 0], gradient[q, 1]
        if np.isfinite(slope_east) and np.isfinite(slope_north):
            add_motion(sums, 0, weight, velocity[p, 0], velocity[p, 1], velocity[p, 2], slope_east, slope_north)
        for i in range(3):
            for j in range(3):
                w = wy[i] * wx[j] * gain[i0 + i, j0 + j]
                for s in range(SUMS):
                    nodes[i0 + i, j0 + j, s] += w * sums[0, s]


@jit
def hat_shares(factor: np.ndarray, rows: Parts, columns: Parts, share: np.ndarray) -> None:
    """Compute the part of each node's hat function that lies on parts of cells where flow is possible.

    Parameters
    ----------
    factor : float64[a, b]
    rows, columns : Parts
        These three as in `add_cells`.
    share : float64[rows, columns], out
    """
    first_row, weight_row, first_column, weight_column = rows.first, rows.weight, columns.first, columns.weight
    share[:] = 0.0
    for part_row in range(first_row.shape[0]):
        for part_column in range(first_column.shape[0]):
            if factor[part_row, part_column] > 0.0:
                for a in range(3):
                    i = first_row[part_row] + a
                    if weight_row[part_row, a] > 0.0 and 0 <= i < share.shape[0]:
                        for b in range(3):
                            j = first_column[part_column] + b
                            if 0 <= j < share.shape[1]:
                                share[i, j] += weight_row[part_row, a] * weight_column[part_column, b]


@jit
def mark_cells(
    nodes: np.ndarray, measure: int, factor: np.ndarray, rows: Parts, columns: Parts, mark: np.ndarray
) -> None:
    """Set `mark` to 1 in the cells that the hat function of a node with flow reaches.

    Parameters
    ----------
    nodes : float64[rows, columns, s]
    measure : int
        Column of `nodes` that is above 0 at a node with flow.
    factor : float64[a, b]
    rows, columns : Parts
        These three as in `add_cells`.
    mark : int32[cell rows, cell columns], out
    """
    owner_row, first_row, weight_row = rows
    owner_column, first_column, weight_column = columns
    reached = np.empty(nodes.shape[1], np.bool_)
    for part_row in range(first_row.shape[0]):
        reached[:] = False
        for a in range(3):
            i = first_row[part_row] + a
            if weight_row[part_row, a] > 0.0 and 0 <= i < nodes.shape[0]:
                for j in range(nodes.shape[1]):
                    reached[j] |= nodes[i, j, measure] > 0.0
        for part_column in range(first_column.shape[0]):
            if factor[part_row, part_column] > 0.0:
                for b in range(3):
                    j = first_column[part_column] + b
                    if weight_column[part_column, b] > 0.0 and 0 <= j < nodes.shape[1] and reached[j]:
                        mark[owner_row[part_row], owner_column[part_column]] = 1


@jit
def add_cells(
    nodes: np.ndarray,
    measure: int,
    factor: np.ndarray,
    mark: np.ndarray,
    rows: Parts,
    columns: Parts,
    area: float,
    sums: np.ndarray,
    top: np.ndarray,
) -> None:
    """Integrate the nodes' field over the cells: `sums`, and the largest mean of `measure` over a cell's parts.

    Parameters
    ----------
    nodes : float64[rows, columns, s]
        Values of each node.
    measure : int
        Column of `nodes` whose largest mean per area is computed.
    factor : float64[a, b]
        Factor of `measure` in each part of a cell; 0 where no flow is possible.
    mark : int32[cell rows, cell columns]
        Number of each cell, -1 for the cells that are left out.
    rows, columns : Parts
    area : float [m2]
        Of a part.
    sums : float64[cells, s], out
        Starts at zero.
    top : float64[cells], out
        Starts at zero.
    """
    owner_row, first_row, weight_row = rows
    owner_column, first_column, weight_column = columns
    held = nodes.shape[2]
    line, part = np.empty((nodes.shape[1], held)), np.empty(held)
    for part_row in range(first_row.shape[0]):
        line[:] = 0.0
        for a in range(3):
            i, w = first_row[part_row] + a, weight_row[part_row, a]
            if w > 0.0 and 0 <= i < nodes.shape[0]:
                for j in range(nodes.shape[1]):
                    for s in range(held):
                        line[j, s] += w * nodes[i, j, s]
        for part_column in range(first_column.shape[0]):
            k = mark[owner_row[part_row], owner_column[part_column]]
            if k < 0 or factor[part_row, part_column] <= 0.0:
                continue
            part[:] = 0.0
            for b in range(3):
                j, w = first_column[part_column] + b, weight_column[part_column, b]
                if w > 0.0 and 0 <= j < nodes.shape[1]:
                    for s in range(held):
                        part[s] += w * line[j, s]
            part[measure] *= factor[part_row, part_column]
            for s in range(held):
                sums[k, s] += part[s]
            top[k] = max(top[k], part[measure] / area)


@jit
def add_crests(
    nodes: np.ndarray,
    measure: int,
    factor: np.ndarray,
    mark: np.ndarray,
    rows: Parts,
    columns: Parts,
    corner: np.ndarray,
    part: np.ndarray,
    area: float,
    top: np.ndarray,
) -> None:
    """Raise `top` of the cells that hold a crest of `measure` to its height per area.

    A crest is a node that is not lower than the eight around it. Without this the peak of a coarse raster would
    depend on where its cells lie. A node between cells counts for the cell on its highest side.

    Parameters
    ----------
    nodes : float64[rows, columns, s]
    measure : int
    factor : float64[a, b]
    mark : int32[cell rows, cell columns]
    rows, columns : Parts
        These as in `add_cells`.
    corner, part : float64[2]
        Down and across: place of the first part's edge, counted from the first node, and its width, in node spacings.
    area : float [m2]
        Of a node.
    top : float64[cells], out
    """
    first = max(int(np.floor(corner[0] - ROUNDING)), 1)
    last = min(int(np.ceil(corner[0] + part[0] * factor.shape[0] + ROUNDING)), nodes.shape[0] - 2)
    for i in range(first, last + 1):
        for j in range(1, nodes.shape[1] - 1):
            here = nodes[i, j, measure]
            if here <= 0.0 or not _is_crest(nodes, measure, i, j, here):
                continue
            down, across, highest = 0, 0, -1.0
            for di in (-1, 1):
                for dj in (-1, 1):
                    side = nodes[i + di, j, measure] + nodes[i, j + dj, measure] + nodes[i + di, j + dj, measure]
                    if side > highest + LEVEL * here:
                        down, across, highest = di, dj, side
            row = int(np.floor((i - corner[0]) / part[0] + ROUNDING * down))
            column = int(np.floor((j - corner[1]) / part[1] + ROUNDING * across))
            if 0 <= row < factor.shape[0] and 0 <= column < factor.shape[1]:
                k = mark[rows.owner[row], columns.owner[column]]
                if k >= 0:
                    top[k] = max(top[k], here / area * factor[row, column])


@jit_inline
def _is_crest(nodes, measure, i, j, here):
    crest = True
    for a in range(i - 1, i + 2):
        for b in range(j - 1, j + 2):
            crest &= nodes[a, b, measure] <= here * (1.0 + LEVEL)
    return crest


@jit
def parts_with_ground(
    corner: np.ndarray,
    step_column: np.ndarray,
    step_row: np.ndarray,
    dtm_corner: np.ndarray,
    dtm_matrix: np.ndarray,
    elevation: np.ndarray,
    gradient: np.ndarray,
    sloped: bool,
    factor: np.ndarray,
) -> None:
    """Set the factor of each part of a cell to 1 where the DTM has an elevation at its middle, else to 0.

    Parameters
    ----------
    corner : float64[2] [m]
        Upper left corner of the parts.
    step_column, step_row : float64[2] [m]
        Map vectors to the next part.
    dtm_corner : float64[2] [m]
    dtm_matrix : float64[2, 2] [m]
    elevation : float64[rows, columns] [m]
    gradient : float64[rows, columns, 2] [1]
        These four describe the DTM as in `cell_places.place`.
    sloped : bool
        The factor is the cosine of the DTM's slope instead of 1; 0 where the DTM has no slope.
    factor : float64[a, b], out
    """
    a, b, d, e = dtm_matrix[0, 0], dtm_matrix[0, 1], dtm_matrix[1, 0], dtm_matrix[1, 1]
    determinant = a * e - b * d
    rows, columns = elevation.shape
    for i in range(factor.shape[0]):
        for j in range(factor.shape[1]):
            x = corner[0] + (j + 0.5) * step_column[0] + (i + 0.5) * step_row[0] - dtm_corner[0]
            y = corner[1] + (j + 0.5) * step_column[1] + (i + 0.5) * step_row[1] - dtm_corner[1]
            column, row = (e * x - b * y) / determinant, (a * y - d * x) / determinant
            there = row >= 0.0 and row < rows and column >= 0.0 and column < columns
            factor[i, j] = 0.0
            if there and np.isfinite(elevation[int(row), int(column)]):
                factor[i, j] = 1.0
                if sloped:
                    slope_east, slope_north = gradient[int(row), int(column), 0], gradient[int(row), int(column), 1]
                    upright = upward_part_of_normal(slope_east, slope_north)
                    factor[i, j] = upright if np.isfinite(upright) else 0.0


@jit
def parts_with_columns(
    row: np.ndarray,
    column: np.ndarray,
    first_row: int,
    first_column: int,
    parts_down: tuple,
    parts_across: tuple,
    factor: np.ndarray,
) -> None:
    """Set the factor to 1 in all parts of the cells that hold the position of a column.

    Parameters
    ----------
    row, column : int32[n]
        Cell of each column; below 0: it is left out.
    first_row, first_column : int
        Of the window of cells.
    parts_down, parts_across : (int, int)
        Parts in a cell, and number of the first part, down and across.
    factor : float64[a, b], out
    """
    for p in range(row.shape[0]):
        if row[p] >= 0:
            i = (row[p] - first_row) * parts_down[0] - parts_down[1]
            j = (column[p] - first_column) * parts_across[0] - parts_across[1]
            for a in range(max(i, 0), min(i + parts_down[0], factor.shape[0])):
                for b in range(max(j, 0), min(j + parts_across[0], factor.shape[1])):
                    factor[a, b] = 1.0


@jit
def count_columns(
    row: np.ndarray, column: np.ndarray, first_row: int, first_column: int, mark: np.ndarray, count: np.ndarray
) -> None:
    """Count the columns whose position lies in each numbered cell.

    Parameters
    ----------
    row, column : int32[n]
    first_row, first_column : int
        These four as in `parts_with_columns`.
    mark : int32[cell rows, cell columns]
        Number of each cell.
    count : int64[cells], out
        Starts at zero.
    """
    for p in range(row.shape[0]):
        if row[p] >= 0:
            count[mark[row[p] - first_row, column[p] - first_column]] += 1
