"""Answer `mpmgis timeseries`: the flow at points over time."""

from collections.abc import Sequence

import numpy as np

from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..terrain.observations import read_points
from .answer_files import answer_output, with_files
from .opened_results import ExportFlow, FrameFlow, open_flow, require_on_grid
from .profiles import SERIES_PRODUCTS, SeriesFound
from .question_options import Question
from .series_plots import write_rows, write_series_plot

PLOT_FILE, TABLE_FILE = "timeseries.png", "timeseries.csv"
WORD = "timeseries"  # end of the name of the default output folder


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
    found = SeriesFound(flow.name, names, x, y, flow.times, values)
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
