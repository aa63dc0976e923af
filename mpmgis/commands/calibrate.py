"""Find parameters of a scene from a mapped event: `mpmgis calibrate`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Unpack

from ..studies.calibration_options import CalibrateOptions, ObservationOptions, ParameterOptions, RoundOptions
from ..system.option import Option, PathLike
from . import shared_options
from .ensemble import MachineArguments
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..studies.calibration import CalibrateFound


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


def work(
    asked: Arguments,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    look: Callable[[int, int, int], None] = lambda done, total, left_out: None,
) -> "CalibrateFound":
    """Calibrate the parameters, and write the results.

    Parameters
    ----------
    asked : Arguments
    confirm : callable
        Question -> whether to start long runs.
    look : callable
        Called with (done, total, left out) a few times a second.

    Returns
    -------
    CalibrateFound
    """
    from ..studies.calibration import calibrate

    return calibrate(asked, confirm=confirm, look=look)


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
    with python_words(VERB):
        return work(complete(VERB, {"scene": scene, "output": output, **options}), confirm=confirm)
