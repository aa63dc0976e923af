"""Work-precision plot of a study as PNG, and tables with results of other codes for the plot.

Plot of a calibration: histograms and pairs of the parameters, with prior, intervals and best run.
"""

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..system.errors import FormatError
from ..system.whole_files import whole_file
from .run_measures import NAMES, UNITS, Errors
from .study_table import BESIDE, ERROR_COLUMNS, Study

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
FADED = 0.35  # opacity of settings that are not on the front
_LARGEST = 10_000_000  # [bytes] of a table of results


class OtherRow(NamedTuple):
    """A row of a table of other codes: seconds (typical, min, max); `thickness`: path of a raster, or None."""

    code: str
    setting: str
    seconds: tuple
    errors: Errors
    thickness: Path | None


def read_other_results(path: str | Path, measure: str) -> list[OtherRow]:
    """The OtherRows of the CSV at `path`, with `measure` from a column error_..., or from a raster of thickness.

    Columns: setting and seconds; error_thickness, error_momentum, error_area, error_reach_m, or thickness (path,
    relative to the table, of a raster of the vertical thickness at the end [m]); optional code, seconds_min and
    seconds_max. Other columns are ignored, so the table of another study is valid.

    Raises
    ------
    FormatError
        With the invalid row.
    """
    path = Path(path)
    rows, column = _table(path), ERROR_COLUMNS[measure]
    names = set(rows[0]) if rows else set()
    for wanted in ("setting", "seconds"):
        if wanted not in names:
            raise FormatError(f"{path} has no column {wanted!r}, expected setting, seconds, and {column} or thickness")
    if column not in names and not (measure == "thickness" and "thickness" in names):
        also = ", or thickness with rasters" if measure == "thickness" else ""
        raise FormatError(f"{path} has no column {column!r}; add it{also}")
    return [_other_row(path, k, row, measure) for k, row in enumerate(rows, 2) if row.get("knob") != BESIDE]


def _table(path):
    try:
        if path.stat().st_size > _LARGEST:
            raise FormatError(f"{path} has {path.stat().st_size / 1e6:.0f} MB, expected a table of results below 10 MB")
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file, expected a CSV with the columns setting and seconds") from error
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path} is not readable text, expected a CSV; save it as CSV UTF-8") from error
    if not rows:
        raise FormatError(f"{path} has no rows, expected a header and one row per result")
    return [{(name or "").strip(): (cell or "").strip() for name, cell in row.items() if name} for row in rows]


def _other_row(path, line, row, measure):
    where = f"{path} line {line}"
    if not row["setting"]:
        raise FormatError(f"{where}: setting is empty, expected a name of this result")
    raster = path.parent / row["thickness"] if row.get("thickness") else None
    errors = Errors(*(_number(row, ERROR_COLUMNS[name], where, least=0.0) for name in NAMES))
    if raster is None and math.isnan(getattr(errors, measure)):
        raise FormatError(f"{where}: {ERROR_COLUMNS[measure]} is empty, expected a number")
    seconds = [_number(row, name, where, above=0.0) for name in ("seconds", "seconds_min", "seconds_max")]
    if math.isnan(seconds[0]):
        raise FormatError(f"{where}: seconds is empty, expected the wall time of the time integration")
    seconds = (seconds[0], *(seconds[0] if math.isnan(value) else value for value in seconds[1:]))
    if not seconds[1] <= seconds[0] <= seconds[2]:
        raise FormatError(f"{where}: seconds = {seconds[0]:g} is not between seconds_min and seconds_max")
    return OtherRow(row.get("code") or path.stem, row["setting"], seconds, errors, raster)


def _number(row, name, where, least=-math.inf, above=-math.inf):
    """The number in a column, or NaN."""
    text = row.get(name, "")
    if not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= least and value > above):
        expected = f"above {above:g}" if math.isfinite(above) else f"of at least {least:g}"
        raise FormatError(f"{where}: {name} = {text[:40]!r}, expected a number {expected}")
    return value


def write_plot(path: Path, study: Study, title: str = "") -> None:
    """Plot error over wall time with the Pareto front, and error over cell size."""
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
    if study.reference_error > 0.0:
        axes.axhline(study.reference_error, color="#bbbbbb", linestyle=":", label="error of the reference")
    _finish(axes, "wall time of the time integration [s]", _error_label(study))
    axes.margins(x=0.1, y=0.1)
    axes.legend(fontsize=8, frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.13))


def _colour(parameter):
    if parameter in PARAMETER_COLOURS:
        return PARAMETER_COLOURS[parameter]
    return STAGE_COLOURS[int(parameter.removeprefix("stage").partition(".")[0]) % len(STAGE_COLOURS)]


def _plot_others(axes, study):
    """Results of other codes: hollow markers, one kind per code, labelled with their settings."""
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
