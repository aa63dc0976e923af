"""Convert columns to 3D points, and back; write start files of other 3D solvers: `mpmgis convert`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypedDict, Unpack, cast

from ..conversion.start_options import SolverOptions
from ..exchange.frame_source import THIRD_PARTY, DeclarationOptions
from ..frames.frame_options import DensityOptions, TerrainOptions
from ..system.errors import InputError
from ..system.option import Option, PathLike, options_of
from ..system.work_options import OverwriteOptions
from .seed import ANOTHER, FOLDER_OF_SOLVER, PARTICLES, WRITES
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    from ..conversion.conversion_options import ColumnOptions, PointOptions
    from ..conversion.frame_conversion import Written
    from ..conversion.start_folder import StartWritten

FRAME_FILES = "mpmgis frames (*.h5)"
_POINTS_ONLY = ("spacing", "vertical_velocity", "paper", "relevel")
_COLUMNS_ONLY = ("by", "detached")


class ConvertPointOptions(TypedDict, total=False):
    """How columns become points."""

    spacing: Annotated[
        float,
        Option(
            "vertical distance of points",
            "R",
            unit="m",
            above=0,
            folded=False,
            usual="half of --cell; without it the median column's side",
            label="To points: their vertical distance",
        ),
    ]
    vertical_velocity: Annotated[
        Literal["tangent", "paper", "linear"],
        Option(
            "tangent: along the bed; paper: 0; linear: along the bed and linear above it, as in an incompressible "
            "column, for which the frame must keep its state",
            usual="tangent",
            label="To points: vertical velocity",
        ),
    ]
    relevel: Annotated[
        bool,
        Option(
            "with --cell: raise overlapping columns to the height that their mass fills",
            default=False,
            label="To points: raise overlapping columns",
        ),
    ]
    paper: Annotated[
        bool,
        Option(
            "conversion exactly as printed in MOX report 15/2025; its errors are reported",
            default=False,
            label="To points: exactly as printed in the report",
        ),
    ]


class ConvertColumnOptions(TypedDict, total=False):
    """How points become columns."""

    by: Annotated[
        Literal["parent", "cell"],
        Option(
            "gather points by the column that they came from, or by cell",
            usual="parent where points have one and are still close together",
            label="To columns: gather points by",
        ),
    ]
    detached: Annotated[
        Literal["refuse", "keep"],
        Option(
            "mass above the bed or leaving it: refuse (error), or keep as points in <output>_points.h5",
            usual="refuse",
            label="To columns: mass that has left the bed",
        ),
    ]


class ConversionOptions(
    OverwriteOptions,
    ConvertPointOptions,
    ConvertColumnOptions,
    TerrainOptions,
    DeclarationOptions,
    DensityOptions,
    total=False,
):
    """Options of `mpmgis.convert`."""

    to: Annotated[
        Literal["points", "columns"],
        Option("convert to", usual="columns to points, points to columns", folded=False, label="Convert to"),
    ]
    cell: Annotated[
        float,
        Option(
            "to points: grid spacing of the 3D code, columns wider than half of it are split horizontally; "
            "to columns: cell size for points without a column [m]",
            "M",
            least=1e-6,
            folded=False,
            usual="no split; the DTM's cells",
            label="Cell size of the 3D grid, or of the columns [m]",
        ),
    ]
    at_time: Annotated[
        float,
        Option("frame of this time, where the file or folder holds several", "S", unit="s", label="Frame of this time"),
    ]


class SolverStartOptions(
    OverwriteOptions, ConvertPointOptions, TerrainOptions, DeclarationOptions, DensityOptions, total=False
):
    """Options of `mpmgis.solver_start`."""

    cell: Annotated[float, options_of(ConversionOptions)["cell"]]
    at_time: Annotated[float, options_of(ConversionOptions)["at_time"]]
    material: Annotated[PathLike, options_of(SolverOptions)["material"]]
    window: Annotated[tuple[float, float, float, float], options_of(SolverOptions)["window"]]


class Arguments(ConversionOptions, SolverOptions, total=False):
    """Options of the command."""

    source: Annotated[
        tuple[PathLike, ...],
        Option(
            "frame of columns or points (.h5), or another code's particle file; several with --for",
            "FRAME",
            positional="many",
            kind="file",
            field="FRAME",
            folded=False,
            label="Frame of columns or points",
            files=FRAME_FILES + ";;All files (*)",
        ),
    ]
    output: Annotated[
        PathLike,
        Option(
            "file to write; columns also as .csv, .json, .gpkg, .parquet, .vtp, points also as a .las point "
            "cloud; with --for a folder",
            "FILE",
            short="-o",
            usual="<name>_points.h5 or <name>_columns.h5",
            folded=False,
            kind="new file",
            label="Converted frame",
            files=FRAME_FILES + ";;" + PARTICLES.replace("mpmgis frame (*.h5);;", ""),
        ),
    ]


VERB = Verb(
    name="convert",
    place=2,
    line="columns to 3D points, and back (Algorithm 2 of MOX report 15/2025)",
    options=ConversionOptions,
    arguments=Arguments,
    trust=True,
    groups=(
        ("to points", ConvertPointOptions),
        ("to columns", ConvertColumnOptions),
        ("terrain", TerrainOptions),
        ("for another 3D solver", SolverOptions),
        (THIRD_PARTY, DeclarationOptions),
        (THIRD_PARTY, DensityOptions),
    ),
    example="""
