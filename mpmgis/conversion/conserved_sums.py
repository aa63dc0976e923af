"""Mass, momentum and energy before and after a conversion."""

import math
from typing import NamedTuple

import numpy as np

_SLAB = 1 << 12  # [particles]


class Sums(NamedTuple):
    """Over a set of particles; `potential` [J] counts from elevation 0 of the map.

    `momentum` (east, north, up) [kg m s-1]; `kinetic_horizontal`, `kinetic_vertical` [J].
    """

    count: int
    mass: float
    momentum: tuple
    kinetic_horizontal: float
    kinetic_vertical: float
    potential: float

    @property
    def kinetic(self):
        """Kinetic energy [J]."""
        return self.kinetic_horizontal + self.kinetic_vertical


NOTHING = Sums(0, 0.0, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


def sums_of(mass, velocity, middle, gravity):
    """Sums over particles of `mass` [n], `velocity` [n, 3], with their centres of mass at elevations `middle` [n]."""
    total = np.array([_of_some(mass[k], velocity[k], middle[k]) for k in _slabs(len(mass))])
    kilos, east, north, up, horizontal, vertical, lift = (math.fsum(column) for column in total.T)
    return Sums(len(mass), kilos, (east, north, up), 0.5 * horizontal, 0.5 * vertical, gravity * lift)


def _slabs(n):
    """Slices that cover `n` rows; temporary arrays of a slab fit into the processor cache."""
    return [slice(start, start + _SLAB) for start in range(0, n, _SLAB)]


def _of_some(mass, velocity, middle):
    momentum = mass[:, None] * velocity
    energy = (momentum * velocity).sum(axis=0)
    return mass.sum(), *momentum.sum(axis=0), energy[0] + energy[1], energy[2], (mass * middle).sum()


def conservation_error(before, *after):
    """(mass, horizontal momentum): relative difference of `before` and the sum over `after`.

    Momentum is relative to the length of the momentum before; 0 without motion before and after.
    """
    mass = abs(sum(part.mass for part in after) - before.mass) / before.mass
    gap = [sum(part.momentum[axis] for part in after) - before.momentum[axis] for axis in (0, 1)]
    scale = np.sqrt(2.0 * before.mass * before.kinetic_horizontal)
    return mass, float(np.hypot(*gap) / scale) if scale > 0 else float(np.hypot(*gap))


def points_sum(count, mass, value=1.0):
    """Sum over all points of mass times `value`, never stored: columns of `mass` [n] in `count` [n] equal points.

    The points of a column are equal, so that the finest cases of MOX report 15/2025, section 4.3, some 6e10 points,
    are sums over columns.
    """
    return float((count * ((mass / count) * value)).sum())


def particle_mass_scatter(count, mass, volume, exact, value=1.0):
    """eps of MOX report 15/2025, Eq (4), over the points of columns in closed form; the unit of `mass` times `value`.

    `exact` is the exact total that the mean point's share is taken from. It measures how much one particle's mass
    differs from the mean particle's, so that it falls with the size of particles for any scheme, even one that loses
    mass: it is no measure of conservation.
    """
    each = mass / count * value
    share = exact / count.sum()
    return float(np.sqrt((volume * (each - share) ** 2).sum() / volume.sum()))
