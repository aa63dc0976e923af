"""Average frames of particles to GeoTIFF bands and a QGIS project: `mpmgis export-raster`."""

from pathlib import Path
from typing import Annotated, Unpack

from ..exchange.frame_source import THIRD_PARTY, DeclarationOptions
from ..frames.frame_options import TerrainOptions
from ..maps.export.export_options import (
    ExportAveragingOptions,
    ExportOptions,
    FileOptions,
    MachineOptions,
    PaperOptions,
    SamplingOptions,
)
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from ..system.trusted_files import trusting
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several


class Arguments(ExportOptions, total=False):
    """Options of the command."""

    frames: Annotated[tuple[PathLike, ...], shared_options.FRAMES]
    list_files: Annotated[bool, shared_options.LIST_FILES]
    output: Annotated[
        PathLike,
        Option(
            "folder to write",
            "DIR",
            short="-o",
            usual="<name>_gis beside the folder <name> of the frames",
            folded=False,
            kind="new folder",
            label="Folder for maps, if not <name>_gis beside the results",
        ),
    ]


VERB = Verb(
    name="export-raster",
    place=4,
    line="frames of particles to GeoTIFF bands and a QGIS project",
    options=ExportOptions,
    arguments=Arguments,
    trust=True,
    groups=(
        ("terrain", TerrainOptions),
        ("cells and steps", SamplingOptions),
        ("averaging", ExportAveragingOptions),
        ("averaging", PaperOptions),
        ("files", FileOptions),
        ("machine", MachineOptions),
        (THIRD_PARTY, DeclarationOptions),
    ),
    example="""
mpmgis export-raster results/*.h5
mpmgis export-raster results/*.h5 --cs-e 1 --dt-e 0.2 --products p,mass,maxima -o avalanche_gis
mpmgis export-raster matter/particles_f*.ply --dem dtm.tif --axes e,u,-n --origin 600000,5170000,0 --density 1500
""",
    forms=(
        Form(
            "Make maps of results",
            "Maps and answers",
            "Frames of particles to GeoTIFF bands (depth, thickness, velocities), their maxima and the deposit, opened "
            "as an animated, styled group: click the clock in QGIS' toolbar (Temporal Controller) and press play. One "
            "simulated second is shown as one minute.",
            project=True,
            load="the maps",
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> list[Path]:
    """Write the folder for GIS.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (frames done, frames in all).

    Returns
    -------
    list of Path
        Every file written, the QGIS project first.
    """
    from ..maps.export.map_export import export_raster

    return export_raster(asked, progress)


def export_raster(
    frames: Results, output: PathLike | None = None, *, trust: bool = False, **options: Unpack[ExportOptions]
) -> list[Path]:
    """Average frames to GeoTIFF bands and a QGIS project (NHESS 25:3897, Eqs 2 to 17), as `mpmgis export-raster`.

    Parameters
    ----------
    frames : path or several
        Frames or the folder that holds them, of mpmgis or of another code.
    output : path, optional
        Folder; default ``<name>_gis`` beside the folder of the frames.
    trust : bool
        Follow links of the files to the network and to other files.
    **options
        `ExportOptions`: cell_size [m], time_step [s], products, dem, ...

    Returns
    -------
    list of Path
        Every file written, the QGIS project first.

    Raises
    ------
    MpmgisError
        Something cannot be read or written; nothing is written then.

    Examples
    --------
    >>> mpmgis.export_raster("results", cell_size=1, time_step=0.2)  # doctest: +SKIP
    """
    with trusting(trust), python_words(VERB):
        return work(complete(VERB, {"frames": several(frames), "output": output, **options}))
