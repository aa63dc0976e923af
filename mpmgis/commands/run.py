"""Simulate a scene: `mpmgis run`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from ..system.errors import InputError
from ..system.option import Option, PathLike
from ..system.trusted_files import trusting
from ..system.work_options import OverwriteOptions
from . import shared_options
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..simulation.scene_run import RunSummary


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
    threads: Annotated[int, shared_options.THREADS]
    law: Annotated[PathLike, shared_options.LAW]
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
            "explained. 'Simulate from a form' needs no scene. Then 'Results to maps' makes GeoTIFFs.",
            changes=(("scene", {"optional": False}),),
        ),
    ),
)


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
    from ..simulation.scene_run import run as run_scene

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
        values = complete(VERB, given)
        require_one_start(values)
        return run_scene(scene, confirm=confirm, **{name: values[name] for name in given})


def require_one_start(values: dict[str, Any]) -> None:
    """Raise InputError if a run is to be both resumed and replaced.

    Parameters
    ----------
    values : dict
        All options of the verb.

    Raises
    ------
    InputError
    """
    if values["resume"] and values["overwrite"]:
        raise InputError("`resume` and `overwrite` contradict each other; give one of them")
