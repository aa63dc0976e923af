"""Average frames of particles to GeoTIFF bands and a QGIS project: `mpmgis export-raster`."""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, TypedDict, Unpack

from ..system.trusted_files import trusting
from . import shared_options
from .option import Form, Option, PathLike, Verb
from .verb_calls import Results, answer


class SamplingOptions(TypedDict, total=False):
    """Cells of an export."""

    cell_size: Annotated[
        float | shared_options.Auto,
        Option(
            "cell size; auto: Eq 15, few empty cells",
            "M|auto",
            unit="m",
            flag="--cs-e",
            above=0,
            folded=False,
            usual="the finer of the cells of DTM and run",
            field="CELL",
            label="Cell size, or auto",
        ),
    ]
    time_step: Annotated[
        float | shared_options.Auto,
        Option(
            "time step; a map for each multiple of it; auto: Eq 17",
            "S|auto",
            unit="s",
            flag="--dt-e",
            above=0,
            usual="every frame",
            field="STEP",
            folded=False,
            label="A map for each multiple of this time, or auto",
        ),
    ]
    north_up: Annotated[
        bool,
        Option(
            "cells along east and north even if the DTM is rotated; otherwise along its axes",
            default=False,
            label="Cells along east and north",
        ),
    ]
    extent: Annotated[
        Literal["flow", "dtm"],
        Option(
            "cover the flow or the DTM",
            usual="dtm without --cs-e, else flow",
            folded=False,
            label="Cover the flow, or the whole terrain",
        ),
    ]


class ExportAveragingOptions(shared_options.AveragingOptions, total=False):
    """How the cells of an export are averaged."""

    bed: Annotated[
        Literal["bilinear", "plane"],
        Option(
            "bed under a particle: bilinear, slopes limited at cliffs; plane: as printed in Eqs 4, 6 of the paper",
            default="bilinear",
            label="Bed under a particle",
        ),
    ]
    min_depth: Annotated[
        float,
        Option(
            "velocities of flow shallower than this are nodata",
            "D",
            default=0.05,
            unit="m",
            least=0,
            label="Velocities of flow shallower than this are left out",
        ),
    ]
    standoff: Annotated[
        float | shared_options.Auto,
        Option(
            "height above the DTM, along its normal, at which particles of a 3D code rest (often below it); auto: "
            "the distance below which 1 %% of the mass lies, in the frame with the most mass below the bed; 0 if "
            "that is under 1 %%",
            "M|auto",
            default=0.0,
            unit="m",
            least=-100,
            most=100,
            label="Height above the terrain at which particles of a 3D code rest, or auto",
        ),
    ]


class BandOptions(TypedDict, total=False):
    """Bands of the steps."""

    products: Annotated[
        tuple[str, ...],
        Option(
            "more bands in the steps: t_vol, n, mass, p, detached, Ut_E, Ut_N; maxima: maxima up to the step",
            "NAME,..",
            default=(),
            label="More bands, with commas",
        ),
    ]


class PaperOptions(TypedDict, total=False):
    """Averaging as printed."""

    paper: Annotated[
        bool,
        Option(
            "as printed in Vicari et al. (2025): --bed plane, --min-depth 0, and points outside the DTM in the "
            "nearest cell of its edge (Eq 5)",
            default=False,
            label="Depth averaging as printed in the paper",
        ),
    ]


def _heights(values: tuple[float, ...]) -> str:
    """What is wrong with the edges of layers; '' if nothing."""
    if not values:
        return ""
    ascending = all(low < high for low, high in pairwise(values))
    return "" if len(values) > 1 and values[0] >= 0 and ascending else "two or more ascending heights from 0 on"


