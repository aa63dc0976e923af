"""Answer `mpmgis runout`: runout, drop height and angles of a flow, along a given line or the centre line."""

import numpy as np

from ..frames.flow_end import FlowEnd
from ..maps.averaging.frame_values import cells_of
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..system.parallel import frame_pool
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from ..terrain.observations import read_line
from .answer_files import answer_output, with_files
from .comparison import footprint
from .flow_line import centre_line, distance_to_line
from .opened_results import ExportFlow, FrameFlow, RasterFlow, open_flow, peaks_of, read_peaks
from .question_options import Question
from .runout_measures import (
    Place,
    RunoutFound,
    ends_along,
    energy_line,
    farthest_place,
    heights_under,
    line_profile,
    mass_state,
)
from .runout_plots import write_figures, write_over_time, write_profile, write_runout_plot

PLOT_FILE, FIGURES_FILE, TIME_FILE, PROFILE_FILE = "runout.png", "runout.csv", "mass_over_time.csv", "profile.csv"
FILES = (PLOT_FILE, FIGURES_FILE, TIME_FILE, PROFILE_FILE)
RUNOUT_BANDS = ("h_max", "h_deposit", "h_last")
WORD = "runout"  # end of the name of the default output folder
CENTRE_LINE = "centre line of the flow"
STRAIGHT_OVER_ALONG = 1.5  # [1] straight distance over runout; a toe as far from the line as along it gives 1.41
_MARGIN = 0.08  # [runouts] by which the profile goes beyond both ends


def given_line(path: PathLike, flowed: np.ndarray, grid: Grid, terrain: Terrain | None) -> np.ndarray:
    """Return the line in the file `path`, from its upper end.

    Parameters
    ----------
    path : path
    flowed : bool[rows, columns]
        Cells of `grid` that the flow reached; the line must pass within two cells of one.
    grid : Grid
    terrain : Terrain or None
        Without it the direction is not changed.

    Returns
    -------
    float64[n, 2] [m]

    Raises
    ------
    MpmgisError
    """
    line = read_line(path, grid)
    distance = distance_to_line(line, flowed, grid)
    if distance > 2 * grid.cell_size:
        raise InputError(f"{path} is {distance:.0f} m away from the flow; give the path of the flow")
    if terrain is not None:
        begin, end = terrain.sample(*line[[0, -1]].T)
        if begin < end:
            log.info(f"{path} runs uphill, from {begin:.0f} to {end:.0f} m; it is reversed")
            return line[::-1]
    return line


def runout(
    asked: Question, line: PathLike | None = None, threshold: float = 0.1, progress: Progress = unwatched
) -> RunoutFound:
    """Find runout, drop, angles of the energy line and of the centre of mass; write the figures.

    Parameters
    ----------
    asked : Question
    line : path, optional
        File with the path of the flow; default: the centre line of the flow.
    threshold : float [m]
        Least depth of a reached cell.
    progress : callable
        Called with (frames done, frames in all).

    Returns
    -------
    RunoutFound

    Raises
    ------
    MpmgisError
        Unreadable input, or a flow that reached no cell; nothing is written then.
    """
    output = answer_output(asked, WORD, FILES)
    flow = open_flow(asked, output, peaks_do=True)
    peaks = peaks_of(asked, progress)
    bands, grid = read_peaks(peaks, RUNOUT_BANDS)
    found = found_runout(flow, bands, grid, peaks.end, line, threshold)
    writers = {PLOT_FILE: write_runout_plot, FIGURES_FILE: write_figures, TIME_FILE: write_over_time}
    if not found.states:
        del writers[TIME_FILE]
    return with_files(found, output, asked["overwrite"], {**writers, PROFILE_FILE: write_profile})


