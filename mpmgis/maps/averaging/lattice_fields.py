"""Fields between the nodes of a square lattice, integrated over raster cells.

Columns give their sums to the nodes of the lattice with quadratic B-splines, as their solver does (Steffen et al.
2008). Between the nodes the sums are bilinear. Each raster cell takes the exact integral of that field, so that the
cells together have the mass of the columns, for any cell size.

Places are in lattice units: `across` counts along the raster's columns, `down` along its rows, one per node spacing.
"""

import numpy as np

from ...compiled.jit import jit, jit_inline
from .binning import MASS, SUMS, VOLUME, add_motion
from .cell_places import ROUNDING, upward_part_of_normal

LEVEL = 1e-9  # share of a node's value by which another of the same height may differ for rounding


@jit_inline
def spline(place):
    """First of the three nodes of the stencil of a column at `place`, and their quadratic B-spline weights."""
    first = int(np.floor(place + 0.5)) - 1
    f = place - first
    return first, 0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2


@jit
def lattice_places(position, row, matrix, shift, place, window):
    """Places of columns on the lattice, and the window of nodes that they give to.

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
def spread_columns(place, row, window, share, gain, pixel, gradient, velocity, mass, volume, nodes):
    """Give the sums of every column to its nine nodes.

    A column gives only to ground that the raster has, and all of its mass. Beside ground that is left out its weights
    are multiplied by the nodes' `gain`, so that a sheet keeps its depth there, and then scaled to the whole mass.

    Parameters
    ----------
    place, row, window : as `lattice_places` returns
    share : float64[rows, columns]
        Part of the bilinear hat function of each node on cells of the raster that can contain flow.
    gain : float64[rows, columns]
        One over the part of each node's spline that lies there; 1 inside the flow's ground.
    pixel, gradient : int64[n], float64[pixels, 2]
        The DTM pixel under each column, and the slopes of the pixels.
    velocity, mass, volume : float[n, 3] [m s-1], float[n] [kg], float[n] [m3]
    nodes : float64[rows, columns, SUMS], out
        Starts at zero; columns of `binning.SUMS`.
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
def hat_shares(factor, first_row, weight_row, first_column, weight_column, share):
    """`share` float64[rows, columns] of each node's hat that lies on the parts of cells that may hold flow.

    `factor` and the tables of rows and columns are those of `add_cells`.
    """
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
    nodes, measure, factor, owner_row, first_row, weight_row, owner_column, first_column, weight_column, mark
):
    """Set `mark` int32[cell rows, cell columns] to 1 in the cells that a node with something reaches.

    `measure` is the column of `nodes` that shows whether a node has something; the other arrays as in `add_cells`.
    """
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
    nodes,
    measure,
    factor,
    mark,
    owner_row,
    first_row,
    weight_row,
    owner_column,
    first_column,
    weight_column,
    area,
    sums,
    top,
):
    """Integrate the nodes' field over the cells: `sums`, and the largest mean of `measure` over a cell's parts.

    Parameters
    ----------
    nodes : float64[rows, columns, s]
        Values of each node.
    measure : int
        Column of `nodes` whose largest mean per area is computed.
    factor : float64[a, b]
        Cells are cut into parts that are no wider than the node spacing. What `measure` is multiplied by in each part;
        0 where no flow may be.
    mark : int32[cell rows, cell columns]
        Number of each cell, -1 for the cells that are left out.
    owner_row, first_row, weight_row : int64[a], int64[a], float64[a, 3]
        Of each row of parts: the cell row that it belongs to, the first node, and how much of the hats of three nodes
        lies in it.
    owner_column, first_column, weight_column : as for rows
    area : float [m2]
        Of a part.
    sums : float64[cells, s], out
        Starts at zero.
    top : float64[cells], out
        Starts at zero.
    """
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
def add_crests(nodes, measure, factor, mark, owner_row, owner_column, corner, part, area, top):
    """Raise `top` of the cells that hold a crest of `measure` to its height per area.

    A crest is a node that is not lower than the eight around it. Without this the peak of a coarse raster would
    depend on where its cells lie. A node between cells counts for the cell on its highest side.

    Parameters
    ----------
    nodes, measure, factor, mark, owner_row, owner_column, top : as in `add_cells`
    corner, part : float64[2]
        Down and across: place of the first part's edge, counted from the first node, and its width, in node spacings.
    area : float [m2]
        Of a node.
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
                k = mark[owner_row[row], owner_column[column]]
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
def parts_with_ground(corner, step_column, step_row, dtm_corner, dtm_matrix, elevation, gradient, sloped, factor):
    """Set `factor` float64[rows, columns] to 1, and to 0 where the DTM has no elevation at the middle of a part.

    With `sloped` it is the cosine of the DTM's slope instead of 1; 0 where the DTM has no slope.

    `corner` [m] is the upper left corner of the parts, `step_column` and `step_row` float64[2] [m] lead to the next
    ones; `dtm_corner` and `dtm_matrix` as in `binning.place`.
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
def parts_with_columns(row, column, first_row, first_column, parts_down, parts_across, factor):
    """Set `factor` to 1 in all parts of the cells that hold the position of a column.

    `parts_down` and `parts_across` (parts in a cell, number of the first part) of the rows and columns of parts.
    """
    for p in range(row.shape[0]):
        if row[p] >= 0:
            i = (row[p] - first_row) * parts_down[0] - parts_down[1]
            j = (column[p] - first_column) * parts_across[0] - parts_across[1]
            for a in range(max(i, 0), min(i + parts_down[0], factor.shape[0])):
                for b in range(max(j, 0), min(j + parts_across[0], factor.shape[1])):
                    factor[a, b] = 1.0


@jit
def count_columns(row, column, first_row, first_column, mark, count):
    """Count the columns whose position lies in each numbered cell."""
    for p in range(row.shape[0]):
        if row[p] >= 0:
            count[mark[row[p] - first_row, column[p] - first_column]] += 1