class FileOptions(BandOptions, total=False):
    """Files of an export."""

    layout: Annotated[
        Literal["steps", "stacks"],
        Option(
            "steps: a file for each step with a band for each variable; stacks: a file for each variable with a "
            "band for each step, and a small .vrt for each step",
            default="steps",
            label="A file for each step, or a stack for each variable",
        ),
    ]
    naming: Annotated[
        Literal["mpmgis", "iseesnow"],
        Option(
            "iseesnow: also peak thickness (t_vol) [m], speed [m/s] and pressure [kPa] on the DTM's grid as "
            "<release>_<digest>_null_mpmgis_{pft,pfv,ppr}.asc",
            default="mpmgis",
            label="Names of the files",
        ),
    ]
    cog: Annotated[bool, Option("write Cloud Optimized GeoTIFFs", default=False, label="Cloud Optimized GeoTIFFs")]
    qgis: Annotated[
        bool,
        Option(
            "rasters only: no project, styles, mesh, outlines",
            default=True,
            flag="--no-qgis",
            turned_off=True,
            no_form="the algorithm opens the project",
        ),
    ]
    qgis_min: Annotated[
        Literal["3.38", "3.22"],
        Option(
            "oldest QGIS in which all layers move; 3.22 takes meshes instead of rasters over time",
            default="3.38",
            label="Oldest QGIS that must open it",
        ),
    ]
    animation: Annotated[
        PathLike,
        Option(
            "a film of the flow depth over a hillshade, .mp4 or .gif (pip install mpmgis[animation])",
            "FILE",
            folded=False,
            kind="new file",
            label="Film of the flow (needs films in Install mpmgis)",
            files="Films (*.mp4 *.gif)",
        ),
    ]
    layers: Annotated[
        tuple[float, ...],
        Option(
            "also layers/<name>_<step>.tif of 3D frames: density and impact pressure between these heights over the "
            "bed",
            "H,..",
            default=(),
            unit="m",
            check=_heights,
            label="Heights over the bed of layers of density and pressure, with commas",
        ),
    ]
    kml: Annotated[
        bool,
        Option(
            "also <name>.kmz: release, largest depth, outlines",
            default=False,
            label="KMZ of release, largest depth and outlines",
        ),
    ]
    stac: Annotated[bool, Option("also <name>.stac.json: a STAC item of the folder", default=False, label="STAC item")]


class MachineOptions(TypedDict, total=False):
    """Processes of an export."""

    workers: Annotated[
        int,
        Option(
            "number of frames at a time; the result does not depend on it",
            "N",
            above=0,
            usual="one for each core",
            label="Frames at a time",
        ),
    ]
    dask: Annotated[str, shared_options.DASK]


class FrameAveragingOptions(
    shared_options.FrameTerrainOptions,
    shared_options.DeclarationOptions,
    SamplingOptions,
    ExportAveragingOptions,
    BandOptions,
    total=False,
):
    """Options of `mpmgis.open_results` and `mpmgis.depth_average`; `cell_size` and `time_step` can be "auto"."""


class ExportOptions(
    shared_options.OverwriteOptions,
    shared_options.TerrainOptions,
    SamplingOptions,
    ExportAveragingOptions,
    PaperOptions,
    FileOptions,
    MachineOptions,
    shared_options.DeclarationOptions,
    total=False,
):
    """Options of `mpmgis.export_raster`."""


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
    workflow="maps.export.map_export:export_raster",
    options=ExportOptions,
    arguments=Arguments,
    trust=True,
    groups=(
        ("terrain", shared_options.TerrainOptions),
        ("cells and steps", SamplingOptions),
        ("averaging", ExportAveragingOptions),
        ("averaging", PaperOptions),
        ("files", FileOptions),
        ("machine", MachineOptions),
        (shared_options.THIRD_PARTY, shared_options.DeclarationOptions),
    ),
    example="""
mpmgis export-raster results/*.h5
mpmgis export-raster results/*.h5 --cs-e 1 --dt-e 0.2 --products p,mass,maxima -o avalanche_gis
mpmgis export-raster matter/particles_f*.ply --dem dtm.tif --axes e,u,-n --origin 600000,5170000,0 --density 1500
""",
    forms=(
        Form(
            "Results to maps",
            "Maps and answers",
            "Frames of particles to GeoTIFF bands (depth, thickness, velocities), their maxima and the deposit, opened "
            "as an animated, styled group: click the clock in QGIS' toolbar (Temporal Controller) and press play. One "
            "simulated second is shown as one minute.",
            project=True,
            load="the maps",
        ),
    ),
)


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
    with trusting(trust):
        files: list[Path] = answer(VERB, frames, output, options)
    return files
