"""Answer `mpmgis profile`: the flow along a line."""

from collections.abc import Sequence

import numpy as np
import shapely

from ..maps.averaging.frame_values import NOWHERE, cells_of, nearest_times
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..terrain.observations import read_line
from .answer_files import answer_output, with_files
from .flow_line import vertex_distances
from .opened_results import ExportFlow, FrameFlow, open_flow
from .profiles import PROFILE_PRODUCTS, ProfileFound, free_surface
from .question_options import Question
from .runout_measures import line_profile
from .series_plots import write_profile_plot, write_rows

PLOT_FILE, TABLE_FILE = "profile.png", "profile.csv"
WORD = "profile"  # end of the name of the default output folder
USUAL_TIMES = 5  # evenly spread over the results, if none are asked for
MOST_PLACES = 200_000  # sample points on a line; more are a wrong `spacing`


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
