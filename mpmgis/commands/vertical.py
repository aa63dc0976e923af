"""Profile a 3D flow over the height above its bed: `mpmgis vertical`."""

from typing import TYPE_CHECKING, Annotated, Unpack

from ..results.question_options import FRAME_GROUPS, FrameQuestionOptions
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    import xarray

    from ..results.vertical_answer import VerticalFound


class VerticalOptions(FrameQuestionOptions, total=False):
    """Options of `mpmgis.vertical`."""

    points: Annotated[PathLike, shared_options.POINTS]
    at: Annotated[tuple[tuple[float, float], ...], shared_options.AT]
    at_times: Annotated[tuple[float, ...], shared_options.AT_TIMES]
    width: Annotated[
        float,
        Option(
            "side of the square cell around a point",
            "M",
            unit="m",
            above=0,
            usual="4 cells of the code's grid",
            folded=False,
            label="Side of the square cell around a point",
        ),
    ]
    layer: Annotated[
        float,
        Option(
            "height of a layer",
            "M",
            unit="m",
            above=0,
            usual="half a cell of the code's grid",
            folded=False,
            label="Height of a layer",
        ),
    ]


class Arguments(VerticalOptions, total=False):
    """Options of the command."""

    frames: Annotated[tuple[PathLike, ...], shared_options.FRAMES]
    json: Annotated[bool, shared_options.JSON]
    output: Annotated[PathLike, shared_options.output("vertical", "plot (.png) and tables (.csv)", "plot and tables")]


VERB = Verb(
    name="vertical",
    place=14,
    line="density, velocities and pressure over the height above the bed, of 3D frames",
    options=VerticalOptions,
    arguments=Arguments,
    groups=FRAME_GROUPS,
    example="""
mpmgis vertical results --at 312900,4008450
mpmgis vertical results --points points.gpkg --at-times 4,6,8 --width 10 --layer 1
""",
    description="""
Density, velocities along (Ut) and across the bed (Un) and impact pressure over the height above the bed, of 3D frames,
in square cells around points. Heights are along the bed's normal. Each layer of a cell is averaged as in an export;
the pressure p of a layer is its density times the square of its mean speed. Its sum over the height is the flux of
momentum: a force per width, with the height at which it acts. It does not include the pressure from the weight above,
the overburden, which has a separate force per width and height. These are values of the undisturbed flow: a
wall would change them (a [[barrier]] in a run of points has forces in barriers.csv).
""",
    forms=(
        Form(
            "Show density and speed over the height",
            "Maps and answers",
            "Density, velocities along and across the bed and impact pressure over the height above the bed, of a 3D "
            "simulation, in square cells around points: a plot (.png, in the Results Viewer) and tables (.csv). The "
            "sums of the pressure, force per width [kN/m] with the height at which it acts, are in the log.",
            prints=True,
            plots=True,
            one_of=("POINTS", "PLACE"),
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "VerticalFound":
    """Answer the question, and write plot and table.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    VerticalFound
    """
    from ..results.vertical_answer import vertical

    where, times = (asked["points"], asked["at"]), asked["at_times"]
    return vertical(asked, *where, times, asked["width"], asked["layer"], progress)


def vertical(results: Results, output: PathLike | None = None, **options: Unpack[VerticalOptions]) -> "xarray.Dataset":
    """Profile a 3D flow over the height above its bed, as `mpmgis vertical`.

    Parameters
    ----------
    results : path or several
        Frames of points, or the folder that holds them.
    output : path, optional
        Folder for the plot and the tables, or one file by its suffix; default ``<name>_vertical`` beside the results.
    **options
        `VerticalOptions`: points (vector file) or at ((E, N), ...) [m], at_times [s], width [m], layer [m], ...

    Returns
    -------
    xarray.Dataset
        The columns of the table of layers over row, with point, time [s] and height [m]; `to_dataframe()` makes a
        table. Its attribute `files` names what was written.

    Raises
    ------
    MpmgisError
        Depth-averaged frames, unreadable input, a point outside the raster; nothing is written then.

    Examples
    --------
    >>> mpmgis.vertical("results", at=[(312900, 4008450)], at_times=[6]).to_dataframe()  # doctest: +SKIP
    """
    from ..results.answer_datasets import vertical_dataset

    with python_words(VERB):
        return vertical_dataset(work(complete(VERB, {"frames": several(results), "output": output, **options})))
