"""Answer `mpmgis timeseries`: the flow at points over time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..laws.quantities import BAND
from ..maps.qgis.colours import LOOKS
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..terrain.observations import read_points
from .answer_files import answer_output, four_digits, with_files, write_rows
from .opened_results import ExportFlow, FrameFlow, open_flow, require_on_grid
from .plot_style import COLOURS, legend, plot_file, style_axes
from .question_options import Question

SERIES_HEADINGS = ("point", "arrival [s]", "largest h [m]", "at [s]", "largest Ut [m/s]", "at [s]")
SERIES_PRODUCTS = ("h", "t", "Un", "Ut", "p")
POINT_COLUMNS = (("E", "m"), ("N", "m"), ("time", "s"))
MOST_CURVES = 24  # points in the plot; the table has all
PLOT_FILE, TABLE_FILE = "timeseries.png", "timeseries.csv"
WORD = "timeseries"  # end of the name of the default output folder


@dataclass(frozen=True)
class SeriesFound:
    """A flow at points over time.

    Parameters
    ----------
    name : str
    names : tuple of str
        Of the points.
    x, y : float64[n] [m]
    times : float64[k] [s]
    values : dict of str to float64[k, n]
        By product.
    min_depth : float [m]
        With which the flow arrives.
    files : tuple of Path
    """

    name: str
    names: tuple
    x: np.ndarray
    y: np.ndarray
    times: np.ndarray
    values: dict
    min_depth: float
    files: tuple = ()

    def columns(self) -> tuple:
        """Return the (name, unit) of each column of `rows`."""
        return (("point", ""), *POINT_COLUMNS, *((name, BAND[name].unit) for name in self.values))

    def rows(self) -> Iterator[tuple]:
        """Yield one row per point and time."""
        for point, name in enumerate(self.names):
            for k, time in enumerate(self.times):
                values = (values[k, point] for values in self.values.values())
                yield (name, self.x[point], self.y[point], time, *values)

    def arrival(self, point: int) -> float:
        """Return the first time [s] with at least `min_depth` at a point; NaN without flow.

        Parameters
        ----------
        point : int
            Number of the point.
        """
        deep = self.values["h"][:, point] >= self.min_depth
        return float(self.times[np.argmax(deep)]) if deep.any() else np.nan

    def peak(self, product: str, point: int) -> tuple[float, float]:
        """Return the largest value of a product at a point, and its time [s]; NaN without values.

        Parameters
        ----------
        product : str
        point : int
            Number of the point.

        Returns
        -------
        (float, float)
        """
        values = self.values[product][:, point]
        if not np.isfinite(values).any():
            return np.nan, np.nan
        k = int(np.nanargmax(values))
        return float(values[k]), float(self.times[k])

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        width = max(map(len, (*self.names, SERIES_HEADINGS[0]))) + 2
        lines = [f"{SERIES_HEADINGS[0]:<{width}}" + "".join(f"{word:>18}" for word in SERIES_HEADINGS[1:])]
        for point, name in enumerate(self.names):
            numbers = self.arrival(point), *self.peak("h", point), *self.peak("Ut", point)
            lines.append(f"{name:<{width}}" + "".join(f"{four_digits(value):>18}" for value in numbers))
        return lines


def timeseries(
    asked: Question,
    points: PathLike | None = None,
    at: Sequence[tuple[float, ...]] = (),
    progress: Progress = unwatched,
) -> SeriesFound:
    """Sample depth, thickness, velocities and impact pressure over time, in the cells of points.

    Parameters
    ----------
    asked : Question
    points : path, optional
        File of points.
    at : sequence of (float, float) [m]
        More points, (E, N).
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    SeriesFound

    Raises
    ------
    MpmgisError
        Unreadable input, no point, a point outside the raster; nothing is written then.
    """
    output = answer_output(asked, WORD, (PLOT_FILE, TABLE_FILE))
    flow = open_flow(asked, output)
    names, x, y = given_points(points, at, flow)
    cells = require_on_grid(flow, x, y, names, "point")
    values = flow.at_cells(cells, _products(flow), range(len(flow.times)), progress)
    found = SeriesFound(flow.name, names, x, y, flow.times, values, asked["min_depth"])
    return with_files(found, output, asked["overwrite"], {PLOT_FILE: write_series_plot, TABLE_FILE: write_rows})


def _products(flow):
    """Products of a series; for an export those that it contains."""
    if isinstance(flow, FrameFlow):
        return SERIES_PRODUCTS
    there = tuple(name for name in SERIES_PRODUCTS if name in flow.steps.bands)
    if there != SERIES_PRODUCTS:
        missing = ", ".join(name for name in SERIES_PRODUCTS if name not in there)
        log.info(
            f"{flow.name}: this export's steps have no {missing}; export with `products={missing}`, or give the frames"
        )
    return there


def given_points(
    path: PathLike | None, places: Sequence, flow: FrameFlow | ExportFlow
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Return the points in a file, and those given as (E, N).

    Parameters
    ----------
    path : path or None
    places : sequence of (float, float) [m]
    flow : FrameFlow or ExportFlow
        Its terrain gives the CRS.

    Returns
    -------
    (tuple of str, float64[n] [m], float64[n] [m])
        Names, x, y.

    Raises
    ------
    InputError
        There is no point.
    """
    names, x, y = ((), np.empty(0), np.empty(0)) if path is None else read_points(path, flow.terrain.grid)
    if len(names) + len(places) == 0:
        raise InputError("no point is given; give `points=FILE` or `at=E,N`")
    given = np.reshape(np.array(places, float), (-1, 2))
    named = tuple(f"{east:.12g},{north:.12g}" for east, north in given)
    return (*names, *named), np.concatenate([x, given[:, 0]]), np.concatenate([y, given[:, 1]])


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
