"""Create particles from a DTM and release areas: `mpmgis seed`."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict, Unpack

from ..conversion.start_options import SolverOptions
from ..frames.frame_options import FrameTerrainOptions, MetricTerrainOptions
from ..system.errors import InputError
from ..system.option import Option, PathLike, options_of
from ..system.work_options import OverwriteOptions
from . import shared_options
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..seeding.seeded_file import Seeded

PARTICLES = "GeoPackage (*.gpkg);;mpmgis frame (*.h5);;CSV (*.csv);;GeoJSON (*.json);;Parquet (*.parquet);;VTK (*.vtp)"
DEFAULT_DENSITY = 1000.0  # [kg m-3]
ANOTHER = "Other 3D codes"
WRITES = (
    "Writes a start folder for that code: its input files in local coordinates, the ground, a sidecar with the "
    "georeference for its results, and README.txt. 'Make maps of results' and the other algorithms for results read "
    "its results."
)
FOR_SOLVER = ("solver", "cell", "material", "window")
FOLDER_OF_SOLVER = {
    "kind": "new folder",
    "label": "Folder for the code's files",
    "optional": False,
    "help": "Its README.txt describes how to start the code.",
    "files": "",
}


class SeedTerrainOptions(MetricTerrainOptions, total=False):
    """The terrain."""

    crs: Annotated[
        str,
        Option(
            "CRS of a DTM without one; local: metres without a position on the map",
            "EPSG:n|local",
            kind="CRS",
            label="CRS, where the files carry none",
        ),
    ]
    dem_band: Annotated[int, options_of(FrameTerrainOptions)["dem_band"]]
    fill_nodata: Annotated[
        Literal["interpolate"],
        Option(
            "interpolate elevations in holes inside the DTM from the ground around them",
            usual="error if a release covers a hole",
            label="Holes inside the terrain model",
        ),
    ]


class MaterialOptions(TypedDict, total=False):
    """The released material."""

    thickness: Annotated[
        float | str | PathLike,
        Option(
            "thickness of the release, normal to the bed: a number [m], a column's name, or a raster",
            "M|COLUMN|RASTER",
            keep_text=True,
            kind="text",
            folded=False,
            usual="the first of the columns thickness, d0, relth, or the values of a release raster",
            label="Release thickness: metres, or name of a column",
        ),
    ]
    thickness_mode: Annotated[
        Literal["normal", "vertical"],
        Option("thickness is measured normal to the bed or vertically", usual="normal", label="Thickness is measured"),
    ]
    surface: Annotated[
        PathLike,
        Option(
            "surface of the material; thickness is surface minus bed",
            "RASTER",
            unit="m",
            kind="raster layer",
            label="Instead of a thickness: surface of the material",
        ),
    ]
    density: Annotated[
        float,
        Option(
            "density; dense snow 200 to 400, debris 1600 to 2200",
            "R",
            unit="kg m-3",
            above=0,
            usual="1000",
            folded=False,
            label="Density",
        ),
    ]
    velocity: Annotated[
        tuple[float, float],
        Option(
            "initial velocity to the east and north; write --velocity=-1,2 if it begins with a minus",
            "E,N",
            default=(0.0, 0.0),
            unit="m s-1",
            least=-1000,
            most=1000,
            label="Initial velocity to the east and north, E,N",
        ),
    ]


class SeedColumnOptions(TypedDict, total=False):
    """Number and arrangement of columns."""

    per_cell: Annotated[
        int,
        Option(
            "columns per DTM cell",
            "K",
            above=0,
            usual="16",
            exclusive="resolution",
            folded=False,
            label="Columns in each cell of the terrain",
        ),
    ]
    count: Annotated[
        int,
        Option(
            "columns in total, within 1 %%",
            "N",
            above=0,
            exclusive="resolution",
            folded=False,
            label="or: columns in total",
        ),
    ]
    spacing: Annotated[
        float,
        Option(
            "horizontal spacing of the columns",
            "M",
            unit="m",
            above=0,
            exclusive="resolution",
            folded=False,
            label="or: spacing of the columns",
        ),
    ]
    points: Annotated[
        Literal["lattice", "staggered", "jittered", "halton", "random"],
        Option(
            "arrangement of the columns; lattice: least noise at the start; staggered within the cells: remains "
            "even when the flow stretches, as in run",
            default="lattice",
            label="Arrangement of the columns",
        ),
    ]
    mass: Annotated[
        Literal["thickness", "equal", "paper"],
        Option(
            "mass from thickness and area; equal masses, with more columns where it is thick; or equal masses at "
            "uniform spacing, as printed in MOX report 15/2025",
            default="thickness",
            label="Mass of the columns",
        ),
    ]
    refine_slope: Annotated[
        float,
        Option(
            "(1 + BETA min(tan slope, 1)) times the columns on steep ground; a number from 0 to 3",
            "BETA",
            default=0.0,
            label="More columns on steep ground, 0 to 3",
        ),
    ]
    seed: Annotated[
        int,
        Option(
            "seed of the random numbers; the same seed gives the same columns",
            "N",
            default=0,
            least=0,
            label="Seed of the random numbers",
        ),
    ]


class SeedSolverOptions(SolverOptions, total=False):
    """Start files of another 3D solver, with the cell size of its grid."""

    cell: Annotated[
        float,
        Option(
            "with --for: cell size of the solver's grid, which is filled with points",
            "M",
            unit="m",
            above=0,
            folded=False,
            label="Cell size of the code's grid",
        ),
    ]


class SeedingOptions(OverwriteOptions, SeedTerrainOptions, MaterialOptions, SeedColumnOptions, total=False):
    """Options of `mpmgis.seed`."""


class Arguments(SeedingOptions, SeedSolverOptions, total=False):
    """Options of the command."""

    dem: Annotated[PathLike, shared_options.DEM]
    release: Annotated[
        PathLike,
        Option(
            "release areas: any vector file with polygons ('file.gpkg|layername=name' picks a layer), or a raster "
            "(mask, or thickness per cell)",
            "FILE",
            required=True,
            keep_text=True,
            folded=False,
            kind="polygon layer",
            label="Release areas",
        ),
    ]
    output: Annotated[
        PathLike,
        Option(
            "file to write; its suffix picks the format: .h5, .csv, .json, .gpkg, .parquet, .vtp; with --for a folder",
            "FILE",
            short="-o",
            usual="<release name>_particles.h5",
            folded=False,
            kind="new file",
            label="Particles",
            files=PARTICLES,
        ),
    ]


VERB = Verb(
    name="seed",
    place=1,
    line="particles from a DTM and release areas (Algorithm 1 of MOX report 15/2025)",
    options=SeedingOptions,
    arguments=Arguments,
    trust=True,
    groups=(
        ("terrain", SeedTerrainOptions),
        ("material", MaterialOptions),
        ("columns", SeedColumnOptions),
        ("for another 3D solver", SeedSolverOptions),
    ),
    example="""
