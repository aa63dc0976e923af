"""Run the whole workflow on the shipped site: `mpmgis demo`."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..simulation.simulation_options import THREADS
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from ..system.work_options import OverwriteOptions
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..simulation.scene_run import RunSummary


class Arguments(OverwriteOptions, total=False):
    """Options of the command."""

    overwrite: Annotated[
        bool,
        Option("replace an earlier demo in that folder", default=False, folded=False, label="Replace an earlier demo"),
    ]
    threads: Annotated[int, THREADS]
    output: Annotated[
        PathLike,
        Option(
            "folder",
            "DIR",
            short="-o",
            default=Path("mpmgis_demo"),
            folded=False,
            kind="new folder",
            label="Folder for site, frames and maps",
        ),
    ]


VERB = Verb(
    name="demo",
    place=0,
    line="the whole workflow on the shipped sample site, in under two minutes",
    arguments=Arguments,
    example="""
mpmgis demo -o demo
""",
    forms=(
        Form(
            "Try it on the shipped site",
            "Simulate",
            "The whole workflow on a sample site (Lava Falls, Grand Canyon): seeds, simulates, makes the maps and "
            "opens them. It takes under two minutes; the first time it also compiles, about 50 seconds more.",
            project=True,
            plots=True,
            load="the maps",
            changes=(("output", {"optional": False, "default": None, "help": "It will contain the scene.toml."}),),
        ),
    ),
)


def work(
    asked: Arguments,
    watch: Callable[[Any, float, str], None] = lambda solver, end_time, left: None,
    progress: Progress = unwatched,
) -> tuple["RunSummary", Path, Path]:
    """Seed, run, export and draw the sample site.

    Parameters
    ----------
    asked : Arguments
    watch : callable
        Called with (solver, end time [s], wall time left in words) a few times a second.
    progress : callable
        Called with (frames done, frames in all) of the export.

    Returns
    -------
    (RunSummary, Path of the QGIS project, Path of the picture)
    """
    from .demo_site import demo as demonstrate

    return demonstrate(
        asked["output"], overwrite=asked["overwrite"], threads=asked["threads"], watch=watch, progress=progress
    )


def demo(
    output: PathLike = "mpmgis_demo", *, overwrite: bool = False, threads: int | None = None
) -> tuple["RunSummary", Path, Path]:
    """Run the whole workflow on the shipped sample site, as `mpmgis demo`.

    Parameters
    ----------
    output : path
        Folder.
    overwrite : bool
        Replace an earlier demo in that folder.
    threads : int, optional
        Processor threads.

    Returns
    -------
    (RunSummary, Path, Path)
        Of the run; the QGIS project and the picture.

    Examples
    --------
    >>> summary, project, picture = mpmgis.demo("demo")  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"output": output, "overwrite": overwrite, "threads": threads}))


def sample_site() -> Path:
    """Return the folder of the shipped sample site, with scene.toml, a DTM and release areas.

    Examples
    --------
    >>> mpmgis.run(mpmgis.sample_site() / "scene.toml", "results")  # doctest: +SKIP
    """
    from .demo_site import sample_folder

    return sample_folder()
