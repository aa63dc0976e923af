"""Sample a flow along a line: `mpmgis profile`."""

from typing import TYPE_CHECKING, Annotated, TypedDict, Unpack

from ..results.question_options import GROUPS, QuestionOptions
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    import xarray

    from ..results.profile_answer import ProfileFound


class ProfileLine(TypedDict, total=False):
    """The line of a profile, a parameter of its own in Python."""

    line: Annotated[
        PathLike,
        Option(
            "one line, in any vector format; distances begin at its first vertex",
            "FILE",
            required=True,
            kind="line layer",
            folded=False,
            label="Line",
        ),
    ]


class ProfileOptions(QuestionOptions, total=False):
    """Options of `mpmgis.profile`."""

    at_times: Annotated[tuple[float, ...], shared_options.AT_TIMES]
    spacing: Annotated[
        float,
        Option(
            "distance between sample points",
            "M",
            unit="m",
            above=0,
            usual="a cell",
            folded=False,
            label="Distance between sample points",
        ),
    ]


class Arguments(ProfileLine, ProfileOptions, total=False):
    """Options of the command."""

    frames: Annotated[tuple[PathLike, ...], shared_options.RESULTS]
    json: Annotated[bool, shared_options.JSON]
    output: Annotated[PathLike, shared_options.output("profile", "plot (.png) and table (.csv)", "plot and table")]


VERB = Verb(
    name="profile",
    place=11,
    line="depth, thickness and velocities along a line at chosen times",
    options=ProfileOptions,
    arguments=Arguments,
    groups=GROUPS,
    example="""
mpmgis profile results --line line.gpkg
mpmgis profile results --line line.gpkg --at-times 20,40,60 --cs-e 2 -o profile.csv
mpmgis profile results_gis --line line.gpkg -o profile.png
""",
    description="""
Flow depth h, thickness t, velocities Un and Ut along a line, with terrain and free surface (bed elevation plus the
vertical depth), as in figure 2h and i of Vicari et al. (2025). Every sample point has the value of its cell, without
interpolation. The table has a row for each time and sample point.
""",
    forms=(
        Form(
            "Show the profile along a line",
            "Maps and answers",
            "Flow depth, thickness and velocities along a line at chosen times, with terrain and free surface: a plot "
            "(.png) and a table (.csv).",
            prints=True,
            plots=True,
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "ProfileFound":
    """Answer the question, and write plot and table.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    ProfileFound
    """
    from ..results.profile_answer import profile

    return profile(asked, asked["line"], asked["at_times"], asked["spacing"], progress)


def profile(
    results: Results, line: PathLike, output: PathLike | None = None, **options: Unpack[ProfileOptions]
) -> "xarray.Dataset":
    """Sample a flow along a line at chosen times, as `mpmgis profile`.

    Parameters
    ----------
    results : path or several
        Frames or the folder that holds them, or an export.
    line : path
        Vector file with one line.
    output : path, optional
        Folder for the plot and the table, or one file by its suffix; default ``<name>_profile`` beside the results.
    **options
        `ProfileOptions`: at_times [s], spacing [m], cell_size [m], ...

    Returns
    -------
    xarray.Dataset
        h, t [m], Un, Ut [m s-1] and surface [m] over (time, along); elevation [m], x and y over along [m]. Its
        attribute `files` names what was written.

    Raises
    ------
    MpmgisError
        Unreadable input, a line outside the raster, a time outside the results; nothing is written then.

    Examples
    --------
    >>> mpmgis.profile("results", "line.gpkg", at_times=(20, 40)).h.plot(col="time")  # doctest: +SKIP
    """
    from ..results.answer_datasets import profile_dataset

    with python_words(VERB):
        return profile_dataset(
            work(complete(VERB, {"frames": several(results), "output": output, "line": line, **options}))
        )
