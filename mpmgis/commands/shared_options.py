"""Declare options of several verbs: terrain, averaging of frames, files of other codes, results, machine."""

from typing import Annotated, Literal, TypedDict

from .option import Option, PathLike

Auto = Literal["auto"]
TOML = "Scenes (*.toml)"
AVERAGED = "cells, averaged as export-raster does"
THIRD_PARTY = "another code's particle files"
_FRAMES = "frames (*.h5) of one run, another code's particle files, or the folder that holds them"
_RASTERS = ", or (the beginning of the names of) rasters named *_pft, *_pfv, *_ppr"
_RESULTS_FIELD = {"kind": "folder", "folded": False, "label": "Results: folder of frames, or of maps"}
FRAMES = Option(_FRAMES, "RESULTS", positional="many", kind="folder", folded=False, label="Results: folder of frames")
RESULTS = Option(f"{_FRAMES}, or an export", "RESULTS", positional="many", **_RESULTS_FIELD)
RESULTS_OR_RASTERS = Option(f"{_FRAMES}, or an export{_RASTERS}", "RESULTS", positional="many", **_RESULTS_FIELD)
SCENE = Option("the scene file (scene.toml)", "scene.toml", positional="one", folded=False, label="Scene", files=TOML)
AT_TIMES = Option(
    "times; the nearest frames are used",
    "T,..",
    unit="s",
    usual="five over the run",
    folded=False,
    label="Times, with commas",
)
POINTS = Option(
    "points, in any vector format; their names are in a column name",
    "FILE",
    kind="point layer",
    folded=False,
    label="Points",
    also=(
        {
            "name": "PLACE",
            "kind": "place",
            "label": "or: one place on the map",
            "help": "Click '...' and then the map.",
        },
    ),
)
AT = Option(
    "a point in the CRS of the DTM; repeatable",
    "E,N",
    default=(),
    unit="m",
    repeat=True,
    no_form="a place is clicked on the map, in any CRS",
)
LINE = Option(
    "path of the flow, from its top",
    "FILE",
    usual="its own centre line",
    kind="line layer",
    folded=False,
    label="Path of the flow, from its top",
)
THRESHOLD = Option(
    "minimum depth of a reached cell",
    "M",
    default=0.1,
    unit="m",
    above=0,
    folded=False,
    label="Minimum depth of a reached cell",
)
LIST_FILES = Option(
    "print the paths of all written files, not only the first", default=False, no_form="the form opens what is written"
)
JSON = Option("print JSON", default=False, no_form="for programs; the figures are in the log and in the tables")
LAW = Option(
    "Python file with your own friction law; it is executed",
    "FILE.py",
    files="Python (*.py)",
    label="Your own friction law: Python file, which is executed",
)
THREADS = Option(
    "number of processor threads; the result does not depend on it",
    "N",
    above=0,
    usual="one for every 10 000 particles, at most all",
    label="Processor threads",
)
DASK = Option("use the Dask cluster with this scheduler", "ADDRESS", label="Dask cluster: address of its scheduler")


def _target(text: str) -> str:
    authority, _, code = text.partition(":")
    known = text == "auto" or (authority.upper() == "EPSG" and code.isdigit())
    return "" if known else "auto or EPSG:n, for example EPSG:32632"


class MetricTerrainOptions(TypedDict, total=False):
    """What is done about a DTM that is not in metres."""

    to_crs: Annotated[
        str,
        Option(
            "reproject the DTM, and rasters in another CRS than it, to this CRS in metres, and heights in feet to "
            "metres; auto: the CRS of the frames, else that of the DTM where it is in metres, else the UTM zone of its "
            "centre",
            "EPSG:n|auto",
            usual="what is not in metres is refused",
            check=_target,
            kind="text",
            label="Reproject the terrain to: auto, or EPSG:n",
        ),
    ]


class FrameTerrainOptions(MetricTerrainOptions, total=False):
    """Band and CRS of the DTM of frames."""

    dem_band: Annotated[
        int,
        Option(
            "band of the DTM with the elevation, where it has several",
            "N",
            above=0,
            label="Band of the terrain model with the elevation",
        ),
    ]
    crs: Annotated[
        str,
        Option(
            "CRS of a DTM without one, and of another code's files; local: metres without a position on the map",
            "EPSG:n|local",
            kind="CRS",
            label="CRS, where the files carry none",
        ),
    ]


