"""Cells without elevation: holes, and the collar around the DTM."""

from typing import NamedTuple

import numpy as np
import scipy

_AROUND = np.ones((3, 3))


def nodata_groups(nodata):
    """(int[rows, columns] number of the group of each cell of bool `nodata`, from 1; set of the groups at the edge).

    Cells that share a side or a corner are of one group. A group at the edge is the collar, any other a hole.
    """
    labels, _ = scipy.ndimage.label(nodata, _AROUND)
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    return labels, set(np.unique(rim[rim > 0]).tolist())


class NodataGroup(NamedTuple):
    """Cells without elevation: their number, and a map place [m] among them."""

    cells: int
    east: float
    north: float


class NodataInReach(NamedTuple):
    """What the flow can reach of the nodata of a DTM: the holes, largest first, and cells of the collar (or None)."""

    holes: tuple = ()  # of NodataGroup, whole holes
    collar: NodataGroup | None = None  # only the cells next to reachable ground

    @property
    def hole(self):
        """(cells of all holes, east, north [m] of the largest); None where no hole is in reach."""
        return (sum(hole.cells for hole in self.holes), *self.holes[0][1:]) if self.holes else None

    def as_numbers(self):
        """All of it as plain numbers for a record."""
        collar = None if self.collar is None else self.collar._asdict()
        return {"holes": [hole._asdict() for hole in self.holes], "collar": collar}

    def lines(self):
        """Messages before a run."""
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


def nodata_in_reach(terrain, reach, cell_size):
    """The NodataInReach of a flow on cells of `cell_size` [m].

    Nodata is in reach where reachable ground is so near that a cell of the solver between them has no elevation.

    Parameters
    ----------
    terrain : Terrain
    reach : Reach
        Reachable ground, on every `reach.step`-th pixel.
    cell_size : float [m]
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


def _group(grid, cells, first):
    """The NodataGroup of bool `cells` of a window of `grid` from the cell `first`; its place is one of them."""
    at = np.argwhere(cells)
    place = at[np.argmin(((at - at.mean(axis=0)) ** 2).sum(axis=1))] + first
    east, north = grid.xy(*place)
    return NodataGroup(len(at), float(east), float(north))
