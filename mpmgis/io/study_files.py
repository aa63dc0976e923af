"""A study's work-precision plot as PNG."""

import numpy as np

from ..studies.errors import UNITS
from .atomic import whole_file

DOTS_PER_INCH = 120
COLOURS = {
    "scene": "#111111", "cell_size": "#1b6ca8", "particles_per_cell": "#d17a00", "points_per_cell": "#d17a00",
    "cfl": "#2e8b57", "precision": "#8e44ad", "stiffness": "#b03a48", "several": "#8a8a8a",
}  # fmt: skip
FADED = 0.35  # opacity of what others beat


def write_plot(path, study, title=""):
    """Plot error over wall time, the front and what it beats, and beside it the error over the cell size."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = 3 if study.exports else 2
    figure = Figure(figsize=(5.2 * panels, 4.6), dpi=DOTS_PER_INCH, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, panels)
    _plot_work(axes[0], study)
    _plot_order(axes[1], study)
    if study.exports:
        _plot_exports(axes[2], study.exports)
    if title:
        figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left")
    with whole_file(path) as part:
        figure.savefig(part, dpi=DOTS_PER_INCH, format="png")


def _plot_work(axes, study):
    named = set()
    for k, row in enumerate(study.rows):
        knob, outcome = row.outcome.setting.knob, row.outcome
        spread = [[study.seconds[k] - min(outcome.seconds)], [max(outcome.seconds) - study.seconds[k]]]
        axes.errorbar(
            study.seconds[k], study.errors[k], xerr=spread, color=COLOURS[knob], alpha=1.0 if study.front[k] else FADED,
            marker="*" if knob == "scene" else "o", markersize=13 if knob == "scene" else 6, linestyle="none",
            label=None if knob in named else _words(knob), zorder=3,
        )  # fmt: skip
        named.add(knob)
    order = np.flatnonzero(study.front)[np.argsort(study.seconds[study.front])]
    axes.plot(study.seconds[order], study.errors[order], color="#555555", linewidth=1.0, zorder=1, label="front")
    if study.reference_error > 0.0:
        axes.axhline(study.reference_error, color="#bbbbbb", linestyle=":", label="the reference's own")
    _finish(axes, "wall time of the steps [s]", _error_label(study))
    axes.legend(fontsize=8, frameon=False)


def _words(knob):
    return {"scene": "the scene as it is", "several": "several at once"}.get(knob, knob)


def _plot_order(axes, study):
    chosen = [(size, study.errors[k]) for k, size in study.by_cell_size()]
    sizes, errors = np.array(sorted(chosen)).T
    axes.plot(sizes, errors, marker="o", color=COLOURS["cell_size"], linestyle="none")
    if study.law is not None:
        line = np.geomspace(sizes.min() / 1.3, sizes.max() * 1.3, 50)
        axes.plot(line, study.law.error(line), color="#555555", linewidth=1.0, label=f"order {study.law.order:.2f}")
        axes.legend(fontsize=8, frameon=False)
    _finish(axes, "cell size [m]", _error_label(study))


def _plot_exports(axes, exports):
    for cs_e in sorted({export.cs_e for export in exports}):
        mine = [export for export in exports if export.cs_e == cs_e and export.h_max > 0.0]
        if mine:
            axes.plot([e.seconds for e in mine], [e.h_max for e in mine], marker="o", label=f"--cs-e {cs_e:g}")
    _finish(axes, "time to average the frames [s]", "difference of h_max from the finest export [1]")
    axes.legend(fontsize=8, frameon=False)


def _finish(axes, across, up):
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set(xscale="log", yscale="log", xlabel=across, ylabel=up)
    for axis in (axes.xaxis, axes.yaxis):  # 1, 2 and 5 of each decade are told, as plain numbers
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="both", linewidth=0.3, color="#dddddd")


def _error_label(study):
    unit = UNITS[study.measure]
    return f"error of {study.measure} [{unit}]"
