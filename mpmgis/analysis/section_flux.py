"""What goes through a section over time: particles counted as they cross it, and the flux of its cells.

A particle that has an identity is at known places at two frames. The straight way between them crosses the section or
does not, so the mass that crossed is a sum over particles: exact where the section cuts the whole flow off, because
then only the sides count. The flux of momentum in the section's cells at frame times, over time by the trapezoidal
rule, needs no identity and is as good as the frames are dense.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ..kernels.binning import MASS, MOMENTUM, VOLUME
from .cells import bin_frame, place
from .frame_values import cells_of, pick

COLUMNS = (
    ("time", "s"), ("discharge", "m3 s-1"), ("mass_discharge", "kg s-1"), ("volume", "m3"), ("mass", "kg"),
    ("cells_discharge", "m3 s-1"), ("cells_mass_discharge", "kg s-1"), ("cells_volume", "m3"), ("cells_mass", "kg"),
)  # fmt: skip


RASTER_BANDS = ("mass", "Un", "Ut_E", "Ut_N")  # of an exported step, from which the flux of its cells is made


@dataclass(frozen=True)
class SectionState:
    """One frame seen from a section.

    Parameters
    ----------
    time : float [s]
    dimension : int
    flux : (float, float)
        Volume [m3 s-1] and mass [kg s-1] a second through the section's cells, to its right as it is drawn.
    ids : uint64[n] or None
        Ascending; None where the particles have none, or one twice.
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
    """What crossed between two frames, to the right of the section as it is drawn.

    `volume` [m3] and `mass` [kg] through the section; `round_mass` [kg] round its ends; `began` and `ended` [kg]: mass
    of particles that only the later or only the earlier frame has; `began_beyond` [kg]: began less ended on the
    section's right, with what particles took up there.
    """

    volume: float
    mass: float
    round_mass: float
    began: float
    ended: float
    began_beyond: float


@dataclass(frozen=True)
class Balance:
    """Where the mass beyond the section comes from [kg]: `beyond` is its change from the first frame to the last."""

    beyond: float
    crossed: float
    round_ends: float
    began: float

    @property
    def error(self):
        """What crossing, going round and beginning there leave unexplained [kg]."""
        return self.beyond - self.crossed - self.round_ends - self.began

    def turned(self):
        """The same seen the other way: what the one side gains the other loses."""
        return Balance(*(-value for value in (self.beyond, self.crossed, self.round_ends, self.began)))


@dataclass(frozen=True)
class HydrographFound:
    """A hydrograph; positive is the way in which more mass went, towards `azimuth` [degrees from north].

    Parameters
    ----------
    name : str
    times : float64[k] [s]
    volume, mass : float64[k - 1] [m3], [kg]
        That crossed from each time to the next.
    by_particles : bool[k - 1]
        Intervals counted by particles; the others by the cells' flux.
    cells : float64[k, 2] [m3 s-1], [kg s-1]
        Flux of the section's cells at each time.
    azimuth : float
    balance : Balance or None
        None where an interval was not counted by particles, or where the section's ends cannot be continued.
    unseen : float [kg]
        Largest mass that began or ended between two frames.
    files : tuple of Path
    """

    name: str
    times: np.ndarray
    volume: np.ndarray
    mass: np.ndarray
    by_particles: np.ndarray
    cells: np.ndarray
    azimuth: float
    balance: Balance | None
    unseen: float = 0.0
    files: tuple = field(default=())

    def rows(self):
        """Rows of COLUMNS: rates are means since the time before, volume and mass those so far."""
        lasting = np.diff(self.times)
        totals = np.cumsum(np.r_[0.0, self.volume]), np.cumsum(np.r_[0.0, self.mass])
        rates = np.r_[math.nan, self.volume / lasting], np.r_[math.nan, self.mass / lasting]
        return list(zip(self.times, *rates, *totals, *self.cells.T, *self.cells_totals().T, strict=True))

    def cells_totals(self):
        """float64[k, 2] [m3], [kg]: what the cells' flux sums to so far, by the trapezoidal rule."""
        return np.vstack([np.zeros(2), np.cumsum(trapezoids(self.times, self.cells), axis=0)])

    def peak(self):
        """(largest mean discharge [m3 s-1], the time at which its interval ends [s])."""
        rates = self.volume / np.diff(self.times)
        k = int(np.argmax(rates))
        return float(rates[k]), float(self.times[k + 1])


