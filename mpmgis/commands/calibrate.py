"""Find parameters of a scene from a mapped event: `mpmgis calibrate`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict, Unpack

from ..system.option import Option, PathLike
from . import shared_options
from .ensemble import MachineArguments, MachineOptions
from .verb import Form, Verb
from .verb_calls import called

if TYPE_CHECKING:
    from ..studies.calibration import CalibrateFound


class ParameterOptions(TypedDict, total=False):
    """Calibrated parameters."""

    vary: Annotated[
        tuple[str, ...] | dict[str, Any],
        Option(
            "a key TABLE.KEY of the scene and its prior distribution, as for ensemble; KEY alone: the range of "
            "--material; repeatable",
            "KEY[=PRIOR]",
            default=(),
            repeat=True,
            folded=False,
            label="What is calibrated: KEY=PRIOR, one a line",
        ),
    ]
    material: Annotated[
        Literal["snow-avalanche", "debris-flow", "rock-avalanche"],
        Option(
            "ranges of friction.mu and friction.xi for keys without a prior",
            folded=False,
            label="Kind of event, for keys without a prior",
        ),
    ]


class ObservationOptions(TypedDict, total=False):
    """Observations of the event."""

    observed: Annotated[
        PathLike,
        Option(
            "mapped outline of the whole flow, in any vector format",
            "FILE",
            kind="polygon layer",
            folded=False,
            label="Mapped outline",
        ),
    ]
    points: Annotated[
        PathLike,
        Option(
            "points with the columns h_max [m], Ut_max [m/s], p_max [Pa] or t_arrival [s], and their standard "
            "deviations h_max_sd, ...",
            "FILE",
            kind="point layer",
            folded=False,
            label="Points with observed values",
        ),
    ]
    deposit: Annotated[
        PathLike,
        Option(
            "raster of the vertical thickness of the deposit; nodata where it is not known",
            "RASTER",
            unit="m",
            kind="raster layer",
            folded=False,
            label="Thickness of the deposit",
        ),
    ]
    volume: Annotated[
        str,
        Option(
            "volume of the deposit and its standard deviation",
            "V[:SD]",
            unit="m3",
            folded=False,
            label="Volume of the deposit: V or V:SD",
        ),
    ]
    line: Annotated[
        PathLike,
        Option(
            "path of the flow, from its top",
            "FILE",
            usual="the centre line of the outline",
            kind="line layer",
            label="Path of the flow, from its top",
        ),
    ]
    event: Annotated[
        tuple[str, ...],
        Option(
            "TOML file of another event with the same parameters: scene and its observed, points, deposit, volume, "
            "line; repeatable",
            "FILE",
            default=(),
            repeat=True,
            label="Files of other events, one a line",
        ),
    ]
    outline_error: Annotated[
        float,
        Option(
            "standard deviation of the position of the outline",
            "M",
            unit="m",
            above=0,
            usual="one cell of the maps",
            label="Error of the outline",
        ),
    ]
    value_error: Annotated[
        float,
        Option(
            "relative standard deviation of values without one",
            "SHARE",
            default=0.2,
            unit="1",
            above=0,
            label="Relative error of values without one",
        ),
    ]
    threshold: Annotated[
        float,
        Option(
            "depth from which a cell counts as covered",
            "M",
            default=0.1,
            unit="m",
            above=0,
            label="Depth from which a cell counts as covered",
        ),
    ]


class RoundOptions(TypedDict, total=False):
    """Numbers of runs, for each event."""

    samples: Annotated[
        int, Option("runs from the prior", "N", default=100, above=0, folded=False, label="Runs from the prior")
    ]
    refine: Annotated[
        int,
        Option("more runs near the posterior; 0 for none", "N", default=50, least=0, label="Runs near the posterior"),
    ]
    predictive: Annotated[
        int,
        Option(
            "runs from the posterior for the hazard maps; 0 for none",
            "N",
            default=50,
            least=0,
            label="Runs for the hazard maps",
        ),
    ]
    seed: Annotated[
        int, Option("seed of all random numbers", "N", default=0, least=0, label="Seed of the random numbers")
    ]
    exceed: Annotated[
        tuple[str, ...] | dict[str, Any],
        Option(
            "thresholds of the probability maps, as for ensemble",
            "NAME=A,B",
            repeat=True,
            usual="h=0.5,1,2",
            label="Thresholds: NAME=A,B, one a line",
        ),
    ]
    cell_size: Annotated[
        float,
        Option(
            "cell size of maps and comparisons",
            "M",
            unit="m",
            flag="--cs-e",
            above=0,
            usual="the DTM's",
            field="CELL",
            label="Cell size of the maps",
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


class CalibrateOptions(ParameterOptions, ObservationOptions, RoundOptions, MachineOptions, total=False):
    """Options of `mpmgis.calibrate`."""

    overwrite: Annotated[
        bool,
        Option(
            "replace the runs of another plan in the folder",
            default=False,
            folded=False,
            label="Replace the runs of another plan in the folder",
        ),
    ]


class Arguments(CalibrateOptions, MachineArguments, total=False):
    """Options of the command."""

    scene: Annotated[PathLike, shared_options.SCENE]
    list_files: Annotated[bool, shared_options.LIST_FILES]
    output: Annotated[
        PathLike,
        Option(
            "folder for runs and results",
            "DIR",
            short="-o",
            usual="calibration beside the scene",
            folded=False,
            kind="new folder",
            label="Folder for runs and results, if not calibration beside the scene",
        ),
    ]


VERB = Verb(
    name="calibrate",
    place=22,
    line="parameters of a scene from a mapped event, with their uncertainty",
    workflow="studies.calibration:calibrate",
    options=CalibrateOptions,
    arguments=Arguments,
    groups=(
        ("calibrated parameters", ParameterOptions),
        ("observations", ObservationOptions),
        ("runs", RoundOptions),
        ("machine", MachineArguments),
    ),
    example="""
