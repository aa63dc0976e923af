"""Plot a calibration: histograms and pairs of the parameters, with prior, intervals and best run."""

from pathlib import Path

import numpy as np

from ..results.plot_style import COLOURS, plot_file, style_axes
from .calibration_result import Calibration

PANEL = 2.6  # [inch] side of a plot
BINS = 30  # of a histogram
PRIOR, POSTERIOR, BEST, RUNS = "#777777", COLOURS[0], COLOURS[2], COLOURS[1]


def write_pairs(path: Path, result: Calibration, draws: np.ndarray) -> None:
    """Write the PNG (atomically).

    Parameters
    ----------
    path : Path
    result : Calibration
    draws : float64[m, d]
        Of the posterior.
    """
    keys = [*result.priors]
    count = len(keys)
    size = (PANEL * count + 1.2, PANEL * count + 0.6) if count > 1 else (5.5, 3.6)
    with plot_file(path, size, rows=count, columns=count, share="none") as axes:
        for i, key in enumerate(keys):
            for j in range(count):
                if j > i:
                    axes[i, j].axis("off")
                elif i == j:
                    _draw_marginal(axes[i, i], result, draws, i)
                else:
                    _draw_pair(axes[i, j], result, draws, j, i)
                    axes[i, j].set_ylim(_limits(result, i))
                axes[i, j].set_xlim(_limits(result, j))
                axes[i, j].tick_params(labelsize=7)
            axes[-1, i].set_xlabel(key, fontsize=9)
        _draw_legend(axes, count)


def _limits(result, k):
    """Return the range of the axis of key `k`: nearly all of the prior, and all runs."""
    prior = [*result.priors.values()][k]
    ends = [prior.at(0.001), prior.at(0.999), *result.values[:, k]]
    low, high = min(ends), max(ends)
    return low - 0.02 * (high - low), high + 0.02 * (high - low)


def _draw_marginal(axes, result, draws, k):
    key, prior = [*result.priors.items()][k]
    low, high = _limits(result, k)
    bins = np.linspace(low, high, BINS + 1)
    density = np.diff([prior.share_of(edge) for edge in bins]) / np.diff(bins)
    axes.stairs(density, bins, color=PRIOR, label="prior")
    axes.hist(draws[:, k], bins, density=True, color=POSTERIOR, alpha=0.75, label="posterior")
    figures = result.parameters()[key]
    middle, (lower, upper) = figures["median"], figures["interval_90"]
    for value, label in ((lower, "90 % interval"), (upper, None)):
        axes.axvline(value, color=POSTERIOR, linestyle="--", linewidth=1.0, label=label)
    axes.axvline(result.values[result.best, k], color=BEST, linewidth=1.5, label="best run")
    style_axes(axes, "density" if k == 0 else "")
    axes.set_title(f"{middle:g} ({lower:g} to {upper:g})", fontsize=9)
    axes.set_yticks([])


def _draw_pair(axes, result, draws, across, up):
    axes.plot(draws[:, across], draws[:, up], ".", color=POSTERIOR, markersize=2.5, alpha=0.35)
    axes.plot(result.values[:, across], result.values[:, up], ".", color=RUNS, markersize=3.5, label="runs")
    best = result.values[result.best]
    axes.plot(best[across], best[up], "*", color=BEST, markersize=11, markeredgecolor="white", label="best run")
    style_axes(axes, [*result.priors][up] if across == 0 else "")


def _draw_legend(axes, count):
    """Draw one legend: beside the marginal of a single key, in the empty corner of several."""
    handles, labels = axes[0, 0].get_legend_handles_labels()
    if count > 1:
        more = axes[1, 0].get_legend_handles_labels()
        handles, labels = handles + more[0][:1], labels + more[1][:1]
    place = axes[0, 0] if count == 1 else axes[0, -1]
    place.legend(handles, labels, fontsize=8, frameon=False, loc="best" if count == 1 else "upper right")
