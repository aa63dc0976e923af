"""Hold profiles of a flow along a line, at points over time, and over the height above the bed.

A vertical profile is a square map cell divided into layers by distance normal to the bed; each layer is averaged like
a cell of an export (outlook of Vicari et al. 2025, NHESS 25:3897). A point has the height of a cube of its volume and
is shared among the layers that it overlaps, so a uniform lattice of points gives uniform layers.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..frames.particles import Frame
from ..laws.quantities import BAND, GRAVITY
from ..maps.averaging.band_products import impact_pressure, normal_velocity, parallel_speed, volume_thickness
from ..maps.averaging.cell_averages import bin_frame, grid_spacing, lower_percentile
from ..maps.averaging.height_layers import point_extents
from ..maps.averaging.placement import Bed, Placed, place
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid

if TYPE_CHECKING:
    from pyproj import CRS


PROFILE_PRODUCTS = ("h", "t", "Un", "Ut")
SERIES_PRODUCTS = (*PROFILE_PRODUCTS, "p")
PLACE_COLUMNS = (("time", "s"), ("along", "m"), ("E", "m"), ("N", "m"), ("terrain", "m"), ("surface", "m"))
POINT_COLUMNS = (("E", "m"), ("N", "m"), ("time", "s"))
PROFILE_COLUMNS = (
    ("point", ""),
    ("E", "m"),
    ("N", "m"),
    ("time", "s"),
    ("height_from", "m"),
    ("height_to", "m"),
    ("particles", "1"),
    ("density", "kg m-3"),
    ("Ut", "m s-1"),
    ("Un", "m s-1"),
    ("p", "Pa"),
    ("overburden", "Pa"),
)
LOAD_COLUMNS = (
    ("point", ""),
    ("E", "m"),
    ("N", "m"),
    ("time", "s"),
    ("h", "m"),
    ("momentum_flux_per_width", "N m-1"),
    ("height_of_momentum_flux", "m"),
    ("largest_p", "Pa"),
    ("overburden_force_per_width", "N m-1"),
    ("height_of_overburden_force", "m"),
)
MOST_LAYERS = 2_000  # of a vertical profile; more are a wrong `layer`
WIDTH_IN_CELLS = 4.0  # [cells of the solver's grid] of the square cell around a point
LAYER_IN_CELLS = 0.5  # [cells of the solver's grid] 64 points per layer with 8 points per cell


@dataclass(frozen=True)
class ProfileFound:
    """A flow along a line.

    Parameters
    ----------
    name : str
    along, x, y, terrain : float64[n] [m]
        Points on the line: distance from its start, position, elevation.
    times : float64[k] [s]
    surface : float64[k, n] [m]
        Elevation of the free surface.
    values : dict of str to float64[k, n]
        Products of the cell of each point.
    files : tuple of Path
    """

    name: str
    along: np.ndarray
    x: np.ndarray
    y: np.ndarray
    terrain: np.ndarray
    times: np.ndarray
    surface: np.ndarray
    values: dict
    files: tuple = ()

    def columns(self) -> tuple:
        """Return the (name, unit) of each column of `rows`."""
        return (*PLACE_COLUMNS, *((name, BAND[name].unit) for name in self.values))

    def rows(self) -> Iterator[tuple]:
        """Yield one row per time and point."""
        for k, time in enumerate(self.times):
            numbers = (self.along, self.x, self.y, self.terrain, self.surface[k], *(v[k] for v in self.values.values()))
            yield from ((time, *row) for row in zip(*numbers, strict=True))


@dataclass(frozen=True)
class SeriesFound:
    """A flow at points over time.

    Parameters
    ----------
    name : str
    names : tuple of str
        Of the points.
    x, y : float64[n] [m]
    times : float64[k] [s]
    values : dict of str to float64[k, n]
        By product.
    files : tuple of Path
    """

    name: str
    names: tuple
    x: np.ndarray
    y: np.ndarray
    times: np.ndarray
    values: dict
    files: tuple = ()

    def columns(self) -> tuple:
        """Return the (name, unit) of each column of `rows`."""
        return (("point", ""), *POINT_COLUMNS, *((name, BAND[name].unit) for name in self.values))

    def rows(self) -> Iterator[tuple]:
        """Yield one row per point and time."""
        for point, name in enumerate(self.names):
            for k, time in enumerate(self.times):
                values = (values[k, point] for values in self.values.values())
                yield (name, self.x[point], self.y[point], time, *values)

    def arrival(self, point: int, min_depth: float) -> float:
        """Return the first time [s] with at least a depth at a point; NaN without flow.

        Parameters
        ----------
        point : int
            Number of the point.
        min_depth : float [m]
        """
        deep = self.values["h"][:, point] >= min_depth
        return float(self.times[np.argmax(deep)]) if deep.any() else np.nan

    def peak(self, product: str, point: int) -> tuple[float, float]:
        """Return the largest value of a product at a point, and its time [s]; NaN without values.

        Parameters
        ----------
        product : str
        point : int
            Number of the point.

        Returns
        -------
        (float, float)
        """
        values = self.values[product][:, point]
        if not np.isfinite(values).any():
            return np.nan, np.nan
        k = int(np.nanargmax(values))
        return float(values[k]), float(self.times[k])


def free_surface(terrain: Terrain, x: np.ndarray, y: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return the elevation of the free surface at map points, vertically above them.

    Parameters
    ----------
    terrain : Terrain
    x, y : float[n] [m]
    depth : float[k, n] [m]
        Normal to the bed.

    Returns
    -------
    float64[k, n] [m]
    """
    row, column = (np.floor(place + 0.5).astype(np.int64) for place in terrain.grid.rowcol(x, y))
    rows, columns = terrain.elevation.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    slope = np.full((len(x), 2), np.nan)
    slope[inside] = terrain.limited_gradient[row[inside], column[inside]]
    return terrain.sample(x, y) + depth * np.sqrt(1.0 + (slope**2).sum(axis=1))


