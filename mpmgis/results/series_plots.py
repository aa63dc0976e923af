"""Write plots and tables of hydrographs, profiles and time series."""

from pathlib import Path

import numpy as np

from ..maps.qgis.colours import BATLOW, LOOKS, ramp_colours
from ..system.csv_rows import column_name, write_records
from .plot_style import COLOURS, draw_ground, legend, plot_file, style_axes
from .profiles import ProfileFound, SeriesFound
from .section_flux import COLUMNS, HydrographFound

MOST_CURVES = 24  # points in the plot; the table has all
LATE = 0.85  # [1] used part of the colour ramp; its end is too pale for lines


def write_hydrograph_table(path: Path, found: HydrographFound) -> None:
    """Write the rows of a HydrographFound as CSV.

    Parameters
    ----------
    path : Path
    found : HydrographFound
    """
    write_records(path, [column_name(*column) for column in COLUMNS], found.rows())


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


def write_rows(path: Path, found: ProfileFound | SeriesFound) -> None:
    """Write the rows of a ProfileFound or SeriesFound as CSV.

    Parameters
    ----------
    path : Path
    found : ProfileFound or SeriesFound
    """
    write_records(path, [column_name(*column) for column in found.columns()], found.rows())


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


def write_series_plot(path: Path, found: SeriesFound) -> None:
    """Plot one panel per product and one curve per point, for the first MOST_CURVES points.

    Parameters
    ----------
    path : Path
    found : SeriesFound
    """
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
            style_axes(axes[row, 0], f"{name} [{unit}]", "time [s]" if last else "", title)
        legend(axes[0, 0], loc="best", ncols=2)
