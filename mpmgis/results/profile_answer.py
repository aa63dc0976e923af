"""Answer `mpmgis profile`: the flow along a line."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from ..laws.quantities import BAND
from ..maps.averaging.frame_values import NOWHERE, cells_of, nearest_times
from ..maps.qgis.colours import BATLOW, ramp_colours
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..terrain.elevation import Terrain
from ..terrain.observations import read_line
from .answer_files import answer_output, with_files, write_rows
from .flow_line import line_profile, vertex_distances
from .opened_results import ExportFlow, FrameFlow, open_flow
from .plot_style import COLOURS, draw_ground, legend, plot_file, style_axes
from .question_options import Question

PROFILE_PRODUCTS = ("h", "t", "Un", "Ut")
PLACE_COLUMNS = (("time", "s"), ("along", "m"), ("E", "m"), ("N", "m"), ("terrain", "m"), ("surface", "m"))
LATE = 0.85  # [1] used part of the colour ramp; its end is too pale for lines
PLOT_FILE, TABLE_FILE = "profile.png", "profile.csv"
WORD = "profile"  # end of the name of the default output folder
USUAL_TIMES = 5  # evenly spread over the results, if none are asked for
MOST_PLACES = 200_000  # sample points on a line; more are a wrong `spacing`


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


def profile(
    asked: Question,
    line: PathLike,
    at_times: Sequence[float] | None = None,
    spacing: float | None = None,
    progress: Progress = unwatched,
) -> ProfileFound:
    """Sample depth, thickness and velocities along a line, with terrain and free surface.

    Values are those of the cells that the line crosses.

    Parameters
    ----------
    asked : Question
    line : path
    at_times : sequence of float, optional [s]
        Default: five, evenly spread.
    spacing : float, optional [m]
        Of the sample points; default: the cell size.
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    ProfileFound

    Raises
    ------
    MpmgisError
        Unreadable input, a line outside the raster, a time outside the results; nothing is written then.
    """
    output = answer_output(asked, WORD, (PLOT_FILE, TABLE_FILE))
    flow = open_flow(asked, output)
    path = read_line(line, flow.terrain.grid)
    steps = chosen_steps(flow.times, at_times)
    length = float(vertex_distances(path)[-1])
    if spacing is not None and spacing > length:
        raise InputError(
            f"`spacing` is {spacing:g} m, expected at most the length of {line}, {length:.6g} m; give a smaller "
            "`spacing`"
        )
    spacing = spacing or flow.grid.cell_size
    if length > MOST_PLACES * spacing:
        raise InputError(
            f"{line}: {length:.6g} m with a spacing of {spacing:g} m make {length / spacing:.3g} sample "
            f"points, expected at most {MOST_PLACES}; give a larger `spacing`"
        )
    along, x, y, elevation, _ = line_profile(path, flow.terrain, 0.0, length, spacing)
    cells = cells_of(flow.grid, x, y)
    _log_outside(line, flow, cells, path)
    values = flow.at_cells(cells, PROFILE_PRODUCTS, steps, progress)
    surface = free_surface(flow.terrain, x, y, values["h"])
    found = ProfileFound(flow.name, along, x, y, elevation, flow.times[steps], surface, values)
    if not (values["h"] > 0).any():
        log.info(f"{line}: no flow along it at these times")
    return with_files(found, output, asked["overwrite"], {PLOT_FILE: write_profile_plot, TABLE_FILE: write_rows})


def chosen_steps(times: np.ndarray, requested: Sequence[float] | None) -> np.ndarray:
    """Return the numbers of the steps nearest to the requested times; evenly spread ones for None.

    Parameters
    ----------
    times : float64[steps] [s]
    requested : sequence of float or None [s]

    Returns
    -------
    int64[n]

    Raises
    ------
    InputError
        A time before the first or after the last.
    """
    if requested is None:
        requested = np.linspace(times[0], times[-1], USUAL_TIMES)
    else:
        tolerance = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        beyond = [time for time in requested if not times[0] - tolerance <= time <= times[-1] + tolerance]
        if beyond:
            raise InputError(
                f"`at_times`: {beyond[0]:g} s is outside the results, which go from {times[0]:g} to {times[-1]:g} s"
            )
        moved = [time for time in requested if np.abs(times - time).min() > 1e-6 * max(1.0, abs(time))]
        if moved:
            log.info(
                f"no frame at {', '.join(f'{time:g}' for time in moved)} s; the nearest frames are used, each once"
            )
    return nearest_times(times, requested)


def _log_outside(path: PathLike, flow: FrameFlow | ExportFlow, cells: np.ndarray, line: np.ndarray) -> None:
    off = cells == NOWHERE
    if off.all():
        west, south, east, north = flow.grid.bounds
        raise InputError(
            f"{path} is outside the raster (E {west:.0f} to {east:.0f}, N {south:.0f} to {north:.0f}); draw it again, "
            "or check its CRS"
        )
    if off.any():
        beyond = shapely.LineString(line).difference(shapely.box(*flow.grid.bounds)).length
        log.info(f"{path}: {beyond:.0f} m of it are outside the raster and have no values")


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


def write_profile_plot(path: Path, found: ProfileFound) -> None:
    """Plot terrain and free surface, depth and thickness, velocities; one colour per time.

    Parameters
    ----------
    path : Path
    found : ProfileFound
    """
    with plot_file(path, (9.0, 8.0), rows=3, heights=(1.3, 1, 1)) as axes:
        ground, depths, speeds = axes[:, 0]
        draw_ground(ground, found.along, found.terrain)
        count = len(found.times)
        colours = ramp_colours(BATLOW, round(max(count, 2) / LATE) + 1)[:count] if count > 1 else COLOURS[:1]
        for k, (time, colour) in enumerate(zip(found.times, colours, strict=True)):
            wet = found.values["h"][k] > 0
            surface = np.where(wet, found.surface[k], np.nan)
            ground.plot(found.along, surface, color=colour, linewidth=1.3, zorder=4, label=f"surface, {time:.4g} s")
            _draw_pair(depths, found, k, ("h", "t"), colour)
            _draw_pair(speeds, found, k, ("Ut", "Un"), colour)
        style_axes(ground, "elevation [m]", title=f"{found.name}: profile")
        legend(ground, loc="best")
        style_axes(depths, "h (solid), t (dashed), normal [m]")
        style_axes(speeds, "Ut (solid), Un (dashed) [m/s]", "distance along the line [m]")
        speeds.axhline(0, color="#999999", linewidth=0.6)
        speeds.set_xlim(found.along[0], found.along[-1])


def _draw_pair(axes, found, k, names, colour):
    for name, style in zip(names, ("-", "--"), strict=True):
        shown = np.where(found.values["h"][k] > 0, found.values[name][k], np.nan)
        axes.plot(found.along, shown, style, color=colour, linewidth=1.3)
