"""Compute discharge through a section over time, from particles that cross it and from the momentum of its cells.

The position of a particle with an id is known at two frames. The straight path between them crosses the section or
not, so the mass that crossed is a sum over particles. It is exact if the section spans the whole flow, because then
only the sides matter. The momentum flux of the section's cells at frame times, integrated with the trapezoidal rule,
needs no ids; its accuracy depends on the frame interval.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..frames.particles import Frame
from ..maps.averaging.binning import MASS, MOMENTUM, VOLUME
from ..maps.averaging.cell_averages import bin_frame
from ..maps.averaging.frame_values import Averaging, cells_of, pick
from ..maps.averaging.placement import place

RASTER_BANDS = ("mass", "Un", "Ut_E", "Ut_N")  # of an exported step, for the flux of its cells


@dataclass(frozen=True)
class SectionState:
    """State of one frame relative to a section.

    Parameters
    ----------
    time : float [s]
    dimension : int
    flux : (float, float)
        Volume [m3 s-1] and mass [kg s-1] per second through the section's cells, to the right of its direction.
    ids : uint64[n] or None
        Ascending; None without ids, or with duplicate ids.
    xy, mass, volume : float64[n, 2] [m], float64[n] [kg], float64[n] [m3]
        In the order of `ids`.
    """

    time: float
    dimension: int
    flux: tuple
    ids: np.ndarray | None
    xy: np.ndarray
    mass: np.ndarray
    volume: np.ndarray


@dataclass(frozen=True)
class Crossed:
    """Amounts that crossed between two frames, to the right of the section's direction.

    `volume` [m3] and `mass` [kg] through the section; `round_mass` [kg] around its ends; `began` and `ended` [kg]: mass
    of particles only in the later or only in the earlier frame; `began_beyond` [kg]: began minus ended on the right
    of the section, including mass that particles entrained there.
    """

    volume: float
    mass: float
    round_mass: float
    began: float
    ended: float
    began_beyond: float


@dataclass(frozen=True)
class Balance:
    """Sources of the mass beyond the section [kg]; `beyond` is its change from the first frame to the last."""

    beyond: float
    crossed: float
    round_ends: float
    began: float

    @property
    def error(self) -> float:
        """Residual [kg] after mass that crossed, went around the ends, or began there."""
        return self.beyond - self.crossed - self.round_ends - self.began

    def turned(self) -> "Balance":
        """Return the balance for the opposite direction."""
        return Balance(*(-value for value in (self.beyond, self.crossed, self.round_ends, self.began)))


def trapezoids(times: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Integrate rates from each time to the next by the trapezoidal rule.

    Parameters
    ----------
    times : float64[k] [s]
    rates : float64[k, n] [unit s-1]

    Returns
    -------
    float64[k - 1, n] [unit]
    """
    return 0.5 * (rates[1:] + rates[:-1]) * np.diff(times)[:, None]


