"""Compute runout, drop height, angles of the energy line, and centre of mass, as numbers and as report lines.

The energy line (Heim 1932: Fahrboeschung) joins the highest point of a flow to its farthest; the tangent of its angle
is drop over length. For the centre of mass the tangent depends on friction only: mu for a block with Coulomb friction.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..frames.particles import Frame
from ..maps.averaging.binning import MASS
from ..maps.averaging.cell_averages import bin_frame
from ..maps.averaging.frame_values import Averaging
from ..maps.averaging.placement import place
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from .flow_line import places_along, positions_along, vertex_distances

QUANTILES = (0.01, 0.5, 0.99)  # [1] shares of the mass along the line; 99 % is the runout of the mass
TIME_COLUMNS = (
    ("time", "s"),
    ("mass", "kg"),
    ("centre_E", "m"),
    ("centre_N", "m"),
    ("centre_elevation", "m"),
    ("centre_along", "m"),
    ("along_1_percent", "m"),
    ("along_50_percent", "m"),
    ("along_99_percent", "m"),
)
ENERGY_LINE_COLUMNS = (
    ("along", "m"),
    ("ground_length", "m"),
    ("E", "m"),
    ("N", "m"),
    ("elevation", "m"),
    ("energy_line", "m"),
    ("h_max", "m"),
    ("h_last_step", "m"),
)


class Place(NamedTuple):
    """A point of the flow: distance `along` the line, map position (`x`, `y`), elevation `z`, all [m]."""

    along: float
    x: float
    y: float
    z: float


class EnergyLine(NamedTuple):
    """From the `top` to the `toe` (Place); `ground` [m] is the length between them along the terrain."""

    top: Place
    toe: Place
    ground: float

    @property
    def length(self) -> float:
        """Horizontal distance along the line [m]."""
        return self.toe.along - self.top.along

    @property
    def straight(self) -> float:
        """Straight horizontal distance [m]."""
        return math.hypot(self.toe.x - self.top.x, self.toe.y - self.top.y)

    @property
    def drop(self) -> float:
        """Drop height [m]."""
        return self.top.z - self.toe.z

    @property
    def angle(self) -> float:
        """Angle below the horizontal [degrees]; NaN for zero length."""
        return slope_angle(self.drop, self.length)


@dataclass(frozen=True)
class MassState:
    """Position of the mass at one `time` [s].

    `mass` [kg] on the terrain; its centre (`x`, `y`, `z`) [m] and position `along` the line [m]; `quantiles`
    float64[k] [m]: the shares QUANTILES of the mass are at or before these positions along the line.
    """

    time: float
    mass: float
    x: float
    y: float
    z: float
    along: float
    quantiles: np.ndarray


def slope_angle(drop: float, length: float) -> float:
    """Return the angle [degrees] of a line with this drop over this length.

    Parameters
    ----------
    drop, length : float [m]

    Returns
    -------
    float
        NaN for a `length` of 0 or less.
    """
    return math.degrees(math.atan2(drop, length)) if length > 0 else math.nan


def highest_place(mask: np.ndarray, elevation: np.ndarray, grid: Grid, line: np.ndarray) -> Place | None:
    """Return the Place of the highest True cell with an elevation; None without such a cell.

    Parameters
    ----------
    mask : bool[rows, columns]
    elevation : float64[rows, columns] [m]
        NaN if unknown.
    grid : Grid
    line : float[n, 2] [m]
    """
    return _place(np.where(mask & np.isfinite(elevation), elevation, -np.inf), elevation, grid, line)


def farthest_place(mask: np.ndarray, elevation: np.ndarray, grid: Grid, line: np.ndarray) -> Place | None:
    """Return the Place of the True cell with an elevation farthest along a line; None without such a cell.

    Parameters
    ----------
    mask : bool[rows, columns]
    elevation : float64[rows, columns] [m]
        NaN if unknown.
    grid : Grid
    line : float[n, 2] [m]
    """
    there = mask & np.isfinite(elevation)
    along = np.full(mask.shape, -np.inf)
    along[there] = positions_along(line, *grid.xy(*np.nonzero(there)))
    return _place(along, elevation, grid, line)


def _place(score: np.ndarray, elevation: np.ndarray, grid: Grid, line: np.ndarray) -> Place | None:
    at = np.unravel_index(np.argmax(score), score.shape)
    if score[at] == -np.inf:
        return None
    x, y = (float(value) for value in grid.xy(*at))
    return Place(float(positions_along(line, [x], [y])[0]), x, y, float(elevation[at]))


def heights_under(mask: np.ndarray, grid: Grid, terrain: Terrain) -> np.ndarray:
    """Return the elevation of the terrain under the True cells of a mask; NaN elsewhere.

    Parameters
    ----------
    mask : bool[rows, columns]
    grid : Grid
    terrain : Terrain

    Returns
    -------
    float64[rows, columns] [m]
    """
    elevation = np.full(grid.shape, np.nan)
    elevation[mask] = terrain.sample(*grid.xy(*np.nonzero(mask)))
    return elevation


def ends_along(
    mask: np.ndarray, elevation: np.ndarray, grid: Grid, line: np.ndarray
) -> tuple[Place | None, Place | None]:
    """Return the highest Place and the farthest Place along `line` of the True cells; each None if missing.

    `runout` and `compare` measure the runout between them: horizontally, along the line, between cell centres.

    Parameters
    ----------
    mask : bool[rows, columns]
        Cells with flow.
    elevation : float64[rows, columns] [m]
        NaN if unknown; such cells are ignored.
    grid : Grid
    line : float[n, 2] [m]

    Returns
    -------
    (Place or None, Place or None)
    """
    return highest_place(mask, elevation, grid, line), farthest_place(mask, elevation, grid, line)


def line_profile(
    line: np.ndarray, terrain: Terrain, begin: float, end: float, spacing: float
) -> tuple[np.ndarray, ...]:
    """Sample the terrain along a line, at its vertices and at equal distances between them.

    Parameters
    ----------
    line : float[n, 2] [m]
    terrain : Terrain
    begin, end : float [m]
        Distances along the line.
    spacing : float [m]

    Returns
    -------
    (along, x, y, elevation, ground) : float64[n] [m]
        `ground` is the length along the terrain from the first point, interpolated over nodata.
    """
    count = max(2, math.ceil((end - begin) / spacing) + 1)
    vertices = vertex_distances(line)
    along = np.union1d(np.linspace(begin, end, count), vertices[(vertices > begin) & (vertices < end)])
    x, y = places_along(line, along)
    elevation = terrain.sample(x, y)
    return along, x, y, elevation, ground_lengths(along, elevation)


def ground_lengths(along: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Return the length along the terrain up to each position on a line.

    Parameters
    ----------
    along, elevation : float64[n] [m]

    Returns
    -------
    float64[n] [m]
    """
    known = np.isfinite(elevation)
    heights = np.interp(along, along[known], elevation[known]) if known.any() else np.zeros(len(along))
    return np.r_[0.0, np.cumsum(np.hypot(np.diff(along), np.diff(heights)))]