mpmgis convert area_particles.h5 --cell 1
mpmgis convert results/frame_000015.h5 --spacing 0.5 -o impact.h5
mpmgis convert impact.h5 --to columns --cell 5
mpmgis convert impact.h5 -o points.las
mpmgis convert area_particles.h5 --for kratos --cell 1 --material slide.toml
mpmgis convert results/*.h5 --for paraview
mpmgis convert particles_f30.ply --to columns --dem dtm.tif --axes e,u,-n --origin 600000,5170000,0 --density 1500
""",
    forms=(
        Form(
            "Convert columns to 3D points, and back",
            "Simulate",
            "Fills a frame of depth-averaged columns with 3D points (Algorithm 2 of MOX report 15/2025), or gathers "
            "points, also of another code, into columns. Mass and momentum are conserved.",
            layers=(".gpkg", ".json", ".parquet"),
            load="columns that are a layer",
            without=("solver", "material", "window"),
            changes=(("output", {"optional": False}),),
        ),
        Form(
            "Write frames for another 3D code",
            ANOTHER,
            "Writes frames of a run for another code or viewer. " + WRITES,
            name="convertfor",
            only=(
                "solver",
                "source",
                "cell",
                "spacing",
                "material",
                "window",
                "dem",
                "crs",
                "dem_band",
                "overwrite",
                "output",
            ),
            changes=(
                ("solver", {"optional": False}),
                ("output", FOLDER_OF_SOLVER),
                ("window", {"kind": "text"}),
                (
                    "source",
                    {"name": "FRAMES", "kind": "files", "label": "Frames of columns or points", "files": FRAME_FILES},
                ),
            ),
        ),
    ),
)


def work(asked: Arguments) -> "Written | StartWritten":
    """Convert a frame, or write start files of another solver.

    Parameters
    ----------
    asked : Arguments

    Returns
    -------
    Written or StartWritten

    Raises
    ------
    InputError
        Options that exclude each other.
    """
    return _converted(asked) if asked["solver"] is None else _started(asked)


def _converted(asked: Arguments) -> "Written":
    from ..conversion import frame_conversion as workflow
    from ..frames.point_cloud import is_point_cloud

    if len(asked["source"]) > 1:
        raise InputError(
            f"{len(asked['source'])} frames, expected one; `solver=paraview` and `solver=houdini` take several"
        )
    for name in ("material", "window"):
        if asked.get(name) is not None:
            raise InputError(f"`{name}` requires `solver`; leave it out, or name the solver")
    dimension = workflow.dimension_of(asked)
    to = asked["to"] or ("points" if dimension == 2 else "columns")
    if (
        asked["output"] is not None
        and is_point_cloud(Path(asked["output"]))
        and dimension == 3
        and asked["to"] != "columns"
    ):
        unused = (*_POINTS_ONLY, *_COLUMNS_ONLY, "cell", "dem", "dem_band")
        _refuse_given(asked, unused, "has no effect where points stay points")
        return workflow.write_point_cloud(asked)
    if to == "points":
        return workflow.convert_to_points(asked, _point_options(asked))
    return workflow.convert_to_columns(asked, _column_options(asked))


def _started(asked: Arguments) -> "StartWritten":
    from ..conversion.start_folder import convert_for_solver

    if asked["to"] == "columns":
        raise InputError(f"`to=columns`: {asked['solver']} starts from points; leave it out")
    _refuse_given(asked, _COLUMNS_ONLY, "requires `to=columns`")
    of_points = any(asked.get(name) for name in _POINTS_ONLY)
    options = _point_options(asked) if of_points or asked["cell"] else None
    return convert_for_solver(asked, options, of_points)


def _point_options(asked: Arguments) -> "PointOptions":
    from ..conversion.conversion_options import PointOptions

    _refuse_given(asked, _COLUMNS_ONLY, "requires `to=columns`")
    if asked["paper"]:
        _refuse_given(asked, ("vertical_velocity", "relevel", "cell"), "contradicts `paper`")
        return PointOptions.as_printed(asked["spacing"])
    return PointOptions(
        spacing=asked["spacing"],
        vertical_velocity=asked["vertical_velocity"] or "tangent",
        cell=asked["cell"],
        relevel=asked["relevel"],
    )


def _column_options(asked: Arguments) -> "ColumnOptions":
    from ..conversion.conversion_options import REFUSE, ColumnOptions

    _refuse_given(asked, _POINTS_ONLY, "requires `to=points`")
    return ColumnOptions(by=asked["by"], cell=asked["cell"], detached=asked["detached"] or REFUSE)


def _refuse_given(asked: Arguments, names: tuple[str, ...], why: str) -> None:
    for name in names:
        if asked.get(name):
            raise InputError(f"`{name}` {why}; leave it out")


def convert(source: PathLike, output: PathLike | None = None, **options: Unpack[ConversionOptions]) -> "Written":
    """Convert a frame of columns to points, or of points to columns, as `mpmgis convert`.

    The conversion is Algorithm 2 of MOX report 15/2025.

    Parameters
    ----------
    source : path
        A frame of mpmgis or another code's particle file.
    output : path, optional
        Default ``<name>_points.h5`` or ``<name>_columns.h5`` in the current folder.
    **options
        `ConversionOptions`: to, cell [m], spacing [m], dem, ...

    Returns
    -------
    Written
        With `path`, `rest` (points that stay points, or None) and the `report` of mass and momentum.

    Raises
    ------
    MpmgisError
        Before anything is written.

    Examples
    --------
    >>> mpmgis.convert("particles.h5", "points.h5", cell=1.0)  # doctest: +SKIP
    """
    with python_words(VERB):
        return cast("Written", work(complete(VERB, {"source": (source,), "output": output, **options})))


def solver_start(
    source: Results, solver: str, output: PathLike | None = None, **options: Unpack[SolverStartOptions]
) -> "StartWritten":
    """Write start files of another 3D solver from frames, as `mpmgis convert --for`.

    Parameters
    ----------
    source : path or several
        Frames of columns or points.
    solver : {"kratos", "cbgeo", "geotaichi", "mpm-geomechanics", "houdini", "paraview"}
    output : path, optional
        Folder; default ``<name>_<solver>`` in the current folder.
    **options
        `SolverStartOptions`: cell [m], material (TOML file), window (west, south, east, north) [m], ...

    Returns
    -------
    StartWritten
        With the folder `path`, and `count`, `mass` [kg] and `volume` [m3] of the points of the first frame.

    Raises
    ------
    MpmgisError
        Before anything is written.

    Examples
    --------
    >>> mpmgis.solver_start("particles.h5", "kratos", cell=1.0, material="slide.toml")  # doctest: +SKIP
    """
    given = {"source": several(source), "solver": solver, "output": output, **options}
    with python_words(VERB):
        return cast("StartWritten", work(complete(VERB, given)))
