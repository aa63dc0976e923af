"""Create particles from a DTM and release areas: `mpmgis seed`."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict, Unpack

from ..frames.frame_options import FrameTerrainOptions, MetricTerrainOptions
from ..system.errors import InputError
from ..system.option import Option, PathLike, options_of
from ..system.work_options import OverwriteOptions
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..seeding.seeded_file import Seeded

PARTICLES = "GeoPackage (*.gpkg);;mpmgis frame (*.h5);;CSV (*.csv);;GeoJSON (*.json);;Parquet (*.parquet);;VTK (*.vtp)"
DEFAULT_DENSITY = 1000.0  # [kg m-3]
ANOTHER = "Other 3D codes"
WRITES = (
    "Writes a start folder for that code: its input files in local coordinates, the ground, a sidecar with the "
    "georeference for its results, and README.txt. 'Results to maps' and the other algorithms for results read its "
    "results."
)
FOR_SOLVER = ("solver", "cell", "material", "window")
FOLDER_OF_SOLVER = {
    "kind": "new folder",
    "label": "Folder for the code's files",
    "optional": False,
    "help": "Its README.txt describes how to start the code.",
    "files": "",
}


def _window(values: tuple[float, ...]) -> str:
    west, south, east, north = values
    return "" if west < east and south < north else "four numbers W,S,E,N, west below east, south below north"


class SolverOptions(TypedDict, total=False):
    """Start files of another 3D solver."""

    solver: Annotated[
        Literal["kratos", "cbgeo", "geotaichi", "mpm-geomechanics", "houdini", "paraview"],
        Option(
            "write a start folder <name>_<solver> for this solver: its input files in local coordinates, the "
            "ground, a sidecar with the georeference for its results, README.txt",
            flag="--for",
            folded=False,
            usual="none",
            label="Code to start",
        ),
    ]
    material: Annotated[
        PathLike,
        Option(
            "with --for: scene with [material], or a TOML file with that table, optionally [friction] and [output] "
            "end_time [s]",
            "FILE",
            folded=False,
            label="Material",
            files="Materials (*.toml)",
        ),
    ]
    window: Annotated[
        tuple[float, float, float, float],
        Option(
            "with --for: extent of the ground for the solver, in map coordinates",
            "W,S,E,N",
            unit="m",
            check=_window,
            kind="extent",
            usual="the points' extent with a margin of its size",
            label="Extent of the ground for the code",
        ),
    ]


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

    dem: Annotated[
        PathLike,
        Option(
            "DTM: any raster that GDAL reads, in a projected CRS in metres",
            "FILE",
            required=True,
            folded=False,
            kind="raster layer",
            label="Terrain model (DTM)",
        ),
    ]
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
            "Release for another 3D code",
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
    from ..seeding.seeded_file import seed_file

    with python_words(VERB):
        values = complete(VERB, {"dem": dem, "release": release, "output": output, **options})
        return seed_file(**seeding_values(values), output=values["output"], overwrite=values["overwrite"])


def seeding_values(values: dict[str, Any]) -> dict[str, Any]:
    """Return the keywords of a seeding, without those of its output file or of another solver.

    Parameters
    ----------
    values : dict
        All options of the verb, from `complete`.

    Returns
    -------
    dict of str to object

    Raises
    ------
    InputError
        A surface with a thickness normal to the bed.
    """
    if values["surface"] is not None and values["thickness_mode"] == "normal":
        raise InputError("`surface` gives a vertical thickness and contradicts `thickness_mode=normal`; leave it out")
    own = {name: value for name, value in values.items() if name not in (*FOR_SOLVER, "output", "overwrite")}
    mode, density = own["thickness_mode"] or "normal", own["density"] or DEFAULT_DENSITY
    return own | {"thickness_mode": mode, "density": density}
