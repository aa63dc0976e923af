"""The depth-averaged solver's grid: square cells on the DTM's extent, with the bed at its nodes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from scipy import ndimage

from ...system.errors import SceneError
from ...terrain.elevation import Terrain, bilinear, continued
from .spline_bed import beds_at, node_gradients

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from ...terrain.nodata_groups import NodataInReach

FEWEST_CELLS = 3  # along a side of the domain
MAX_NODES_PER_SIDE = 262_000  # block rows, of 8 nodes each, have 15 bits and a sign
RIM = 3  # [cells] beyond the known ground over which it is extended with its slope
LEVEL = 1e-6  # [1] tangent of a slope below which there is no downhill direction
ROUNDING = 1e-9  # [cells] error of the extent of the terrain that does not cost a cell
RIM_ROUNDING = 1e-6  # [pixels] by which a node may lie beyond the rim of the raster
SPARE = 4  # numbers behind an array of nodes, because kernels load three nodes of a row as four


class CellWindow(NamedTuple):
    """Some cells: uint8[a, b] with 1 for those that belong, and the row and column of the array's first cell."""

    marked: np.ndarray
    row: int
    column: int


@dataclass(frozen=True)
class ColumnGrid:
    """Nodes on cell corners, with one ghost node outside each edge.

    Parameters
    ----------
    x0, y0 : float [m]
        Map coordinates of the domain's south-west corner, which is node [1, 1].
    rest : float [m]
        What has to be added to `y0` to be exact: the corner is a whole number of cells south of the raster's upper one.
    cell_size : float [m]
    bed : float64[ny + 3, nx + 3] [m]
        Coefficients of the spline bed b = sum b_i N_i; row index grows northwards.
    gradient : float64[ny + 3, nx + 3, 2]
        Gradient of the spline bed at the nodes.
    inside : uint8[ny, nx]
        1 for cells that the DTM covers; leaving them is leaving the terrain.
    """

    x0: float
    y0: float
    cell_size: float
    bed: np.ndarray
    gradient: np.ndarray
    inside: np.ndarray
    rest: float = 0.0

    @classmethod
    def on(cls, terrain: Terrain, cell_size: float) -> Self:
        """Make the grid on a terrain, anchored at the upper left corner of the raster's bounding box.

        The bed is bilinear where cells are finer than pixels and the mean over the node's box where they are coarser.

        Parameters
        ----------
        terrain : Terrain
        cell_size : float [m]

        Raises
        ------
        SceneError
            The terrain has too few or too many cells of this size.
        """
        west, _, _, north = terrain.grid.bounds
        near = terrain.moved(-west, -north)  # the upper left corner is (0, 0) there, and small cells keep their digits
        _, depth, length, _ = near.grid.bounds
        off = max(ROUNDING, terrain.grid.rounding / cell_size)  # [cells]
        nx, ny = (int(extent / cell_size + off) for extent in (length, -depth))
        if min(nx, ny) < FEWEST_CELLS:
            raise SceneError(
                f"[numerics] cell_size = {cell_size:g} m leaves {nx} x {ny} cells on a terrain of "
                f"{length:g} x {-depth:g} m, expected {FEWEST_CELLS} x {FEWEST_CELLS} at least; "
                "take a smaller cell_size"
            )
        if max(nx, ny) > MAX_NODES_PER_SIDE:
            raise SceneError(
                f"[numerics] cell_size = {cell_size:g} m makes {nx} x {ny} cells, expected at most "
                f"{MAX_NODES_PER_SIDE} along a side; take a larger cell_size or clip the DTM"
            )
        x0, y0 = west, north - ny * cell_size
        bed = _node_beds(near, 0.0, -ny * cell_size, cell_size, nx, ny)
        known = np.isfinite(bed)
        core = known[1:-1, 1:-1] & _on_raster(near.grid, 0.0, -ny * cell_size, cell_size, nx, ny, off)
        inside = core[:-1, :-1] & core[:-1, 1:] & core[1:, :-1] & core[1:, 1:]
        if not known.all():  # ghosts and rims need a bed on which a plane stays one; there is no flow there
            bed = continued(bed, most=RIM)
        gradient = node_gradients(bed, cell_size)
        gradient[0], gradient[-1] = gradient[1], gradient[-2]
        gradient[:, 0], gradient[:, -1] = gradient[:, 1], gradient[:, -2]
        rest = (north - y0) - ny * cell_size
        return cls(x0, y0, float(cell_size), spared(bed), gradient, inside.astype(np.uint8), rest)

    def corner_from(self, origin: Sequence[float]) -> np.ndarray:
        """Return the vector from a place of the map to the domain's south-west corner.

        Parameters
        ----------
        origin : sequence of float [m]
            E, N, ... of the place.

        Returns
        -------
        float64[2] [m]
        """
        return np.array([self.x0 - origin[0], (self.y0 - origin[1]) + self.rest])

    def from_corner(self, frame: "Frame") -> tuple[np.ndarray, np.ndarray]:
        """Return the places of the particles of a frame, from the domain's south-west corner.

        Parameters
        ----------
        frame : Frame

        Returns
        -------
        float64[n], float64[n] [m]
            East and north.
        """
        x, y = frame.xy_from(self.x0, self.y0)
        return x, y - self.rest

    def holds(self, frame: "Frame") -> np.ndarray:
        """Return which particles of a frame are on cells that the DTM covers; elsewhere is off the terrain.

        Parameters
        ----------
        frame : Frame

        Returns
        -------
        bool[n]
        """
        return self.covers(*self.from_corner(frame))

    def covers(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return which places are on cells that the DTM covers.

        Parameters
        ----------
        x, y : float64[n] [m]
            From the domain's south-west corner.

        Returns
        -------
        bool[n]
        """
        ny, nx = self.inside.shape
        there = (x >= 0) & (y >= 0) & (x < nx * self.cell_size) & (y < ny * self.cell_size)
        i, j = ((np.where(there, v, 0.0) / self.cell_size).astype(int) for v in (x, y))
        return there & (self.inside[np.minimum(j, ny - 1), np.minimum(i, nx - 1)] == 1)

    def some_place(self) -> tuple[float, float]:
        """Return the map coordinates [m] of the middle of a cell that the DTM covers."""
        row, column = np.argwhere(self.inside)[0]
        return self.x0 + (column + 0.5) * self.cell_size, self.y0 + (row + 0.5) * self.cell_size

    def cells_of(self, frame: "Frame", grown: int = 0) -> CellWindow:
        """Return the cells with columns of a frame, and those around them.

        Parameters
        ----------
        frame : Frame
        grown : int [cells]
            Distance up to which cells around those with columns belong.
        """
        x, y = self.from_corner(frame)
        ny, nx = self.inside.shape
        j, i = (y / self.cell_size).astype(int), (x / self.cell_size).astype(int)
        row, column = max(j.min() - grown, 0), max(i.min() - grown, 0)
        marked = np.zeros((min(j.max() + grown + 1, ny) - row, min(i.max() + grown + 1, nx) - column), np.uint8)
        marked[j - row, i - column] = 1
        if grown:
            marked = ndimage.binary_dilation(marked, np.ones((3, 3)), grown).astype(np.uint8)
        return CellWindow(marked, int(row), int(column))

    def corners_of(self, window: CellWindow) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows and columns, in the node arrays, of all corners of the cells of a window.

        Parameters
        ----------
        window : CellWindow
        """
        corners = np.zeros((window.marked.shape[0] + 1, window.marked.shape[1] + 1), bool)
        for j in (0, 1):
            for i in (0, 1):
                corners[j : j + window.marked.shape[0], i : i + window.marked.shape[1]] |= window.marked == 1
        rows, columns = np.nonzero(corners)
        return rows + window.row + 1, columns + window.column + 1

    def node_axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the map coordinates [m] of the columns and of the rows of the nodes, ghosts included."""
        rows, columns = self.bed.shape
        return self.x0 + (np.arange(columns) - 1) * self.cell_size, self.y0 + (np.arange(rows) - 1) * self.cell_size

    def node_points(self) -> list[np.ndarray]:
        """Return the map coordinates [m] of all nodes, each float64[ny + 3, nx + 3]."""
        return np.meshgrid(*self.node_axes())

    def domain_nodes(self) -> np.ndarray:
        """Return which nodes are no ghosts.

        Returns
        -------
        bool[ny + 3, nx + 3]
        """
        inner = np.zeros(self.bed.shape, bool)
        inner[1:-1, 1:-1] = True
        return inner

    def beds_at(self, frame: "Frame") -> np.ndarray:
        """Compute the elevation of the spline bed under the columns of a frame.

        Parameters
        ----------
        frame : Frame

        Returns
        -------
        float64[n] [m]
        """
        return beds_at(self.bed, *self.from_corner(frame), self.cell_size)[0]

    def gradients_at(self, frame: "Frame") -> np.ndarray:
        """Compute the gradient of the bed under the columns of a frame.

        Parameters
        ----------
        frame : Frame

        Returns
        -------
        float64[n, 2] [1]
        """
        return np.column_stack(beds_at(self.bed, *self.from_corner(frame), self.cell_size)[1:])

    def downslope(self, frame: "Frame") -> np.ndarray:
        """Compute unit vectors along the ground down the steepest descent under the columns of a frame.

        Parameters
        ----------
        frame : Frame

        Returns
        -------
        float64[n, 3] [1]

        Raises
        ------
        SceneError
            Level ground.
        """
        gradient = self.gradients_at(frame)
        slope = np.hypot(*gradient.T)
        level = slope < LEVEL
        if level.any():
            x, y = (values[int(np.argmax(level))] for values in frame.map_xy())
            raise SceneError(
                f"a speed down the steepest descent needs a slope; the ground is level under {int(level.sum())} of "
                f"{len(slope)} columns, the first at E {x:.1f} N {y:.1f}; give a velocity east and north instead"
            )
        along = -gradient / (slope * np.sqrt(1.0 + slope**2))[:, None]
        return np.column_stack([along, (along * gradient).sum(axis=1)])


def require_ground(solver: str, edges: str, in_reach: "NodataInReach") -> None:
    """Raise SceneError where the flow can reach nodata and the solver, or its edges, need ground.

    The 3D solver needs ground without holes, walls at the edges also ground up to the edge of the DTM.

    Parameters
    ----------
    solver : {"columns", "points"}
    edges : {"open", "wall"}
    in_reach : NodataInReach

    Raises
    ------
    SceneError
    """
    hole, collar = in_reach.hole, in_reach.collar
    window = "a [terrain] window = [west, south, east, north] without it"
    if hole is not None and (solver == "points" or edges == "wall"):
        who = "the 3D solver" if solver == "points" else "[numerics] edges = 'wall'"
        cells, east, north = hole
        raise SceneError(
            f"{who} needs ground without holes where the flow can get, got {cells} cells of nodata around "
            f"E {east:.1f} N {north:.1f}; set [terrain] fill_nodata = 'interpolate', or take {window}"
        )
    if collar is not None and edges == "wall":
        raise SceneError(
            "[numerics] edges = 'wall' needs a DTM without nodata around it where the flow can get, got "
            f"{collar.cells} cells, for example at E {collar.east:.1f} N {collar.north:.1f}; take {window}, or "
            "edges = 'open'"
        )


def bed_at_nodes(grid: ColumnGrid) -> np.ndarray:
    """Compute the elevation of the spline bed at the nodes; the outermost ones continue their line.

    Parameters
    ----------
    grid : ColumnGrid

    Returns
    -------
    float64[ny + 3, nx + 3] [m]
    """
    rows, columns = (np.arange(size - 2) * grid.cell_size for size in grid.bed.shape)
    inner_x, inner_y = np.meshgrid(columns, rows)
    bed = beds_at(grid.bed, inner_x.ravel(), inner_y.ravel(), grid.cell_size)[0].reshape(inner_x.shape)
    return np.pad(bed, 1, mode="reflect", reflect_type="odd")


def spared(array: np.ndarray) -> np.ndarray:
    """Copy an array, with SPARE numbers to spare behind it.

    Parameters
    ----------
    array : float64[...]
    """
    padded = np.zeros(array.size + SPARE)
    padded[: array.size] = array.ravel()
    return padded[: array.size].reshape(array.shape)


def _on_raster(grid, x0, y0, cell_size, nx, ny, off):
    """bool[ny + 1, nx + 1]: nodes on the raster itself, not on its extension; up to `off` [cells] beyond is its rim."""
    x, y = x0 + np.arange(nx + 1) * cell_size, y0 + np.arange(ny + 1) * cell_size
    row, column = grid.rowcol(x[None, :], y[:, None])
    rows, columns = grid.shape
    rim = 0.5 + max(RIM_ROUNDING, off * cell_size / min(grid.sides))
    return (row >= -rim) & (row <= rows - 1 + rim) & (column >= -rim) & (column <= columns - 1 + rim)


def _node_beds(terrain, x0, y0, cell_size, nx, ny):
    """Elevation [m] at all nodes, ghosts included: the raster is extended oddly beyond its rim (a plane stays one)."""
    pixel = terrain.grid.cell_size
    samples = max(1, int(np.ceil(cell_size / pixel - 1e-9)))
    pad = int(np.ceil(2.0 * cell_size / min(np.hypot(*terrain.grid.matrix)))) + 2
    padded = terrain.elevation
    while pad > 0:  # odd reflection requires a raster wider than the padding
        now = min(pad, min(padded.shape) - 1)
        if now < 1:
            padded = np.pad(padded, pad, mode="edge")
            break
        padded = np.pad(padded, now, mode="reflect", reflect_type="odd")
        pad -= now
    added = (padded.shape[0] - terrain.elevation.shape[0]) // 2
    x = x0 + (np.arange(nx + 3) - 1) * cell_size
    y = y0 + (np.arange(ny + 3) - 1) * cell_size
    total = np.zeros((ny + 3, nx + 3))
    offsets = ((np.arange(samples) + 0.5) / samples - 0.5) * cell_size if samples > 1 else np.zeros(1)
    for oy in offsets:
        for ox in offsets:
            row, column = terrain.grid.rowcol(x[None, :] + ox, y[:, None] + oy)
            total += bilinear(padded, row + added, column + added)
    return total / len(offsets) ** 2