mpmgis calibrate scene.toml --observed outline.gpkg --vary friction.mu=0.1:0.4 --vary friction.xi=500:3000
mpmgis calibrate scene.toml --observed outline.gpkg --vary friction.mu --vary friction.xi --material snow-avalanche
mpmgis calibrate scene.toml --observed outline.gpkg --points marks.gpkg --volume 20000:5000 --vary friction.mu=0.1:0.4
""",
    description="""
Finds the values of the varied keys that agree with a mapped event: outline, depths, speeds, pressures and arrival
times at points, thickness and volume of the deposit. Runs from the prior (--samples) give an emulator of the compared
quantities; more runs near the posterior (--refine) make it accurate there. Prints best fit, median and 90 % interval
of each key, how well it is identified, and what trades off. Writes calibrate.json, pairs.png, samples.csv, runs.csv,
a map of the misfit, and probability maps of runs from the posterior (--predictive). A second start continues.
Intervals hold for the given errors and for this model.
""",
    forms=(
        Form(
            "Calibrate to a mapped event",
            "Many runs",
            "Finds the values of uncertain parameters that agree with a mapped event: outline, values at points, "
            "deposit. Write parameters like friction.mu=0.1:0.4, one a line. Best fit, 90 % intervals and what trades "
            "off are in the log. Probability maps of runs with the calibrated parameters are opened.",
            project=True,
            load="the maps",
        ),
    ),
)


def calibrate(
    scene: PathLike,
    output: PathLike | None = None,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    **options: Unpack[CalibrateOptions],
) -> "CalibrateFound":
    """Find parameters of a scene from a mapped event, as `mpmgis calibrate`.

    Parameters
    ----------
    scene : path
    output : path, optional
        Folder; default ``calibration`` beside the scene.
    confirm : callable
        Called with a question before runs of hours; if it returns False, nothing is run.
    **options
        `CalibrateOptions`: vary (a dictionary of keys and priors, None for the range of `material`), observed,
        points, deposit, volume, samples, refine, predictive, workers, ...

    Returns
    -------
    CalibrateFound
        With the `folder`, the `files`, and the `result`, whose `record()` has all figures.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> vary = {"friction.mu": "0.1:0.4"}
    >>> found = mpmgis.calibrate("scene.toml", observed="outline.gpkg", vary=vary)  # doctest: +SKIP
    >>> found.result.parameters()["friction.mu"]["interval_90"]  # doctest: +SKIP
    """
    return called(VERB, {"scene": scene, "output": output, **options}, confirm=confirm)
