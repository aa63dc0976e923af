"""Regions of a DTM with one constant elevation behind walls: undeclared nodata that is used as ground."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

from ..system.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from .flow_reach import Reach
    from .grid import Grid

WALL_DEGREES = 85.0  # [deg] a steeper step between two cells is a wall
LEAST_WALL = 10.0  # [m] of a wall: banks of basins and pits of small cells are lower
HIGH_WALL = 100.0  # [m] a step as high as this is a wall from HIGH_DEGREES on: coarse cells have no steeper ones
HIGH_DEGREES = 70.0  # [deg]
FEWEST = 4  # [cells] of one value behind walls; fewer only count with one of USUAL
USUAL = (0.0, -1.0, -9.0, -99.0, -999.0)  # values without data in many files
ROWS_AT_ONCE = 512  # whose steps are computed together, to limit the memory
_SAME = 1e-6  # [1] relative difference of two values that are the same: rounding of single precision
_LISTED = 3  # values that are reported one by one


class WalledRegion(NamedTuple):
    """Cells of one elevation behind walls.

    Parameters
    ----------
    value : float [m]
    cells : int
        Number of cells.
    parts : int
        Number of separate regions.
    wall : float [m]
        Height of the lowest wall; negative where the region is above the ground around it.
    east, north : float [m]
        Map position of a cell of the largest region.
    places : int[n, 2]
        Row and column of every cell.
    """

    value: float
    cells: int
    parts: int
    wall: float
    east: float
    north: float
    places: Any

    def words(self) -> str:
        """Return value, number, walls and place as text."""
        regions = "" if self.parts == 1 else f" in {self.parts} regions"
        side = "deep" if self.wall > 0 else "high"
        return (
            f"{self.cells} cells{regions} have the constant elevation {self.value:.7g} behind walls, at least "
            f"{abs(self.wall):.4g} m {side}, around E {self.east:.1f} N {self.north:.1f}"
        )


def walled_lines(regions: "tuple[WalledRegion, ...]", path: "str | Path") -> list[str]:
    """Return a message for each value.

    Parameters
    ----------
    regions : tuple of WalledRegion
    path : str or Path
        Of the DTM.
    """
    lines = [
        f"{path}: {region.words()}: probably undeclared nodata; if so, declare it (rio edit-info FILE --nodata "
        f"{region.value:.7g})"
        for region in regions[:_LISTED]
    ]
    if len(regions) > _LISTED:
        rest = regions[_LISTED:]
        cells = sum(region.cells for region in rest)
        lines.append(f"{path}: {cells} more cells with {len(rest)} other constant elevations are behind walls")
    return lines


def walled_regions(
    elevation: np.ndarray, grid: "Grid", steps: tuple[float, float] | None = None
) -> "tuple[WalledRegion, ...]":
    """Find the cells of one constant elevation that walls surround, most cells first.

    A region may extend to the edge of the raster or to nodata. A lake or the sea is none: at its shore the ground
    begins at its level.

    Parameters
    ----------
    elevation : float64[rows, columns] [m]
        NaN for nodata.
    grid : Grid
    steps : (float, float), optional [m]
        Its `largest_steps`, where they are known.
    """
    heights = [_least_wall(side) for side in reversed(grid.sides)]
    steps = largest_steps(elevation) if steps is None else steps
    if all(step < height for step, height in zip(steps, heights, strict=True)):
        return ()
    found = {}
    for value, cells, wall in _regions(elevation, heights):
        found.setdefault(value, []).append((cells, wall))
    regions = [_joined(value, parts, grid) for value, parts in found.items()]
    kept = [region for region in regions if region.cells >= FEWEST or region.value in USUAL]
    return tuple(sorted(kept, key=lambda region: (-region.cells, region.value)))


def _least_wall(side: float) -> float:
    """Return the height [m] from which a step over `side` [m] is a wall."""
    steep = max(LEAST_WALL, side * math.tan(math.radians(WALL_DEGREES)))
    return min(steep, max(HIGH_WALL, side * math.tan(math.radians(HIGH_DEGREES))))


def largest_steps(elevation: np.ndarray) -> tuple[float, float]:
    """Return the largest difference [m] between neighbours along columns and along rows; 0 without neighbours.

    Parameters
    ----------
    elevation : float64[rows, columns] [m]
    """
    steps = [0.0, 0.0]
    for _, rows in _bands(elevation):
        for axis in (0, 1):
            change = np.diff(rows, axis=axis)
            largest = max(
                np.fmax.reduce(change, axis=None, initial=0.0), -np.fmin.reduce(change, axis=None, initial=0.0)
            )
            steps[axis] = max(steps[axis], float(largest))
    return steps[0], steps[1]


def _bands(elevation: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield (first row, rows of the raster with one more than ROWS_AT_ONCE)."""
    for first in range(0, elevation.shape[0], ROWS_AT_ONCE):
        yield first, elevation[first : first + ROWS_AT_ONCE + 1]


