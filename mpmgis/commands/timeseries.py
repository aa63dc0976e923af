"""Sample a flow at points over time: `mpmgis timeseries`."""

from typing import TYPE_CHECKING, Annotated, Unpack

from ..results.question_options import GROUPS, QuestionOptions
from ..system.messages import Progress, unwatched
from ..system.option import PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    import xarray

    from ..results.timeseries_answer import SeriesFound


class TimeseriesOptions(QuestionOptions, total=False):
    """Options of `mpmgis.timeseries`."""

    points: Annotated[PathLike, shared_options.POINTS]
    at: Annotated[tuple[tuple[float, float], ...], shared_options.AT]


class Arguments(TimeseriesOptions, total=False):
    """Options of the command."""

    frames: Annotated[tuple[PathLike, ...], shared_options.RESULTS]
    json: Annotated[bool, shared_options.JSON]
    output: Annotated[PathLike, shared_options.output("timeseries", "plot (.png) and table (.csv)", "plot and table")]


VERB = Verb(
    name="timeseries",
    place=12,
    line="depth, thickness, velocities and pressure at points over time",
    options=TimeseriesOptions,
    arguments=Arguments,
    groups=GROUPS,
    example="""
mpmgis timeseries results --points points.gpkg
mpmgis timeseries results --at 312900,4008450 --at 313100,4008160 --cs-e 5 -o series.csv
""",
    description="""
Flow depth h, thickness t, velocities Un and Ut and impact pressure p (density of the release times the squared speed)
in the cells of points, for every frame. Points have the names of a column `name`, else numbers.
""",
    forms=(
        Form(
            "Show time series at points",
            "Maps and answers",
            "Flow depth, thickness, velocities and impact pressure at points over time: a plot (.png, in the Results "
            "Viewer) and a table (.csv). The largest values are in the log.",
            prints=True,
            plots=True,
            one_of=("POINTS", "PLACE"),
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "SeriesFound":
    """Answer the question, and write plot and table.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    SeriesFound
    """
    from ..results.timeseries_answer import timeseries

    return timeseries(asked, asked["points"], asked["at"], progress)


def timeseries(
    results: Results, output: PathLike | None = None, **options: Unpack[TimeseriesOptions]
) -> "xarray.Dataset":
    """Sample a flow at points over time, as `mpmgis timeseries`.

    Parameters
    ----------
    results : path or several
        Frames or the folder that holds them, or an export.
    output : path, optional
        Folder for the plot and the table, or one file by its suffix; default ``<name>_timeseries`` beside the results.
    **options
        `TimeseriesOptions`: points (vector file) or at ((E, N), ...) [m], cell_size [m], ...

    Returns
    -------
    xarray.Dataset
        h, t [m], Un, Ut [m s-1] and p [Pa] over (time, point), x and y over point [m]. Its attribute `files` names
        what was written.

    Raises
    ------
    MpmgisError
        Unreadable input, no point, a point outside the raster; nothing is written then.

    Examples
    --------
    >>> mpmgis.timeseries("results", at=[(312900, 4008450)]).to_dataframe()  # doctest: +SKIP
    """
    from ..results.answer_datasets import series_dataset

    with python_words(VERB):
        return series_dataset(work(complete(VERB, {"frames": several(results), "output": output, **options})))
