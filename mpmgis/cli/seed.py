"""`mpmgis seed`: particles from a DTM and release areas."""

import argparse
import math
from pathlib import Path

from . import solver_options, talk
from .values import number, positive

EXAMPLE = """
mpmgis seed --dem dtm.tif --release area.shp
mpmgis seed --dem dtm.tif --release area.gpkg --thickness 1.5 --count 20000 --density 300 -o area.parquet
mpmgis seed --dem dtm.tif --release area.shp --for kratos --cell 1 --material slide.toml
"""
DEFAULT_DENSITY = 1000.0


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument(
        "--dem", required=True, type=Path, metavar="FILE", help="DTM: any raster that GDAL reads, in metres"
    )
    parser.add_argument(
        "--release",
        required=True,
        metavar="FILE",
        help="release areas: any vector file with polygons ('file.gpkg|layername=name' picks a layer), or a raster "
        "(mask, or thickness per cell)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="file to write; its suffix picks the format: .h5, .csv, .json, .gpkg, .parquet, .vtp "
        "(default: <release name>_particles.h5); with --for a folder",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier file or folder of that name")
    _add_terrain_options(parser.add_argument_group("terrain"))
    _add_material_options(parser.add_argument_group("material"))
    _add_resolution_options(parser.add_argument_group("columns"))
    solver_options.add_arguments(parser).add_argument(
        "--cell",
        type=positive,
        metavar="M",
        help="with --for: side of the cells of the solver's grid; columns become points that fill it",
    )


def _add_terrain_options(group):
    group.add_argument(
        "--crs", metavar="EPSG:n|local", help="CRS of a DTM that carries none; local: metres without a place"
    )
    group.add_argument("--dem-band", type=_count, metavar="N", help="band of the DTM, where it has several")
    group.add_argument(
        "--fill-nodata",
        choices=("interpolate",),
        help="holes amid the DTM: heights interpolated from the ground around them (default: a release over one is "
        "refused)",
    )


def _add_material_options(group):
    group.add_argument(
        "--thickness",
        metavar="M|COLUMN|RASTER",
        help="thickness: a number [m], a column's name, or a raster (default: the first of the columns thickness, d0, "
        "relth, or the values of a release raster)",
    )
    group.add_argument(
        "--thickness-mode",
        choices=("normal", "vertical"),
        help="thickness is measured normal to the bed or vertically (default: normal)",
    )
    group.add_argument(
        "--surface", type=Path, metavar="RASTER", help="surface of the material [m]: thickness is surface minus bed"
    )
    group.add_argument("--density", type=positive, metavar="R", help=f"density [kg m-3] (default: {DEFAULT_DENSITY:g})")
    group.add_argument(
        "--velocity",
        type=_pair,
        default=(0.0, 0.0),
        metavar="E,N",
        help="initial velocity to the east and north [m s-1]; write --velocity=-1,2 where it begins with a minus "
        "(default: 0,0)",
    )


def _add_resolution_options(group):
    resolution = group.add_mutually_exclusive_group()
    resolution.add_argument("--per-cell", type=_count, metavar="K", help="columns a DTM cell (default: 16)")
    resolution.add_argument("--count", type=_count, metavar="N", help="columns in all, met within 1 %%")
    resolution.add_argument("--spacing", type=positive, metavar="M", help="spacing of the columns [m]")
    group.add_argument(
        "--points",
        choices=("lattice", "staggered", "jittered", "halton", "random"),
        default="lattice",
        help="where the columns lie: a lattice has the least noise at the start; staggered within the cells it stays "
        "even when the flow stretches it, which is what run seeds by itself (default: lattice)",
    )
    group.add_argument(
        "--mass",
        choices=("thickness", "equal", "paper"),
        default="thickness",
        help="mass from thickness and area; equal masses, dense where it is thick; or equal masses spread uniformly, "
        "as MOX report 15/2025 prints it (default: thickness)",
    )
    group.add_argument(
        "--refine-slope",
        type=number,
        default=0.0,
        metavar="BETA",
        help="(1 + BETA min(tan slope, 1)) times the columns on steep ground, 0 to 3 (default: 0)",
    )
    group.add_argument("--seed", type=_whole, default=0, metavar="N", help="seed of the random numbers (default: 0)")


def run(arguments):
    """Seed and write; prints the file's path."""
    from ..errors import InputError
    from ..workflows.seed import seed_file

    if arguments.surface is not None and arguments.thickness_mode == "normal":
        raise InputError(
            "--surface is a vertical thickness by nature, --thickness-mode normal contradicts it; leave it out"
        )
    if arguments.density is None:
        talk.say(f"density is {DEFAULT_DENSITY:g} kg m-3 (--density gives another)")
    asked = {
        "crs": arguments.crs,
        "dem_band": arguments.dem_band,
        "fill_nodata": arguments.fill_nodata,
        "thickness": arguments.thickness,
        "thickness_mode": arguments.thickness_mode or "normal",
        "surface": arguments.surface,
        "per_cell": arguments.per_cell,
        "count": arguments.count,
        "spacing": arguments.spacing,
        "points": arguments.points,
        "mass": arguments.mass,
        "density": arguments.density or DEFAULT_DENSITY,
        "refine_slope": arguments.refine_slope,
        "velocity": arguments.velocity,
        "seed": arguments.seed,
    }
    if arguments.solver is not None:
        return _run_for_solver(arguments, asked)
    solver_options.refuse_without_solver(arguments)
    if arguments.cell is not None:
        raise InputError("--cell belongs to --for; leave it out, or say for which solver")
    seeded = seed_file(arguments.dem, arguments.release, arguments.output, overwrite=arguments.overwrite, **asked)
    _tell(seeded.count, seeded.record)
    print(seeded.path)
    return 0


def _run_for_solver(arguments, asked):
    from ..workflows.solver_start import seed_for_solver

    request = solver_options.request_of(arguments)
    with talk.notes_after_success():
        written, count, record = seed_for_solver(request, arguments.dem, arguments.release, **asked)
        _tell(count, record)
    print(written.path)
    return 0


def _tell(count, record):
    talk.say(
        f"{count} columns on {record['release_area']:.6g} m2: {record['reference_volume']:.6g} m3, "
        f"{record['reference_mass']:.6g} kg (thickness {record['thickness_mode']} to the bed)".replace(
            "vertical to the bed", "vertical"
        )
    )
    talk.say(
        f"closure factor k = {record['closure_factor']:.6f}; column masses from {record['lightest_column']:.4g} to "
        f"{record['heaviest_column']:.4g} kg"
    )


def _whole(text):
    value = float(text)
    if not math.isfinite(value) or value != int(value) or value < 0:
        raise argparse.ArgumentTypeError(f"got {text}, wanted a whole number, 0 or more")
    return int(value)


def _count(text):
    value = _whole(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"got {text}, wanted a whole number, 1 or more")
    return value


def _pair(text):
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted two numbers E,N")
    return tuple(number(part) for part in parts)