def _regions(elevation: np.ndarray, heights: list) -> Iterator[tuple[float, np.ndarray, float]]:
    """Yield (value, row and column of its cells int[n, 2], height of the lowest wall) of each region.

    Every step from a cell of a region is a wall or leads to a cell of the same value. In other ground such cells are
    rare, so that only few groups of them are looked at.
    """
    enclosed, walled = _enclosed(elevation, heights)
    labels, count = scipy.ndimage.label(enclosed)
    alone = np.bincount(labels.ravel(), minlength=count + 1) == 1
    yield from _single_cells(elevation, walled & alone[labels])
    windows = scipy.ndimage.find_objects(labels)
    for number in np.unique(labels[walled & enclosed & ~alone[labels]]).tolist():
        window = tuple(slice(max(part.start - 1, 0), part.stop + 1) for part in windows[number - 1])
        first = np.array([part.start for part in window])
        heights_here, group = elevation[window], labels[window] == number
        for value in np.unique(heights_here[group]).tolist():
            pieces, count = scipy.ndimage.label(group & (heights_here == value))
            for piece in range(1, count + 1):
                wall = _lowest_wall(heights_here, pieces == piece, value)
                if wall is not None:
                    yield value, np.argwhere(pieces == piece) + first, wall


def _single_cells(elevation: np.ndarray, cells: np.ndarray) -> Iterator[tuple[float, np.ndarray, float]]:
    """Yield as `_regions` the cells (bool) without a neighbour of their value; values that are rare are left out.

    All of them at once: noise can have very many. Cells with walls up and down are left out, unless of USUAL.
    """
    row, column = np.nonzero(cells)
    values = elevation[row, column]
    around = np.full((4, row.size), np.nan)
    for k, (down, across) in enumerate(((-1, 0), (1, 0), (0, -1), (0, 1))):
        i, j = row + down, column + across
        there = (i >= 0) & (i < elevation.shape[0]) & (j >= 0) & (j < elevation.shape[1])
        around[k, there] = elevation[i[there], j[there]] - values[there]
    up, down = (np.where(side, around, np.nan) for side in (around > 0, around < 0))
    lowest = np.where(np.isnan(up).all(axis=0), np.fmax.reduce(down, axis=0), np.fmin.reduce(up, axis=0))
    usual = np.isin(values, USUAL)
    one_sided = np.isnan(up).all(axis=0) | np.isnan(down).all(axis=0)
    known, which, often = np.unique(values, return_inverse=True, return_counts=True)
    for k in np.flatnonzero((often >= FEWEST) | np.isin(known, USUAL)).tolist():
        own = (which == k) & (one_sided | usual)
        for place, wall in zip(np.argwhere(own)[:, 0].tolist(), lowest[own].tolist(), strict=True):
            yield float(known[k]), np.array([[row[place], column[place]]]), wall