def energy_line(
    top: Place | None, toe: Place | None, line: np.ndarray, terrain: Terrain, spacing: float
) -> EnergyLine | None:
    """Return the EnergyLine between two Places; None if one is missing or the toe is not beyond the top.

    Parameters
    ----------
    top, toe : Place or None
    line : float[n, 2] [m]
    terrain : Terrain
    spacing : float [m]
        Of the points at which the terrain is sampled.
    """
    if top is None or toe is None or toe.along <= top.along:
        return None
    *_, ground = line_profile(line, terrain, top.along, toe.along, spacing)
    return EnergyLine(top, toe, float(ground[-1]))


def mass_state(frame: Frame, averaging: Averaging, line: np.ndarray) -> MassState | None:
    """Return the position of the mass of a frame.

    The centre is that of the particles, the distribution along `line` that of the export cells. The centre of a column
    is half its thickness above the bed. Particles outside the terrain are ignored.

    Parameters
    ----------
    frame : Frame
    averaging : Averaging
    line : float[n, 2] [m]

    Returns
    -------
    MassState or None
        None without particles on the terrain.
    """
    placed = place(frame, averaging.bed)
    cells = bin_frame(frame, placed, averaging.bed, averaging.grid, averaging.density)
    weight = cells.sums[:, MASS]
    if not weight.sum() > 0:
        return None
    row, column = np.divmod(cells.index, averaging.grid.shape[1])
    along = positions_along(line, *averaging.grid.xy(row, column))
    inside, particles = placed.inside, frame.particles
    height = np.asarray(particles.position[:, 2], float) + frame.origin[2]
    if frame.dimension == 2:
        height = height + 0.5 * np.asarray(particles.thickness, float)
    mass = np.where(inside, np.asarray(particles.mass, float), 0.0)
    x, y = frame.map_xy()
    centre = (float(np.average(np.asarray(values, float), weights=mass)) for values in (x, y, height))
    return MassState(
        frame.time, float(mass.sum()), *centre, float(np.average(along, weights=weight)), quantiles(along, weight)
    )


