"""Write friction by class of terrain from a table, for the zones of a scene: `mpmgis friction-map`."""

from typing import TYPE_CHECKING, Annotated, Literal, TypedDict, Unpack

from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from ..system.work_options import OverwriteOptions
from ..terrain.class_limits import ClassLimits
from . import seed, shared_options
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..simulation.terrain_friction import FrictionFound


class EventOptions(TypedDict, total=False):
    """The law and the event."""

    law: Annotated[
        Literal[
            "Coulomb",
            "Voellmy",
            "ModifiedVoellmy",
            "Bingham",
            "Pouliquen",
            "SamosAT",
            "VoellmyMinShear",
            "OBrien",
            "HerschelBulkley",
            "Manning",
        ],
        Option("law of friction whose parameters the table has", default="Voellmy", folded=False, label="Law"),
    ]
    volume: Annotated[
        float,
        Option(
            "volume of the release, where the table depends on it",
            "V",
            unit="m3",
            above=0,
            folded=False,
            label="Volume of the release, where the table depends on it",
        ),
    ]
    return_period: Annotated[
        float,
        Option(
            "return period, where the table has several",
            "T",
            unit="years",
            above=0,
            folded=False,
            label="Return period, where the table has several",
        ),
    ]


class ClassOptions(TypedDict, total=False):
    """Limits between classes of terrain."""

    flat_slope: Annotated[
        float,
        Option(
            "ground of a smaller slope is flat",
            "A",
            default=ClassLimits.flat_slope,
            unit="degrees",
            least=0,
            below=90,
            label="Slope below which ground is flat",
        ),
    ]
    channel_radius: Annotated[
        float,
        Option(
            "radius at which the ground around a cell is compared with it, for channels",
            "M",
            default=ClassLimits.channel_radius,
            unit="m",
            above=0,
            label="Channels: radius",
        ),
    ]
    channel_rise: Annotated[
        float,
        Option(
            "least mean rise to the ground around, over the radius, of a channel",
            "X",
            default=ClassLimits.channel_rise,
            unit="1",
            above=0,
            label="Channels: least rise over radius",
        ),
    ]
    gully_radius: Annotated[
        float,
        Option(
            "the same radius for gullies",
            "M",
            default=ClassLimits.gully_radius,
            unit="m",
            above=0,
            label="Gullies: radius",
        ),
    ]
    gully_rise: Annotated[
        float,
        Option(
            "the same rise for gullies",
            "X",
            default=ClassLimits.gully_rise,
            unit="1",
            above=0,
            label="Gullies: least rise over radius",
        ),
    ]


class FrictionMapOptions(OverwriteOptions, EventOptions, ClassOptions, seed.SeedTerrainOptions, total=False):
    """Options of `mpmgis.friction_map`."""


class Arguments(FrictionMapOptions, total=False):
    """Options of the command."""

    dem: Annotated[PathLike, shared_options.DEM]
    table: Annotated[
        PathLike,
        Option(
            "friction by class of terrain, altitude, volume and return period, as CSV",
            "FILE",
            required=True,
            folded=False,
            label="Table of friction",
            files="Tables (*.csv *.txt)",
        ),
    ]
    output: Annotated[
        PathLike,
        Option(
            "folder for the classes, the rasters and the lines for a scene",
            "DIR",
            short="-o",
            usual="<name of the DTM>_friction",
            folded=False,
            kind="new folder",
            label="Folder for the rasters",
        ),
    ]


VERB = Verb(
    name="friction-map",
    place=5,
    line="friction by class of terrain from a table, as rasters for a scene",
    options=FrictionMapOptions,
    arguments=Arguments,
    trust=True,
    groups=(("event", EventOptions), ("classes of terrain", ClassOptions), ("terrain", seed.SeedTerrainOptions)),
    example="""
mpmgis friction-map --dem dtm.tif --table friction.csv
mpmgis friction-map --dem dtm.tif --table friction.csv --return-period 300 --volume 60000 -o friction
mpmgis friction-map --dem dtm.tif --table friction.csv --law Coulomb --flat-slope 5
""",
    description="""
Classifies the terrain (open slope, channel, gully, flat ground) and gives each cell the friction that a table has for
its class, altitude, volume of the release and return period. Writes terrain_class.tif, a raster for each parameter that
varies, and friction.toml: the lines [friction] and [[zones]] for a scene beside the folder. A row of the table is a
rule; its columns are terrain (open, channel, gully, flat), altitude_from, altitude_to, volume_from, volume_to,
return_period, and the parameters of the law; SamosAT takes size (small, medium, large) in place of mu. An empty cell is
any value.
""",
    counted="block",
    forms=(
        Form(
            "Map friction by class of terrain",
            "Simulate",
            "Classifies the terrain (open slope, channel, gully, flat ground) and writes the friction that a table has "
            "for each class, altitude, volume and return period, as rasters and as lines for a scene. Check the map of "
            "classes on ground that you know.",
            prints=True,
            layers=(".tif",),
            load="the classes and the rasters",
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "FrictionFound":
    """Write classes, rasters and lines for a scene.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (blocks of the DTM done, blocks in all).

    Returns
    -------
    FrictionFound
    """
    from ..simulation.terrain_friction import terrain_friction
    from ..terrain.dtm import BY_BLOCK, TerrainFile, whole_or_parts

    file = TerrainFile(asked["dem"], asked["crs"], asked["dem_band"], asked["fill_nodata"], asked["to_crs"])
    terrain = whole_or_parts(file, BY_BLOCK)
    limits = ClassLimits(
        flat_slope=asked["flat_slope"],
        channel_radius=asked["channel_radius"],
        channel_rise=asked["channel_rise"],
        gully_radius=asked["gully_radius"],
        gully_rise=asked["gully_rise"],
    )
    event = asked["volume"], asked["return_period"]
    folder = asked["output"], asked["overwrite"]
    return terrain_friction(terrain, asked["table"], asked["law"], event, limits, *folder, progress=progress)


def friction_map(
    dem: PathLike, table: PathLike, output: PathLike | None = None, **options: Unpack[FrictionMapOptions]
) -> "FrictionFound":
    """Write friction by class of terrain from a table, for the zones of a scene, as `mpmgis friction-map`.

    Parameters
    ----------
    dem : path
    table : path
        CSV with conditions (terrain, altitude_from, ...) and parameters of the law.
    output : path, optional
        Folder; default ``<name of the DTM>_friction`` in the current folder.
    **options
        `FrictionMapOptions`: law, volume [m3], return_period [years], flat_slope [degrees], ...

    Returns
    -------
    FrictionFound
        With plan `areas` of the classes [m2], the range of all `parameters`, and the `files`.

    Raises
    ------
    MpmgisError
        An invalid table, or one with a gap; nothing is written then.

    Examples
    --------
    >>> mpmgis.friction_map("dtm.tif", "friction.csv", "friction", return_period=300).areas  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"dem": dem, "table": table, "output": output, **options}))