mpmgis seed --dem dtm.tif --release area.shp
mpmgis seed --dem dtm.tif --release area.gpkg --thickness 1.5 --count 20000 --density 300 -o area.parquet
mpmgis seed --dem dtm.tif --release area.shp --for kratos --cell 1 --material slide.toml
""",
    forms=(
        Form(
            "Seed particles on release areas",
            "Simulate",
            "Particles of the release: columns of material on the terrain, from a DTM and polygons (Algorithm 1 of MOX "
            "report 15/2025), to check a release or to start another code. A simulation seeds its own particles. "
            "Choose a .h5 file to simulate or convert from it.",
            layers=(".gpkg", ".json", ".parquet"),
            load="the particles",
            without=FOR_SOLVER,
            changes=(("output", {"optional": False}), ("density", {"default": 1000.0})),
        ),
        Form(
            "Write a release for another 3D code",
            ANOTHER,
            "Fills a release with 3D points for another code. " + WRITES,
            name="seedfor",
            only=(
                "solver",
                "dem",
                "release",
                "thickness",
                "density",
                "cell",
                "material",
                "window",
                "crs",
                "dem_band",
                "fill_nodata",
                "overwrite",
                "output",
            ),
            changes=(
                ("solver", {"optional": False}),
                ("cell", {"optional": False}),
                ("output", FOLDER_OF_SOLVER),
                ("density", {"default": 1000.0}),
            ),
        ),
    ),
)


def work(asked: Arguments) -> "Seeded":
    """Write columns, or with `solver` a start folder of another solver.

    Parameters
    ----------
    asked : Arguments

    Returns
    -------
    Seeded

    Raises
    ------
    InputError
        A surface with a thickness normal to the bed, or options of a solver without one.
    """
    from ..seeding.seeded_file import Seeded, seed_file

    if asked["surface"] is not None and asked["thickness_mode"] == "normal":
        raise InputError("`surface` gives a vertical thickness and contradicts `thickness_mode=normal`; leave it out")
    seeding: dict[str, Any] = {
        name: asked.get(name) for name in VERB.named() if name not in (*FOR_SOLVER, "output", "overwrite")
    }
    seeding["thickness_mode"] = asked["thickness_mode"] or "normal"
    seeding["density"] = asked["density"] or DEFAULT_DENSITY
    if asked["solver"] is not None:
        from ..conversion.start_folder import seed_for_solver

        written, count, record = seed_for_solver(asked, **seeding)
        return Seeded(written.path, count, record)
    for name in FOR_SOLVER:
        if asked.get(name) is not None:
            raise InputError(f"`{name}` requires `solver`; leave it out, or name the solver")
    return seed_file(**seeding, output=asked["output"], overwrite=asked["overwrite"])


def seed(
    dem: PathLike, release: PathLike, output: PathLike | None = None, **options: Unpack[SeedingOptions]
) -> "Seeded":
    """Create columns from a DTM and release areas (MOX report 15/2025, Algorithm 1), as `mpmgis seed`.

    Parameters
    ----------
    dem, release : path
    output : path, optional
        Its suffix picks the format; default ``<release name>_particles.h5`` in the current folder.
    **options
        `SeedingOptions`: thickness [m, a column's name or a raster], density [kg m-3], count, spacing [m], ...

    Returns
    -------
    Seeded
        With `path`, `count` and `record`.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> mpmgis.seed("dtm.tif", "release.shp", "particles.h5", thickness=1.5, count=20_000)  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"dem": dem, "release": release, "output": output, **options}))
