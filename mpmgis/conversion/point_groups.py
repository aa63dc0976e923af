"""The bed below columns and points, and the stress of the weight of a column.

A conversion stores in the `state` of the frame, one row per point: `depth` [m], vertical, below the surface, and
`vertical_stress` [Pa], negative in compression. A material computes its strain from them; without it every layer would
first drop until its elasticity carries it.

Points over ground, and the columns that they are grouped into.
"""

import numpy as np

from ..system.errors import InputError

SPREAD = 2.0  # times the footprint of a column over which its points can be spread and still belong together
APART = 0.01  # share of the mass in other columns, from which on the parents are not used
_DENSE = 16  # up to this ratio of numbers to points columns are found in a table of all numbers


class PointsOverGround:
    """Points over ground: rows `index` of a frame, with `height` [m] over the bed, `bed` [m] and its gradient."""

    def __init__(self, frame, index, bed, slope_east, slope_north):
        self.frame, self.index, self.bed = frame, index, bed
        self.slope_east, self.slope_north = slope_east, slope_north
        particles = frame.particles
        self.position, self.velocity = particles.position[index], particles.velocity[index]
        self.mass, self.volume = particles.mass[index], particles.volume[index]
        self.height = self.position[:, 2] + (frame.origin[2] - bed)

    def take(self, mask):
        """The points that `mask` picks."""
        return PointsOverGround(
            self.frame, self.index[mask], self.bed[mask], self.slope_east[mask], self.slope_north[mask]
        )


class Groups:
    """Points by column: `key` int64[m] names the columns, `of` int64[n] is each point's."""

    def __init__(self, labels):
        low = labels.min()
        number = (labels - low).astype(np.int64)
        if number.max() > _DENSE * len(labels):
            self.key, self.of = np.unique(labels, return_inverse=True)
            return
        there = np.zeros(int(number.max()) + 1, bool)  # a table instead of a sort
        there[number] = True
        self.key = np.flatnonzero(there).astype(labels.dtype) + low
        self.of = (np.cumsum(there) - 1)[number]

    def __len__(self):
        return len(self.key)

    def sum(self, values):
        """float64[m]: sum over each column's points."""
        return np.bincount(self.of, values, len(self))

    def least(self, values):
        """float64[m]: least value among each column's points."""
        low = np.full(len(self), np.inf)
        np.minimum.at(low, self.of, values)
        return low

    def spread(self, values):
        """Each point's column's value."""
        return values[self.of]

    def without(self, gone):
        """The groups that are not `gone` (bool[m]), with the points left."""
        left = object.__new__(Groups)
        left.key = self.key[~gone]
        number = np.cumsum(~gone) - 1
        left.of = number[self.of[~gone[self.of]]]
        return left


def grouped(over, x, y, terrain, options):
    """(Groups, "parent" or "cell", area of a cell or None, share of the mass in columns that moved apart)."""
    parent, by, apart = over.frame.particles.parent, options.by, 0.0
    if by == "parent" and parent is None:
        raise InputError("these points have no parent identities; bin them on cells (by cell)")
    if parent is not None and by != "cell":
        groups = Groups(parent[over.index])
        apart = _apart(over, groups)
        if by == "parent" or apart <= APART:
            return groups, "parent", None, apart
    labels, cell_area = cells_of(x, y, terrain.grid, options.cell)
    return Groups(labels), "cell", cell_area, apart


def _apart(over, groups):
    """Share of the mass in columns whose points are below the bed or spread over more than their footprint."""
    mass = groups.sum(over.mass)
    thickness = 2.0 * groups.sum(over.mass * over.height) / mass
    spread = np.zeros(len(groups))
    for axis in (0, 1):
        off = over.position[:, axis] - groups.spread(groups.sum(over.mass * over.position[:, axis]) / mass)
        spread += groups.sum(over.mass * off**2) / mass
    sunk = thickness <= 0
    area = groups.sum(over.volume) / np.where(sunk, 1.0, thickness)
    return float(mass[sunk | (spread > SPREAD**2 * area / 6.0)].sum() / mass.sum())


def cells_of(x, y, grid, cell):
    """(int64[n] number of each point's cell, area of a cell [m2]): of the terrain's pixels, or squares of `cell`."""
    if cell is None:
        row, column = grid.rowcol(x, y)
        row, column, area = np.floor(row + 0.5), np.floor(column + 0.5), grid.cell_area
    else:
        west, _, _, north = grid.bounds
        row, column, area = np.floor((north - y) / cell), np.floor((x - west) / cell), cell**2
    row, column = row.astype(np.int64), column.astype(np.int64)
    return row * (int(column.max()) + 1) + column, float(area)
