"""Draw figures in one style: all figures of answers except maps."""

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..maps.export.run_picture import INK, LETTER, POINTS_PER_INCH
from ..system.whole_files import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DOTS_PER_INCH = 110  # small files that are sharp on a screen
TITLE = 11  # [points] of letters
COLOURS = ("#144d62", "#d29343", "#94384d", "#3c6d56", "#5fa2c4", "#818232", "#8e44ad", "#111111")  # of curves
GROUND = "#d8cfc2"  # below the terrain
GROUND_LINE = "#5a4632"  # of the terrain


@contextmanager
def plot_file(
    path: Path, size: tuple, rows: int = 1, heights: tuple | None = None, columns: int = 1, share: str = "x"
) -> Iterator[np.ndarray]:
    """Yield the axes of a figure, which is written as PNG (atomically) on exit.

    Parameters
    ----------
    path : Path
    size : (float, float) [inch]
    rows, columns : int
        Number of axes.
    heights : tuple of float, optional
        Relative heights of the rows.
    share : str
        "x": common horizontal axis; "row": common vertical axis in each row.

    Yields
    ------
    ndarray of Axes
        [rows, columns].
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


def style_axes(axes: "Axes", up: str, across: str = "", title: str = "") -> None:
    """Set labels, title (in lines as long as the axes), grid and frame.

    Parameters
    ----------
    axes : Axes
    up, across : str
        Labels of the vertical and of the horizontal axis.
    title : str
    """
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
    """Draw the terrain along a line, filled below.

    Parameters
    ----------
    axes : Axes
    along, elevation : float64[n] [m]
    """
    known = np.asarray(elevation)[np.isfinite(elevation)]
    if known.size:
        margin = 0.04 * max(float(known.max() - known.min()), 1.0)
        axes.fill_between(along, elevation, known.min() - margin, color=GROUND, linewidth=0, zorder=1)
        axes.plot(along, elevation, color=GROUND_LINE, linewidth=1.0, zorder=3, label="terrain")


def legend(axes: "Axes", **place: Any) -> None:
    """Draw a legend without a frame, if there are entries.

    Parameters
    ----------
    axes : Axes
    **place : keyword arguments of Axes.legend
    """
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(fontsize=8, frameon=False, **place)