def _enclosed(elevation: np.ndarray, heights: list) -> tuple[np.ndarray, np.ndarray]:
    """Return which cells have only walls and equal neighbours, and which have a wall, as two bool[rows, columns]."""
    enclosed, walled = np.isfinite(elevation), np.zeros(elevation.shape, bool)
    for first, rows in _bands(elevation):
        for axis, height in enumerate(heights):
            size = np.abs(np.diff(rows, axis=axis))
            wall = size >= height
            slope = (size > 0) & ~wall  # NaN is neither
            last = first + slope.shape[0]
            ends = np.s_[first:last, :-1], np.s_[first:last, 1:]
            if axis == 0:
                ends = np.s_[first:last], np.s_[first + 1 : last + 1]
            for end in ends:
                enclosed[end] &= ~slope
                walled[end] |= wall
    return enclosed, walled


def _lowest_wall(elevation: np.ndarray, piece: np.ndarray, value: float) -> float | None:
    """Return the height [m] of the lowest wall around cells of one value; None where they are ground.

    They are ground where they continue, and where some walls go up (positive) and others down, unless the value is one
    of USUAL.
    """
    around = scipy.ndimage.binary_dilation(piece) & ~piece & np.isfinite(elevation)
    steps = elevation[around] - value
    if not steps.size or (steps == 0).any():
        return None
    if steps.min() < 0 < steps.max() and value not in USUAL:  # a terrace
        return None
    if np.ptp(steps) == 0 and np.count_nonzero(piece) > 0.5 * elevation.size:  # a plain with a block on it
        return None
    up = steps[steps > 0]
    return float(up.min() if up.size else steps.max())


def _joined(value: float, parts: list, grid: "Grid") -> WalledRegion:
    """Return the WalledRegion of all regions of one value."""
    cells, _ = max(parts, key=lambda part: len(part[0]))
    middle = cells[np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1))]
    east, north = grid.xy(*middle)
    wall = min((wall for _, wall in parts), key=abs)
    places = np.concatenate([one for one, _ in parts])
    return WalledRegion(float(value), len(places), len(parts), wall, float(east), float(north), places)


def walled_in_reach(
    regions: "tuple[WalledRegion, ...]", reach: "Reach", grid: "Grid", cell_size: float
) -> "tuple[WalledRegion, ...]":
    """Return the regions that a flow can reach.

    A region below the ground around it is in reach where reachable ground is within a cell of the solver; a region
    above it where the energy of the flow is above it.

    Parameters
    ----------
    regions : tuple of WalledRegion
    reach : Reach
        Reachable ground, on every `reach.step`-th pixel.
    grid : Grid
        Of the DTM.
    cell_size : float [m]
        Of the solver.
    """
    near = int(np.ceil(1.5 * max(cell_size / grid.cell_size, 1.0))) + reach.step - 1
    beside = None
    found = []
    for region in regions:
        row, column = (np.minimum(region.places[:, k] // reach.step, reach.inside.shape[k] - 1) for k in (0, 1))
        if region.wall > 0 and beside is None:
            beside = scipy.ndimage.binary_dilation(reach.inside, np.ones((3, 3)), -(-near // reach.step))
        if (beside if region.wall > 0 else reach.inside)[row, column].any():
            found.append(region)
    return tuple(found)


def require_real(regions: "tuple[WalledRegion, ...]", real: "Sequence[float]", path: "str | Path") -> list[str]:
    """Refuse regions in reach of a flow whose elevation is not declared as ground; return a warning for each other.

    Parameters
    ----------
    regions : tuple of WalledRegion
        Those in reach.
    real : sequence of float [m]
        Elevations that are ground.
    path : str or Path
        Of the DTM.

    Raises
    ------
    InputError
    """
    lines = []
    for region in regions:
        if not any(math.isclose(region.value, value, rel_tol=_SAME, abs_tol=_SAME) for value in real):
            raise InputError(
                f"{path}: the flow can reach probably undeclared nodata: {region.words()}; declare it (rio edit-info "
                f"FILE --nodata {region.value:.7g}), or if it is ground: [terrain] real_values = [{region.value:.7g}]"
            )
        lines.append(
            f"warning: the flow can reach constant ground behind walls: {region.words()}; it is ground by [terrain] "
            "real_values"
        )
    return lines
