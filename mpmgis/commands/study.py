"""Compare accuracy with computing time: `mpmgis study`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from ..system.option import Option, PathLike
from ..system.work_options import OverwriteOptions
from . import shared_options
from .verb import Form, Verb
from .verb_calls import called

if TYPE_CHECKING:
    from ..studies.accuracy_study import StudyFound


class StudyOptions(OverwriteOptions, total=False):
    """Options of `mpmgis.study`."""

    target_error: Annotated[
        float,
        Option(
            "print the settings for this error; 0.05 is 5 %%, with --measure reach in metres",
            "E",
            above=0,
            folded=False,
            label="Find the settings for this error [1, or m]",
        ),
    ]
    knobs: Annotated[
        tuple[str, ...],
        Option(
            "change only these settings: cell_size, particles_per_cell, cfl; in 3D also points_per_cell, precision, "
            "stiffness",
            "NAME,..",
            usual="all settings of the scene",
            folded=False,
            label="Change only these settings, with commas",
        ),
    ]
    cell_sizes: Annotated[
        tuple[float, ...],
        Option(
            "cell sizes to run",
            "M,..",
            unit="m",
            above=0,
            usual="2, 1.4, 1, 0.7 times the scene's",
            folded=False,
            label="Cell sizes to run, with commas",
        ),
    ]
    repeats: Annotated[
        int,
        Option(
            "runs of each setting; the time is their median",
            "N",
            default=3,
            above=0,
            folded=False,
            label="Runs of each setting",
        ),
    ]
    measure: Annotated[
        Literal["thickness", "momentum", "area", "reach"],
        Option("error measure; reach in m, the others relative", default="thickness", label="Error measure"),
    ]
    exact: Annotated[
        PathLike,
        Option(
            "raster of the exact vertical thickness at end_time",
            "FILE",
            unit="m",
            usual="a finer run",
            kind="raster layer",
            label="Exact solution: vertical thickness at the end",
        ),
    ]
    refinement: Annotated[
        float,
        Option(
            "the cell size of the finer run is the scene's divided by this number",
            "F",
            above=0,
            usual="the smallest cell size over 1.4",
            label="Cell size of the finer run: the scene's divided by",
        ),
    ]
    beside: Annotated[
        tuple[PathLike, ...],
        Option(
            "also show these results of other codes: columns setting, seconds and error_thickness, or thickness; "
            "repeatable",
            "CSV",
            default=(),
            repeat=True,
            label="Also show these results of other codes",
        ),
    ]
    full: Annotated[
        bool,
        Option(
            "also run all combinations of three values of each",
            default=False,
            label="All combinations of three values of each setting",
        ),
    ]
    exports: Annotated[
        bool,
        Option(
            "do not study cell size and time step of exports",
            default=True,
            flag="--no-exports",
            turned_off=True,
            field="NO_EXPORTS",
            label="Do not study cell size and time step of exports",
        ),
    ]
    threads: Annotated[int, shared_options.THREADS]
    law: Annotated[PathLike, shared_options.LAW]


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
    workflow="studies.accuracy_study:study",
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
            "Accuracy against computing time",
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
    return called(VERB, {"scene": scene, "output": output, **options}, confirm=confirm)
