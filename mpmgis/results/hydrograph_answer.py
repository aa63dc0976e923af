"""Answer `mpmgis hydrograph`: volume and mass through a section over time."""

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely

from ..maps.averaging.frame_values import cells_of
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..system.parallel import frame_pool
from ..terrain.observations import read_line
from .answer_files import answer_output, with_files, write_rows
from .opened_results import ExportFlow, FrameFlow, open_flow
from .plot_style import COLOURS, legend, plot_file, style_axes
from .question_options import Question
from .section_flux import (
    RASTER_BANDS,
    Balance,
    azimuth_to_the_right,
    continued,
    crossed_between,
    mass_beyond,
    raster_flux,
    section_pieces,
    section_state,
    trapezoids,
)

COLUMNS = (
    ("time", "s"),
    ("discharge", "m3 s-1"),
    ("mass_discharge", "kg s-1"),
    ("volume", "m3"),
    ("mass", "kg"),
    ("cells_discharge", "m3 s-1"),
    ("cells_mass_discharge", "kg s-1"),
    ("cells_volume", "m3"),
    ("cells_mass", "kg"),
)
PLOT_FILE, TABLE_FILE = "hydrograph.png", "hydrograph.csv"
WORD = "hydrograph"  # end of the name of the default output folder
BEYOND = 2.0  # [diagonals of the raster] by which a section is extended at both ends


@dataclass(frozen=True)
class HydrographFound:
    """A hydrograph; positive in the direction of the net mass, towards `azimuth` [degrees from north].

    Parameters
    ----------
    name : str
    times : float64[k] [s]
    volume, mass : float64[k - 1] [m3], [kg]
        Crossed from each time to the next.
    by_particles : bool[k - 1]
        True: from particles; False: from the flux of the cells.
    cells : float64[k, 2] [m3 s-1], [kg s-1]
        Flux of the section's cells at each time.
    azimuth : float
    balance : Balance or None
        None if an interval is not from particles, or if the section cannot be extended at its ends.
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

    def columns(self) -> tuple:
        """Return the (name, unit) of each column of `rows`."""
        return COLUMNS

    def rows(self) -> list[tuple]:
        """Return the rows of the table: rates are means since the previous time, volume and mass are cumulative."""
        lasting = np.diff(self.times)
        totals = np.cumsum(np.r_[0.0, self.volume]), np.cumsum(np.r_[0.0, self.mass])
        rates = np.r_[math.nan, self.volume / lasting], np.r_[math.nan, self.mass / lasting]
        return list(zip(self.times, *rates, *totals, *self.cells.T, *self.cells_totals().T, strict=True))

    def cells_totals(self) -> np.ndarray:
        """Return the cumulative flux of the cells, by the trapezoidal rule.

        Returns
        -------
        float64[k, 2] [m3], [kg]
        """
        return np.vstack([np.zeros(2), np.cumsum(trapezoids(self.times, self.cells), axis=0)])

    def peak(self) -> tuple[float, float]:
        """Return the largest mean discharge [m3 s-1] and the time [s] at which its interval ends."""
        rates = self.volume / np.diff(self.times)
        k = int(np.argmax(rates))
        return float(rates[k]), float(self.times[k + 1])

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        cells_volume, cells_mass = self.cells_totals()[-1]
        rate, time = self.peak()
        counted = f"{self.by_particles.sum()} of {len(self.by_particles)} intervals counted by particles"
        lines = [
            f"{self.name}: positive towards {self.azimuth:.0f} degrees from north; {counted}",
            f"through the section   {self.volume.sum():.6g} m3, {self.mass.sum():.6g} kg",
            f"by flux of cells      {cells_volume:.6g} m3, {cells_mass:.6g} kg",
            f"largest discharge     {rate:.6g} m3/s, mean of the interval to {time:g} s",
        ]
        balance = self.balance
        if balance is not None:
            parts = f"{balance.crossed:.6g} through it, {balance.round_ends:.6g} around its ends, {balance.began:.6g}"
            lines.append(
                f"mass beyond it        {balance.beyond:+.6g} kg = {parts} new there; error {balance.error:.1e} kg"
            )
        if self.unseen > 0:
            lines.append(f"up to {self.unseen:.6g} kg appeared or disappeared between two frames; counted from then on")
        return lines


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
    writers = {PLOT_FILE: write_hydrograph_plot, TABLE_FILE: write_rows}
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


def write_hydrograph_plot(path: Path, found: HydrographFound) -> None:
    """Plot mean discharge between frames, flux of the cells at frames, and cumulative volume.

    Parameters
    ----------
    path : Path
    found : HydrographFound
    """
    with plot_file(path, (9.0, 6.0), rows=2, heights=(1.4, 1)) as axes:
        rate, total = axes[:, 0]
        steps = found.volume / np.diff(found.times)
        partly = "particles, else cells" if found.by_particles.any() else "cells"
        word = "particles" if found.by_particles.all() else partly
        rate.stairs(
            steps, found.times, color=COLOURS[0], linewidth=1.5, fill=False, label=f"mean between frames, by {word}"
        )
        rate.plot(found.times, found.cells[:, 0], ".", color=COLOURS[1], markersize=4, label="flux of the cells")
        rate.axhline(0, color="#999999", linewidth=0.6)
        title = f"{found.name}: discharge towards {found.azimuth:.0f}° from north"
        style_axes(rate, "discharge [m³/s]", title=title)
        legend(rate, loc="best")
        total.plot(
            found.times, np.r_[0.0, np.cumsum(found.volume)], color=COLOURS[0], linewidth=1.5, label=f"by {word}"
        )
        total.plot(
            found.times, found.cells_totals()[:, 0], "--", color=COLOURS[1], linewidth=1.2, label="flux of the cells"
        )
        style_axes(total, "cumulative volume [m³]", "time [s]")
        legend(total, loc="best")