def quantiles(along: np.ndarray, weight: np.ndarray, shares: tuple = QUANTILES) -> np.ndarray:
    """Return the smallest positions with each of the shares of the weight at or before them.

    Parameters
    ----------
    along : float[n] [m]
    weight : float[n]
    shares : tuple of float [1]

    Returns
    -------
    float64[k] [m]
    """
    order = np.argsort(along, kind="stable")
    below = np.cumsum(weight[order])
    wanted = np.asarray(shares) * below[-1] * (1 - 1e-12)
    return np.asarray(along, float)[order][np.searchsorted(below, wanted)]


@dataclass(frozen=True)
class RunoutFound:
    """Runout of a result. Distances along the line are measured from its start.

    Parameters
    ----------
    name : str
    threshold : float [m]
        Flow depth above which a cell counts as reached.
    line : float[n, 2] [m]
    line_source : str
    flow, deposit : EnergyLine
        To the farthest cell ever reached, and for the last frame (None without cells above the threshold).
    states : tuple of MassState
        One per frame; () for an export, which has no particles.
    farthest_mass : Place or None
        Position on the line with 99 % of the last frame's mass at or before it.
    profile : tuple of float[k]
        Columns ENERGY_LINE_COLUMNS along the line.
    files : tuple of Path
    """

    name: str
    threshold: float
    line: np.ndarray
    line_source: str
    flow: EnergyLine
    deposit: EnergyLine | None
    states: tuple
    farthest_mass: Place | None
    profile: tuple
    files: tuple = ()

    @property
    def centre(self) -> tuple[float, float, float] | None:
        """(distance along the line [m], drop [m], angle [degrees]) of the centre of mass; None without frames."""
        if len(self.states) < 2:
            return None
        first, last = self.states[0], self.states[-1]
        travelled, drop = last.along - first.along, first.z - last.z
        return travelled, drop, slope_angle(drop, travelled)

    def rows(self) -> list[tuple]:
        """Return a row for every result.

        Returns
        -------
        list of (str, str, float)
            Quantity, unit, value.
        """
        rows = [*_line_rows("", self.flow), ("farthest_along_line", "m", self.flow.toe.along)]
        if self.deposit is not None:
            rows += _line_rows("deposit_", self.deposit)
        if self.centre is not None:
            travelled, drop, angle = self.centre
            rows += [("centre_of_mass_runout", "m", travelled), ("centre_of_mass_drop", "m", drop)]
            rows += [("centre_of_mass_angle", "degrees", angle), ("centre_of_mass_tangent", "1", _tangent(angle))]
        if self.farthest_mass is not None:
            length = self.farthest_mass.along - self.flow.top.along
            rows += [("runout_99_percent_of_mass", "m", length)]
            angle = slope_angle(self.flow.top.z - self.farthest_mass.z, length)
            rows += [("angle_99_percent_of_mass", "degrees", angle)]
        return rows

    def time_rows(self) -> list[tuple]:
        """Return rows of TIME_COLUMNS."""
        return [
            (state.time, state.mass, state.x, state.y, state.z, state.along, *map(float, state.quantiles))
            for state in self.states
        ]

    def facts(self) -> dict:
        """Return all results as plain numbers, lists and strings; None for missing numbers."""
        named = {
            quantity if unit == "1" else f"{quantity}_{'deg' if unit == 'degrees' else unit}": _number(value)
            for quantity, unit, value in self.rows()
        }
        return {
            "name": self.name,
            "threshold_m": self.threshold,
            **named,
            "top": list(self.flow.top[1:]),
            "toe": list(self.flow.toe[1:]),
            "line": {"source": self.line_source, "vertices": self.line.tolist()},
            "files": [str(file) for file in self.files],
        }


def _line_rows(before, found):
    return [
        (f"{before}runout", "m", found.length),
        (f"{before}runout_straight", "m", found.straight),
        (f"{before}runout_along_ground", "m", found.ground),
        (f"{before}drop_height", "m", found.drop),
        (f"{before}energy_line_angle", "degrees", found.angle),
        (f"{before}energy_line_tangent", "1", _tangent(found.angle)),
    ]


def _tangent(angle):
    return math.tan(math.radians(angle))


def _number(value):
    return value if math.isfinite(value) else None
