"""Whether the points of a 3D flow still fill the volume that they stand for: packed mass, layers that hang off the bed.

An explicit MPM keeps the mass of its points to rounding, but not their spacing. On cells that are large against the
flow's depth points can crowd together without their stress noticing, or come to rest on each other's grid momentum
above the ground, or come to rest farther apart than their mass asks. None shows in a balance. All show in the columns
of the map's cells.
"""

from dataclasses import asdict, dataclass

import numpy as np

from ..fields import GRAVITY

PACKED = 1.2  # times its density, above which mass is packed
PACKED_CELLS = 2.0  # side of the squares of the map in which that is taken: points of a fluid gather in single cells
CLEARANCE = 0.25  # [cells] that points may lie lower than a lattice on the ground; what slides lies 0.1 to 0.2 lower
# Empty height under the lowest point of a column above which it hangs: half its own thickness, within these [cells].
# What has fallen rests up to 1.4 cells high, of which half a point is its own.
HANGING_SHARE_OF_DEPTH, HANGING_CELLS = 0.5, (0.5, 1.5)
FALLING = 0.1  # share of the speed of a free fall through that height, below which the column does not fall
PACKED_SHARE, HANGING_SHARE = 0.05, 0.1  # of the mass, above which volume is lost; resolved flows have 0.02 at most
MISSING_SHARE = 0.1  # of the volume, above which the room that the points take is too small for their mass
LOOSE_SHARE = 0.1  # of the volume of what lies at rest, by which the room that it takes may be larger
INTERIOR = 0.5  # of a column's mass, that each of the four beside it has where it is no rim


@dataclass(frozen=True)
class PointVolume:
    """What became of the volume of a 3D flow at one time.

    Parameters
    ----------
    time : float [s]
    mass : float [kg]
        Of the points that have ground under them.
    packed_share, hanging_share : float [1]
        Of that mass: packed beyond PACKED times its density; in columns that hang off the bed and do not fall.
    missing_share : float [1]
        Of the volume of that mass: what does not fit into the height that its points take.
    loose_share : float [1]
        By which the room that points at rest on the ground take is larger than the volume of their mass; 0 where less
        than HANGING_SHARE of all mass is at rest within the flow.
    cells_over_depth : float [1]
        Mean thickness of the flow over the cell size, weighted by mass.
    """

    time: float
    mass: float
    packed_share: float
    hanging_share: float
    missing_share: float
    cells_over_depth: float
    loose_share: float = 0.0

    @property
    def kept(self):
        """Whether all shares are within what a usable result has."""
        in_place = self.hanging_share <= HANGING_SHARE and self.loose_share <= LOOSE_SHARE
        return in_place and self.packed_share <= PACKED_SHARE and self.missing_share <= MISSING_SHARE

    def as_numbers(self):
        """All of it as plain numbers for a record."""
        return asdict(self) | {"kept": self.kept}


def point_volume(frame, height, slope, cell_size, density, gravity=GRAVITY):
    """The PointVolume of a Frame of points.

    In a square of the map of PACKED_CELLS cells the points that lie no higher than a point fill a height; where that is
    more than PACKED times the height at which the point lies, the point is packed. So a point in the air above a packed
    layer hides nothing, and a thin layer counts as well as a deep one. What is
    missing in a square is the largest excess of volume over room. What hangs is found in columns of single cells, and
    so is what lies too loose, by the mean height of a column's points: half its thickness, where they fill it evenly.

    Parameters
    ----------
    frame : Frame
        Of dimension 3.
    height : float64[n] [m]
        Of each point above the ground under it, vertical; NaN where there is no ground.
    slope : float64[n] [1]
        Tangent of the steepest slope of the ground there.
    cell_size : float [m]
        Of the solver's grid.
    density : float [kg m-3]
    gravity : float [m s-2]

    Returns
    -------
    PointVolume
    """
    known = np.isfinite(height)
    particles, (x, y) = frame.particles, frame.map_xy()
    mass = np.asarray(particles.mass, float)[known]
    if not mass.size:
        return PointVolume(frame.time, 0.0, 0.0, 0.0, 0.0, 0.0)
    height, steep = height[known], np.hypot(1.0, np.nan_to_num(slope[known]))
    half = 0.5 * np.cbrt(np.asarray(particles.volume, float)[known])
    speed = np.sqrt((np.asarray(particles.velocity, float)[known] ** 2).sum(axis=1))
    room = np.maximum(height, 0.0) + half + CLEARANCE * cell_size * steep
    square = _columns(x[known], y[known], cell_size, PACKED_CELLS)
    filled, room = _filled(square, height, mass / density), room * (PACKED_CELLS * cell_size) ** 2
    packed = filled > PACKED * room
    missing = np.zeros(square.max() + 1)
    np.maximum.at(missing, square, filled - room)
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
    lies &= _interior(x[known], y[known], cell_size, of_column)
    return PointVolume(
        float(frame.time), float(whole), float(mass[packed].sum() / whole), float(of_column[hanging].sum() / whole),
        float(missing.sum() * density / whole), float((of_column * thickness).sum() / whole / cell_size),
        _excess(taken[lies], thickness[lies]) if of_column[lies].sum() > HANGING_SHARE * whole else 0.0,
    )  # fmt: skip


def _falls(height, gravity):
    """FALLING times the speed [m s-1] of a free fall through `height` [m]."""
    return FALLING * np.sqrt(2.0 * gravity * np.maximum(height, 0.0))


def _excess(taken, thickness):
    """By how much the heights `taken` [m] exceed, in all, the `thickness` [m] of the mass there; 0 at least."""
    return max(float(taken.sum() / thickness.sum()) - 1.0, 0.0)


def _filled(column, height, volume):
    """float64[n] [m3]: the volume of the points of each one's column that lie no higher than it does."""
    order = np.lexsort((height, column))
    column = column[order]
    first = np.flatnonzero(np.diff(column, prepend=-1))
    below = np.cumsum(volume[order])
    filled = np.empty(len(below))
    filled[order] = below - (below[first] - volume[order][first])[column]
    return filled


def _columns(x, y, cell_size, cells):
    """int64[n]: which square of so many `cells` of `cell_size` [m] each point lies in, numbered from 0 without gaps."""
    return np.unique(_places(x, y, cell_size, cells)[0], return_inverse=True)[1].reshape(-1)


def _places(x, y, cell_size, cells):
    """(int64[n] the square's number in its lattice, squares of a row of it with an empty one at its end).

    Squares begin a quarter of a cell before the first point, so that no points of a lattice lie on their edges.
    """
    east, north = (np.floor(((values - values.min()) / cell_size + 0.25) / cells).astype(np.int64) for values in (x, y))
    row = int(east.max()) + 2
    return north * row + east, row


def _interior(x, y, cell_size, of_column):
    """bool[columns]: columns of single cells beside which each of four has INTERIOR of their mass `of_column` [kg]."""
    places, row = _places(x, y, cell_size, 1.0)
    known = np.unique(places)
    within = np.ones(len(known), bool)
    for step in (-1, 1, -row, row):
        at = np.minimum(np.searchsorted(known, known + step), len(known) - 1)
        within &= (known[at] == known + step) & (of_column[at] >= INTERIOR * of_column)
    return within
