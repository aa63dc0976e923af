"""Answer `mpmgis vertical`: profiles of 3D frames over the height above the bed, at points."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..maps.export.export_request import AnswerRequest
from ..system.errors import InputError
from ..system.messages import log
from ..system.parallel import frame_pool
from .answer_files import answer_output, write_answer
from .opened_results import open_frames, require_on_grid
from .profile_answer import chosen_steps
from .profiles import MOST_LAYERS, VerticalFound, corners_of, usual_sizes, vertical_profiles
from .timeseries_answer import given_points
from .vertical_plots import write_loads, write_profiles, write_vertical_plot

PLOT_FILE, PROFILE_FILE, LOAD_FILE = "vertical.png", "vertical.csv", "loads.csv"
WORD = "vertical"  # end of the name of the default output folder


@dataclass(frozen=True, kw_only=True)
class VerticalRequest(AnswerRequest):
    """A question about results; `mpmgis.commands` describes its options."""

    points: Path | None = None
    at: tuple = ()  # (E, N) [m]
    at_times: tuple | None = None  # [s]
    width: float | None = None  # [m]
    layer: float | None = None  # [m]


def vertical(
    request: VerticalRequest, progress: Callable[[int, int], None] = lambda done, total: None
) -> VerticalFound:
    """Compute density, velocities and pressure over the height above the bed, in cells around points.

    Parameters
    ----------
    request : VerticalRequest
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
    output = answer_output(request, WORD, files)
    flow = _of_points(open_frames(request.results, output, "it has no values over the depth"))
    names, x, y = given_points(request.points, request.at, flow)
    require_on_grid(flow, x, y, names, "point")
    steps = chosen_steps(flow.times, request.at_times)
    first = flow.entries[steps[0]].read(flow.averaging.density)
    usual_width, usual_layer = usual_sizes(first)
    width, layer = request.width or usual_width, request.layer or usual_layer
    require_on_grid(flow, *corners_of(x, y, width), np.repeat(names, 4), f"the cell of {width:.3g} m around point")
    if request.layer is None or request.width is None:
        log.info(f"cells of {width:.3g} m, layers of {layer:.3g} m, from the grid of the code (`width`, `layer`)")
    points, profiles = np.stack([x, y], axis=1), []
    with frame_pool() as pool:
        entries = [flow.entries[step] for step in steps]
        for found in pool.map(_entry_profiles, entries, flow.averaging, points, width, layer):
            profiles.append(found)
            progress(len(profiles), len(entries))
    found = VerticalFound(flow.name, names, x, y, width, tuple(zip(*profiles, strict=True)))
    _log_empty(found)
    writers = {
        PLOT_FILE: lambda path: write_vertical_plot(path, found),
        PROFILE_FILE: lambda path: write_profiles(path, found),
        LOAD_FILE: lambda path: write_loads(path, found),
    }
    return replace(found, files=write_answer(request, output, writers))


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