def crossings(section: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Count the net crossings of straight paths over a line, from its left to its right.

    Consecutive paths add up; a path through a vertex crosses once.

    Parameters
    ----------
    section : float64[m, 2] [m]
    before, after : float64[n, 2] [m]
        Both ends of each path.

    Returns
    -------
    int64[n]
    """
    count = np.zeros(len(before), np.int64)
    for a, b in pairwise(section):
        left_before, left_after = (_cross(b - a, ends - a) >= 0 for ends in (before, after))
        changed = np.flatnonzero(left_before != left_after)
        start, path = before[changed], after[changed] - before[changed]
        within = (_cross(path, a - start) >= 0) != (_cross(path, b - start) >= 0)
        hit = changed[within]
        count[hit] += np.where(left_before[hit], 1, -1)
    return count


def _cross(first, second):
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def continued(section: np.ndarray, length: float) -> np.ndarray:
    """Extend the first and the last piece of a section straight.

    Parameters
    ----------
    section : float64[m, 2] [m]
    length : float [m]
        Of each extension.

    Returns
    -------
    float64[m, 2] [m]
    """
    ends = []
    for end, inner in ((section[0], section[1]), (section[-1], section[-2])):
        direction = (end - inner) / np.linalg.norm(end - inner)
        ends.append(end + length * direction)
    return np.vstack([ends[0], section[1:-1], ends[1]])


def azimuth_to_the_right(section: np.ndarray) -> float:
    """Return the direction [degrees from north] across a section, to its right.

    Parameters
    ----------
    section : float64[m, 2] [m]
    """
    east, north = section[-1] - section[0]
    return math.degrees(math.atan2(north, -east)) % 360.0


def section_pieces(section: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Divide a section into pieces of at most a length.

    A normal points to the right and is as long as its piece [m].

    Parameters
    ----------
    section : float64[m, 2] [m]
    spacing : float [m]

    Returns
    -------
    (float64[n, 2] [m], float64[n, 2] [m])
        Middles of the pieces; normals.
    """
    places, normals = [], []
    for a, b in pairwise(section):
        count = max(1, math.ceil(np.linalg.norm(b - a) / spacing))
        share = (np.arange(count) + 0.5)[:, None] / count
        places.append(a + share * (b - a))
        normals.append(np.tile(np.array([b[1] - a[1], a[0] - b[0]]) / count, (count, 1)))
    return np.concatenate(places), np.concatenate(normals)


def cells_flux(frame: Frame, averaging: Averaging, section: np.ndarray) -> tuple[float, float]:
    """Return volume and mass per second through the cells of a section, to its right.

    Mass flux: momentum per plan area of each cell. Volume flux: the same times volume over mass of the cell.

    Parameters
    ----------
    frame : Frame
    averaging : Averaging
    section : float64[m, 2] [m]

    Returns
    -------
    (float [m3 s-1], float [kg s-1])
    """
    places, normals = section_pieces(section, 0.25 * averaging.grid.cell_size)
    cells = bin_frame(frame, place(frame, averaging.bed), averaging.bed, averaging.grid, averaging.density)
    where = cells_of(averaging.grid, *places.T)
    across = sum(
        np.nan_to_num(pick(cells.index, cells.sums[:, MOMENTUM + axis] / cells.cell_area, 0.0, where))
        * normals[:, axis]
        for axis in (0, 1)
    )
    mass = cells.sums[:, MASS]
    bulk = np.divide(cells.sums[:, VOLUME], mass, out=np.zeros(len(mass)), where=mass > 0)
    return float(np.sum(across * np.nan_to_num(pick(cells.index, bulk, 0.0, where)))), float(across.sum())


def raster_flux(values: dict, normals: np.ndarray, slopes: tuple, density: float) -> tuple[float, float]:
    """Return volume and mass per second through a section's pieces, from the bands of an exported step.

    The flow has the velocity Ut + Un n (n: bed normal). Equal to `cells_flux`, except for cells that are too shallow
    for a velocity.

    Parameters
    ----------
    values : dict of str to float64[n]
        RASTER_BANDS at the pieces, in their units; NaN without flow.
    normals : float64[n, 2] [m]
        From `section_pieces`.
    slopes : (float64[n], float64[n])
        Terrain gradient to the east and to the north.
    density : float [kg m-3]

    Returns
    -------
    (float [m3 s-1], float [kg s-1])
    """
    steep = np.sqrt(1.0 + slopes[0] ** 2 + slopes[1] ** 2)
    across = sum(
        (values[name] - values["Un"] * slope / steep) * normals[:, axis]
        for axis, (name, slope) in enumerate(zip(("Ut_E", "Ut_N"), slopes, strict=True))
    )
    mass = float(np.nansum(values["mass"] * across))
    return mass / density, mass


def section_state(frame: Frame, averaging: Averaging, section: np.ndarray) -> SectionState:
    """Return the state of a frame relative to a section.

    Parameters
    ----------
    frame : Frame
    averaging : Averaging
    section : float64[m, 2] [m]

    Returns
    -------
    SectionState
    """
    particles = frame.particles
    xy = np.stack([np.asarray(values, float) for values in frame.map_xy()], axis=1)
    mass, volume = (np.array(values, float) for values in (particles.mass, particles.volume))
    ids = particles.id
    if ids is not None:
        order = np.argsort(ids, kind="stable")
        ids, xy, mass, volume = ids[order], xy[order], mass[order], volume[order]
        if (ids[1:] == ids[:-1]).any():
            ids = None
    return SectionState(frame.time, frame.dimension, cells_flux(frame, averaging, section), ids, xy, mass, volume)


def crossed_between(
    section: np.ndarray, whole: np.ndarray, before: SectionState, after: SectionState
) -> Crossed | None:
    """Return the amounts that crossed between two SectionStates; None without usable ids.

    Parameters
    ----------
    section : float64[m, 2] [m]
    whole : float64[m, 2] [m]
        The section extended beyond the flow at both ends.
    before, after : SectionState

    Returns
    -------
    Crossed or None
    """
    if before.ids is None or after.ids is None or before.dimension != after.dimension:
        return None
    _, i, j = np.intersect1d(before.ids, after.ids, assume_unique=True, return_indices=True)
    mass, volume = (0.5 * (v[i] + w[j]) for v, w in ((before.mass, after.mass), (before.volume, after.volume)))
    sides = [is_beyond(whole, state.xy) for state in (before, after)]
    through = crossings(section, before.xy[i], after.xy[j])
    beyond = sides[1][j].astype(int) - sides[0][i]
    alone = [np.setdiff1d(np.arange(len(state.mass)), k) for state, k in ((before, i), (after, j))]
    ended, began = (state.mass[k] for state, k in zip((before, after), alone, strict=True))
    grown = 0.5 * np.sum((sides[0][i] + sides[1][j].astype(int)) * (after.mass[j] - before.mass[i]))
    return Crossed(
        volume=float(np.sum(through * volume)),
        mass=float(np.sum(through * mass)),
        round_mass=float(np.sum((beyond - through) * mass)),
        began=float(began.sum()),
        ended=float(ended.sum()),
        began_beyond=float(grown + began[sides[1][alone[1]]].sum() - ended[sides[0][alone[0]]].sum()),
    )


def is_beyond(whole: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return which points are on the right of an extended section.

    The path from far on its left to such a point crosses it once.

    Parameters
    ----------
    whole : float64[m, 2] [m]
    xy : float64[n, 2] [m]

    Returns
    -------
    bool[n]
    """
    return crossings(whole, np.broadcast_to(far_left(whole), xy.shape), xy) > 0


def mass_beyond(whole: np.ndarray, state: SectionState) -> float:
    """Return the mass [kg] of a SectionState on the right of an extended section.

    Parameters
    ----------
    whole : float64[m, 2] [m]
    state : SectionState
    """
    return float(state.mass[is_beyond(whole, state.xy)].sum())


def far_left(whole: np.ndarray) -> np.ndarray:
    """Return a point to the left of an extended section, outside the flow.

    Parameters
    ----------
    whole : float64[m, 2] [m]

    Returns
    -------
    float64[2] [m]
    """
    along = whole[-1] - whole[0]
    middle = 0.5 * (whole[0] + whole[-1])
    return middle + 0.4 * np.array([-along[1], along[0]])
