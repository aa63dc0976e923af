"""Plots in the house's style: one look for every figure that is not a map."""

from contextlib import contextmanager

from ..io.atomic import whole_file
from .picture import INK

DOTS_PER_INCH = 110
COLOURS = ("#144d62", "#d29343", "#94384d", "#3c6d56", "#5fa2c4", "#818232", "#8e44ad", "#111111")  # one a curve
GROUND, GROUND_LINE = "#d8cfc2", "#5a4632"


@contextmanager
def plot_file(path, size, rows=1, heights=None, columns=1, share="x"):
    """Gives the axes [rows, columns] of a figure of `size` [inch]; a PNG when all is drawn, whole or not at all.

    `share` "x": all axes share what is across; "row": those of a row share what is up.
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


def dress(axes, up, across="", title=""):
    """Labels, a light grid and thin lines around."""
    axes.set_ylabel(up, fontsize=9, color=INK)
    if across:
        axes.set_xlabel(across, fontsize=9, color=INK)
    if title:
        axes.set_title(title, loc="left", fontsize=11, fontweight="bold")
    axes.grid(True, linewidth=0.35, color="#dddddd")
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    for spine in axes.spines.values():
        spine.set(color=INK, linewidth=0.7)


def draw_ground(axes, along, elevation):
    """The terrain along a line, filled down to the bottom of the axes."""
    import numpy as np

    known = np.asarray(elevation)[np.isfinite(elevation)]
    if known.size:
        room = 0.04 * max(float(known.max() - known.min()), 1.0)
        axes.fill_between(along, elevation, known.min() - room, color=GROUND, linewidth=0, zorder=1)
        axes.plot(along, elevation, color=GROUND_LINE, linewidth=1.0, zorder=3, label="terrain")


def legend(axes, **place):
    """A legend without a frame, where there is something to tell."""
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(fontsize=8, frameon=False, **place)
