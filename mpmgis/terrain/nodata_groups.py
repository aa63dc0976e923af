"""Cells without elevation: holes inside the DTM, and the nodata collar that extends to its edge."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

if TYPE_CHECKING:
    from .elevation import Terrain
    from .flow_reach import Reach
    from .grid import Grid

_AROUND = np.ones((3, 3))


def nodata_groups(nodata: np.ndarray) -> tuple[np.ndarray, set[int]]:
    """Number the groups of cells without elevation; cells that share a side or a corner are of one group.

    A group at the edge is the collar, any other a hole.

    Parameters
    ----------
    nodata : bool[rows, columns]

    Returns
    -------
    int[rows, columns]
        Number of the group of each cell, from 1; 0 for cells with elevation.
    set of int
        The groups at the edge.
    """
    labels, _ = scipy.ndimage.label(nodata, _AROUND)
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    return labels, set(np.unique(rim[rim > 0]).tolist())


class NodataGroup(NamedTuple):
    """A group of cells without elevation.

    Parameters
    ----------
    cells : int
        Number of cells.
    east, north : float [m]
        Map position of one of them.
    """

    cells: int
    east: float
    north: float


class NodataInReach(NamedTuple):
    """Nodata of a DTM that the flow can reach.

    Parameters
    ----------
    holes : tuple of NodataGroup
        Whole holes, the largest first.
    collar : NodataGroup or None
        Only the cells of the collar next to reachable ground.
    """

    holes: tuple = ()  # of NodataGroup, whole holes
    collar: NodataGroup | None = None  # only the cells next to reachable ground

    @property
    def hole(self) -> tuple[int, float, float] | None:
        """Cells of all holes, east and north [m] of the largest; None where no hole is in reach."""
        return (sum(hole.cells for hole in self.holes), *self.holes[0][1:]) if self.holes else None

    def as_numbers(self) -> dict[str, Any]:
        """Return all of it as plain numbers for a record."""
        collar = None if self.collar is None else self.collar._asdict()
        return {"holes": [hole._asdict() for hole in self.holes], "collar": collar}

    def lines(self) -> list[str]:
        """Return messages before a run."""
        lines = []
        if self.holes:
            cells, east, north = self.hole
            more = "" if len(self.holes) == 1 else f" in {len(self.holes)} holes, {self.holes[0].cells} of them"
            lines.append(
                f"the flow can reach nodata amid the DTM: {cells} cells{more} around E {east:.1f} N "
                f"{north:.1f}; what flows in there leaves the terrain; fill it: [terrain] fill_nodata = "
                "'interpolate'"
            )
        if self.collar is not None:
            east, north = self.collar.east, self.collar.north
            lines.append(
                f"the flow can reach the nodata around the DTM: {self.collar.cells} cells, for example at E {east:.1f} "
                f"N {north:.1f}; what gets there leaves the terrain; take a larger DTM"
            )
        return lines


def nodata_in_reach(terrain: "Terrain", reach: "Reach", cell_size: float) -> NodataInReach:
    """Find the nodata that a flow can reach.

    Nodata is in reach where reachable ground is so near that a cell of the solver between them has no elevation.

    Parameters
    ----------
    terrain : Terrain
    reach : Reach
        Reachable ground, on every `reach.step`-th pixel.
    cell_size : float [m]
        Of the solver.
    """
    nodata = ~terrain.valid
    if not nodata.any() or not reach.inside.any():
        return NodataInReach()
    rows, columns = nodata.shape
    radius = int(np.ceil(1.5 * max(cell_size / terrain.grid.cell_size, 1.0))) + reach.step - 1
    reached = np.repeat(np.repeat(reach.inside, reach.step, 0), reach.step, 1)[:rows, :columns]
    beside = nodata & scipy.ndimage.binary_dilation(reached, _AROUND, radius)
    labels, at_edge = nodata_groups(nodata)
    of_collar = beside & np.isin(labels, list(at_edge))
    windows = scipy.ndimage.find_objects(labels)
    holes = []
    for number in np.unique(labels[beside & ~of_collar]).tolist():
        window = windows[number - 1]
        holes.append(_group(terrain.grid, labels[window] == number, [part.start for part in window]))
    holes.sort(key=lambda hole: (-hole.cells, hole.east, hole.north))
    return NodataInReach(tuple(holes), _group(terrain.grid, of_collar, (0, 0)) if of_collar.any() else None)


def _group(grid: "Grid", cells: np.ndarray, first: tuple[int, int]) -> NodataGroup:
    """Return the NodataGroup of bool `cells` of a window of `grid` from the cell `first`; its place is one of them."""
    at = np.argwhere(cells)
    place = at[np.argmin(((at - at.mean(axis=0)) ** 2).sum(axis=1))] + first
    east, north = grid.xy(*place)
    return NodataGroup(len(at), float(east), float(north))
