"""Check of the volume of the points of a 3D flow: packed mass, and layers that hang above the bed.

An explicit MPM conserves the mass of its points to rounding, but not their spacing. If cells are large against the
flow depth, points can crowd together without a change of their stress, come to rest above the ground on grid momentum
of other points, or come to rest farther apart than their mass requires. Balances do not show these errors; columns of
map cells do.
"""

from dataclasses import asdict, dataclass

import numpy as np

from ...frames.particles import Frame
from ...laws.quantities import GRAVITY

PACKED = 1.2  # [1] times the material density, above which mass counts as packed
PACKED_CELLS = 2.0  # [cells] side of the map squares for this test: points of a fluid gather in single cells
CLEARANCE = 0.25  # [cells] by which points may be lower than a lattice on the ground; sliding points: 0.1 to 0.2
HANGING_SHARE_OF_DEPTH = 0.5  # [1] gap under the lowest point over the thickness, above which a column hangs
HANGING_CELLS = (0.5, 1.5)  # [cells] limits of that gap; fallen material rests up to 1.4 high, half a point included
FALLING = 0.1  # [1] share of the free-fall speed through the gap, below which the column is not falling
PACKED_SHARE = 0.05  # [1] of the mass; limit of a usable result; resolved flows have 0.02 at most
HANGING_SHARE = 0.1  # [1] of the mass; limit of a usable result; resolved flows have 0.02 at most
MISSING_SHARE = 0.1  # [1] of the volume; limit of a usable result
LOOSE_SHARE = 0.1  # [1] of the volume at rest; limit of a usable result
LOOSE_FROM = 0.9  # [cells] least thickness of a loose layer: fewer points do not show how thick their layer is
INTERIOR = 0.5  # [1] share of a column's mass that each of its four neighbours has unless the column is at the rim


@dataclass(frozen=True)
class PointVolume:
    """Volume check of a 3D flow at one time.

    Parameters
    ----------
    time : float [s]
    mass : float [kg]
        Of the points with ground under them.
    packed_share, hanging_share : float [1]
        Of that mass: packed beyond PACKED times its density; in columns that hang above the bed without falling.
    missing_share : float [1]
        Of the volume of that mass: the part that exceeds the space below its points.
    loose_share : float [1]
        Excess of the space of points at rest on the ground over the volume of their mass, relative, in columns of at
        least LOOSE_FROM cells; 0 if less than HANGING_SHARE of all mass is at rest within the flow.
    cells_over_depth : float [1]
        Mass-weighted mean thickness of the flow, divided by the cell size.
    """

    time: float
    mass: float
    packed_share: float
    hanging_share: float
    missing_share: float
    cells_over_depth: float
    loose_share: float = 0.0

    @property
    def kept(self) -> bool:
        """True if all shares are within the limits of a usable result."""
        in_place = self.hanging_share <= HANGING_SHARE and self.loose_share <= LOOSE_SHARE
        return in_place and self.packed_share <= PACKED_SHARE and self.missing_share <= MISSING_SHARE

    def as_numbers(self) -> dict[str, float]:
        """Return all values as plain numbers for a record."""
        return asdict(self) | {"kept": self.kept}


