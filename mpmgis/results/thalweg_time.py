"""Thalweg-time diagram: the largest depth and speed across a path, over its length and over time.

The diagram is that of Fischer (2013) in the coordinates of `path_coordinates`; its front is the first arrival.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..laws.quantities import BAND
from ..maps.qgis.colours import BATLOW_REVERSED, LAJOLLA, ramp_colours
from ..system.csv_rows import write_columns
from ..system.messages import Progress, unwatched
from .opened_results import ExportFlow, FrameFlow
from .path_coordinates import PathBins
from .plot_style import legend, plot_file, style_axes

PRODUCTS = ("h", "Ut")
TITLES = {"h": "largest depth h across the path, normal [m]", "Ut": "largest speed Ut across the path [m/s]"}
RAMPS = {"h": LAJOLLA, "Ut": BATLOW_REVERSED}  # dark where large
VALUES_AT_ONCE = 10_000_000  # cells of steps that are read together, to limit memory
SHADES = 64  # of a colour ramp
FRONT = "#111111"  # colour of the first arrival


@dataclass(frozen=True)
class ThalwegTime:
    """Largest values across a path over time.

    Parameters
    ----------
    name : str
    bins : PathBins
    times : float64[steps] [s]
    values : dict of str to float64[steps, bins.count]
        Depth h [m] and, where the result has it, speed Ut [m s-1]; NaN in parts of the path without flow.
    depth : float [m]
        From which a part counts as reached.
    """

    name: str
    bins: PathBins
    times: np.ndarray
    values: dict[str, np.ndarray]
    depth: float

    def arrival(self) -> np.ndarray:
        """Return the first time at which each part is reached.

        Returns
        -------
        float64[bins.count] [s]
            NaN for parts that are not reached.
        """
        deep = np.nan_to_num(self.values["h"]) >= self.depth
        return np.where(deep.any(axis=0), self.times[np.argmax(deep, axis=0)], np.nan)


def thalweg_time(
    flow: FrameFlow | ExportFlow,
    cells: np.ndarray,
    along: np.ndarray,
    bins: PathBins,
    depth: float,
    progress: Progress = unwatched,
) -> ThalwegTime:
    """Return the largest depth and speed across a path at each step of a flow.

    Parameters
    ----------
    flow : FrameFlow or ExportFlow
    cells : int64[k]
        Flat numbers of the cells of its grid that the flow reached.
    along : float64[k] [m]
        Their positions along the path.
    bins : PathBins
    depth : float [m]
        From which a part counts as reached.
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    ThalwegTime
    """
    names = [name for name in PRODUCTS if isinstance(flow, FrameFlow) or name in flow.steps.bands]
    part, steps = bins.of(along), range(len(flow.times))
    at_once = max(1, VALUES_AT_ONCE // max(len(cells), 1))
    rows: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for first in steps[::at_once]:
        found = flow.at_cells(cells, names, steps[first : first + at_once])
        for name in names:
            rows[name] += [bins.largest(part, values) for values in found[name]]
        progress(min(first + at_once, len(steps)), len(steps))
    values = {name: np.array(own) for name, own in rows.items()}
    return ThalwegTime(
        flow.name,
        bins,
        flow.times,
        {name: np.where(np.nan_to_num(values["h"]) > 0, own, np.nan) for name, own in values.items()},
        depth,
    )


def write_thalweg_time(path: Path, found: ThalwegTime) -> None:
    """Write the parts of the path with flow as CSV, a row for each time and part.

    Parameters
    ----------
    path : Path
    found : ThalwegTime
    """
    columns = [("time", "s"), ("s", "m"), *((name, BAND[name].unit) for name in found.values)]
    step, part = np.nonzero(found.values["h"] > 0)
    numbers = (found.times[step], found.bins.middles[part], *(own[step, part] for own in found.values.values()))
    write_columns(path, columns, zip(*numbers, strict=True))


def write_thalweg_time_plot(path: Path, found: ThalwegTime) -> None:
    """Draw the thalweg-time diagram, a panel for each product, with the first arrival.

    Parameters
    ----------
    path : Path
    found : ThalwegTime
    """
    from matplotlib.colors import ListedColormap

    edges = found.bins.edges
    with plot_file(path, (9.0, 4.2 * len(found.values)), rows=len(found.values)) as panels:
        for row, (name, values) in enumerate(found.values.items()):
            axes = panels[row, 0]
            shades = ListedColormap(ramp_colours(RAMPS[name], SHADES))
            drawn = axes.pcolormesh(edges, _borders(found.times), values, cmap=shades, vmin=0.0, rasterized=True)
            axes.figure.colorbar(drawn, ax=axes, pad=0.01).ax.tick_params(labelsize=8)
            label = f"first arrival, h of {found.depth:g} m"
            axes.plot(found.bins.middles, found.arrival(), color=FRONT, linewidth=1.3, label=label)
            last = row == len(found.values) - 1
            title = f"{found.name}: {TITLES[name]}"
            style_axes(axes, "time [s]", "distance s along the path [m]" if last else "", title)
            legend(axes, loc="lower right")


def _borders(times: np.ndarray) -> np.ndarray:
    """Return the borders between times, float64[steps + 1] [s]; the first and the last are half a step beyond."""
    if len(times) == 1:
        return times[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (times[1:] + times[:-1])
    return np.r_[1.5 * times[0] - 0.5 * times[1], middle, 1.5 * times[-1] - 0.5 * times[-2]]
