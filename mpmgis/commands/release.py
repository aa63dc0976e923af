"""Find potential release areas of snow slabs in a DTM: `mpmgis release`."""

from typing import TYPE_CHECKING, Annotated, Literal, TypedDict, Unpack

from ..frames.frame_options import FrameTerrainOptions, MetricTerrainOptions
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike, options_of
from ..system.work_options import DASK, OverwriteOptions
from . import shared_options
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..seeding.snow_slabs.potential_areas import SlabAreas


class ReleaseTerrainOptions(MetricTerrainOptions, total=False):
    """The terrain."""

    crs: Annotated[
        str,
        Option(
            "CRS of a DTM without one; local: metres without a position on the map",
            "EPSG:n|local",
            kind="CRS",
            label="CRS, where the terrain model carries none",
        ),
    ]
    dem_band: Annotated[int, options_of(FrameTerrainOptions)["dem_band"]]
    forest: Annotated[
        PathLike,
        Option(
            "forest, where no slab releases: polygons of any vector file, or a raster that is not 0 there",
            "FILE",
            keep_text=True,
            folded=False,
            kind="polygon layer",
            label="Forest, where no slab releases",
        ),
    ]


class CriteriaOptions(TypedDict, total=False):
    """Where a slab can release."""

    scenario: Annotated[
        Literal["extreme", "frequent"],
        Option(
            "published limits for return periods of 100 to 300 or of 10 to 30 years (Buehler et al. 2018)",
            default="extreme",
            folded=False,
            label="Limits of the scenario",
        ),
    ]
    slope_min: Annotated[
        float,
        Option(
            "gentlest slope", "A", unit="degrees", above=0, below=90, usual="28, 30 if frequent", label="Gentlest slope"
        ),
    ]
    slope_max: Annotated[
        float, Option("steepest slope", "A", unit="degrees", above=0, below=90, usual="60", label="Steepest slope")
    ]
    curvature: Annotated[
        float,
        Option(
            "largest turning of the contour lines",
            "K",
            unit="rad per 100 m",
            above=0,
            usual="6",
            label="Largest turning of the contour lines",
        ),
    ]
    ruggedness: Annotated[
        float,
        Option(
            "largest vector ruggedness measure in a window of 45 m",
            "R",
            unit="1",
            above=0,
            usual="0.08, 0.06 if frequent",
            label="Largest ruggedness in a window of 45 m",
        ),
    ]
    min_area: Annotated[
        float, Option("smallest area", "M2", unit="m2", above=0, usual="500", folded=False, label="Smallest area")
    ]
    ridge_angle: Annotated[
        float,
        Option(
            "ridges and gullies at which the aspect turns by more, within 45 m, divide areas",
            "A",
            unit="degrees",
            above=0,
            most=180,
            usual="20",
            label="Ridges at which the aspect turns by more divide areas",
        ),
    ]


class SnowOptions(TypedDict, total=False):
    """Thickness of the slabs."""

    snow_depth: Annotated[
        float | str,
        Option(
            "new snow of three days, normal to a slope of 28 degrees (vertical depth times 0.88): a number, or one for "
            "each return period [years]; it is multiplied with the slope factor of the Swiss guideline",
            "M|T=M,..",
            unit="m",
            usual="areas without thickness",
            folded=False,
            kind="text",
            label="New snow of three days, metres or 30=0.9,100=1.2",
        ),
    ]
    snow_altitude: Annotated[
        float,
        Option(
            "elevation of that depth; elsewhere it changes by --snow-gradient",
            "M",
            unit="m",
            usual="the depth applies everywhere",
            label="Elevation of that depth",
        ),
    ]
    snow_gradient: Annotated[
        float,
        Option(
            "increase of the depth for 100 m of elevation, with --snow-altitude",
            "M",
            default=0.05,
            unit="m",
            label="Increase of the depth for 100 m of elevation",
        ),
    ]
    wind: Annotated[
        float, Option("drifted snow added to the depth", "M", default=0.0, unit="m", least=0, label="Drifted snow")
    ]
    wind_altitude: Annotated[
        float,
        Option(
            "elevation above which there is drifted snow",
            "M",
            unit="m",
            usual="everywhere",
            label="Elevation above which there is drifted snow",
        ),
    ]


class ReleaseMachineOptions(TypedDict, total=False):
    """Threads or a cluster."""

    workers: Annotated[
        int,
        Option(
            "number of threads; the areas do not depend on it", "N", above=0, usual="one for each core", label="Threads"
        ),
    ]
    dask: Annotated[str, DASK]


