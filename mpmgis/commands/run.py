"""Simulate a scene: `mpmgis run`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from ..simulation.simulation_options import LAW, THREADS
from ..system.errors import InputError
from ..system.option import Option, PathLike
from ..system.trusted_files import trusting
from ..system.work_options import OverwriteOptions
from . import shared_options
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..simulation.scene_run import RunSummary


OF_RUN = ("output", "overwrite", "resume", "threads", "law", "device")  # options that the simulation takes


class Arguments(OverwriteOptions, total=False):
    """Options of the command."""

    scene: Annotated[
        PathLike,
        Option(
            "the scene to simulate",
            "scene.toml",
            positional="maybe",
            folded=False,
            label="Scene",
            files=shared_options.TOML,
        ),
    ]
    resume: Annotated[
        bool,
        Option(
            "continue after the last complete frame in that folder",
            default=False,
            folded=False,
            label="Continue after the last complete frame",
        ),
    ]
    overwrite: Annotated[
        bool,
        Option(
            "replace the frames of an earlier run in that folder",
            default=False,
            folded=False,
            label="Replace the frames of an earlier run in the folder",
        ),
    ]
    yes: Annotated[bool, shared_options.start_unasked("over an hour")]
    threads: Annotated[int, THREADS]
    law: Annotated[PathLike, LAW]
    device: Annotated[
        Literal["cpu", "cuda", "auto"],
        Option(
            "what computes the steps: cpu; cuda (a GPU of NVIDIA); auto: cuda, if there is one, for many particles",
            usual="[numerics] device of the scene",
            label="Device that computes the steps",
        ),
    ]
    template: Annotated[
        bool,
        Option(
            "print a commented scene and stop",
            default=False,
            no_form="'Simulate from a form' writes a scene to start from",
        ),
    ]
    schema: Annotated[
        bool,
        Option("print the JSON Schema of scenes, for editors, and stop", default=False, no_form="for text editors"),
    ]
    output: Annotated[
        PathLike,
        Option(
            "folder for frames",
            "DIR",
            short="-o",
            usual="results beside the scene",
            folded=False,
            kind="new folder",
            label="Folder for frames, if not results beside the scene",
        ),
    ]


VERB = Verb(
    name="run",
    place=3,
    line="simulate a scene",
    arguments=Arguments,
    trust=True,
    example="""
mpmgis run --template > scene.toml
mpmgis run --schema > scene.schema.json
mpmgis run scene.toml -o results
""",
    forms=(
        Form(
            "Simulate a scene file",
            "Simulate",
            "Simulates a scene.toml, depth-averaged or in 3D, and writes frames of particles, with balances of mass "
            "and energy in the log. A scene contains all settings; 'mpmgis run --template' prints one with every key "
            "explained. 'Simulate from a form' needs no scene. Then 'Make maps of results' makes GeoTIFFs.",
            changes=(("scene", {"optional": False}),),
        ),
    ),
)


def work(
    asked: Arguments,
    confirm: Callable[[str], bool],
    watch: Callable[[Any, float, str], None] = lambda solver, end_time, left: None,
    scene: PathLike | Mapping[str, Any] | None = None,
) -> "RunSummary":
    """Simulate the scene.

    Parameters
    ----------
    asked : Arguments
    confirm : callable
        Called with a question before a run that takes hours or most of the memory; if it returns False, nothing is run.
    watch : callable
        Called with (solver, end time [s], wall time left in words) a few times a second.
    scene : path or mapping, optional
        In place of that of `asked`.

    Returns
    -------
    RunSummary

    Raises
    ------
    InputError
        No scene, or a run is to be both resumed and replaced.
    """
    scene = asked["scene"] if scene is None else scene
    if scene is None:
        raise InputError("no scene is given; give scene.toml, or --template to print one")
    if asked["resume"] and asked["overwrite"]:
        raise InputError("`resume` and `overwrite` contradict each other; give one of them")
    from ..simulation.scene_run import run as run_scene

    own: dict[str, Any] = {name: asked.get(name) for name in OF_RUN}
    return run_scene(scene, **own, confirm=confirm, watch=watch)


def run(
    scene: PathLike | Mapping[str, Any],
    output: PathLike | None = None,
    *,
    overwrite: bool = False,
    resume: bool = False,
    threads: int | None = None,
    laws: PathLike | None = None,
    device: str | None = None,
    trust: bool = False,
    confirm: Callable[[str], bool] = lambda question: True,
) -> "RunSummary":
    """Simulate a scene into a folder of frames, as `mpmgis run`.

    Parameters
    ----------
    scene : path or mapping
        A scene.toml, or its tables as a dictionary, with paths relative to the current folder.
    output : path, optional
        Folder; default ``results`` beside the scene.
    overwrite : bool
        Replace the frames of an earlier run.
    resume : bool
        Continue after the last complete frame.
    threads : int, optional
        Processor threads; the result does not depend on them.
    laws : path, optional
        Python file with your own friction law; it is executed.
    device : {"cpu", "cuda", "auto"}, optional
        What computes the steps; default [numerics] device of the scene.
    trust : bool
        Follow links of the scene's files to the network and to other files.
    confirm : callable
        Called with a question before a run that takes hours or most of the memory; if it returns False, nothing is run.

    Returns
    -------
    RunSummary
        With `folder`, `frames`, `time` [s], `reason`, `balances`, ...

    Raises
    ------
    MpmgisError
        Before the first step: nothing is written. `UnphysicalError`: the run stopped; all frames written are complete.

    Examples
    --------
    >>> summary = mpmgis.run("scene.toml", "results")  # doctest: +SKIP
    """
    if not isinstance(scene, (str, Path, Mapping)):
        raise InputError(f"scene is {scene!r}, expected a path or a mapping of its tables")
    given = {
        "output": output,
        "overwrite": overwrite,
        "resume": resume,
        "threads": threads,
        "law": laws,
        "device": device,
    }
    with python_words(VERB), trusting(trust):
        return work(complete(VERB, given), confirm, scene=scene)
