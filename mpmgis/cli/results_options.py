"""What every question about results is asked with: the results, their terrain and cells, other codes' files."""

from pathlib import Path

from . import foreign_options
from .export_raster import add_percentile, add_terrain_options
from .values import number, positive


def add_arguments(parser, exports=True, cells=True, rasters=False):
    """Declare RESULTS, --overwrite and the groups of options.

    `exports`: an exported folder will do, `rasters`: other codes' rasters of largest values too.
    `cells`: their size can be chosen.
    """
    also = ", or an export" if exports else ""
    also += ", or (the beginning of the names of) rasters called *_pft, *_pfv, *_ppr" if rasters else ""
    frames = "frames (*.h5) of one run, another code's particle files, or the folder that holds them"
    parser.add_argument("frames", nargs="+", metavar="RESULTS", help=frames + also)
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier answer of that name")
    add_terrain_options(parser.add_argument_group("terrain"))
    group = parser.add_argument_group("cells, averaged as export-raster does")
    if cells:
        group.add_argument(
            "--cs-e", type=positive, metavar="M", dest="cell_size", help="cell size [m] (default: the DTM's own cells)"
        )
        group.add_argument(
            "--min-depth",
            type=positive,
            metavar="D",
            default=0.05,
            help="velocities of flow shallower than this [m] are left out (default 0.05)",
        )
    add_percentile(group)
    group.add_argument("--standoff", type=number, metavar="M", default=0.0, help="as of export-raster (default 0)")
    group.add_argument(
        "--density", type=positive, metavar="R", help="of the release [kg m-3], where the frames do not say it"
    )
    foreign_options.add_arguments(parser.add_argument_group("another code's particle files"))


def add_output(parser, word, files):
    """Declare -o of an answer that is made of `files`, in words, in a folder called after the results and `word`."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="PATH",
        help=f"folder for {files}, or one file by its suffix (default: <name>_{word} beside the results)",
    )


def request(arguments):
    """The ExportRequest of the parsed arguments: which results, and how their cells are averaged."""
    from ..workflows.export import ExportRequest

    asked = {key: value for key, value in vars(arguments).items() if key in ExportRequest.__dataclass_fields__}
    return ExportRequest(**asked | {"frames": tuple(arguments.frames), "output": None, "overwrite": False})


def answer_request(kind, arguments):
    """The request of class `kind` (an AnswerRequest) that the parsed arguments make."""
    asked = {key: value for key, value in vars(arguments).items() if key in kind.__dataclass_fields__}
    asked = {key: tuple(value) if isinstance(value, list) else value for key, value in asked.items()}
    return kind(**asked | {"results": request(arguments)})


def tell(ask):
    """Call `ask(progress)`; its messages are printed after success, or at once with -v."""
    from . import talk
    from .progress import frame_progress

    with talk.notes_after_success():
        return ask(frame_progress)
