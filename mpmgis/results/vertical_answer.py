"""Answer `mpmgis vertical`: profiles of 3D frames over the height above the bed, at points.

A vertical profile is a square map cell divided into layers by distance normal to the bed; each layer is averaged like
a cell of an export (outlook of Vicari et al. 2025, NHESS 25:3897). A point has the height of a cube of its volume and
is shared among the layers that it overlaps, so a uniform lattice of points gives uniform layers.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..frames.particles import Frame
from ..laws.quantities import GRAVITY
from ..maps.averaging.band_products import impact_pressure, normal_velocity, parallel_speed, volume_thickness
from ..maps.averaging.cell_averages import bin_frame, grid_spacing, lower_percentile
from ..maps.averaging.height_layers import point_extents
from ..maps.averaging.placement import Bed, Placed, place
from ..maps.qgis.colours import BATLOW, ramp_colours
from ..system.csv_rows import write_columns
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..system.parallel import frame_pool
from ..terrain.grid import Grid
from .answer_files import answer_output, four_digits, with_files
from .opened_results import open_frames, require_on_grid
from .plot_style import GROUND_LINE, legend, plot_file, style_axes
from .profile_answer import chosen_steps
from .question_options import FrameQuestion
from .timeseries_answer import given_points

if TYPE_CHECKING:
    from pyproj import CRS

LOAD_HEADINGS = (
    "time [s]",
    "h normal [m]",
    "momentum [kN/m]",
    "at height [m]",
    "largest p [kPa]",
    "overburden [kN/m]",
    "at height [m]",
)
COLUMN_WIDTH = 19  # [characters] of a column of loads
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
MOST_ROWS = 10  # points in the plot; the tables have all
# attribute of a VerticalProfile, label, factor, whether the axis starts at zero
PANELS = (
    ("density", "density [kg/m³]", 1.0, True),
    ("parallel", "Ut [m/s]", 1.0, False),
    ("normal", "Un [m/s]", 1.0, False),
    ("pressure", "p = density × speed² [kPa]", 1e-3, True),
)
PLOT_FILE, PROFILE_FILE, LOAD_FILE = "vertical.png", "vertical.csv", "loads.csv"
WORD = "vertical"  # end of the name of the default output folder


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

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        width = max(map(len, (*self.names, "point"))) + 2
        lines = [f"{'point':<{width}}" + "".join(f"{word:>{COLUMN_WIDTH}}" for word in LOAD_HEADINGS)]
        for name, _, _, time, depth, momentum, height, largest, weight, height_of_weight in self.load_rows():
            cells = (time, depth, momentum / 1e3, height, largest / 1e3, weight / 1e3, height_of_weight)
            lines.append(f"{name:<{width}}" + "".join(f"{four_digits(value):>{COLUMN_WIDTH}}" for value in cells))
        return lines


def vertical(
    asked: FrameQuestion,
    points: PathLike | None = None,
    at: Sequence[tuple[float, ...]] = (),
    at_times: Sequence[float] | None = None,
    width: float | None = None,
    layer: float | None = None,
    progress: Progress = unwatched,
) -> VerticalFound:
    """Compute density, velocities and pressure over the height above the bed, in cells around points.

    Parameters
    ----------
    asked : FrameQuestion
    points : path, optional
        File of points.
    at : sequence of (float, float) [m]
        More points, (E, N).
    at_times : sequence of float, optional [s]
        Default: five, evenly spread.
    width, layer : float, optional [m]
        Of the cells, and of the layers in them; default: from the grid of the code.
    progress : callable
        Called with (frames done, frames in all).

    Returns
    -------
    VerticalFound

    Raises
    ------
    MpmgisError
        Depth-averaged frames, unreadable input, a point outside the raster; nothing is written then.
    """
    files = (PLOT_FILE, PROFILE_FILE, LOAD_FILE)
    output = answer_output(asked, WORD, files)
    flow = _of_points(open_frames(asked, output, "it has no values over the depth"))
    names, x, y = given_points(points, at, flow)
    require_on_grid(flow, x, y, names, "point")
    steps = chosen_steps(flow.times, at_times)
    first = flow.entries[steps[0]].read(flow.averaging.density)
    usual, given = usual_sizes(first), (width, layer)
    width, layer = width or usual[0], layer or usual[1]
    require_on_grid(flow, *corners_of(x, y, width), np.repeat(names, 4), f"the cell of {width:.3g} m around point")
    if None in given:
        log.info(f"cells of {width:.3g} m, layers of {layer:.3g} m, from the grid of the code (`width`, `layer`)")
    places, profiles = np.stack([x, y], axis=1), []
    with frame_pool() as pool:
        entries = [flow.entries[step] for step in steps]
        for one in pool.map(_entry_profiles, entries, flow.averaging, places, width, layer):
            profiles.append(one)
            progress(len(profiles), len(entries))
    found = VerticalFound(flow.name, names, x, y, width, tuple(zip(*profiles, strict=True)))
    _log_empty(found)
    writers = {PLOT_FILE: write_vertical_plot, PROFILE_FILE: write_profiles, LOAD_FILE: write_loads}
    return with_files(found, output, asked["overwrite"], writers)


def _of_points(flow):
    """The flow's frames of points; InputError without any."""
    entries = tuple(entry for entry in flow.entries if entry.header.dimension == 3)
    if not entries:
        raise InputError(
            f'{flow.name}: depth-averaged frames have no vertical profile; run the scene with solver = "points"'
        )
    if len(entries) < len(flow.entries):
        log.info(f"{len(flow.entries) - len(entries)} frames are columns without a profile; the others are used")
    return replace(flow, entries=entries)


