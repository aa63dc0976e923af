"""Measure runout, drop height and angles of a flow: `mpmgis runout`."""

from typing import TYPE_CHECKING, Annotated, Unpack

from ..results.question_options import GROUPS, QuestionOptions
from ..system.messages import Progress, unwatched
from ..system.option import PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    from ..results.runout_answer import RunoutFound


class RunoutOptions(QuestionOptions, total=False):
    """Options of `mpmgis.runout`."""

    line: Annotated[PathLike, shared_options.LINE]
    threshold: Annotated[float, shared_options.THRESHOLD]


class Arguments(RunoutOptions, total=False):
    """Options of the command."""

    frames: Annotated[tuple[PathLike, ...], shared_options.RESULTS_OR_RASTERS]
    json: Annotated[bool, shared_options.JSON]
    output: Annotated[PathLike, shared_options.output("runout", "plot (.png) and tables (.csv)", "profile and tables")]


VERB = Verb(
    name="runout",
    place=10,
    line="runout, drop height, angles of energy line and centre of mass",
    options=RunoutOptions,
    arguments=Arguments,
    groups=GROUPS,
    example="""
mpmgis runout results
mpmgis runout results --line flow_path.gpkg --threshold 0.5 -o runout
mpmgis runout results --json -o profile.png
""",
    description="""
Runout along the flow line from the highest to the farthest cell that the flow ever covered, drop height, and angle of
the energy line (Fahrboeschung) between the two; the same for the deposit; the travel angle of the centre of mass,
whose tangent is mu for Coulomb friction alone; and the distance that contains 99 % of the mass at the end. Without
--line the line is the centre line of the flow, from its highest part. Distances are horizontal and along the line;
runout_straight is the distance in a straight line, runout_along_ground the length along the terrain. The path of the
mass is not known for an export.
""",
    forms=(
        Form(
            "Measure runout and energy line",
            "Maps and answers",
            "Runout, drop, angles of the energy line and of the centre of mass, and a longitudinal profile (.png) with "
            "tables (.csv). The figures are in the log.",
            prints=True,
            plots=True,
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "RunoutFound":
    """Answer the question, and write plot and table.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    RunoutFound
    """
    from ..results.runout_answer import runout

    return runout(asked, asked["line"], asked["threshold"], progress)


def runout(results: Results, output: PathLike | None = None, **options: Unpack[RunoutOptions]) -> "RunoutFound":
    """Measure runout, drop height, and angles of the energy line and of the centre of mass, as `mpmgis runout`.

    Parameters
    ----------
    results : path or several
        Frames or the folder that holds them, an export, or rasters of peaks of another code.
    output : path, optional
        Folder for the plot and the tables, or one file by its suffix; default ``<name>_runout`` beside the results.
    **options
        `RunoutOptions`: line, threshold [m], cell_size [m], dem, ...

    Returns
    -------
    RunoutFound
        With `rows()`: (quantity, unit, value) of every figure, and `facts()`: a dictionary for pandas.

    Raises
    ------
    MpmgisError
        Unreadable input, or a flow that reached no cell; nothing is written then.

    Examples
    --------
    >>> found = mpmgis.runout("results", line="flow_path.gpkg")  # doctest: +SKIP
    >>> pandas.DataFrame(found.rows(), columns=["quantity", "unit", "value"])  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"frames": several(results), "output": output, **options}))
