"""Run a scene many times over parameter ranges: `mpmgis ensemble`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict, Unpack

from ..system.option import Option, PathLike
from ..system.work_options import DASK
from . import shared_options
from .verb import Form, Verb
from .verb_calls import called

if TYPE_CHECKING:
    from ..studies.ensemble_runs import EnsembleFound


class PlanOptions(TypedDict, total=False):
    """Varied parameters."""

    vary: Annotated[
        tuple[str, ...] | dict[str, Any],
        Option(
            "a key TABLE.KEY of the scene and its values; repeatable",
            "KEY=VALUES",
            default=(),
            repeat=True,
            folded=False,
            label="What varies: KEY=VALUES, one a line",
        ),
    ]
    plan: Annotated[
        PathLike,
        Option(
            "TOML file with [vary] and the options of this group; options override it",
            "FILE",
            folded=False,
            label="or: plan in a file",
            files="Plans (*.toml)",
        ),
    ]
    samples: Annotated[
        int,
        Option(
            "number of runs; with grid: number of values per range",
            "N",
            above=0,
            usual="32, with grid 5",
            folded=False,
            label="Runs",
        ),
    ]
    sampling: Annotated[
        Literal["lhs", "sobol", "random", "grid"],
        Option(
            "lhs (Latin hypercube), sobol, random, or grid: all combinations of values, of each range --samples "
            "values, each in the middle of an equally likely interval",
            usual="grid if all are lists, else lhs",
            label="How values are drawn",
        ),
    ]
    seed: Annotated[
        int,
        Option(
            "seed of the sampling; the same seed gives the same runs",
            "N",
            least=0,
            usual="0",
            label="Seed of the random numbers",
        ),
    ]


class MapOptions(TypedDict, total=False):
    """Maps of an ensemble."""

    exceed: Annotated[
        tuple[str, ...] | dict[str, Any],
        Option(
            "map of the probability that the peak of h [m], Ut [m/s] or p [Pa] is at least this",
            "NAME=A,B",
            repeat=True,
            usual="h=0.5,1,2",
            folded=False,
            label="Thresholds: NAME=A,B, one a line",
        ),
    ]
    percentiles: Annotated[
        tuple[float, ...],
        Option(
            "percentiles of the members' peaks and arrivals",
            "P,..",
            unit="%%",
            usual="5,50,95",
            folded=False,
            label="Percentiles, with commas",
        ),
    ]
    cell_size: Annotated[
        float,
        Option(
            "cell size of the maps",
            "M",
            unit="m",
            flag="--cs-e",
            above=0,
            usual="the DTM's",
            folded=False,
            field="CELL",
            label="Cell size of the maps",
        ),
    ]
    min_depth: Annotated[
        float,
        Option(
            "depth from which flow counts as arrived and has a velocity",
            "D",
            default=0.05,
            unit="m",
            above=0,
            label="Depth from which flow counts as arrived",
        ),
    ]
    keep: Annotated[
        Literal["maxima", "deposit", "frames"],
        Option(
            "keep of each run: its maxima, also its deposit, or all frames", default="maxima", label="Keep of each run"
        ),
    ]
    tolerate: Annotated[
        float,
        Option(
            "share of the runs that may become unphysical or fail; a number from 0 to below 1",
            "SHARE",
            default=0.1,
            least=0,
            below=1,
            label="Share of the runs that may fail",
        ),
    ]


class MachineOptions(TypedDict, total=False):
    """Processes of an ensemble."""

    workers: Annotated[
        int,
        Option(
            "number of processes; the results do not depend on it",
            "N",
            above=0,
            usual="one for each core",
            label="Runs at a time",
        ),
    ]
    dask: Annotated[str, DASK]
    law: Annotated[PathLike, shared_options.LAW]


class MachineArguments(MachineOptions, total=False):
    """Processes of an ensemble, and --yes of the command."""

    yes: Annotated[bool, shared_options.start_unasked("over an hour, or most of the memory")]


class EnsembleOptions(PlanOptions, MapOptions, MachineOptions, total=False):
    """Options of `mpmgis.ensemble`."""

    overwrite: Annotated[
        bool,
        Option(
            "replace the ensemble of another plan; members of both are kept",
            default=False,
            folded=False,
            label="Replace the ensemble of another plan in the folder",
        ),
    ]


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
    workflow="studies.ensemble_runs:ensemble",
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
            "Probability maps from many runs",
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
    return called(VERB, {"scene": scene, "output": output, **options}, confirm=confirm)
