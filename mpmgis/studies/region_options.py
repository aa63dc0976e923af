"""Options of a region: its release areas, scenarios and windows."""

from typing import Annotated, TypedDict

from ..maps.qgis.page_options import PageOptions
from ..system.option import Option, PathLike
from .many_runs_options import MachineOptions


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
            field="RELEASE",
        ),
    ]


class AreaOptions(PageOptions, total=False):
    """Scenarios and windows of the areas."""

    scenario: Annotated[
        str,
        Option(
            "column of the areas, for example the return period: also maps for each of its values",
            "COLUMN",
            folded=False,
            kind="any column",
            label="Column with the scenario",
        ),
    ]
    frequency: Annotated[
        str,
        Option(
            "column with the events a year of each area: maps of the frequency and of the annual probability",
            "COLUMN",
            folded=False,
            kind="column",
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


class AskedRegion(RegionChoices, total=False):
    """A region: options, the scene and the folder to write."""

    scene: PathLike
    output: PathLike
