"""Sum mass, momentum and energy before and after a conversion."""

import math
from typing import NamedTuple

import numpy as np

_SLAB = 1 << 12  # [particles] summed at a time: their arrays fit into the processor cache


class Sums(NamedTuple):
    """Sums over a set of particles.

    Parameters
    ----------
    count : int
    mass : float [kg]
    momentum : (float, float, float) [kg m s-1]
        East, north, up.
    kinetic_horizontal, kinetic_vertical : float [J]
    potential : float [J]
        From elevation 0 of the map.
    """

    count: int
    mass: float
    momentum: tuple
    kinetic_horizontal: float
    kinetic_vertical: float
    potential: float

    @property
    def kinetic(self) -> float:
        """Kinetic energy [J]."""
        return self.kinetic_horizontal + self.kinetic_vertical


NOTHING = Sums(0, 0.0, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


def sums_of(mass: np.ndarray, velocity: np.ndarray, middle: np.ndarray, gravity: float) -> Sums:
    """Sum over particles.

    Parameters
    ----------
    mass : float64[n] [kg]
    velocity : float64[n, 3] [m s-1]
    middle : float64[n] [m]
        Elevation of the centre of mass of each.
    gravity : float [m s-2]
    """
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


def conservation_error(before: Sums, *after: Sums) -> tuple[float, float]:
    """Compute the relative differences of the sums before and after a conversion.

    Parameters
    ----------
    before : Sums
    *after : Sums
        Their sum is compared.

    Returns
    -------
    (float, float)
        Of mass [1], and of horizontal momentum [1], relative to the length of the momentum before; 0 without motion
        before and after.
    """
    mass = abs(sum(part.mass for part in after) - before.mass) / before.mass
    gap = [sum(part.momentum[axis] for part in after) - before.momentum[axis] for axis in (0, 1)]
    scale = np.sqrt(2.0 * before.mass * before.kinetic)
    return mass, float(np.hypot(*gap) / scale) if scale > 0 else float(np.hypot(*gap))


def bed_words(bed: Sums) -> str:
    """Return one line of text about what the bed takes of a flow that becomes columns.

    Parameters
    ----------
    bed : Sums
        Of the motion across the bed.
    """
    momentum = ", ".join(f"{value:.6g}" for value in bed.momentum)
    return f"the bed takes the motion across it: momentum ({momentum}) kg m s-1, kinetic energy {bed.kinetic:.6g} J"


def points_sum(count: np.ndarray, mass: np.ndarray, value: float | np.ndarray = 1.0) -> float:
    """Sum mass times a value over the points of columns, which are never stored.

    The points of a column are equal, so that the finest cases of MOX report 15/2025, section 4.3, some 6e10 points,
    are sums over columns.

    Parameters
    ----------
    count : float64[n]
        Points in each column.
    mass : float64[n] [kg]
        Of each column.
    value : float or float64[n]
    """
    return float((count * ((mass / count) * value)).sum())


def particle_mass_scatter(
    count: np.ndarray, mass: np.ndarray, volume: np.ndarray, exact: float, value: float | np.ndarray = 1.0
) -> float:
    """Compute eps of MOX report 15/2025, Eq (4), over the points of columns in closed form.

    It measures how much one particle's mass differs from the mean particle's, so that it falls with the size of
    particles for any scheme, even one that loses mass: it is no measure of conservation.

    Parameters
    ----------
    count : float64[n]
        Points in each column.
    mass : float64[n] [kg]
    volume : float64[n] [m3]
    exact : float
        Exact total that the mean point's share is taken from.
    value : float or float64[n]

    Returns
    -------
    float
        In the unit of `mass` times `value`.
    """
    each = mass / count * value
    share = exact / count.sum()
    return float(np.sqrt((volume * (each - share) ** 2).sum() / volume.sum()))