def point_volume(
    frame: Frame, height: np.ndarray, slope: np.ndarray, cell_size: float, density: float, gravity: float = GRAVITY
) -> PointVolume:
    """Check the volume of the points of a frame.

    A map square has PACKED_CELLS cells per side. A point is packed if the points of its square up to its height have
    more than PACKED times the volume below that height. So a point above a packed layer does not hide it, and thin
    layers count like deep ones. The missing volume of a square is the largest excess over the space below a point.
    Hanging mass and loose layers are found in columns of single cells; the thickness of a loose layer is twice the
    mean height of the points of its column.

    Parameters
    ----------
    frame : Frame
        Of dimension 3.
    height : float64[n] [m]
        Vertical height of each point above the ground; NaN without ground.
    slope : float64[n] [1]
        Tangent of the steepest ground slope at each point.
    cell_size : float [m]
        Of the solver's grid.
    density : float [kg m-3]
        Of the material.
    gravity : float [m s-2]
    """
    known = np.isfinite(height)
    particles, (x, y) = frame.particles, frame.map_xy()
    mass = np.asarray(particles.mass, float)[known]
    if not mass.size:
        return PointVolume(frame.time, 0.0, 0.0, 0.0, 0.0, 0.0)
    height, steep = height[known], np.hypot(1.0, np.nan_to_num(slope[known]))
    half = 0.5 * np.cbrt(np.asarray(particles.volume, float)[known])
    speed = np.sqrt((np.asarray(particles.velocity, float)[known] ** 2).sum(axis=1))
    space = np.maximum(height, 0.0) + half + CLEARANCE * cell_size * steep
    square = _columns(x[known], y[known], cell_size, PACKED_CELLS)
    filled, space = _filled(square, height, mass / density), space * (PACKED_CELLS * cell_size) ** 2
    packed = filled > PACKED * space
    missing = np.zeros(square.max() + 1)
    np.maximum.at(missing, square, filled - space)
    column = _columns(x[known], y[known], cell_size, 1.0)
    of_column = np.bincount(column, mass)
    lowest = np.full(len(of_column), np.inf)
    np.minimum.at(lowest, column, height / steep - half)
    typical = np.bincount(column, mass * speed) / of_column
    thickness = of_column / (density * cell_size**2)
    allowed = np.clip(HANGING_SHARE_OF_DEPTH * thickness, *(cells * cell_size for cells in HANGING_CELLS))
    hanging, whole = (lowest > allowed) & (typical < _falls(lowest, gravity)), mass.sum()
    bottom = np.full(len(of_column), np.inf)
    np.minimum.at(bottom, column, height - half)
    above = height - np.clip(bottom[column], 0.0, CLEARANCE * cell_size * steep)
    taken = 2.0 * np.bincount(column, mass * above) / of_column
    lies = (lowest <= allowed) & (typical < _falls(taken, gravity))
    lies &= (thickness >= LOOSE_FROM * cell_size) & _interior(x[known], y[known], cell_size, of_column)
    return PointVolume(
        float(frame.time),
        float(whole),
        float(mass[packed].sum() / whole),
        float(of_column[hanging].sum() / whole),
        float(missing.sum() * density / whole),
        float((of_column * thickness).sum() / whole / cell_size),
        _excess(taken[lies], thickness[lies]) if of_column[lies].sum() > HANGING_SHARE * whole else 0.0,
    )


def _falls(height, gravity):
    """Compute FALLING times the speed [m s-1] of a free fall through `height` [m]."""
    return FALLING * np.sqrt(2.0 * gravity * np.maximum(height, 0.0))


def _excess(taken, thickness):
    """Compute by how much the heights `taken` [m] exceed, in all, the `thickness` [m] of the mass there; 0 at least."""
    return max(float(taken.sum() / thickness.sum()) - 1.0, 0.0)


def _filled(column, height, volume):
    """Compute for each point the volume of the points of its column up to its height, float64[n] [m3]."""
    order = np.lexsort((height, column))
    column = column[order]
    first = np.flatnonzero(np.diff(column, prepend=-1))
    below = np.cumsum(volume[order])
    filled = np.empty(len(below))
    filled[order] = below - (below[first] - volume[order][first])[column]
    return filled


def _columns(x, y, cell_size, cells):
    """Number the square (side: `cells` times `cell_size` [m]) of each point, from 0 without gaps, int64[n]."""
    return np.unique(_places(x, y, cell_size, cells)[0], return_inverse=True)[1].reshape(-1)


def _places(x, y, cell_size, cells):
    """Return the number of each point's square in the lattice, int64[n], and the squares of a row with an empty one.

    Squares begin a quarter of a cell before the first point, so that lattice points are not on square edges.
    """
    east, north = (np.floor(((values - values.min()) / cell_size + 0.25) / cells).astype(np.int64) for values in (x, y))
    row = int(east.max()) + 2
    return north * row + east, row


def _interior(x, y, cell_size, of_column):
    """Find the columns of single cells beside which each of four has INTERIOR of their mass `of_column` [kg]."""
    places, row = _places(x, y, cell_size, 1.0)
    known = np.unique(places)
    within = np.ones(len(known), bool)
    for step in (-1, 1, -row, row):
        at = np.minimum(np.searchsorted(known, known + step), len(known) - 1)
        within &= (known[at] == known + step) & (of_column[at] >= INTERIOR * of_column)
    return within
