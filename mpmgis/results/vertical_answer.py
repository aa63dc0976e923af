"""Answer `mpmgis vertical`: profiles of 3D frames over the height above the bed, at points."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..system.parallel import frame_pool
from .answer_files import answer_output, with_files
from .opened_results import open_frames, require_on_grid
from .profile_answer import chosen_steps
from .profiles import MOST_LAYERS, VerticalFound, corners_of, usual_sizes, vertical_profiles
from .question_options import FrameQuestion
from .timeseries_answer import given_points
from .vertical_plots import write_loads, write_profiles, write_vertical_plot

PLOT_FILE, PROFILE_FILE, LOAD_FILE = "vertical.png", "vertical.csv", "loads.csv"
WORD = "vertical"  # end of the name of the default output folder


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
