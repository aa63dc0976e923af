"""Run a scene many times over parameter ranges: `mpmgis ensemble`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Unpack

from ..studies.ensemble_options import EnsembleOptions, MapOptions, PlanOptions
from ..studies.many_runs_options import MachineOptions
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..studies.ensemble_runs import EnsembleFound


class MachineArguments(MachineOptions, total=False):
    """Processes of many runs, and --yes of the command."""

    yes: Annotated[bool, shared_options.start_unasked("over an hour, or most of the memory")]


class Arguments(EnsembleOptions, MachineArguments, total=False):
    """Options of the command."""

    scene: Annotated[PathLike, shared_options.SCENE]
    list_files: Annotated[bool, shared_options.LIST_FILES]
    output: Annotated[
        PathLike,
        Option(
            "folder for runs and maps",
            "DIR",
            short="-o",
            usual="ensemble beside the scene",
            folded=False,
            kind="new folder",
            label="Folder for runs and maps, if not ensemble beside the scene",
        ),
    ]


VERB = Verb(
    name="ensemble",
    place=21,
    line="many runs over parameter ranges: probability and percentile rasters",
    options=EnsembleOptions,
    arguments=Arguments,
    groups=(("varied parameters", PlanOptions), ("maps", MapOptions), ("machine", MachineArguments)),
    example="""
mpmgis ensemble scene.toml --vary friction.mu=0.15:0.3 --vary release.thickness=normal:1.5:0.3:0.5:3
mpmgis ensemble scene.toml --plan plan.toml --exceed h=0.5,1 --exceed p=10000 -o ensemble
""",
    description="""
Runs the scene many times with different values of the varied keys, and writes maps of all runs together: the
probability that thresholds are reached, means, percentiles and envelopes, with styles and a QGIS project. Keys are
TABLE.KEY, or zones.1.KEY for the first [[zones]]. Values are LOW:HIGH (uniform), A,B,C (a list),
normal:MEAN:SD, lognormal:MEAN:SD (both also with :LOW:HIGH to truncate them), triangular:LOW:MODE:HIGH. A second start
continues an interrupted ensemble: finished members are identified by a digest of their scene, their inputs and the
program, and are not run again. A Python script that calls mpmgis.ensemble with more than one worker must do so under
if __name__ == "__main__".
""",
    forms=(
        Form(
            "Map probabilities from many runs",
            "Many runs",
            "Runs a scene many times with different values of uncertain parameters, and maps all runs together: the "
            "probability that depths, speeds or pressures are reached, means, percentiles and envelopes, opened as a "
            "styled group. Write varied parameters like friction.mu=0.15:0.3 (uniform from 0.15 to 0.3), "
            "release.density=300,400 (a list), release.thickness=normal:1.5:0.3, lognormal:MEAN:SD (both also with "
            ":LOW:HIGH), or triangular:LOW:MODE:HIGH. A cancelled ensemble continues when it is started again with the "
            "same folder.",
            project=True,
            load="the maps",
        ),
    ),
)


def work(
    asked: Arguments,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    look: Callable[[int, int, int], None] = lambda done, total, left_out: None,
) -> "EnsembleFound":
    """Run the scene many times, and write the results.

    Parameters
    ----------
    asked : Arguments
    confirm : callable
        Question -> whether to start long runs.
    look : callable
        Called with (done, total, left out) a few times a second.

    Returns
    -------
    EnsembleFound
    """
    from ..studies.ensemble_runs import ensemble

    return ensemble(asked, confirm=confirm, look=look)


def ensemble(
    scene: PathLike,
    output: PathLike | None = None,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    **options: Unpack[EnsembleOptions],
) -> "EnsembleFound":
    """Run a scene many times over parameter ranges, and map all runs together, as `mpmgis ensemble`.

    Parameters
    ----------
    scene : path
    output : path, optional
        Folder; default ``ensemble`` beside the scene.
    confirm : callable
        Called with a question before runs of hours; if it returns False, nothing is run.
    **options
        `EnsembleOptions`: vary (a dictionary of keys and values, or texts KEY=VALUES), samples, exceed, workers, ...

    Returns
    -------
    EnsembleFound
        With the `folder`, the `files` (the QGIS project first) and the `statuses` of the members.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> found = mpmgis.ensemble("scene.toml", vary={"friction.mu": "0.15:0.3"}, samples=16)  # doctest: +SKIP
    >>> rioxarray.open_rasterio(found.files[1]).plot()  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"scene": scene, "output": output, **options}), confirm=confirm)
