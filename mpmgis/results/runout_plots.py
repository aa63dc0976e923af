"""Tables and plots of runout, profiles, time series, hydrographs and vertical profiles.

Common style of all figures except maps.

Plots of a barrier: force, moment and overtopping over time; a section through it with the flow.
"""

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..maps.export.run_picture import INK, LETTER, POINTS_PER_INCH
from ..maps.qgis.colours import BATLOW, LOOKS, ramp_colours
from ..system.whole_files import whole_file
from ..terrain.hydrograph_file import column_name, write_records
from .barrier_loads import FORCE, OVERTOPPED, BarrierHistory
from .profiles import LOAD_COLUMNS, PROFILE_COLUMNS, ProfileFound, SeriesFound, VerticalFound
from .runout_figures import ENERGY_LINE_COLUMNS, TIME_COLUMNS, RunoutFound
from .section_flux import COLUMNS, HydrographFound

if TYPE_CHECKING:
    from matplotlib.axes import Axes


DOTS_PER_INCH = 110
TITLE = 11  # [points]
COLOURS = ("#144d62", "#d29343", "#94384d", "#3c6d56", "#5fa2c4", "#818232", "#8e44ad", "#111111")  # of curves
GROUND, GROUND_LINE = "#d8cfc2", "#5a4632"


