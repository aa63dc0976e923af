"""Answer `mpmgis runout`: runout, drop height and angles of a flow, along a given line or the centre line.

The energy line (Heim 1932: Fahrboeschung) joins the highest point of a flow to its farthest; the tangent of its angle
is drop over length. For the centre of mass the tangent depends on friction only: mu for a block with Coulomb friction.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..frames.flow_end import FlowEnd
from ..frames.particles import Frame
from ..maps.averaging.binning import MASS
from ..maps.averaging.cell_averages import bin_frame
from ..maps.averaging.frame_values import Averaging, cells_of
from ..maps.averaging.placement import place
from ..system.csv_rows import write_columns, write_records
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..system.parallel import frame_pool
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from .answer_files import answer_output, finite_or_none, with_files
from .comparison import footprint
from .flow_line import (
    CENTRE_LINE,
    Place,
    ends_along,
    farthest_place,
    heights_under,
    line_or_centre,
    line_profile,
    positions_along,
)
from .opened_results import ExportFlow, FrameFlow, RasterFlow, open_flow, peaks_of, read_peaks
from .plot_style import COLOURS, draw_ground, legend, plot_file, style_axes
from .question_options import Question

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
FLOW_COLOUR, DEPOSIT_COLOUR, LINE_COLOUR, MASS_COLOUR = COLOURS[4], COLOURS[1], COLOURS[2], COLOURS[0]
PLOT_FILE, FIGURES_FILE, TIME_FILE, PROFILE_FILE = "runout.png", "runout.csv", "mass_over_time.csv", "profile.csv"
FILES = (PLOT_FILE, FIGURES_FILE, TIME_FILE, PROFILE_FILE)
RUNOUT_BANDS = ("h_max", "h_deposit", "h_last")
WORD = "runout"  # end of the name of the default output folder
STRAIGHT_OVER_ALONG = 1.5  # [1] straight distance over runout; a toe as far from the line as along it gives 1.41
_MARGIN = 0.08  # [runouts] by which the profile goes beyond both ends


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
            quantity if unit == "1" else f"{quantity}_{'deg' if unit == 'degrees' else unit}": finite_or_none(value)
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

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        lines = [f"{self.name}: cells deeper than {self.threshold:g} m, along {self.line_source}"]
        for quantity, unit, value in self.rows():
            head = f"{quantity.replace('_', ' ')} [{unit}]" if unit != "1" else quantity.replace("_", " ")
            lines.append(f"{head:<40}{_figure(value):>10}")
        return lines


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
    vertices, source = line_or_centre(line, flow.name, mask, depth, elevation, grid, flow.terrain)
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


def write_figures(path: Path, found: RunoutFound) -> None:
    """Write the results of a RunoutFound as CSV.

    Parameters
    ----------
    path : Path
    found : RunoutFound
    """
    write_records(path, ("quantity", "unit", "value"), found.rows())


def write_over_time(path: Path, found: RunoutFound) -> None:
    """Write the position of the mass as CSV, one row per frame.

    Parameters
    ----------
    path : Path
    found : RunoutFound
    """
    write_columns(path, TIME_COLUMNS, found.time_rows())


def write_profile(path: Path, found: RunoutFound) -> None:
    """Write the profile along the line as CSV, one row per point.

    Parameters
    ----------
    path : Path
    found : RunoutFound
    """
    write_columns(path, ENERGY_LINE_COLUMNS, zip(*found.profile, strict=True))


def write_runout_plot(path: Path, found: RunoutFound) -> None:
    """Plot the longitudinal profile: terrain, flow and last step, energy line, path of the centre of mass.

    Parameters
    ----------
    path : Path
    found : RunoutFound
    """
    along, _, _, _, elevation, _, depth, last = found.profile
    with plot_file(path, (9.0, 6.0), rows=2, heights=(3, 1)) as axes:
        upper, lower = axes[:, 0]
        draw_ground(upper, along, elevation)
        _draw_energy_line(upper, found)
        _draw_centre(upper, found)
        style_axes(
            upper,
            "elevation [m]",
            title=f"{found.name}: runout {found.flow.length:.0f} m, drop {found.flow.drop:.0f} m",
        )
        legend(upper, loc="upper right")
        _draw_depth(lower, along, depth, FLOW_COLOUR, "largest h, normal")
        _draw_depth(lower, along, last, DEPOSIT_COLOUR, "h of the last frame, normal")
        style_axes(lower, "h [m]", f"distance along the {_source(found)} [m]")
        highest = float(np.nan_to_num(depth).max(initial=1e-3))
        lower.set(xlim=(along[0], along[-1]), ylim=(0, 1.35 * highest))
        legend(lower, loc="upper right", ncols=2)


def _draw_depth(axes, along, depth, colour, label):
    if np.isfinite(depth).any():
        shown = np.nan_to_num(depth)
        axes.fill_between(along, 0, shown, step="mid", color=colour, alpha=0.55, linewidth=0, label=label)


def _source(found):
    return found.line_source if found.line_source == CENTRE_LINE else "line"


def _draw_energy_line(axes, found):
    top, toe = found.flow.top, found.flow.toe
    label = f"energy line, {found.flow.angle:.1f}° (tan {found.flow.drop / found.flow.length:.3f})"
    axes.plot((top.along, toe.along), (top.z, toe.z), color=LINE_COLOUR, linewidth=1.5, zorder=4, label=label)
    axes.plot((top.along, toe.along), (top.z, toe.z), "o", color=LINE_COLOUR, markersize=5, zorder=5)
    if found.deposit is not None and found.deposit.toe != toe:
        at = found.deposit.toe
        label = f"toe of the deposit, {found.deposit.length:.0f} m, {found.deposit.angle:.1f}°"
        look = {"color": DEPOSIT_COLOUR, "markersize": 6, "markeredgecolor": "white", "zorder": 5}
        axes.plot(at.along, at.z, "s", label=label, **look)


def _draw_centre(axes, found):
    if found.centre is not None:
        way = [(state.along, state.z) for state in found.states]
        angle = found.centre[2]
        label = f"centre of mass, {angle:.1f}° from start to end" if np.isfinite(angle) else "centre of mass"
        axes.plot(*np.array(way).T, color=MASS_COLOUR, linewidth=1.2, zorder=4, label=label)
        ends = np.array([way[0], way[-1]]).T
        axes.plot(*ends, "^", color=MASS_COLOUR, markersize=6, markeredgecolor="white", zorder=5)
        axes.plot(*ends, color=MASS_COLOUR, linewidth=1.0, linestyle="--", zorder=4)
    if found.farthest_mass is not None:
        at = found.farthest_mass
        label = f"99 % of the mass, {at.along - found.flow.top.along:.0f} m"
        axes.plot(at.along, at.z, "D", color=COLOURS[3], markersize=5, markeredgecolor="white", zorder=5, label=label)


def _figure(value):
    if not math.isfinite(value):
        return "-"
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.3f}"
