"""What columns hold as a smooth field over the ground, integrated over raster cells.

A column of a depth-averaged run is a sample of the flow, not a block of material: its solver spreads it over nine nodes
with a quadratic B-spline, and only the sum of many columns is a flow depth. An export does the same. The sums of all
columns go to the nodes of the solver's lattice, are bilinear in between, and every raster cell takes the integral of
that field. So volume is conserved in every cell size, and a fine raster shows a smooth depth.
"""

from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are first used

from ..kernels import binning
from ..kernels import node_fields as kernel
from ..kernels.cell_places import ROUNDING
from .sampling import export_axes

SPLINE_REACH = 2.5  # node spacings from a column to the end of its field: 1.5 of the spline, 1 of the hats


class Axis(NamedTuple):
    """The raster cells along one side of a window, in lattice units.

    Parameters
    ----------
    start : float
        Lattice place of the first cell's edge, counted from the first node.
    cell : float
        Width of a cell, in node spacings.
    parts : int
        Parts that a cell is cut into; none is wider than the node spacing.
    low : int
        Number of the first part that a node reaches, counted from the first cell. The parts before it are left out.
    owner : int64[parts]
        Cell that each part belongs to.
    first : int64[parts]
        Of each part the first node that its field depends on.
    weight : float64[parts, 3]
        How much of the hats of three nodes lies in each part.
    """

    start: float
    cell: float
    parts: int
    low: int
    owner: np.ndarray
    first: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, start, cell, cells, nodes):
        """The axis of `cells` cells that are `cell` node spacings wide, from `start` on; 0 is the first of `nodes`."""
        parts = max(1, int(np.ceil(cell - 1e-9)))
        part = cell / parts
        low = max(0, int(np.floor((-1.0 - start) / part)))
        high = min(cells * parts, int(np.ceil((nodes - start) / part)))
        number = np.arange(low, max(high, low) + 1)
        edges = start + number * part
        whole = np.rint(edges)
        edges = np.where(np.abs(edges - whole) < ROUNDING, whole, edges)  # no slivers where cells end at nodes
        first = np.floor(edges[:-1]).astype(np.int64)
        node = first[:, None] + np.arange(3)
        weight = _below(edges[1:, None] - node) - _below(edges[:-1, None] - node)
        weight = np.ascontiguousarray(np.maximum(weight, 0.0))
        return cls(float(start), float(cell), parts, low, number[:-1] // parts, first, weight)

    @property
    def part(self):
        """Width of a part, in node spacings."""
        return self.cell / self.parts

    def rows(self, first, last):
        """The axis of the cells from `first` to `last` alone."""
        a, b = np.searchsorted(self.owner, (first, last))
        return self._replace(
            start=self.start + first * self.cell, low=self.low + int(a) - first * self.parts,
            owner=self.owner[a:b] - first, first=self.first[a:b], weight=self.weight[a:b],
        )  # fmt: skip

    def shares(self, nodes):
        """float64[nodes]: how much of each node's hat lies in the cells."""
        node = self.first[:, None] + np.arange(3)
        there = (node >= 0) & (node < nodes)
        return np.bincount(node[there], self.weight[there], nodes)

    def table(self):
        """The arrays that the kernels take."""
        return self.owner, self.first, self.weight


def _below(place):
    """Integral of the hat function of a node at 0 up to `place`, in node spacings."""
    place = np.clip(place, -1.0, 1.0)
    return np.where(place < 0.0, 0.5 * (1.0 + place) ** 2, 1.0 - 0.5 * (1.0 - place) ** 2)


class Lattice(NamedTuple):
    """Nodes laid out along the axes of a raster, `spacing` [m] apart, one of them at the map point `anchor` [m]."""

    spacing: float
    anchor: tuple

    @classmethod
    def of_solver(cls, spacing, terrain_grid, grid):
        """The nodes of a depth-averaged run on a DTM, along the axes of the export `grid`.

        One lies where the cells of the export are counted from: on the upper left corner of the DTM's bounds, or on the
        first corner of a rotated DTM whose axes the export keeps.
        """
        return cls(float(spacing), tuple(export_axes(terrain_grid, not grid.is_rotated).corner))

    def units(self, grid):
        """(float64[2], float64[2, 2]): sides of a cell of `grid` in node spacings; map vectors to (across, down)."""
        sides = np.array(grid.sides) / self.spacing
        return sides, sides[:, None] * np.linalg.inv(grid.matrix)

    def place_of(self, grid, x, y):
        """float64[2]: (across, down) of a map point [m], counted from the anchor along the axes of `grid`."""
        return self.units(grid)[1] @ np.array([x - self.anchor[0], y - self.anchor[1]])

    def window(self, grid, nodes):
        """(first row, end row, first column, end column) of the cells of `grid` that the window of `nodes` reaches."""
        sides, _ = self.units(grid)
        corner = self.place_of(grid, grid.transform.c, grid.transform.f)
        low = np.floor((np.array([nodes[2], nodes[0]]) - 1.0 - corner) / sides).astype(int)
        high = np.ceil((np.array([nodes[3], nodes[1]]) - corner) / sides).astype(int)
        (j0, i0), (j1, i1) = np.maximum(low, 0), np.minimum(high, grid.shape[::-1])
        return np.array([i0, max(i1, i0), j0, max(j1, j0)], np.int64)

    def axes(self, grid, cells, nodes):
        """(Axis down, Axis across) of the window `cells` of `grid`, counted from the first of the window `nodes`."""
        (across, down), _ = self.units(grid)
        corner = self.place_of(grid, grid.transform.c, grid.transform.f)
        return (
            Axis.of(corner[1] + cells[0] * down - nodes[0], down, cells[1] - cells[0], nodes[1] - nodes[0]),
            Axis.of(corner[0] + cells[2] * across - nodes[2], across, cells[3] - cells[2], nodes[3] - nodes[2]),
        )

    def cell_window(self, grid, bed, cells, axes, sloped=False):
        """The CellWindow of the `cells` of `grid` with their `axes`: flow may be where `bed` has ground.

        With `sloped` the factor is the cosine of the slope under the middle of each part, else 1.
        """
        down, across = axes
        factor = np.empty((len(down.owner), len(across.owner)))
        first = cells[0] + down.low / down.parts - 0.5, cells[2] + across.low / across.parts - 0.5
        step_column, step_row = grid.matrix[:, 0] / across.parts, grid.matrix[:, 1] / down.parts
        kernel.parts_with_ground(
            np.array(grid.xy(*first)), step_column, step_row, bed.grid.corner, bed.grid.matrix, bed.elevation,
            bed.gradient, sloped, factor,
        )  # fmt: skip
        return CellWindow(cells, axes, factor, self.node_area(grid))

    def node_area(self, grid):
        """Ground of one node [m2]."""
        sides, _ = self.units(grid)
        return grid.cell_area / float(sides.prod())


class CellWindow(NamedTuple):
    """Raster cells that a window of nodes reaches.

    Parameters
    ----------
    cells : int64[4]
        First row, row after the last, first column, column after the last.
    axes : (Axis, Axis)
        Down and across, counted from the first node.
    factor : float64[rows of parts, columns of parts]
        What the measure of a field is multiplied by in each part of a cell; 0 where no flow may be.
    node_area : float [m2]
        Ground of one node.
    """

    cells: np.ndarray
    axes: tuple
    factor: np.ndarray
    node_area: float

    def admit(self, row, column):
        """Let flow be in the cells that hold a particle, `row` and `column` int32[n], whatever their ground."""
        down, across = self.axes
        parts = (down.parts, down.low), (across.parts, across.low)
        kernel.parts_with_columns(row, column, self.cells[0], self.cells[2], *parts, self.factor)

    def shares(self, shape):
        """float64[shape]: how much of each node's hat lies where flow may be."""
        down, across = self.axes
        if self.factor.all():
            return down.shares(shape[0])[:, None] * across.shares(shape[1])[None, :]
        share = np.empty(shape)
        kernel.hat_shares(self.factor, *down.table()[1:], *across.table()[1:], share)
        return share


class CellSums(NamedTuple):
    """The field of nodes in the cells that it reaches.

    `index` int64[k] flat number of each cell in the grid, ascending; `sums` float64[k, s]; `top` float64[k] [m-2]
    largest amount per area of one of the sums, of the parts of the cell and the crests in it; `mark` int32[rows,
    columns] number of each cell of the window, -1 where it has none.
    """

    index: np.ndarray
    sums: np.ndarray
    top: np.ndarray
    mark: np.ndarray


def nodes_to_cells(nodes, present, measure, grid, window):
    """Integrate the field of `nodes` over the cells of `grid` in `window`.

    Parameters
    ----------
    nodes : float64[rows, columns, s]
    present, measure : int
        The sum without which a cell is left out, and the one whose largest value per area is wanted.
    grid : Grid
    window : CellWindow

    Returns
    -------
    CellSums
    """
    down, across = window.axes
    first_row, end_row, first_column, end_column = window.cells
    mark = np.zeros((end_row - first_row, end_column - first_column), np.int32)
    kernel.mark_cells(nodes, present, window.factor, *down.table(), *across.table(), mark)
    index = np.empty(int(np.count_nonzero(mark)), np.int64)
    binning.number_cells(mark, window.cells, grid.shape[1], index)
    sums, top = np.zeros((len(index), nodes.shape[2])), np.zeros(len(index))
    part = np.array([down.part, across.part])
    area = part.prod() * window.node_area
    kernel.add_cells(nodes, measure, window.factor, mark, *down.table(), *across.table(), area, sums, top)
    corner = np.array([down.start + down.low * down.part, across.start + across.low * across.part])
    kernel.add_crests(
        nodes, measure, window.factor, mark, down.owner, across.owner, corner, part, window.node_area, top
    )
    return CellSums(index, sums, top, mark)


def column_sums(frame, placed, bed, grid, row, column, lattice):
    """Give the columns of `frame` to the nodes of `lattice`, and integrate their field over the cells of `grid`.

    Parameters
    ----------
    frame : Frame
    placed : Placed
    bed : Bed
    grid : Grid
        Of the export.
    row, column : int32[n]
        Cell of each column; `row` is below 0 for columns that are left out.
    lattice : Lattice

    Returns
    -------
    (CellSums, int64[k])
        With the sums that `binning` names, `top` of UPRIGHT; and the number of columns in each cell.
    """
    particles, n = frame.particles, len(frame.particles)
    _, matrix = lattice.units(grid)
    shift = lattice.place_of(grid, *np.asarray(frame.origin, float)[:2])
    place, extent = np.empty((n, 2)), np.zeros(4, np.int64)
    if (row >= 0).any():
        kernel.lattice_places(particles.position, row, matrix, shift, place, extent)
    cells = lattice.window(grid, extent)
    window = lattice.cell_window(grid, bed, cells, lattice.axes(grid, cells, extent))
    window.admit(row, column)
    nodes = np.zeros((int(extent[1] - extent[0]), int(extent[3] - extent[2]), binning.SUMS))
    share = window.shares(nodes.shape[:2])
    kernel.spread_columns(
        place, row, extent, share, _gains(share), placed.pixel, bed.gradient_by_pixel,
        particles.velocity, particles.mass, particles.volume, nodes,
    )  # fmt: skip
    found = nodes_to_cells(nodes, binning.MASS, binning.UPRIGHT, grid, window)
    count = np.zeros(len(found.index), np.int64)
    kernel.count_columns(row, column, cells[0], cells[2], found.mark, count)
    return found, count


def _gains(share):
    """float64[rows, columns]: one over the part of each node's spline on ground with flow, from those of the hats.

    A quadratic B-spline is 1/8, 3/4 and 1/8 at three nodes, and hats with these heights are close to it everywhere.
    """
    if share.min(initial=1.0) > 1.0 - 1e-9:
        return np.ones(share.shape)
    part = scipy.ndimage.convolve1d(share, _AT_NODES, 0, mode="nearest")
    part = scipy.ndimage.convolve1d(part, _AT_NODES, 1, mode="nearest")
    return np.divide(1.0, part, out=np.zeros(share.shape), where=part > 1e-9)


_AT_NODES = (0.125, 0.75, 0.125)
