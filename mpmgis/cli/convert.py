"""`mpmgis convert`: columns to 3D points, and back."""

from pathlib import Path

from . import foreign_options, solver_options, talk
from .values import count, number, positive

EXAMPLE = """
mpmgis convert area_particles.h5 --cell 1
mpmgis convert results/frame_000015.h5 --spacing 0.5 -o impact.h5
mpmgis convert impact.h5 --to columns --cell 5
mpmgis convert impact.h5 -o points.las
mpmgis convert area_particles.h5 --for kratos --cell 1 --material slide.toml
mpmgis convert results/*.h5 --for paraview
mpmgis convert particles_f30.ply --to columns --dem dtm.tif --axes e,u,-n --origin 600000,5170000,0 --density 1500
"""
_POINTS_ONLY = ("spacing", "vertical_velocity", "paper", "relevel")
_COLUMNS_ONLY = ("by", "detached")


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument(
        "source",
        type=Path,
        nargs="+",
        metavar="FRAME",
        help="frame of columns or points (.h5), or another code's particle file; several with --for",
    )
    parser.add_argument(
        "--to", choices=("points", "columns"), help="what to make of it (default: points of columns and the reverse)"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="file to write; columns also as .csv, .json, .gpkg, .parquet, .vtp, points also as a .las point cloud "
        "(default: <name>_points.h5 or <name>_columns.h5); with --for a folder",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier file or folder of that name")
    parser.add_argument(
        "--cell",
        type=positive,
        metavar="M",
        help="to points: grid spacing of the 3D code to be filled; columns wider than half of it are split sideways "
        "(default: never split). To columns: side of the cells that points are binned on where they do not know their "
        "column (default: the DTM's cells)",
    )
    parser.add_argument(
        "--at-time", type=number, metavar="S", help="frame of this time [s], where the file or folder holds several"
    )
    _add_point_options(parser.add_argument_group("to points"))
    _add_column_options(parser.add_argument_group("to columns"))
    _add_terrain_options(parser.add_argument_group("terrain"))
    solver_options.add_arguments(parser)
    group = parser.add_argument_group("another code's particle files")
    foreign_options.add_arguments(group)
    group.add_argument("--density", type=positive, metavar="R", help="of the release [kg m-3]")


def _add_point_options(group):
    group.add_argument(
        "--spacing",
        type=positive,
        metavar="R",
        help="vertical distance of points [m] (default: half of --cell; without it the median column's side)",
    )
    group.add_argument(
        "--vertical-velocity",
        choices=("tangent", "paper", "linear"),
        help="along the bed; 0; or along the bed and linear above it, as an incompressible column moves, for which the "
        "frame must keep its state (default: tangent)",
    )
    group.add_argument(
        "--relevel",
        action="store_true",
        help="with --cell: raise columns that lie over each other to what their mass fills",
    )
    group.add_argument(
        "--paper", action="store_true", help="every choice as MOX report 15/2025 prints it; its defects are named"
    )


def _add_column_options(group):
    group.add_argument(
        "--by",
        choices=("parent", "cell"),
        help="gather points by the column that they came from, or by cell (default: by parent where points know theirs "
        "and still stand together)",
    )
    group.add_argument(
        "--detached",
        choices=("refuse", "keep"),
        help="mass that is clear of the bed or leaves it: refuse, or keep as points in <output>_points.h5 "
        "(default: refuse)",
    )


def _add_terrain_options(group):
    group.add_argument("--dem", type=Path, metavar="FILE", help="DTM (default: the one that the frame names)")
    group.add_argument("--dem-band", type=count, metavar="N", help="band of the DTM, where it has several")
    group.add_argument(
        "--crs", metavar="EPSG:n|local", help="CRS of a DTM that carries none, and of another code's files"
    )


def run(arguments):
    """Convert and write; prints the paths of the files, one a line."""
    from ..workflows.convert import ConvertRequest

    sources = arguments.source
    named = set(ConvertRequest.__dataclass_fields__) - {"source", "terms"}
    asked = {name: getattr(arguments, name) for name in named}
    request = ConvertRequest(sources[0], terms=foreign_options.terms(arguments), **asked)
    with talk.notes_after_success():
        if arguments.solver is not None:
            paths = _run_for_solver(arguments, request)
        else:
            _require_one(arguments)
            solver_options.refuse_without_solver(arguments)
            paths = _run(arguments, request)
    for path in paths:
        print(path)
    return 0


def _require_one(arguments):
    from ..errors import InputError

    if len(arguments.source) > 1:
        raise InputError(
            f"{len(arguments.source)} frames, wanted one; --for paraview and --for houdini take several, and "
            "export-raster makes maps of them"
        )


def _run(arguments, request):
    """Paths of the frames written."""
    from ..io.point_cloud import is_point_cloud
    from ..workflows.convert import convert_to_columns, convert_to_points, dimension_of, write_point_cloud

    dimension = dimension_of(request)
    to = arguments.to or ("points" if dimension == 2 else "columns")
    if request.output is not None and is_point_cloud(request.output) and dimension == 3 and arguments.to != "columns":
        unused = (*_POINTS_ONLY, *_COLUMNS_ONLY, "cell", "dem", "dem_band")
        _refuse_given(arguments, unused, "changes nothing in points that stay points")
        return [write_point_cloud(request).path]
    if to == "points":
        written = convert_to_points(request, _point_options(arguments))
    else:
        written = convert_to_columns(request, _column_options(arguments))
    return [path for path in (written.path, written.rest) if path is not None]


def _run_for_solver(arguments, request):
    """The folder written."""
    from ..errors import InputError
    from ..workflows.solver_start import convert_for_solver

    if arguments.to == "columns":
        raise InputError(f"--to columns: {arguments.solver} starts from points; leave it out")
    _refuse_given(arguments, _COLUMNS_ONLY, "belongs to --to columns")
    of_points = any(getattr(arguments, name) for name in _POINTS_ONLY)
    options = _point_options(arguments) if of_points or arguments.cell else None
    start = solver_options.request_of(arguments)
    return [convert_for_solver(start, arguments.source, request, options, of_points).path]


def _point_options(arguments):
    from ..conversion.options import PointOptions

    _refuse_given(arguments, _COLUMNS_ONLY, "belongs to --to columns")
    if arguments.paper:
        _refuse_given(arguments, ("vertical_velocity", "relevel", "cell"), "contradicts --paper, which has its own way")
        return PointOptions.as_printed(arguments.spacing)
    return PointOptions(
        spacing=arguments.spacing,
        vertical_velocity=arguments.vertical_velocity or "tangent",
        cell=arguments.cell,
        relevel=arguments.relevel,
    )


def _column_options(arguments):
    from ..conversion.options import REFUSE, ColumnOptions

    _refuse_given(arguments, _POINTS_ONLY, "belongs to --to points")
    return ColumnOptions(by=arguments.by, cell=arguments.cell, detached=arguments.detached or REFUSE)


def _refuse_given(arguments, names, why):
    from ..errors import InputError

    for name in names:
        if getattr(arguments, name):
            raise InputError(f"--{name.replace('_', '-')} {why}; leave it out")
