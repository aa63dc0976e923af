"""Where frames come from: their files, their DTM, and what the user declares about files of another code."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, TypedDict

from ..frames.frame_options import DensityOptions, TerrainOptions
from ..system.option import Option, PathLike

if TYPE_CHECKING:
    from .declarations import Declarations
    from .frame_list import FrameEntry
    from .map_coordinates import Ground

THIRD_PARTY = "another code's particle files"  # title of the group of DeclarationOptions in the help


class DeclarationOptions(TypedDict, total=False):
    """Data that another code's particle files do not contain (`declarations.Declarations`)."""

    reader: Annotated[
        str,
        Option(
            "code that wrote the files",
            "NAME",
            usual="detected from their contents",
            label="Another code: name of its reader",
        ),
    ]
    origin: Annotated[
        tuple[float, float, float],
        Option(
            "map position of the files' own origin",
            "E,N,H",
            usual="0,0,0 where the particles then lie on the DTM",
            unit="m",
            label="Another code: map position of its origin, E,N,H",
        ),
    ]
    axes: Annotated[
        tuple[str, str, str],
        Option(
            "directions of the files' x, y, z: e east, n north, u up, minus for the opposite; e,u,-n (y is up)",
            "X,Y,Z",
            usual="e,n,u where the particles then lie on the DTM",
            label="Another code: directions of its x,y,z, for example e,u,-n",
        ),
    ]
    times: Annotated[
        tuple[float, ...],
        Option(
            "time of each file, in the order of their numbers",
            "T,..",
            unit="s",
            label="Another code: times of its files, with commas",
        ),
    ]
    frame_step: Annotated[
        float,
        Option(
            "or: time from one file number to the next",
            "S",
            unit="s",
            flag="--dt",
            above=0,
            field="DT",
            label="Another code: time between frames",
        ),
    ]
    frames_per_second: Annotated[
        float,
        Option(
            "or: file numbers per second",
            "F",
            unit="1/s",
            flag="--fps",
            above=0,
            field="FPS",
            label="Another code: frames per second",
        ),
    ]
    columns: Annotated[
        tuple[tuple[str, str], ...],
        Option(
            "the files' columns for x, y, z, vx, vy, vz, mass, volume, density, radius, diameter, id, active, time, "
            "where they have other names; with three components each: position, velocity",
            "NAME=COL,..",
            default=(),
            label="Another code: its columns, NAME=COLUMN with commas",
        ),
    ]
    particle_volume: Annotated[
        float,
        Option(
            "volume of every particle, where the files have none",
            "V",
            unit="m3",
            above=0,
            label="Another code: volume of a particle",
        ),
    ]
    sidecar: Annotated[
        PathLike,
        Option(
            "JSON file with these declarations; options override it",
            "FILE",
            usual="<name>.georef.json or georef.json beside the files",
            label="Another code: file with these declarations",
            files="Sidecars (*.json)",
        ),
    ]


class ThirdPartyOptions(DeclarationOptions, total=False):
    """Data that another code's particle files do not contain, with CRS and density."""

    crs: Annotated[str, Option("CRS of the files", "EPSG:n|local", kind="CRS", label="CRS, where the files carry none")]
    density: Annotated[
        float,
        Option("density of the material", "R", unit="kg m-3", above=0, label="Density, where the frames have none"),
    ]


class SourceOptions(TerrainOptions, DensityOptions, DeclarationOptions, total=False):
    """All that the user says about frames."""


def frames_at(paths: Sequence[PathLike], asked: SourceOptions) -> "Sequence[FrameEntry]":
    """List the frames at paths, by time.

    Parameters
    ----------
    paths : sequence of path
    asked : SourceOptions

    Returns
    -------
    sequence of FrameEntry

    Raises
    ------
    MpmgisError
        No frames, or declarations are missing or wrong.
    """
    from .frame_list import list_frames

    return list_frames(paths, terms_of(asked), ground_of(asked))


def terms_of(asked: SourceOptions) -> "Declarations":
    """Return the declarations, checked.

    Parameters
    ----------
    asked : SourceOptions
    """
    from .declarations import Declarations

    return Declarations.named({**asked, "dem": None}, asked["crs"])


def ground_of(asked: TerrainOptions) -> "Ground":
    """Return the DTM of frames, where it is given.

    Parameters
    ----------
    asked : TerrainOptions
    """
    from .map_coordinates import Ground

    return Ground(dem=asked["dem"], crs=asked["crs"], band=asked["dem_band"], to_crs=asked["to_crs"])
