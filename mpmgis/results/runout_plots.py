"""Write tables and the plot of a runout."""

from pathlib import Path

import numpy as np

from ..system.csv_rows import column_name, write_records
from .plot_style import COLOURS, draw_ground, legend, plot_file, style_axes
from .runout_measures import ENERGY_LINE_COLUMNS, TIME_COLUMNS, RunoutFound

FLOW_COLOUR, DEPOSIT_COLOUR, LINE_COLOUR, MASS_COLOUR = COLOURS[4], COLOURS[1], COLOURS[2], COLOURS[0]


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
    write_records(path, [column_name(*column) for column in TIME_COLUMNS], found.time_rows())


def write_profile(path: Path, found: RunoutFound) -> None:
    """Write the profile along the line as CSV, one row per point.

    Parameters
    ----------
    path : Path
    found : RunoutFound
    """
    write_records(path, [column_name(*column) for column in ENERGY_LINE_COLUMNS], zip(*found.profile, strict=True))


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
