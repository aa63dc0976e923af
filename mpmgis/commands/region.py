"""Simulate every release area of a region in its own window of one large DTM: `mpmgis region`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, TypedDict, Unpack

from ..system.option import Option, PathLike
from ..system.work_options import DASK
from . import shared_options
from .verb import Form, Verb
from .verb_calls import called

if TYPE_CHECKING:
    from ..studies.region_runs import RegionFound


class AreaFile(TypedDict, total=False):
    """The release areas, a parameter of its own in Python."""

    releases: Annotated[
        PathLike,
        Option(
            "release areas: polygons of any vector file, each with its own run",
            "FILE",
            folded=False,
            kind="polygon layer",
            label="Release areas",
        ),
    ]


class AreaOptions(TypedDict, total=False):
    """Scenarios and windows of the areas."""

    scenario: Annotated[
        str,
        Option(
            "column of the areas, for example the return period: also maps for each of its values",
            "COLUMN",
            folded=False,
            label="Column with the scenario",
        ),
    ]
    frequency: Annotated[
        str,
        Option(
            "column with the events a year of each area: maps of the frequency and of the annual probability",
            "COLUMN",
            folded=False,
            label="Column with the events a year",
        ),
    ]
    angle: Annotated[
        float,
        Option(
            "travel angle of the energy line for the first window",
            "A",
            unit="degrees",
            above=0,
            below=90,
            usual="atan of [friction] mu, of at least 0.1; 0.2 without a number mu",
            label="Travel angle for the first window",
        ),
    ]
    min_depth: Annotated[
        float,
        Option(
            "depth from which a cell counts as reached and flow has a velocity",
            "D",
            default=0.05,
            unit="m",
            above=0,
            label="Depth from which a cell counts as reached",
        ),
    ]


class MachineOptions(TypedDict, total=False):
    """Processes of a region."""

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
    """Processes of a region, and --yes of the command."""

    yes: Annotated[bool, shared_options.start_unasked("over an hour, or most of the memory")]


class RegionOptions(AreaOptions, MachineOptions, total=False):
    """Options of `mpmgis.region`."""

    overwrite: Annotated[
        bool,
        Option(
            "replace the region of another scene or other areas; runs of both are kept",
            default=False,
            folded=False,
            label="Replace the region of another scene in the folder",
        ),
    ]


class RegionChoices(AreaFile, RegionOptions, total=False):
    """All options of Python."""


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
    workflow="studies.region_runs:region",
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
            "Maps of many release areas",
            "Many runs",
            "Runs every release area of a region alone, each in its own automatic window of one large terrain model, "
            "and maps all together: largest depth, speed and pressure, number of areas that reach a cell, and with "
            "frequencies the probability of a year. A cancelled region continues when it is started again with the "
            "same folder.",
            load="the maps",
        ),
    ),
)


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
    return called(VERB, {"scene": scene, "releases": releases, "output": output, **options}, confirm=confirm)