@dataclass(frozen=True)
class VerticalProfile:
    """One cell at one `time` [s], in layers between the heights `edges` float64[k + 1] [m] above the bed.

    `depth` [m]: h as in an export: the largest particle distance from the bed, or its percentile, at least 0.
    `count` int64[k]: points with centre in a layer; `density` float64[k] [kg m-3], 0 in an empty layer; `parallel`,
    `normal` float64[k] [m s-1] as Ut and Un of an export, NaN in an empty layer; `pressure` float64[k] [Pa]: density
    times the squared mean speed; `overburden` float64[k] [Pa]: normal stress at rest from the weight above the middle
    of each layer.
    """

    time: float
    depth: float
    edges: np.ndarray
    count: np.ndarray
    density: np.ndarray
    parallel: np.ndarray
    normal: np.ndarray
    pressure: np.ndarray
    overburden: np.ndarray

    @property
    def momentum_flux(self) -> tuple[float, float]:
        """(force per width [N m-1], height of its resultant [m]) of the momentum flux rho v^2."""
        return self._force(self.pressure)

    @property
    def overburden_force(self) -> tuple[float, float]:
        """(force per width [N m-1], height of its resultant [m]) of the overburden, with isotropic pressure as in a
        fluid; the only force of a flow at rest."""
        return self._force(self.overburden)

    def _force(self, pressure):
        """(integral of `pressure` over height, height of its resultant; NaN without pressure)."""
        thickness, middles = np.diff(self.edges), 0.5 * (self.edges[1:] + self.edges[:-1])
        force = float(np.sum(pressure * thickness))
        return force, float(np.sum(pressure * middles * thickness)) / force if force > 0 else math.nan


@dataclass(frozen=True)
class VerticalFound:
    """Profiles of a result: a list of `profiles` per point (names, x, y [m]), cell `width` [m], and the `files`."""

    name: str
    names: tuple
    x: np.ndarray
    y: np.ndarray
    width: float
    profiles: tuple
    files: tuple = ()

    def rows(self) -> Iterator[tuple]:
        """Yield rows of PROFILE_COLUMNS."""
        for k, found in self._each():
            layers = (found.edges[:-1], found.edges[1:], found.count, found.density, found.parallel, found.normal)
            for layer in zip(*layers, found.pressure, found.overburden, strict=True):
                yield (self.names[k], self.x[k], self.y[k], found.time, *layer)

    def load_rows(self) -> Iterator[tuple]:
        """Yield rows of LOAD_COLUMNS."""
        for k, found in self._each():
            largest = float(found.pressure.max(initial=0.0))
            numbers = found.depth, *found.momentum_flux, largest, *found.overburden_force
            yield (self.names[k], self.x[k], self.y[k], found.time, *numbers)

    def _each(self):
        return ((k, found) for k, of_point in enumerate(self.profiles) for found in of_point)


def cell_around(x: float, y: float, width: float, crs: "CRS | None") -> Grid:
    """Return the grid of one square cell around a map point.

    Parameters
    ----------
    x, y : float [m]
    width : float [m]
    crs : CRS or None
    """
    return Grid.north_up(crs, x - 0.5 * width, y + 0.5 * width, width, (1, 1))