class ReleaseOptions(
    ReleaseTerrainOptions, CriteriaOptions, SnowOptions, ReleaseMachineOptions, OverwriteOptions, total=False
):
    """Options of `mpmgis.release_areas`."""


class Arguments(ReleaseOptions, total=False):
    """Options of the command."""

    dem: Annotated[PathLike, shared_options.DEM]
    output: Annotated[
        PathLike,
        Option(
            "GeoPackage to write",
            "FILE",
            short="-o",
            usual="<DTM name>_release.gpkg",
            folded=False,
            kind="new file",
            label="Release areas",
            files="GeoPackage (*.gpkg)",
        ),
    ]


VERB = Verb(
    name="release",
    place=6,
    line="potential release areas of snow slabs from a DTM, with their thickness",
    options=ReleaseOptions,
    arguments=Arguments,
    groups=(
        ("terrain", ReleaseTerrainOptions),
        ("where a slab can release", CriteriaOptions),
        ("thickness", SnowOptions),
        ("machine", ReleaseMachineOptions),
    ),
    example="""
mpmgis release --dem dtm.tif --snow-depth 1.2
mpmgis release --dem dtm.tif --forest forest.gpkg --snow-depth 30=0.9,100=1.2,300=1.5 --snow-altitude 2000 -o areas.gpkg
mpmgis release --dem dtm.tif --scenario frequent --min-area 2000
""",
    description="""
Cells within a band of slopes, without strong curvature, rugged ground and forest are divided into areas at ridges and
gullies and by aspect. The areas are polygons along the cells, with slope, aspect, elevation and plan area, and with
--snow-depth thickness and volume. seed, run and region take the file as it is; the columns thickness_30, volume_30, ...
are those of a return period, thickness that of the longest one. The areas are the same for any number of threads and
on a Dask cluster.
""",
    counted="block",
    forms=(
        Form(
            "Find release areas of snow slabs",
            "Simulate",
            "Potential release areas of snow slabs from a terrain model: a band of slopes without strong curvature, "
            "rugged ground and forest (Buehler et al. 2018), divided at ridges, gullies and by aspect. With a depth of "
            "new snow they get thickness and volume. The other algorithms take them as release areas.",
            layers=(".gpkg",),
            load="the areas",
            changes=(("output", {"optional": False}),),
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "SlabAreas":
    """Find the areas and write them.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (blocks of the DTM done, blocks in all).

    Returns
    -------
    SlabAreas
    """
    from dataclasses import replace

    from ..seeding.snow_slabs.potential_areas import SlabSearch, write_slab_areas
    from ..seeding.snow_slabs.slab_criteria import SCENARIOS
    from ..seeding.snow_slabs.slab_thickness import NewSnow, parsed_depths

    names = ("slope_min", "slope_max", "curvature", "ruggedness", "min_area", "ridge_angle")
    given = {name: value for name, value in asked.items() if name in names and value is not None}
    depth = asked["snow_depth"]
    snow = NewSnow(
        {} if depth is None else parsed_depths(depth),
        asked["snow_altitude"],
        asked["snow_gradient"],
        asked["wind"],
        asked["wind_altitude"],
    )
    search = SlabSearch(
        replace(SCENARIOS[asked["scenario"]], **given), snow, asked["forest"], asked["workers"], asked["dask"]
    )
    terrain = {name: asked[name] for name in ("crs", "dem_band", "to_crs")}
    return write_slab_areas(
        asked["dem"], asked["output"], search, **terrain, overwrite=asked["overwrite"], progress=progress
    )


def release_areas(dem: PathLike, output: PathLike | None = None, **options: Unpack[ReleaseOptions]) -> "SlabAreas":
    """Find potential release areas of snow slabs in a DTM (Buehler et al. 2018), as `mpmgis release`.

    Parameters
    ----------
    dem : path
    output : path, optional
        GeoPackage; default ``<DTM name>_release.gpkg`` in the current folder.
    **options
        `ReleaseOptions`: scenario, forest, snow_depth [m, or "30=0.9,100=1.2"], min_area [m2], ...

    Returns
    -------
    SlabAreas
        With `polygons`, `columns` (slope, aspect, elevation, area, thickness, volume), `crs` and `path`.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> areas = mpmgis.release_areas("dtm.tif", "areas.gpkg", snow_depth="30=0.9,300=1.5")  # doctest: +SKIP
    >>> areas.columns["volume_300"].max()  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"dem": dem, "output": output, **options}))
