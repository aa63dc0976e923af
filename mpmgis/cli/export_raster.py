"""`mpmgis export-raster`: frames of particles to GeoTIFF bands and a QGIS project."""

import argparse
from pathlib import Path

from . import foreign_options, talk
from .progress import frame_progress
from .values import count, number, percentile, positive

EXAMPLE = """
mpmgis export-raster results/*.h5
mpmgis export-raster results/*.h5 --cs-e 1 --dt-e 0.2 --products t_vol,p,maxima -o avalanche_gis
mpmgis export-raster matter/particles_f*.ply --dem dtm.tif --axes e,u,-n --origin 600000,5170000,0 --density 1500
"""
AUTO = "auto"


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument(
        "frames",
        nargs="+",
        help="frames (*.h5) of one run, another code's particle files, or the folder that holds them",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="folder to write (default: <name>_gis next to the folder <name> that holds the frames)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier export of that name, as a whole")
    add_terrain_options(parser.add_argument_group("terrain"))
    _add_sampling_options(parser.add_argument_group("cells and steps"))
    _add_averaging_options(parser.add_argument_group("averaging"))
    _add_file_options(parser.add_argument_group("files"))
    _add_machine_options(parser.add_argument_group("machine"))
    foreign_options.add_arguments(parser.add_argument_group("another code's particle files"))


def add_terrain_options(group):
    """Declare what says which DTM the frames lie on."""
    group.add_argument("--dem", type=Path, metavar="FILE", help="DTM (default: the one that the frames name)")
    group.add_argument("--dem-band", type=count, metavar="N", help="band of the DTM, where it has several")
    group.add_argument(
        "--crs",
        metavar="EPSG:n|local",
        help="CRS of a DTM that carries none, and of another code's files; local: metres without a place",
    )


def _add_sampling_options(group):
    group.add_argument(
        "--cs-e",
        type=_positive_or_auto,
        metavar="M|auto",
        dest="cell_size",
        help="cell size [m]; auto: Eq 15, few empty cells (default: the DTM's own cells)",
    )
    group.add_argument(
        "--dt-e",
        type=_positive_or_auto,
        metavar="S|auto",
        dest="time_step",
        help="a step for each multiple of this time [s]; auto: Eq 17 (default: every frame)",
    )
    group.add_argument(
        "--north-up",
        action="store_true",
        help="cells along east and north also where the DTM is rotated (default: those of a rotated DTM are rotated)",
    )
    group.add_argument(
        "--extent", choices=("flow", "dtm"), help="cover the flow or the DTM (default: dtm without --cs-e, else flow)"
    )


def add_percentile(group):
    """Declare --percentile, which whatever averages cells of frames has."""
    group.add_argument(
        "--percentile",
        type=percentile,
        metavar="P",
        default=100.0,
        help="of a cell's distances from the bed, by mass, taken as depth (default 100: the highest)",
    )


def _add_averaging_options(group):
    add_percentile(group)
    group.add_argument(
        "--bed",
        choices=("bilinear", "plane"),
        default="bilinear",
        help="bed under a particle: bilinear, slopes limited at cliffs; plane: the paper's Eqs 4, 6 "
        "to the letter (default bilinear)",
    )
    group.add_argument(
        "--min-depth",
        type=_not_negative,
        metavar="D",
        default=0.05,
        help="velocities of flow shallower than this [m] are nodata (default 0.05)",
    )
    group.add_argument(
        "--standoff",
        type=_number_or_auto,
        metavar="M|auto",
        default=0.0,
        help="height [m] over the DTM, along its normal, at which a 3D code lets particles rest (often "
        "below it); auto: in the frame with the largest share of its mass below the bed, the "
        "distance that 1 %% of the mass lies under; 0 where that share is under 1 %% (default 0)",
    )
    group.add_argument(
        "--paper",
        action="store_true",
        help="Vicari et al. (2025) to the letter: --bed plane, --min-depth 0, and points outside the DTM in the "
        "nearest cell of its rim (Eq 5)",
    )
    group.add_argument(
        "--density", type=positive, metavar="R", help="of the release [kg m-3], where the frames do not say it"
    )


def _add_file_options(group):
    group.add_argument(
        "--products",
        type=_names,
        metavar="NAME,..",
        default=(),
        help="more bands in the steps: t_vol, n, mass, p, detached, Ut_E, Ut_N; maxima: those so far",
    )
    group.add_argument(
        "--layout",
        choices=("steps", "stacks"),
        default="steps",
        help="steps: a file per step with a band per variable; stacks: a file per variable with a "
        "band per step, and a small .vrt for each step (default steps)",
    )
    group.add_argument(
        "--naming",
        choices=("mpmgis", "iseesnow"),
        default="mpmgis",
        help="iseesnow: besides, peak thickness (t_vol) [m], speed [m/s] and pressure [kPa] on the DTM's "
        "grid as <release>_<digest>_null_mpmgis_{pft,pfv,ppr}.asc (default mpmgis)",
    )
    group.add_argument("--cog", action="store_true", help="Cloud Optimized GeoTIFFs")
    group.add_argument(
        "--no-qgis", dest="qgis", action="store_false", help="rasters only: no project, styles, mesh, outlines"
    )
    group.add_argument(
        "--qgis-min",
        choices=("3.38", "3.22"),
        default="3.38",
        help="oldest QGIS to open the project; 3.22 takes a layer per step (default 3.38)",
    )
    group.add_argument(
        "--animation",
        type=Path,
        metavar="FILE",
        help="a film of the flow depth over a hillshade, .mp4 or .gif (pip install mpmgis[animation])",
    )
    group.add_argument("--kml", action="store_true", help="besides, <name>.kmz: release, largest depth, outlines")
    group.add_argument("--stac", action="store_true", help="besides, <name>.stac.json: a STAC item of the folder")


def _add_machine_options(group):
    group.add_argument(
        "--workers",
        type=count,
        metavar="N",
        help="frames at a time (default: one per core); the result is the same for any N",
    )
    group.add_argument("--dask", metavar="ADDRESS", help="average frames on the Dask cluster with this scheduler")


def run(arguments):
    """Export; the paths written go to stdout, one a line."""
    from ..workflows.export import ExportRequest, export_raster

    asked = {key: value for key, value in vars(arguments).items() if key in ExportRequest.__dataclass_fields__}
    with talk.notes_after_success():
        paths = export_raster(ExportRequest(**asked | {"frames": tuple(arguments.frames)}), progress=frame_progress)
    for path in paths:
        print(path)
    if arguments.qgis:
        talk.say(f"open {paths[0]} in QGIS (double-click), then press play in the Temporal Controller")
    return 0


def _not_negative(text):
    value = number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"got {text}, wanted 0 or more")
    return value


def _positive_or_auto(text):
    return AUTO if text == AUTO else positive(text)


def _number_or_auto(text):
    return AUTO if text == AUTO else number(text)


def _names(text):
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted names with commas between them")
    return names