def _entry_profiles(entry, averaging, points, width, layer):
    frame = entry.read(averaging.density)
    try:
        return vertical_profiles(frame, averaging.bed, averaging.density, points, width, layer, averaging.percentile)
    except ValueError as error:
        raise InputError(
            f"{entry.path.name}: {error}, expected at most {MOST_LAYERS}; give a larger `layer`"
        ) from error


def _log_empty(found):
    empty = [
        name
        for name, of_point in zip(found.names, found.profiles, strict=True)
        if not any(profile.count.any() for profile in of_point)
    ]
    if empty:
        others = f" and of {len(empty) - 1} others" if len(empty) > 1 else ""
        log.info(f"no particle is within {0.5 * found.width:.3g} m of point {empty[0]!r}{others} at these times")


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


def write_profiles(path: Path, found: VerticalFound) -> None:
    """Write the layers of a VerticalFound as CSV.

    Parameters
    ----------
    path : Path
    found : VerticalFound
    """
    write_columns(path, PROFILE_COLUMNS, found.rows())


def write_loads(path: Path, found: VerticalFound) -> None:
    """Write the loads of a VerticalFound as CSV.

    Parameters
    ----------
    path : Path
    found : VerticalFound
    """
    write_columns(path, LOAD_COLUMNS, found.load_rows())


def write_vertical_plot(path: Path, found: VerticalFound) -> None:
    """Plot density, velocities and pressure over height.

    There is one row of panels per point (the first MOST_ROWS), and one colour per time.

    Parameters
    ----------
    path : Path
    found : VerticalFound
    """
    names = found.names[:MOST_ROWS]
    rows, of_all = len(names), f", {MOST_ROWS} of {len(found.names)} points" * (len(found.names) > MOST_ROWS)
    with plot_file(path, (11.0, 3.1 * rows + 0.4), rows=rows, columns=len(PANELS), share="row") as axes:
        colours = ramp_colours(BATLOW, len(found.profiles[0]) + 2)
        for k, name in enumerate(names):
            for profile, colour in zip(found.profiles[k], colours, strict=False):
                if profile.count.any():
                    _draw(axes[k], profile, colour)
            for panel, (_, label, _, from_zero) in enumerate(PANELS):
                height = f"{name}\nheight above the bed [m]" if panel == 0 else ""
                title = f"{found.name}: cells of {found.width:.3g} m{of_all}" if (k, panel) == (0, 0) else ""
                style_axes(axes[k, panel], height, label if k == rows - 1 else "", title)
                axes[k, panel].axhline(0.0, color=GROUND_LINE, linewidth=1.2)
                if from_zero:
                    axes[k, panel].set_xlim(left=0)
            legend(axes[k, 0], loc="best")


def _draw(axes, profile, colour):
    for panel, (key, _, factor, from_zero) in enumerate(PANELS):
        axes[panel].stairs(
            getattr(profile, key) * factor,
            profile.edges,
            orientation="horizontal",
            color=colour,
            linewidth=1.4,
            baseline=0 if from_zero else None,
            label=f"{profile.time:.4g} s" if panel == 0 else None,
        )