def vertical_profiles(
    frame: Frame, bed: Bed, density: float, points: np.ndarray, width: float, layer: float, percentile: float = 100.0
) -> list[VerticalProfile]:
    """Compute the VerticalProfile of every point in a frame of points.

    Parameters
    ----------
    frame : Frame
        Of dimension 3.
    bed : Bed
    density : float [kg m-3]
        Of the release; it cancels.
    points : float64[n, 2] [m]
    width : float [m]
        Of the square cell around each.
    layer : float [m]
        Height of a layer; edges are multiples of it, also below the bed if particles are there.
    percentile : float
        Mass-weighted percentile of the particles' distances from the bed, used as depth; layers have all particles.

    Returns
    -------
    list of VerticalProfile
    """
    placed = place(frame, bed)
    x, y = frame.map_xy()
    half, found = 0.5 * width, []
    for east, north in points:
        across, along = x - east, north - y
        near = (across >= -half) & (across < half) & (along >= -half) & (along < half) & np.isfinite(placed.distance)
        grid = cell_around(east, north, width, bed.grid.crs)
        found.append(_profile(frame, placed, np.flatnonzero(near), bed, density, grid, layer, percentile))
    return found


def _profile(
    frame: Frame,
    placed: Placed,
    there: np.ndarray,
    bed: Bed,
    density: float,
    grid: Grid,
    layer: float,
    percentile: float,
) -> VerticalProfile:
    """The VerticalProfile of the particles `there` (their numbers) in the one cell of `grid`."""
    part = replace(frame, particles=frame.particles.take(there))
    placed = Placed(placed.pixel[there], placed.distance[there])
    lower, upper = point_extents(part.particles.volume, placed, bed)
    first = math.floor(min(lower.min(initial=0.0), 0.0) / layer)
    end = max(math.ceil(upper.max(initial=0.0) / layer), first + 1)
    if end - first > MOST_LAYERS:
        raise ValueError(f"{end - first} layers of {layer:g} m")
    edges = layer * np.arange(first, end + 1)
    values = np.full((4, end - first), np.nan)
    values[[0, 3]] = 0.0
    for k in range(end - first):
        share = np.clip(np.minimum(upper, edges[k + 1]) - np.maximum(lower, edges[k]), 0.0, None) / (upper - lower)
        if share.any():
            values[:, k] = _layer_values(part, placed, share, bed, density, grid, layer)
    count = np.histogram(placed.distance, edges)[0]
    overburden = _overburden(values[0], layer, part, placed, bed)
    depth = max(lower_percentile(placed.distance, part.particles.mass, percentile), 0.0)
    return VerticalProfile(frame.time, depth, edges, count, *values, overburden)


def _overburden(density: np.ndarray, layer: float, part: Frame, placed: Placed, bed: Bed) -> np.ndarray:
    """float64[k] [Pa]: normal stress of the weight above the middle of each layer, g cos(slope) of the particles."""
    if not len(placed.pixel):
        return np.zeros(len(density))
    slope2 = (bed.gradient_by_pixel[placed.pixel] ** 2).sum(axis=-1)
    cosine = np.average(1.0 / np.sqrt(1.0 + slope2), weights=np.asarray(part.particles.mass, float))
    weight = GRAVITY * cosine * layer * density
    return np.cumsum(weight[::-1])[::-1] - 0.5 * weight


def _layer_values(part, placed, share, bed, density, grid, layer):
    """(density, Ut, Un, pressure) of a layer with this `share` of each particle."""
    held = np.flatnonzero(share)
    particles = part.particles.take(held)
    scaled = replace(particles, mass=particles.mass * share[held], volume=particles.volume * share[held])
    within = Placed(placed.pixel[held], placed.distance[held])
    cells = bin_frame(replace(part, particles=scaled), within, bed, grid, density)
    packed = float(volume_thickness(cells)[0]) * density / layer
    return packed, parallel_speed(cells)[0], normal_velocity(cells)[0], packed / density * impact_pressure(cells)[0]


def usual_sizes(frame: Frame) -> tuple[float, float]:
    """Return the default width of the cell and height of a layer, from the grid spacing of the solver.

    Parameters
    ----------
    frame : Frame

    Returns
    -------
    (float, float) [m]
    """
    spacing = grid_spacing(frame)
    return WIDTH_IN_CELLS * spacing, LAYER_IN_CELLS * spacing


def corners_of(x: np.ndarray, y: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the square cells around map points.

    Parameters
    ----------
    x, y : float64[n] [m]
    width : float [m]

    Returns
    -------
    (float64[4 n], float64[4 n]) [m]
        x and y.
    """
    offsets = np.array(list(product((-0.5, 0.5), repeat=2))) * width
    return tuple((np.stack([x, y], axis=1)[:, None] + offsets).reshape(-1, 2).T)
