"""Answer `mpmgis hydrograph`: volume and mass through a section over time."""

import numpy as np
import shapely

from ..maps.averaging.frame_values import cells_of
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..system.parallel import frame_pool
from ..terrain.observations import read_line
from .answer_files import answer_output, with_files
from .opened_results import ExportFlow, FrameFlow, open_flow
from .question_options import Question
from .section_flux import (
    RASTER_BANDS,
    Balance,
    HydrographFound,
    azimuth_to_the_right,
    continued,
    crossed_between,
    mass_beyond,
    raster_flux,
    section_pieces,
    section_state,
    trapezoids,
)
from .series_plots import write_hydrograph_plot, write_hydrograph_table

PLOT_FILE, TABLE_FILE = "hydrograph.png", "hydrograph.csv"
WORD = "hydrograph"  # end of the name of the default output folder
BEYOND = 2.0  # [diagonals of the raster] by which a section is extended at both ends
METHODS = ("auto", "particles", "cells")


def hydrograph(
    asked: Question, section: PathLike, method: str = "auto", progress: Progress = unwatched
) -> HydrographFound:
    """Compute volume and mass through a section over time, counted by particles where these have ids.

    Parameters
    ----------
    asked : Question
    section : path
        File with a line across the flow.
    method : {"auto", "particles", "cells"}
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    HydrographFound

    Raises
    ------
    MpmgisError
        Unreadable input, a section that crosses itself or is outside the raster, a single frame.
    """
    output = answer_output(asked, WORD, (PLOT_FILE, TABLE_FILE))
    flow = open_flow(asked, output)
    if len(flow.times) < 2:
        raise InputError(f"{flow.name}: one frame, expected two or more: discharge is computed between frames")
    line = _section(section, flow)
    if flow.entries:
        found = _found(method, flow, line, section, progress)
    else:
        found = _found_in_rasters(method, flow, line, progress)
    writers = {PLOT_FILE: write_hydrograph_plot, TABLE_FILE: write_hydrograph_table}
    return with_files(found, output, asked["overwrite"], writers)


def _section(path, flow):
    """float64[m, 2] [m]: the vertices of the section."""
    section = read_line(path, flow.terrain.grid)
    line = shapely.LineString(section)
    if not line.is_simple or line.is_closed:
        raise InputError(f"{path} crosses itself or is closed, expected a line from one side of the flow to the other")
    if not line.intersects(shapely.box(*flow.grid.bounds)):
        west, south, east, north = flow.grid.bounds
        raise InputError(
            f"{path} is outside the raster (E {west:.0f} to {east:.0f}, N {south:.0f} to {north:.0f}); draw it again, "
            "or check its CRS"
        )
    return section


def _entry_state(entry, averaging, section):
    return section_state(entry.read(averaging.density), averaging, section)


def _found(method: str, flow: FrameFlow, section: np.ndarray, path: PathLike, progress: Progress) -> HydrographFound:
    """The HydrographFound of frames."""
    west, south, east, north = flow.grid.bounds
    whole = continued(section, BEYOND * float(np.hypot(east - west, north - south)))
    cells, crossed, beyond, before = [], [], [], None
    with frame_pool() as pool:
        for state in pool.map(_entry_state, flow.entries, flow.averaging, section):
            cells.append(state.flux)
            if before is not None:
                counted = None if method == "cells" else crossed_between(section, whole, before, state)
                crossed.append(counted)
            if len(cells) in (1, len(flow.entries)):
                beyond.append(mass_beyond(whole, state))
            before = state
            progress(len(cells), len(flow.entries))
    _require_counted(method, flow, crossed)
    simple = shapely.LineString(whole).is_simple
    balance = _balance(crossed, beyond) if simple else None
    if not simple:
        log.info(f"{path}: extended straight it crosses itself, so that mass beyond it is not defined: no balance")
    return _towards_more(flow, section, np.array(cells), crossed, balance)


def _found_in_rasters(method: str, flow: ExportFlow, section: np.ndarray, progress: Progress) -> HydrographFound:
    """The HydrographFound of an export, by the flux of its cells."""
    if method == "particles":
        raise InputError(f"`method=particles`: {flow.name} is an export without particles; give the frames")
    missing = [name for name in RASTER_BANDS if name not in flow.steps.bands]
    if missing or flow.density is None:
        raise InputError(
            f"{flow.name}: its steps have no {', '.join(missing) or 'density'}, which the flux of cells requires; "
            "export with `products` mass,Ut_E,Ut_N, or give the frames"
        )
    places, normals = section_pieces(section, 0.25 * flow.grid.cell_size)
    under = cells_of(flow.terrain.grid, *places.T)
    gradient = flow.terrain.limited_gradient.reshape(-1, 2)[np.maximum(under, 0)]
    slopes = np.where(under >= 0, np.nan_to_num(gradient).T, 0.0)
    values = flow.at_cells(cells_of(flow.grid, *places.T), RASTER_BANDS, range(len(flow.times)), progress)
    cells = np.array(
        [
            raster_flux({name: band[step] for name, band in values.items()}, normals, slopes, flow.density)
            for step in range(len(flow.times))
        ]
    )
    return _towards_more(flow, section, cells, [None] * (len(cells) - 1), None)


def _require_counted(method, flow, crossed):
    missing = next((k for k, counted in enumerate(crossed) if counted is None), None)
    if method == "particles" and missing is not None:
        names = [flow.entries[k].path.name for k in (missing, missing + 1)]
        raise InputError(
            f"`method=particles`: {names[0]} and {names[1]} have no particles in common by id (none stored, an id "
            "twice, or columns became points); use `method=auto` or cells"
        )


def _balance(crossed, beyond):
    """The Balance of all intervals; None if one was not counted by particles."""
    if None in crossed:
        return None
    sums = (sum(getattr(counted, key) for counted in crossed) for key in ("mass", "round_mass", "began_beyond"))
    return Balance(beyond[1] - beyond[0], *sums)


def _towards_more(flow, section, cells, crossed, balance):
    """The HydrographFound whose positive direction is that of more mass."""
    times = flow.times
    by_particles = np.array([counted is not None for counted in crossed])
    sums = trapezoids(times, cells)
    for k, counted in enumerate(crossed):
        if counted is not None:
            sums[k] = counted.volume, counted.mass
    azimuth, sign = azimuth_to_the_right(section), 1.0
    if sums[:, 1].sum() < 0:
        azimuth, sign = (azimuth + 180.0) % 360.0, -1.0
    if not by_particles.all():
        why = (
            "their particles have no ids in common, or `method=cells`" if flow.entries else "rasters have no particles"
        )
        log.info(
            f"{np.count_nonzero(~by_particles)} of {len(crossed)} intervals are from the flux of cells at the frames, "
            f"by the trapezoidal rule: {why}"
        )
    return HydrographFound(
        name=flow.name,
        times=times,
        volume=sign * sums[:, 0],
        mass=sign * sums[:, 1],
        by_particles=by_particles,
        cells=sign * cells,
        azimuth=azimuth,
        balance=balance if balance is None or sign > 0 else balance.turned(),
        unseen=max((max(counted.began, counted.ended) for counted in crossed if counted is not None), default=0.0),
    )
