"""The bed below columns and points, and the stress of the weight of a column.

A conversion stores in the `state` of the frame, one row per point: `depth` [m], vertical, below the surface, and
`vertical_stress` [Pa], negative in compression. A material computes its strain from them; without it every layer would
first drop until its elasticity carries it.

Points over ground, and the columns that they are grouped into.
"""

from dataclasses import dataclass

import numpy as np

from ..system.errors import InputError
from ..terrain.elevation import Terrain, bilinear

_MARGIN = 3  # [pixels] beyond the particles, so that gradients under them are central


@dataclass(frozen=True)
class Ground:
    """Bilinear height of a terrain, and its gradient limited at cliff edges, interpolated likewise."""

    terrain: Terrain

    @classmethod
    def under(cls, terrain, x, y, reach=0.0):
        """The ground below map points `x`, `y` [m] and up to `reach` [m] around them."""
        bounds = (x.min() - reach, y.min() - reach, x.max() + reach, y.max() + reach)
        return cls(terrain.cropped(bounds, _MARGIN))

    def height(self, x, y):
        """float64[n] [m]; NaN off the terrain and next to nodata."""
        return self.terrain.sample(x, y)

    def gradient(self, x, y):
        """(db/dE, db/dN), float64[n] each; NaN where there is no height."""
        row, column = self.terrain.grid.rowcol(x, y)
        slopes = self.terrain.limited_gradient
        return tuple(bilinear(slopes[..., axis], row, column) for axis in (0, 1))


def slope_cosine(gradient_east, gradient_north):
    """Cosine of the slope angle."""
    return 1.0 / np.sqrt(1.0 + gradient_east**2 + gradient_north**2)


def vertical_stress(density, gravity, depth, cosine):
    """float64[n] [Pa]: -rho g c^2 d, the load of `depth` [m] (vertical) on a slope of `cosine` c."""
    return -density * gravity * cosine**2 * depth


def vertical_strain(stress, bulk_modulus, shear_modulus):
    """float64[n] [1]: Hencky strain e_zz of a point confined sideways, all other components 0; K0 follows.

    `stress` [Pa] vertical, moduli [Pa]. The return mapping of the material then removes excess stress.
    """
    stiffness = bulk_modulus + 4.0 / 3.0 * shear_modulus
    if not stiffness > 0:
        raise InputError(f"confined modulus K + 4 G / 3 is {stiffness:g} Pa, expected above 0")
    return stress / stiffness


def volume_ratio(density, gravity, depth, bulk_modulus):
    """float64[n] [1]: J of a weakly compressible fluid under `depth` [m] of itself, 1 - rho g d / K."""
    if not bulk_modulus > 0:
        raise InputError(f"bulk modulus is {bulk_modulus:g} Pa, expected above 0")
    return 1.0 - density * gravity * depth / bulk_modulus


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