def trapezoids(times, rates):
    """float64[k - 1, ...]: integral of `rates` [k, ...] from each of the `times` to the next."""
    return 0.5 * (rates[1:] + rates[:-1]) * np.diff(times)[:, None]


def crossings(section, before, after):
    """How often straight ways cross a line from its left to its right, less how often back.

    Ways that follow each other add up; a way through a vertex crosses once.

    Parameters
    ----------
    section : float64[m, 2] [m]
    before, after : float64[n, 2] [m]
        Both ends of each way.

    Returns
    -------
    int64[n]
    """
    count = np.zeros(len(before), np.int64)
    for a, b in pairwise(section):
        left_before, left_after = (_cross(b - a, ends - a) >= 0 for ends in (before, after))
        changed = np.flatnonzero(left_before != left_after)
        start, way = before[changed], after[changed] - before[changed]
        within = (_cross(way, a - start) >= 0) != (_cross(way, b - start) >= 0)
        hit = changed[within]
        count[hit] += np.where(left_before[hit], 1, -1)
    return count


def _cross(first, second):
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def continued(section, length):
    """float64[m, 2]: the section with its first and last piece `length` [m] longer, straight on."""
    ends = []
    for end, inner in ((section[0], section[1]), (section[-1], section[-2])):
        direction = (end - inner) / np.linalg.norm(end - inner)
        ends.append(end + length * direction)
    return np.vstack([ends[0], section[1:-1], ends[1]])


def azimuth_to_the_right(section):
    """Direction [degrees from north] across the section, to its right as it is drawn."""
    east, north = section[-1] - section[0]
    return math.degrees(math.atan2(north, -east)) % 360.0


def section_pieces(section, spacing):
    """(places float64[n, 2], normals float64[n, 2]) of pieces of at most `spacing` [m] of the section.

    A normal points to the right and is as long as its piece [m].
    """
    places, normals = [], []
    for a, b in pairwise(section):
        count = max(1, math.ceil(np.linalg.norm(b - a) / spacing))
        share = (np.arange(count) + 0.5)[:, None] / count
        places.append(a + share * (b - a))
        normals.append(np.tile(np.array([b[1] - a[1], a[0] - b[0]]) / count, (count, 1)))
    return np.concatenate(places), np.concatenate(normals)


def cells_flux(frame, averaging, section):
    """(volume [m3 s-1], mass [kg s-1]) through the cells that the section lies in, to its right.

    Of each cell: momentum per plan area, and the same with the volume instead of the mass of what lies in it.
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


def raster_flux(values, normals, slopes, density):
    """(volume [m3 s-1], mass [kg s-1]) a second through a section's pieces, of the bands of an exported step.

    What flows over a place has the horizontal velocity Ut + Un n, n the normal of the bed: the sum of `cells_flux`, but
    for cells that are too shallow for a velocity.

    Parameters
    ----------
    values : dict of str to float64[n]
        RASTER_BANDS at the pieces, in their own units; NaN where nothing flows.
    normals : float64[n, 2] [m]
        As `section_pieces` gives them.
    slopes : (float64[n], float64[n])
        Gradient of the terrain eastwards and northwards.
    density : float [kg m-3]
    """
    steep = np.sqrt(1.0 + slopes[0] ** 2 + slopes[1] ** 2)
    across = sum(
        (values[name] - values["Un"] * slope / steep) * normals[:, axis]
        for axis, (name, slope) in enumerate(zip(("Ut_E", "Ut_N"), slopes, strict=True))
    )
    mass = float(np.nansum(values["mass"] * across))
    return mass / density, mass


def section_state(frame, averaging, section):
    """The SectionState of a frame."""
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


def crossed_between(section, whole, before, after):
    """What crossed between two SectionStates; None where their particles cannot be told apart.

    `whole` is the section continued beyond the flow at both ends.

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


def is_beyond(whole, xy):
    """bool[n]: places on the right of a continued section; the way there from far on its left crosses it once."""
    return crossings(whole, np.broadcast_to(far_left(whole), xy.shape), xy) > 0


def mass_beyond(whole, state):
    """Mass [kg] of a SectionState on the right of a continued section."""
    return float(state.mass[is_beyond(whole, state.xy)].sum())


def far_left(whole):
    """float64[2] [m]: a place to the left of a continued section, beyond all that flows."""
    along = whole[-1] - whole[0]
    middle = 0.5 * (whole[0] + whole[-1])
    return middle + 0.4 * np.array([-along[1], along[0]])