def found_runout(
    flow: FrameFlow | ExportFlow | RasterFlow,
    bands: dict[str, np.ndarray],
    grid: Grid,
    end: FlowEnd | None,
    line: PathLike | None,
    threshold: float,
) -> RunoutFound:
    """Return the RunoutFound of largest and last depths, without files.

    Parameters
    ----------
    flow : FrameFlow, ExportFlow or RasterFlow
    bands : dict of str to float[rows, columns] [m]
        `h_max` and, if known, `h_deposit` of a flow that came to rest, `h_last` of another.
    grid : Grid
        Of the bands.
    end : FlowEnd or None
        State of the flow in its last step.
    line : path or None
        File with the path of the flow; None: the centre line of the flow.
    threshold : float [m]
        Least depth of a reached cell.

    Returns
    -------
    RunoutFound

    Raises
    ------
    InputError
        No largest depth, no cell above the threshold, no elevations, or no movement along the line.
    """
    if "h_max" not in bands:
        raise InputError(f"{flow.name} has no largest depth (h_max, or <name>_pft), which the runout requires")
    depth, unknown = bands["h_max"], np.full(grid.shape, np.nan)
    deposit = bands.get("h_deposit", unknown)
    last = bands.get("h_last", deposit)
    if end is not None and not end.came_to_rest:
        log.info(f"{flow.name}: the flow did not come to rest ({end.words()}); its runout can grow, and has no deposit")
    mask = footprint(depth, threshold)
    if not mask.any():
        raise InputError(f"{flow.name}: no cell was ever deeper than `threshold={threshold:g}` m; give a lower one")
    _require_moved(threshold, flow, mask)
    elevation = heights_under(mask, grid, flow.terrain)
    if not np.isfinite(elevation).any():
        raise InputError(
            f"{flow.terrain.path} has no elevations under the flow; give the DTM of the results with `dem`"
        )
    vertices, source = _line(line, flow, mask, depth, elevation, grid)
    top, toe = ends_along(mask, elevation, grid, vertices)
    lying = footprint(deposit, threshold)
    spacing = 0.5 * min(grid.cell_size, flow.terrain.grid.cell_size)
    reached = energy_line(top, toe, vertices, flow.terrain, spacing)
    if reached is None:
        raise InputError(
            f"{flow.name}: the flow does not move beyond its highest point along {source}; give another `line`"
        )
    if reached.straight > STRAIGHT_OVER_ALONG * reached.length:
        log.info(
            f"{source}: the flow's toe is {reached.straight:.0f} m from its top, but only {reached.length:.0f} m "
            "along the line, which does not follow the flow; give another `line`"
        )
    states = _states(flow, vertices)
    return RunoutFound(
        name=flow.name,
        threshold=threshold,
        line=vertices,
        line_source=source,
        flow=reached,
        deposit=energy_line(
            top, farthest_place(lying & mask, elevation, grid, vertices), vertices, flow.terrain, spacing
        ),
        states=states,
        farthest_mass=_farthest_mass(states, vertices, flow.terrain),
        profile=_profile(reached, vertices, flow.terrain, spacing, depth, last, grid),
    )


def _require_moved(threshold, flow, mask):
    """Refuse a flow that was in all cells of `mask` in its first step: the line would be that of the release's slope.

    A first step after t = 0 can be anywhere in the flow, and proves nothing.
    """
    if not len(flow.times) or flow.times[0] > 0:
        return
    first = flow.at_cells(np.flatnonzero(mask), ("h",), (0,))["h"][0]
    if (np.nan_to_num(first) >= threshold).all():
        raise InputError(
            f"{flow.name}: the flow did not move: all cells that were ever deeper than `threshold="
            f"{threshold:g}` m were so in its first step; there is no runout and no angle"
        )


def _line(
    path: PathLike | None,
    flow: FrameFlow | ExportFlow | RasterFlow,
    mask: np.ndarray,
    depth: np.ndarray,
    elevation: np.ndarray,
    grid: Grid,
) -> tuple[np.ndarray, str]:
    """(vertices, description) of the line along which runout is measured."""
    if path is not None:
        return given_line(path, mask, grid, flow.terrain), str(path)
    line = centre_line([mask], [depth], elevation, grid)
    if line is None:
        raise InputError(
            f"{flow.name}: the flow is one cell, or has no elevations under it; give `line`, or smaller `cell_size`"
        )
    return line, CENTRE_LINE


def _states(flow, line):
    """MassState of every frame; () of rasters."""
    if not flow.entries:
        return ()
    with frame_pool() as pool:
        return tuple(state for state in pool.map(_entry_state, flow.entries, flow.averaging, line) if state is not None)


def _entry_state(entry, averaging, line):
    return mass_state(entry.read(averaging.density), averaging, line)


def _farthest_mass(states: tuple, line: np.ndarray, terrain: Terrain) -> Place | None:
    """Point on the line up to which 99 % of the last frame's mass lie; None without frames."""
    if not states:
        return None
    along = float(states[-1].quantiles[-1])
    (_, x, y, elevation, _) = line_profile(line, terrain, along, along + 1e-3, 1.0)
    return Place(along, float(x[0]), float(y[0]), float(elevation[0]))


def _profile(reached, line, terrain, spacing, depth, last, grid):
    """The columns of PROFILE_COLUMNS, from a little above the top to a little beyond the toe."""
    margin = _MARGIN * reached.length
    begin, end = reached.top.along - margin, reached.toe.along + margin
    along, x, y, elevation, ground = line_profile(line, terrain, begin, end, 2 * spacing)
    share = (along - reached.top.along) / reached.length
    falling = np.where((share >= 0) & (share <= 1), reached.top.z - share * reached.drop, np.nan)
    cells = cells_of(grid, x, y)
    values = [np.where(cells >= 0, band.reshape(-1)[np.maximum(cells, 0)], np.nan) for band in (depth, last)]
    return (along, ground, x, y, elevation, falling, *values)
