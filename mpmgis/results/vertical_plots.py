"""Write plots and tables of vertical profiles."""

from pathlib import Path

from ..maps.qgis.colours import BATLOW, ramp_colours
from ..system.csv_rows import column_name, write_records
from .plot_style import GROUND_LINE, legend, plot_file, style_axes
from .profiles import LOAD_COLUMNS, PROFILE_COLUMNS, VerticalFound

MOST_ROWS = 10  # points in the plot; the tables have all
# attribute of a VerticalProfile, label, factor, whether the axis starts at zero
PANELS = (
    ("density", "density [kg/m³]", 1.0, True),
    ("parallel", "Ut [m/s]", 1.0, False),
    ("normal", "Un [m/s]", 1.0, False),
    ("pressure", "p = density × speed² [kPa]", 1e-3, True),
)


def write_profiles(path: Path, found: VerticalFound) -> None:
    """Write the layers of a VerticalFound as CSV.

    Parameters
    ----------
    path : Path
    found : VerticalFound
    """
    write_records(path, [column_name(*column) for column in PROFILE_COLUMNS], found.rows())


def write_loads(path: Path, found: VerticalFound) -> None:
    """Write the loads of a VerticalFound as CSV.

    Parameters
    ----------
    path : Path
    found : VerticalFound
    """
    write_records(path, [column_name(*column) for column in LOAD_COLUMNS], found.load_rows())


def write_vertical_plot(path: Path, found: VerticalFound) -> None:
    """Plot density, velocities and pressure over height.

    There is one row of panels per point (the first MOST_ROWS), and one colour per time.

    Parameters
    ----------
    path : Path
    found : VerticalFound
    """
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
                style_axes(axes[k, panel], height, label if k == rows - 1 else "", title)
                axes[k, panel].axhline(0.0, color=GROUND_LINE, linewidth=1.2)
                if from_zero:
                    axes[k, panel].set_xlim(left=0)
            legend(axes[k, 0], loc="best")


def _draw(axes, profile, colour):
    for panel, (key, _, factor, from_zero) in enumerate(PANELS):
        axes[panel].stairs(
            getattr(profile, key) * factor,
            profile.edges,
            orientation="horizontal",
            color=colour,
            linewidth=1.4,
            baseline=0 if from_zero else None,
            label=f"{profile.time:.4g} s" if panel == 0 else None,
        )
