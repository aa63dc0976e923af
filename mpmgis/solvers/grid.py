"""The depth-averaged solver's grid: square cells on the DTM's extent, with the bed at its nodes."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..errors import SceneError
from ..geo.terrain import Terrain, bilinear
from ..kernels.columns import node_gradients

MAX_NODES_PER_SIDE = 262_000  # block rows have 15 bits beside the sign, of 8 nodes each


@dataclass(frozen=True)
class ColumnGrid:
    """Nodes on cell corners, with one ghost node outside each edge.

    Parameters
    ----------
    x0, y0 : float [m]
        Map coordinates of the domain's south-west corner, which is node [1, 1].
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

    @classmethod
    def on(cls, terrain: Terrain, cell_size: float):
        """The grid on `terrain`, anchored at the upper left corner of the raster's bounding box.

        The bed is bilinear where cells are finer than pixels and the mean over the node's box where they are coarser.
        """
        west, south, east, north = terrain.grid.bounds
        nx, ny = (int((b - a) / cell_size + 1e-9) for a, b in ((west, east), (south, north)))
        if min(nx, ny) < 3:
            raise SceneError(
                f"[numerics] cell_size = {cell_size:g} m leaves {nx} x {ny} cells on a terrain of "
                f"{east - west:g} x {north - south:g} m, wanted 3 x 3 at least; take a smaller cell_size"
            )
        if max(nx, ny) > MAX_NODES_PER_SIDE:
            raise SceneError(
                f"[numerics] cell_size = {cell_size:g} m makes {nx} x {ny} cells, wanted at most "
                f"{MAX_NODES_PER_SIDE} along a side; take a larger cell_size or clip the DTM"
            )
        x0, y0 = west, north - ny * cell_size
        bed = _node_beds(terrain, x0, y0, cell_size, nx, ny)
        known = np.isfinite(bed)
        core = known[1:-1, 1:-1] & _on_raster(terrain.grid, x0, y0, cell_size, nx, ny)
        inside = core[:-1, :-1] & core[:-1, 1:] & core[1:, :-1] & core[1:, 1:]
        if not known.all():  # ghosts and rims need a finite bed; nobody flows there
            nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
            bed = bed[tuple(nearest)]
        gradient = node_gradients(bed, cell_size)
        gradient[0], gradient[-1] = gradient[1], gradient[-2]
        gradient[:, 0], gradient[:, -1] = gradient[:, 1], gradient[:, -2]
        return cls(x0, y0, float(cell_size), bed, gradient, inside.astype(np.uint8))


def _on_raster(grid, x0, y0, cell_size, nx, ny):
    """bool[ny + 1, nx + 1]: nodes on the raster itself, its rim included, not on its extension."""
    x, y = x0 + np.arange(nx + 1) * cell_size, y0 + np.arange(ny + 1) * cell_size
    row, column = grid.rowcol(x[None, :], y[:, None])
    rows, columns = grid.shape
    rim = 0.5 + 1e-6
    return (row >= -rim) & (row <= rows - 1 + rim) & (column >= -rim) & (column <= columns - 1 + rim)


def _node_beds(terrain, x0, y0, cell_size, nx, ny):
    """Elevation [m] at all nodes, ghosts included: the raster is extended oddly beyond its rim (a plane stays one)."""
    pixel = terrain.grid.cell_size
    samples = max(1, int(np.ceil(cell_size / pixel - 1e-9)))
    pad = int(np.ceil(2.0 * cell_size / min(np.hypot(*terrain.grid.matrix)))) + 2
    padded = terrain.elevation
    while pad > 0:  # odd reflection needs a raster wider than what it adds
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
