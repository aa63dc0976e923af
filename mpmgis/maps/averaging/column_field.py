"""Columns as a smooth field over the ground, integrated over raster cells.

A column of a depth-averaged run is a sample of the flow, not a block of material: its solver spreads it over nine nodes
with a quadratic B-spline, and only the sum of many columns is a flow depth. An export does the same: columns are
summed at the nodes of the solver's lattice, the field is bilinear between nodes, and every raster cell takes its
integral. Volume is conserved for every cell size, and a fine raster has a smooth depth.
"""

from typing import NamedTuple

import numpy as np
import scipy  # submodules are loaded on first use

from ...frames.particles import Frame
from ...terrain.grid import Grid
from . import binning
from . import lattice_fields as kernel
from .cell_places import ROUNDING
from .export_resolution import export_axes
from .placement import Bed, Placed

SPLINE_REACH = 2.5  # [node spacings] from a column to the end of its field: 1.5 of the spline, 1 of the hats
_AT_NODES = (0.125, 0.75, 0.125)  # [1] quadratic B-spline at the three nodes around its middle


class Axis(NamedTuple):
    """The raster cells along one side of a window, in lattice units.

    Parameters
    ----------
    start : float
        Lattice coordinate of the first cell's edge, from the first node.
    cell : float
        Width of a cell, in node spacings.
    parts : int
        Parts of a cell, none wider than the node spacing.
    low : int
        Number of the first part within reach of a node, from the first cell. Earlier parts are omitted.
    owner : int64[parts]
        Cell of each part.
    first : int64[parts]
        First node of the field in each part.
    weight : float64[parts, 3]
        Integrals of the hat functions of three nodes over each part.
    """

    start: float
    cell: float
    parts: int
    low: int
    owner: np.ndarray
    first: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, start: float, cell: float, cells: int, nodes: int) -> "Axis":
        """Cut cells along an axis into parts, and integrate the hat functions of nodes over them.

        Parameters
        ----------
        start : float
            Edge of the first cell, in node spacings from the first node.
        cell : float
            Width of a cell, in node spacings.
        cells, nodes : int
            Number of them.
        """
        parts = max(1, int(np.ceil(cell - 1e-9)))
        part = cell / parts
        low = max(0, int(np.floor((-1.0 - start) / part)))
        high = min(cells * parts, int(np.ceil((nodes - start) / part)))
        number = np.arange(low, max(high, low) + 1)
        edges = start + number * part
        whole = np.rint(edges)
        edges = np.where(np.abs(edges - whole) < ROUNDING, whole, edges)  # no slivers at cell edges on nodes
        first = np.floor(edges[:-1]).astype(np.int64)
        node = first[:, None] + np.arange(3)
        weight = _below(edges[1:, None] - node) - _below(edges[:-1, None] - node)
        weight = np.ascontiguousarray(np.maximum(weight, 0.0))
        return cls(float(start), float(cell), parts, low, number[:-1] // parts, first, weight)

    @property
    def part(self) -> float:
        """Width of a part, in node spacings."""
        return self.cell / self.parts

    def rows(self, first: int, last: int) -> "Axis":
        """Return the axis of a range of cells.

        Parameters
        ----------
        first, last : int
            First cell, and cell after the last.
        """
        a, b = np.searchsorted(self.owner, (first, last))
        return self._replace(
            start=self.start + first * self.cell,
            low=self.low + int(a) - first * self.parts,
            owner=self.owner[a:b] - first,
            first=self.first[a:b],
            weight=self.weight[a:b],
        )

    def shares(self, nodes: int) -> np.ndarray:
        """Integrate each node's hat function over the cells.

        Parameters
        ----------
        nodes : int
            Number of nodes.

        Returns
        -------
        float64[nodes]
        """
        node = self.first[:, None] + np.arange(3)
        there = (node >= 0) & (node < nodes)
        return np.bincount(node[there], self.weight[there], nodes)

    def table(self) -> kernel.Parts:
        """Return the arrays for the kernels."""
        return kernel.Parts(self.owner, self.first, self.weight)


def _below(place):
    """Integral of the hat function of a node at 0 up to `place`, in node spacings."""
    place = np.clip(place, -1.0, 1.0)
    return np.where(place < 0.0, 0.5 * (1.0 + place) ** 2, 1.0 - 0.5 * (1.0 - place) ** 2)


class Lattice(NamedTuple):
    """Nodes along the axes of a raster, `spacing` [m] apart, with one node at the map point `anchor` [m]."""

    spacing: float
    anchor: tuple

    @classmethod
    def of_solver(cls, spacing: float, terrain_grid: Grid, grid: Grid) -> "Lattice":
        """Return the nodes of a depth-averaged run on a DTM, along the axes of the export grid.

        One node is at the origin of the export cells: the upper left corner of the DTM's bounds, or the first corner
        of a rotated DTM if the export keeps its axes.

        Parameters
        ----------
        spacing : float [m]
            Of the nodes.
        terrain_grid, grid : Grid
            Of the DTM; of the export.
        """
        return cls(float(spacing), tuple(export_axes(terrain_grid, not grid.is_rotated).corner))

    def units(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Return the units of a grid in node spacings.

        Parameters
        ----------
        grid : Grid

        Returns
        -------
        (float64[2], float64[2, 2])
            Sides of a cell [node spacings]; matrix that turns map vectors [m] into (across, down) [node spacings].
        """
        sides = np.array(grid.sides) / self.spacing
        return sides, sides[:, None] * np.linalg.inv(grid.matrix)

    def place_of(self, grid: Grid, x: float, y: float) -> np.ndarray:
        """Compute the place of a map point, from the anchor along the axes of a grid.

        Parameters
        ----------
        grid : Grid
        x, y : float [m]

        Returns
        -------
        float64[2]
            Across and down, in node spacings.
        """
        return self.units(grid)[1] @ np.array([x - self.anchor[0], y - self.anchor[1]])

    def window(self, grid: Grid, nodes: np.ndarray) -> np.ndarray:
        """Find the cells of a grid within reach of nodes.

        Parameters
        ----------
        grid : Grid
        nodes : int64[4]
            First row, row after the last, first column, column after the last of the nodes.

        Returns
        -------
        int64[4]
            The same of the cells.
        """
        sides, _ = self.units(grid)
        corner = self.place_of(grid, grid.transform.c, grid.transform.f)
        low = np.floor((np.array([nodes[2], nodes[0]]) - 1.0 - corner) / sides).astype(int)
        high = np.ceil((np.array([nodes[3], nodes[1]]) - corner) / sides).astype(int)
        (j0, i0), (j1, i1) = np.maximum(low, 0), np.minimum(high, grid.shape[::-1])
        return np.array([i0, max(i1, i0), j0, max(j1, j0)], np.int64)

    def axes(self, grid: Grid, cells: np.ndarray, nodes: np.ndarray) -> tuple[Axis, Axis]:
        """Return the axes of a window of cells.

        Parameters
        ----------
        grid : Grid
        cells, nodes : int64[4]
            Windows of cells and of nodes, as in `window`.

        Returns
        -------
        (Axis, Axis)
            Down and across, from the first node.
        """
        (across, down), _ = self.units(grid)
        corner = self.place_of(grid, grid.transform.c, grid.transform.f)
        return (
            Axis.of(corner[1] + cells[0] * down - nodes[0], down, cells[1] - cells[0], nodes[1] - nodes[0]),
            Axis.of(corner[0] + cells[2] * across - nodes[2], across, cells[3] - cells[2], nodes[3] - nodes[2]),
        )

    def cell_window(self, grid: Grid, bed: Bed, cells: np.ndarray, axes: tuple, sloped: bool = False) -> "FieldWindow":
        """Return the window of cells with the factor of each part; flow is possible where the bed has data.

        Parameters
        ----------
        grid : Grid
        bed : Bed
        cells : int64[4]
        axes : (Axis, Axis)
            Of the cells.
        sloped : bool
            The factor is the cosine of the slope at the middle of each part, else 1.

        Returns
        -------
        FieldWindow
        """
        down, across = axes
        factor = np.empty((len(down.owner), len(across.owner)))
        first = cells[0] + down.low / down.parts - 0.5, cells[2] + across.low / across.parts - 0.5
        step_column, step_row = grid.matrix[:, 0] / across.parts, grid.matrix[:, 1] / down.parts
        kernel.parts_with_ground(
            np.array(grid.xy(*first)),
            step_column,
            step_row,
            bed.grid.corner,
            bed.grid.matrix,
            bed.elevation,
            bed.gradient,
            sloped,
            factor,
        )
        return FieldWindow(cells, axes, factor, self.node_area(grid))

    def node_area(self, grid: Grid) -> float:
        """Return the ground area [m2] of one node.

        Parameters
        ----------
        grid : Grid
        """
        sides, _ = self.units(grid)
        return grid.cell_area / float(sides.prod())


class FieldWindow(NamedTuple):
    """Raster cells within reach of a window of nodes.

    Parameters
    ----------
    cells : int64[4]
        First row, row after the last, first column, column after the last.
    axes : (Axis, Axis)
        Down and across, from the first node.
    factor : float64[rows of parts, columns of parts]
        Factor of the field in each part of a cell; 0 where no flow is possible.
    node_area : float [m2]
        Ground area of one node.
    """

    cells: np.ndarray
    axes: tuple
    factor: np.ndarray
    node_area: float

    def admit(self, row: np.ndarray, column: np.ndarray) -> None:
        """Allow flow in the cells of particles, also where the bed has no data.

        Parameters
        ----------
        row, column : int32[n]
            Cell of each particle; below 0: it is left out.
        """
        down, across = self.axes
        parts = (down.parts, down.low), (across.parts, across.low)
        kernel.parts_with_columns(row, column, self.cells[0], self.cells[2], *parts, self.factor)

    def shares(self, shape: tuple) -> np.ndarray:
        """Integrate each node's hat function where flow is possible.

        Parameters
        ----------
        shape : tuple
            Rows and columns of the nodes.

        Returns
        -------
        float64[rows, columns]
        """
        down, across = self.axes
        if self.factor.all():
            return down.shares(shape[0])[:, None] * across.shares(shape[1])[None, :]
        share = np.empty(shape)
        kernel.hat_shares(self.factor, down.table(), across.table(), share)
        return share


class CellSums(NamedTuple):
    """Integrals of a nodal field over raster cells.

    Parameters
    ----------
    index : int64[k]
        Flat number of each cell in the grid, ascending.
    sums : float64[k, s]
    top : float64[k] [m-2]
        Largest amount per area of one sum, over the parts of the cell and its crests.
    mark : int32[rows, columns]
        Number of each cell of the window, -1 outside the field.
    """

    index: np.ndarray
    sums: np.ndarray
    top: np.ndarray
    mark: np.ndarray


def nodes_to_cells(nodes: np.ndarray, present: int, measure: int, grid: Grid, window: FieldWindow) -> CellSums:
    """Integrate the field of `nodes` over the cells of `grid` in `window`.

    Parameters
    ----------
    nodes : float64[rows, columns, s]
    present, measure : int
        Number of the sum that must be present in a cell, and of the sum for `top`.
    grid : Grid
    window : FieldWindow

    Returns
    -------
    CellSums
    """
    down, across = window.axes
    first_row, end_row, first_column, end_column = window.cells
    mark = np.zeros((end_row - first_row, end_column - first_column), np.int32)
    rows, columns = down.table(), across.table()
    kernel.mark_cells(nodes, present, window.factor, rows, columns, mark)
    index = np.empty(int(np.count_nonzero(mark)), np.int64)
    binning.number_cells(mark, window.cells, grid.shape[1], index)
    sums, top = np.zeros((len(index), nodes.shape[2])), np.zeros(len(index))
    part = np.array([down.part, across.part])
    area = part.prod() * window.node_area
    kernel.add_cells(nodes, measure, window.factor, mark, rows, columns, area, sums, top)
    corner = np.array([down.start + down.low * down.part, across.start + across.low * across.part])
    kernel.add_crests(nodes, measure, window.factor, mark, rows, columns, corner, part, window.node_area, top)
    return CellSums(index, sums, top, mark)


def column_sums(
    frame: Frame, placed: Placed, bed: Bed, grid: Grid, row: np.ndarray, column: np.ndarray, lattice: Lattice
) -> tuple[CellSums, np.ndarray]:
    """Spread the columns of `frame` to the nodes of `lattice` and integrate the field over the cells of `grid`.

    Parameters
    ----------
    frame : Frame
    placed : Placed
    bed : Bed
    grid : Grid
        Export grid.
    row, column : int32[n]
        Cell of each column; negative `row`: column is ignored.
    lattice : Lattice

    Returns
    -------
    (CellSums, int64[k])
        Sums as defined in `binning`, with `top` of UPRIGHT; number of columns in each cell.
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
        place,
        row,
        extent,
        share,
        _gains(share),
        placed.pixel,
        bed.gradient_by_pixel,
        particles.velocity,
        particles.mass,
        particles.volume,
        nodes,
    )
    found = nodes_to_cells(nodes, binning.MASS, binning.UPRIGHT, grid, window)
    count = np.zeros(len(found.index), np.int64)
    kernel.count_columns(row, column, cells[0], cells[2], found.mark, count)
    return found, count


def _gains(share):
    """float64[rows, columns]: inverse of the part of each node's spline on ground with flow, from the hat shares.

    A quadratic B-spline is 1/8, 3/4 and 1/8 at three nodes; hat functions with these heights approximate it.
    """
    if share.min(initial=1.0) > 1.0 - 1e-9:
        return np.ones(share.shape)
    part = scipy.ndimage.convolve1d(share, _AT_NODES, 0, mode="nearest")
    part = scipy.ndimage.convolve1d(part, _AT_NODES, 1, mode="nearest")
    return np.divide(1.0, part, out=np.zeros(share.shape), where=part > 1e-9)
