"""Compare results along and across a path: `mpmgis path`."""

from typing import TYPE_CHECKING, Annotated, Unpack

from ..results.question_options import GROUPS, QuestionOptions
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    from ..results.path_answer import PathFound


class PathOptions(QuestionOptions, total=False):
    """Options of `mpmgis.path`."""

    line: Annotated[
        PathLike,
        Option(
            "path (thalweg), from its top",
            "FILE",
            usual="the centre line of the first result",
            kind="line layer",
            folded=False,
            label="Path (thalweg), from its top",
        ),
    ]
    outline: Annotated[
        PathLike,
        Option(
            "polygons of an observed event, with which all results are compared",
            "FILE",
            usual="the first result is compared with",
            kind="polygon layer",
            folded=False,
            label="Observed outline, if any",
        ),
    ]
    pressure: Annotated[
        float,
        Option(
            "largest pressure from which a cell counts as reached",
            "P",
            unit="Pa",
            above=0,
            exclusive="limit",
            folded=False,
            label="Limit of the runout: pressure",
        ),
    ]
    speed: Annotated[
        float,
        Option(
            "largest speed from which a cell counts as reached",
            "U",
            unit="m s-1",
            above=0,
            exclusive="limit",
            folded=False,
            label="or: speed",
        ),
    ]
    depth: Annotated[
        float,
        Option(
            "largest depth from which a cell counts as reached",
            "H",
            unit="m",
            above=0,
            usual="0.1 without another limit",
            exclusive="limit",
            folded=False,
            label="or: depth",
        ),
    ]
    spacing: Annotated[
        float,
        Option(
            "length of the parts of the path in plots and tables",
            "M",
            unit="m",
            above=0,
            usual="two cells",
            label="Length of the parts of the path",
        ),
    ]


class Arguments(PathOptions, total=False):
    """Options of the command."""

    frames: Annotated[
        tuple[PathLike, ...],
        Option(
            "one or several results: the folder of frames of a run or of another code, an export, (the beginning of "
            "the names of) rasters named *_pft, *_pfv, *_ppr, or the folder of a region",
            "RESULTS",
            positional="many",
            kind="folder",
            folded=False,
            label="Results: folder of frames, of maps, or of a region",
        ),
    ]
    json: Annotated[bool, shared_options.JSON]
    output: Annotated[PathLike, shared_options.output("path", "plots (.png) and tables (.csv)", "plots and tables")]


VERB = Verb(
    name="path",
    place=19,
    line="many results and an observed outline along one path: runout, area, growth",
    options=PathOptions,
    arguments=Arguments,
    groups=GROUPS,
    example="""
mpmgis path results --line thalweg.gpkg --pressure 1000
mpmgis path run_1 run_2 run_3 --line thalweg.gpkg --outline observed.gpkg -o comparison
mpmgis path results --speed 1 -o - --json
""",
    description="""
Coordinates along (s) and across (l, positive to the left) a path, as in AIMEC of AvaFrame (Fischer 2013). For each
result: s of the farthest cell that reaches --pressure, --speed or --depth, area of these cells, largest values, growth
index (mass of the last frame over that of the first), and differences from the outline or else from the first result.
Each cell keeps its area on the map. A single result with steps gets a thalweg-time diagram of depth and speed, with the
first arrival at the depth limit (0.1 m where the limit is another quantity).
""",
    forms=(
        Form(
            "Show results along a path",
            "Maps and answers",
            "Runout at a limit of pressure, speed or depth, area and growth of a result along a path (thalweg), also "
            "against an observed outline: plots (.png) and tables (.csv). The figures are in the log.",
            prints=True,
            plots=True,
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "PathFound":
    """Answer the question, and write plots and tables.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    PathFound
    """
    from ..results.path_answer import chosen_limit, path

    limit = chosen_limit(asked["depth"], asked["speed"], asked["pressure"])
    return path(asked, asked["line"], asked["outline"], limit, asked["spacing"], progress)


def path(results: Results, output: PathLike | None = None, **options: Unpack[PathOptions]) -> "PathFound":
    """Compare results and an observed outline along and across a path, as `mpmgis path`.

    Parameters
    ----------
    results : path or several
        Each is a result: a folder of frames, an export, rasters of peaks of another code, or a region.
    output : path, optional
        Folder for plots and tables, or one file by its suffix; default ``<name>_path`` beside the first result.
    **options
        `PathOptions`: line, outline, pressure [Pa], speed [m s-1], depth [m], spacing [m], ...

    Returns
    -------
    PathFound
        With `rows()`: a row for each result and the outline, `along_rows()`: one for each part of the path, and `time`:
        the thalweg-time diagram of a single result.

    Raises
    ------
    MpmgisError
        Unreadable input, several limits, or no cell that reaches the limit; nothing is written then.

    Examples
    --------
    >>> found = mpmgis.path(["run_1", "run_2"], line="thalweg.gpkg", pressure=1000)  # doctest: +SKIP
    >>> pandas.DataFrame(found.rows(), columns=[name for name, _ in found.columns()])  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"frames": several(results), "output": output, **options}))