class TerrainOptions(FrameTerrainOptions, total=False):
    """The DTM of frames."""

    dem: Annotated[
        PathLike,
        Option(
            "DTM; elevation in metres",
            "FILE",
            usual="the one that the frames name",
            kind="raster layer",
            label="Terrain model, if not the one that the frames name",
        ),
    ]


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


class DensityOptions(TypedDict, total=False):
    """Density of the release."""

    density: Annotated[
        float,
        Option(
            "density of the release, where the frames have none",
            "R",
            unit="kg m-3",
            above=0,
            label="Density, where the frames have none",
        ),
    ]


class AveragingOptions(DensityOptions, total=False):
    """How the cells of frames are averaged."""

    percentile: Annotated[
        float,
        Option(
            "percentile of the particles' distances from the bed, by mass, taken as depth; 100 is the highest",
            "P",
            default=100.0,
            unit="%",
            above=0,
            most=100,
            label="Percentile of the particles' heights taken as depth",
        ),
    ]


class CellOptions(AveragingOptions, total=False):
    """Averaging of cells for questions about results."""

    standoff: Annotated[
        float,
        Option(
            "height above the DTM, along its normal, at which particles of a 3D code rest",
            "M",
            default=0.0,
            unit="m",
            least=-100,
            most=100,
            label="Height above the terrain at which particles of a 3D code rest",
        ),
    ]


class SizedCellOptions(CellOptions, total=False):
    """Averaging and size of cells for questions about results."""

    cell_size: Annotated[
        float,
        Option(
            "cell size",
            "M",
            unit="m",
            flag="--cs-e",
            above=0,
            usual="the finer of the cells of DTM and run",
            field="CELL",
            label="Cell size",
        ),
    ]
    min_depth: Annotated[
        float,
        Option(
            "velocities of flow shallower than this are left out",
            "D",
            default=0.05,
            unit="m",
            above=0,
            label="Velocities of flow shallower than this are left out",
        ),
    ]


class OverwriteOptions(TypedDict, total=False):
    """Whether earlier files are replaced."""

    overwrite: Annotated[
        bool,
        Option(
            "replace earlier files of that name",
            default=False,
            folded=False,
            label="Replace earlier files of that name",
        ),
    ]


class FrameQuestionOptions(OverwriteOptions, TerrainOptions, CellOptions, DeclarationOptions, total=False):
    """Options of questions about frames whose cell size is fixed."""


class QuestionOptions(OverwriteOptions, TerrainOptions, SizedCellOptions, DeclarationOptions, total=False):
    """Options of every question about results."""


FRAME_GROUPS = (("terrain", TerrainOptions), (AVERAGED, CellOptions), (THIRD_PARTY, DeclarationOptions))
GROUPS = (("terrain", TerrainOptions), (AVERAGED, SizedCellOptions), (THIRD_PARTY, DeclarationOptions))


def output(word: str, files: str, label: str) -> Option:
    """Return the option -o of an answer that consists of several files.

    Parameters
    ----------
    word : str
        The default folder is `<name of the results>_<word>`.
    files : str
        Words for the files in the help of the command.
    label : str
        Words for the files in the form of QGIS.

    Returns
    -------
    Option
    """
    usual = f"<name>_{word} beside the results"
    return Option(
        f"folder for {files}, or one file by its suffix; - prints the table",
        "PATH",
        short="-o",
        usual=usual,
        folded=False,
        kind="new folder",
        label=f"Folder for {label}, if not {usual}",
    )


def start_unasked(long: str) -> Option:
    """Return the option --yes of a verb that can take long.

    Parameters
    ----------
    long : str
        Words for how long, in the form of QGIS.

    Returns
    -------
    Option
    """
    return Option(
        "do not ask about predicted time and memory",
        default=False,
        folded=False,
        label=f"Start even if predicted to take {long}",
    )
