"""Simulate every release area of a region in its own window of one large DTM: `mpmgis region`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Unpack

from ..studies.region_options import AreaFile, AreaOptions, RegionChoices, RegionOptions
from ..system.option import Option, PathLike
from . import shared_options
from .ensemble import MachineArguments
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..studies.region_runs import RegionFound


class AreaGroup(AreaFile, AreaOptions, total=False):
    """Release areas."""


class Arguments(RegionChoices, MachineArguments, total=False):
    """Options of the command."""

    scene: Annotated[PathLike, shared_options.SCENE]
    list_files: Annotated[bool, shared_options.LIST_FILES]
    output: Annotated[
        PathLike,
        Option(
            "folder for runs and maps",
            "DIR",
            short="-o",
            usual="region beside the scene",
            folded=False,
            kind="new folder",
            label="Folder for runs and maps, if not region beside the scene",
        ),
    ]


VERB = Verb(
    name="region",
    place=23,
    line="every release area of a region in its own window of one large DTM",
    options=RegionChoices,
    arguments=Arguments,
    groups=(("release areas", AreaGroup), ("machine", MachineArguments)),
    example="""
mpmgis region scene.toml --releases areas.gpkg --scenario return_period --frequency per_year -o region
""",
    description="""
Runs every polygon alone, each in its own window of the DTM, which is read by part. The first window contains the ground
below an energy line; where the flow reaches an edge of the window that is not an edge of the DTM, the area is run again
in a larger window, and this is reported. Maps on the DTM's grid, sparse where nothing flows: largest depth, speed and
pressure, number of areas that reach a cell, and number of the area with the largest depth; areas.gpkg contains the
affected area and the other results of each release area; maps/region.qgz shows all of it in QGIS. A second start
continues an interrupted region. A Python script that calls mpmgis.region with more than one worker must do so under
if __name__ == "__main__".
""",
    forms=(
        Form(
            "Map flows of many release areas",
            "Many runs",
            "Runs every release area of a region alone, each in its own automatic window of one large terrain model, "
            "and maps all together: largest depth, speed and pressure, number of areas that reach a cell, and with "
            "frequencies the probability of a year. A cancelled region continues when it is started again with the "
            "same folder.",
            load="the maps",
        ),
    ),
)


def work(
    asked: Arguments,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    look: Callable[[int, int, int], None] = lambda done, total, left_out: None,
) -> "RegionFound":
    """Run every release area, and write the results.

    Parameters
    ----------
    asked : Arguments
    confirm : callable
        Question -> whether to start long runs.
    look : callable
        Called with (done, total, left out) a few times a second.

    Returns
    -------
    RegionFound
    """
    from ..studies.region_runs import region

    return region(asked, confirm=confirm, look=look)


def region(
    scene: PathLike,
    releases: PathLike,
    output: PathLike | None = None,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    **options: Unpack[RegionOptions],
) -> "RegionFound":
    """Simulate every release area of a region in its own window of one large DTM, as `mpmgis region`.

    Parameters
    ----------
    scene : path
        Its [release] needs no source.
    releases : path
        Polygons.
    output : path, optional
        Folder; default ``region`` beside the scene.
    confirm : callable
        Called with a question before runs of hours; if it returns False, nothing is run.
    **options
        `RegionOptions`: scenario, frequency, angle, workers, ...

    Returns
    -------
    RegionFound
        With the `folder`, the `files` (the table of areas first) and the `statuses` of the areas.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> found = mpmgis.region("scene.toml", "areas.gpkg", scenario="return_period")  # doctest: +SKIP
    """
    with python_words(VERB):
        asked = complete(VERB, {"scene": scene, "releases": releases, "output": output, **options})
        return work(asked, confirm=confirm)
