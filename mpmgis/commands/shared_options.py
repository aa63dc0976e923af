"""Declare options of several verbs: terrain, results, places, files to write, what is printed and asked."""

from ..system.option import Option

TOML = "Scenes (*.toml)"
_FRAMES = "frames (*.h5) of one run, another code's particle files, or the folder that holds them"
_RASTERS = ", or (the beginning of the names of) rasters named *_pft, *_pfv, *_ppr"
_RESULTS_FIELD = {"kind": "folder", "folded": False, "label": "Results: folder of frames, or of maps"}
FRAMES = Option(_FRAMES, "RESULTS", positional="many", kind="folder", folded=False, label="Results: folder of frames")
RESULTS = Option(f"{_FRAMES}, or an export", "RESULTS", positional="many", **_RESULTS_FIELD)
RESULTS_OR_RASTERS = Option(f"{_FRAMES}, or an export{_RASTERS}", "RESULTS", positional="many", **_RESULTS_FIELD)
SCENE = Option("the scene file (scene.toml)", "scene.toml", positional="one", folded=False, label="Scene", files=TOML)
DEM = Option(
    "DTM: any raster that GDAL reads, in a projected CRS in metres",
    "FILE",
    required=True,
    folded=False,
    kind="raster layer",
    label="Terrain model (DTM)",
)
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
