"""Compare accuracy with computing time: `mpmgis study`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Unpack

from ..studies.study_options import StudyOptions
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..studies.accuracy_study import StudyFound


class Arguments(StudyOptions, total=False):
    """Options of the command."""

    scene: Annotated[PathLike, shared_options.SCENE]
    yes: Annotated[bool, shared_options.start_unasked("over ten minutes")]
    output: Annotated[
        PathLike,
        Option(
            "folder for table and plot",
            "DIR",
            short="-o",
            usual="study beside the scene",
            folded=False,
            kind="new folder",
            label="Folder for table and plot, if not study beside the scene",
        ),
    ]


VERB = Verb(
    name="study",
    place=20,
    line="accuracy against computing time: work-precision table and plot",
    options=StudyOptions,
    arguments=Arguments,
    example="""
mpmgis study scene.toml
mpmgis study scene.toml --knobs cell_size,cfl --target-error 0.05
mpmgis study scene.toml --exact exact_thickness.tif --beside other_codes.csv -o study
""",
    description="""
Runs the scene with its numerical settings changed one at a time (cell size, particles per cell, Courant number; in 3D
also precision and stiffness; for a scene in stages the cells of all stages and of each stage, where points per cell is
the spacing of the conversion), each several times, and compares all runs with a finer one or with an exact solution.
Writes the table (study.csv), the work-precision plot (study.png, with the front of settings that no other one beats)
and the errors from cell size and time step of an export (export.csv). Times are medians of the time loop, without
compilation. The error of the finer run is estimated from the order of convergence (Richardson). With --beside results
of other codes are also shown: a CSV with columns setting, seconds and error_thickness (or another one of study.csv),
or thickness, a raster like that of --exact, whose error is computed on the same cells; the column code names the
program.
""",
    forms=(
        Form(
            "Study accuracy and computing time",
            "Many runs",
            "Runs a scene with its numerical settings changed one at a time (cell size, particles per cell, Courant "
            "number, ...), each several times, and compares the results with a finer run or an exact solution: a table "
            "(study.csv), the plot of error against time (study.png, in the Results Viewer) and the errors of an "
            "export (export.csv). The best settings are in the log. It runs the scene some dozens of times: begin with "
            "a short one.",
            prints=True,
            plots=True,
        ),
    ),
)


def work(
    asked: Arguments,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    watch: Callable[..., None] = lambda solver, end_time, left: None,
) -> "StudyFound":
    """Run the scene with other settings, and write the results.

    Parameters
    ----------
    asked : Arguments
    confirm : callable
        Question -> whether to start long runs.
    watch : callable
        Called with (solver, end time [s], '') a few times a second.

    Returns
    -------
    StudyFound
    """
    from ..studies.accuracy_study import study

    return study(asked, confirm=confirm, watch=watch)


def study(
    scene: PathLike,
    output: PathLike | None = None,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    **options: Unpack[StudyOptions],
) -> "StudyFound":
    """Compare accuracy with computing time, as `mpmgis study`.

    Parameters
    ----------
    scene : path
    output : path, optional
        Folder for table and plot; default ``study`` beside the scene.
    confirm : callable
        Called with a question before more than ten minutes of runs; if it returns False, nothing is run.
    **options
        `StudyOptions`: knobs, cell_sizes [m], target_error, ...

    Returns
    -------
    StudyFound
        With the `study` (rows, front, `records()` for pandas), the `choice` for the target error, and the `files`.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> found = mpmgis.study("scene.toml", knobs=("cell_size",))  # doctest: +SKIP
    >>> names, rows = found.study.records()  # doctest: +SKIP
    >>> pandas.DataFrame(rows, columns=names)  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"scene": scene, "output": output, **options}), confirm=confirm)
