"""Plot a study: error over wall time with the Pareto front, and error over cell size."""

from pathlib import Path

import numpy as np

from ..system.whole_files import whole_file
from .run_measures import UNITS
from .study_table import Study

DOTS_PER_INCH = 120
PARAMETER_COLOURS = {
    "scene": "#111111",
    "cell_size": "#1b6ca8",
    "particles_per_cell": "#d17a00",
    "points_per_cell": "#d17a00",
    "cfl": "#2e8b57",
    "precision": "#8e44ad",
    "stiffness": "#b03a48",
    "several": "#8a8a8a",
}
STAGE_COLOURS = ("#4aa3df", "#17becf", "#9edae5")  # cell size of one stage
OTHERS = (("s", "#7a1f5c"), ("D", "#0f6b5f"), ("^", "#8a5a00"), ("v", "#37477d"))  # marker and colour of other codes
FADED = 0.35  # [1] opacity of settings that are not on the front


def write_plot(path: Path, study: Study, title: str = "") -> None:
    """Write the plot of a study as PNG.

    Parameters
    ----------
    path : Path
    study : Study
    title : str
    """
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
        parameter, outcome = row.outcome.setting.parameter, row.outcome
        spread = [[study.seconds[k] - min(outcome.seconds)], [max(outcome.seconds) - study.seconds[k]]]
        is_scene = parameter == "scene"
        axes.errorbar(
            study.seconds[k],
            study.errors[k],
            xerr=spread,
            color=_colour(parameter),
            alpha=1.0 if study.front[k] else FADED,
            marker="*" if is_scene else "o",
            markersize=13 if is_scene else 6,
            linestyle="none",
            label=None if parameter in named else _words(parameter),
            zorder=3,
        )
        named.add(parameter)
    _plot_others(axes, study)
    order = np.flatnonzero(study.front)[np.argsort(study.seconds[study.front])]
    axes.plot(study.seconds[order], study.errors[order], color="#555555", linewidth=1.0, zorder=1, label="Pareto front")
    if study.reference_error is None:
        axes.plot([], [], linestyle="none", label="error of the reference: unknown")
    elif study.reference_error > 0.0:
        axes.axhline(study.reference_error, color="#bbbbbb", linestyle=":", label="error of the reference")
    _finish(axes, "wall time of the time integration [s]", _error_label(study))
    axes.margins(x=0.1, y=0.1)
    axes.legend(fontsize=8, frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.13))


def _colour(parameter):
    if parameter in PARAMETER_COLOURS:
        return PARAMETER_COLOURS[parameter]
    return STAGE_COLOURS[int(parameter.removeprefix("stage").partition(".")[0]) % len(STAGE_COLOURS)]


def _plot_others(axes, study):
    """Draw results of other codes: hollow markers, one kind per code, labelled with their settings."""
    codes = list(dict.fromkeys(other.code for other in study.beside))
    for k, (other, error) in enumerate(zip(study.beside, study.errors_of_others(), strict=True)):
        marker, colour = OTHERS[codes.index(other.code) % len(OTHERS)]
        typical, least, most = other.seconds
        first = other.code not in [earlier.code for earlier in study.beside[:k]]
        axes.errorbar(
            typical,
            error,
            xerr=[[typical - least], [most - typical]],
            color=colour,
            marker=marker,
            markersize=7,
            markerfacecolor="white",
            linestyle="none",
            label=other.code if first else None,
            zorder=4,
        )
        axes.annotate(
            other.setting,
            (typical, error),
            xytext=(0, 6),
            textcoords="offset points",
            fontsize=6,
            color=colour,
            ha="center",
        )


def _words(parameter):
    return {"scene": "unchanged scene", "several": "several at once"}.get(parameter, parameter)


def _plot_order(axes, study):
    chosen = [(size, study.errors[k]) for k, size in study.by_cell_size()]
    sizes, errors = np.array(sorted(chosen)).T
    axes.plot(sizes, errors, marker="o", color=PARAMETER_COLOURS["cell_size"], linestyle="none")
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
    for axis in (axes.xaxis, axes.yaxis):  # labels at 1, 2 and 5 of each decade
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="both", linewidth=0.3, color="#dddddd")


def _error_label(study):
    unit = UNITS[study.measure]
    return f"error of {study.measure} [{unit}]"
