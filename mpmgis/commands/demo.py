"""Run the whole workflow on the shipped site: `mpmgis demo`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..system.option import Option, PathLike
from ..system.work_options import OverwriteOptions
from . import shared_options
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
    threads: Annotated[int, shared_options.THREADS]
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
    from .demo_site import demo as demonstrate

    with python_words(VERB):
        values = complete(VERB, {"output": output, "overwrite": overwrite, "threads": threads})
        return demonstrate(values["output"], overwrite=values["overwrite"], threads=values["threads"])


def sample_site() -> Path:
    """Return the folder of the shipped sample site, with scene.toml, a DTM and release areas.

    Examples
    --------
    >>> mpmgis.run(mpmgis.sample_site() / "scene.toml", "results")  # doctest: +SKIP
    """
    from .demo_site import sample_folder

    return sample_folder()