@contextmanager
def plot_file(
    path: Path, size: tuple, rows: int = 1, heights: tuple | None = None, columns: int = 1, share: str = "x"
) -> Iterator[np.ndarray]:
    """Axes [rows, columns] of a figure of `size` [inch]; the PNG is written (atomically) on exit.

    `share` "x": common horizontal axis; "row": common vertical axis in each row.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=DOTS_PER_INCH, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    shared = {"sharex": True} if share == "x" else {"sharey": share}
    axes = figure.subplots(rows, columns, squeeze=False, height_ratios=heights, **shared)
    yield axes
    with whole_file(path) as part:
        figure.savefig(part, dpi=DOTS_PER_INCH, format="png")


def dress(axes: "Axes", up: str, across: str = "", title: str = "") -> None:
    """Set labels, title (in lines as long as the axes), grid and frame."""
    axes.set_ylabel(up, fontsize=9, color=INK)
    if across:
        axes.set_xlabel(across, fontsize=9, color=INK)
    if title:
        columns = axes.get_subplotspec().get_gridspec().ncols
        letters = int(axes.figure.get_figwidth() * POINTS_PER_INCH / (LETTER * TITLE * columns))
        axes.set_title(textwrap.fill(title, letters), loc="left", fontsize=TITLE, fontweight="bold")
    axes.grid(True, linewidth=0.35, color="#dddddd")
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    for spine in axes.spines.values():
        spine.set(color=INK, linewidth=0.7)


def draw_ground(axes: "Axes", along: np.ndarray, elevation: np.ndarray) -> None:
    """Draw the terrain along a line, filled below."""
    known = np.asarray(elevation)[np.isfinite(elevation)]
    if known.size:
        margin = 0.04 * max(float(known.max() - known.min()), 1.0)
        axes.fill_between(along, elevation, known.min() - margin, color=GROUND, linewidth=0, zorder=1)
        axes.plot(along, elevation, color=GROUND_LINE, linewidth=1.0, zorder=3, label="terrain")


def legend(axes: "Axes", **place) -> None:
    """Draw a legend without a frame, if there are entries."""
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(fontsize=8, frameon=False, **place)


def write_history_plot(path: Path, history: BarrierHistory) -> None:
    """Plot mean force, mean moment (3D only) and overtopped mass of a barrier over time."""
    moment, times = history.moment, history.times
    rows = 2 if moment is None else 3
    with plot_file(path, (9.0, 2.4 * rows), rows=rows) as axes:
        panels = list(axes[:, 0])
        _means(panels[0], times, history.columns[FORCE] / 1e3, "force [kN]", COLOURS[0])
        dress(panels[0], "force [kN]", title=f"{history.name}: means between frames")
        if moment is not None:
            _means(panels[1], times, moment / 1e3, "moment [kN m]", COLOURS[2])
        panels[-1].plot(times, history.columns[OVERTOPPED] / 1e3, color=COLOURS[3], linewidth=1.5)
        panels[-1].set_ylim(bottom=0)
        dress(panels[-1], "overtopped mass [t]", "time [s]")


def _means(axes, times, values, label, colour):
    if len(times) > 1:
        axes.stairs(values[1:], times, color=colour, linewidth=1.5, fill=True, alpha=0.25)
        axes.stairs(values[1:], times, color=colour, linewidth=1.5)
    axes.set_ylim(bottom=0)
    dress(axes, label)


def write_section_plot(
    path: Path, name: str, along: np.ndarray, terrain: np.ndarray, surfaces: dict, wall: np.ndarray, crest: float
) -> None:
    """Plot a section through a barrier.

    Parameters
    ----------
    path : Path
    name : str
        Of the barrier.
    along, terrain : float64[n] [m]
        Distance along the section, in the direction of the force, 0 at the barrier; elevation.
    surfaces : dict of str to float64[n] [m]
        Words -> elevation of a free surface; NaN without flow.
    wall : bool[n]
        Where the barrier stands.
    crest : float [m]
        Elevation.
    """
    with plot_file(path, (9.0, 4.2)) as axes:
        (panel,) = axes[0]
        draw_ground(panel, along, terrain)
        for k, (words, surface) in enumerate(surfaces.items()):
            panel.plot(along, surface, color=COLOURS[(0, 4)[k % 2]], linewidth=1.6, label=words, zorder=4)
            panel.fill_between(along, terrain, surface, color=COLOURS[(0, 4)[k % 2]], alpha=0.18, linewidth=0, zorder=2)
        top = np.maximum(terrain, crest)
        panel.fill_between(along, terrain, top, where=wall, color="#444444", linewidth=0.5, zorder=5, label="barrier")
        panel.axhline(crest, color=GROUND_LINE, linewidth=0.8, linestyle=":", zorder=3, label="crest")
        shown = np.concatenate([terrain, [crest], *surfaces.values()])
        low, high = np.nanmin(shown), np.nanmax(shown)
        panel.set_ylim(low - 0.05 * (high - low), high + 0.12 * (high - low))
        panel.set_xlim(along[0], along[-1])
        title = f"{name}: section in the direction of the force (heights not to scale)"
        dress(panel, "elevation [m]", "distance from the barrier [m]", title)
        legend(panel, loc="upper right")


def write_hydrograph_table(path: Path, found: HydrographFound) -> None:
    """Write the rows of a HydrographFound as CSV."""
    write_records(path, [column_name(*column) for column in COLUMNS], found.rows())


def write_hydrograph_plot(path: Path, found: HydrographFound) -> None:
    """Plot mean discharge between frames, flux of the cells at frames, and cumulative volume."""
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
        dress(rate, "discharge [m³/s]", title=title)
        legend(rate, loc="best")
        total.plot(
            found.times, np.r_[0.0, np.cumsum(found.volume)], color=COLOURS[0], linewidth=1.5, label=f"by {word}"
        )
        total.plot(
            found.times, found.cells_totals()[:, 0], "--", color=COLOURS[1], linewidth=1.2, label="flux of the cells"
        )
        dress(total, "cumulative volume [m³]", "time [s]")
        legend(total, loc="best")


MOST_CURVES = 24  # points in the plot; the table has all
LATE = 0.85  # used part of the colour ramp; its end is too pale for lines


def write_rows(path: Path, found: ProfileFound | SeriesFound) -> None:
    """Write the rows of a ProfileFound or SeriesFound as CSV."""
    write_records(path, [column_name(*column) for column in found.columns()], found.rows())


def write_profile_plot(path: Path, found: ProfileFound) -> None:
    """Plot terrain and free surface, depth and thickness, velocities; one colour per time."""
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
        dress(ground, "elevation [m]", title=f"{found.name}: profile")
        legend(ground, loc="best")
        dress(depths, "h (solid), t (dashed), normal [m]")
        dress(speeds, "Ut (solid), Un (dashed) [m/s]", "distance along the line [m]")
        speeds.axhline(0, color="#999999", linewidth=0.6)
        speeds.set_xlim(found.along[0], found.along[-1])


def _draw_pair(axes, found, k, names, colour):
    for name, style in zip(names, ("-", "--"), strict=True):
        shown = np.where(found.values["h"][k] > 0, found.values[name][k], np.nan)
        axes.plot(found.along, shown, style, color=colour, linewidth=1.3)


def write_series_plot(path: Path, found: SeriesFound) -> None:
    """Plot one panel per product and one curve per point, for the first MOST_CURVES points."""
    names = found.names[:MOST_CURVES]
    of_all = f", {MOST_CURVES} of {len(found.names)} points" * (len(found.names) > MOST_CURVES)
    with plot_file(path, (9.0, 2.1 * len(found.values) + 0.5), rows=len(found.values)) as axes:
        for row, (name, values) in enumerate(found.values.items()):
            look = LOOKS[name]
            for point, label in enumerate(names):
                colour = COLOURS[point % len(COLOURS)]
                axes[row, 0].plot(found.times, values[:, point] * look.factor, color=colour, linewidth=1.3, label=label)
            if not np.isfinite(values[:, : len(names)]).any() or not np.nan_to_num(found.values["h"]).any():
                axes[row, 0].text(0.5, 0.5, "no flow here", transform=axes[row, 0].transAxes, ha="center", va="center")
            unit = look.unit.partition(";")[0]
            last = row == len(found.values) - 1
            title = f"{found.name}: series{of_all}" if row == 0 else ""
            dress(axes[row, 0], f"{name} [{unit}]", "time [s]" if last else "", title)
        legend(axes[0, 0], loc="best", ncols=2)


MOST_ROWS = 10  # points in the plot; the tables have all
# attribute of a VerticalProfile, label, factor, whether the axis starts at zero
PANELS = (
    ("density", "density [kg/m³]", 1.0, True),
    ("parallel", "Ut [m/s]", 1.0, False),
    ("normal", "Un [m/s]", 1.0, False),
    ("pressure", "p = density × speed² [kPa]", 1e-3, True),
)


def write_profiles(path: Path, found: VerticalFound) -> None:
    """Write the layers of a VerticalFound as CSV."""
    write_records(path, [column_name(*column) for column in PROFILE_COLUMNS], found.rows())


def write_loads(path: Path, found: VerticalFound) -> None:
    """Write the loads of a VerticalFound as CSV."""
    write_records(path, [column_name(*column) for column in LOAD_COLUMNS], found.load_rows())


def write_vertical_plot(path: Path, found: VerticalFound) -> None:
    """Plot density, velocities and pressure over height: one row per point (first MOST_ROWS), one colour per time."""
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
                dress(axes[k, panel], height, label if k == rows - 1 else "", title)
                axes[k, panel].axhline(0.0, color=GROUND_LINE, linewidth=1.2)
                if from_zero:
                    axes[k, panel].set_xlim(left=0)
            legend(axes[k, 0], loc="best")


def _draw(axes, profile, colour):
    for panel, (key, _, factor, from_zero) in enumerate(PANELS):
        axes[panel].stairs(
            getattr(profile, key) * factor, profile.edges, orientation="horizontal", color=colour, linewidth=1.4,
            baseline=0 if from_zero else None, label=f"{profile.time:.4g} s" if panel == 0 else None,
        )  # fmt: skip


FLOW_COLOUR, DEPOSIT_COLOUR, LINE_COLOUR, MASS_COLOUR = COLOURS[4], COLOURS[1], COLOURS[2], COLOURS[0]


def write_figures(path: Path, found: RunoutFound) -> None:
    """Write the results of a RunoutFound as CSV."""
    write_records(path, ("quantity", "unit", "value"), found.rows())


def write_over_time(path: Path, found: RunoutFound) -> None:
    """Write the position of the mass as CSV, one row per frame."""
    write_records(path, [column_name(*column) for column in TIME_COLUMNS], found.time_rows())


def write_profile(path: Path, found: RunoutFound) -> None:
    """Write the profile along the line as CSV, one row per point."""
    write_records(path, [column_name(*column) for column in ENERGY_LINE_COLUMNS], zip(*found.profile, strict=True))


def write_runout_plot(path: Path, found: RunoutFound) -> None:
    """Plot the longitudinal profile: terrain, flow and deposit, energy line, path of the centre of mass."""
    along, _, _, _, elevation, _, depth, deposit = found.profile
    with plot_file(path, (9.0, 6.0), rows=2, heights=(3, 1)) as axes:
        upper, lower = axes[:, 0]
        draw_ground(upper, along, elevation)
        _draw_energy_line(upper, found)
        _draw_centre(upper, found)
        dress(
            upper,
            "elevation [m]",
            title=f"{found.name}: runout {found.flow.length:.0f} m, drop {found.flow.drop:.0f} m",
        )
        legend(upper, loc="upper right")
        _draw_depth(lower, along, depth, FLOW_COLOUR, "largest h, normal")
        _draw_depth(lower, along, deposit, DEPOSIT_COLOUR, "h of the last frame, normal")
        dress(lower, "h [m]", f"distance along the {_source(found)} [m]")
        highest = float(np.nan_to_num(depth).max(initial=1e-3))
        lower.set(xlim=(along[0], along[-1]), ylim=(0, 1.35 * highest))
        legend(lower, loc="upper right", ncols=2)


def _draw_depth(axes, along, depth, colour, label):
    if np.isfinite(depth).any():
        shown = np.nan_to_num(depth)
        axes.fill_between(along, 0, shown, step="mid", color=colour, alpha=0.55, linewidth=0, label=label)


def _source(found):
    return found.line_source if found.line_source.startswith("centre") else "line"


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
