"""Options of an export: cells, time steps, averaging, files."""

from itertools import pairwise
from typing import Annotated, Literal, TypedDict, Unpack, cast

from ...exchange.frame_source import DeclarationOptions
from ...frames.frame_options import FrameTerrainOptions, TerrainOptions
from ...system.option import Auto, Option, PathLike
from ...system.option_values import defaults_of
from ...system.work_options import DASK, OverwriteOptions
from ..averaging.averaging_options import USUAL_DEPTH, AveragingOptions
from ..qgis.page_options import PageOptions


class SamplingOptions(TypedDict, total=False):
    """Cells of an export."""

    cell_size: Annotated[
        float | Auto,
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
        float | Auto,
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


class ExportAveragingOptions(AveragingOptions, total=False):
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
            default=USUAL_DEPTH,
            unit="m",
            least=0,
            label="Velocities of flow shallower than this are left out",
        ),
    ]
    standoff: Annotated[
        float | Auto,
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
            kind="choices",
            label="More bands",
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


class FileOptions(BandOptions, PageOptions, total=False):
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
    dask: Annotated[str, DASK]


class FrameAveragingOptions(
    FrameTerrainOptions, DeclarationOptions, SamplingOptions, ExportAveragingOptions, BandOptions, total=False
):
    """Options of `mpmgis.open_results` and `mpmgis.depth_average`; `cell_size` and `time_step` can be "auto"."""


class ExportOptions(
    OverwriteOptions,
    TerrainOptions,
    SamplingOptions,
    ExportAveragingOptions,
    PaperOptions,
    FileOptions,
    MachineOptions,
    DeclarationOptions,
    total=False,
):
    """Options of `mpmgis.export_raster`."""


class Export(ExportOptions, total=False):
    """An export: frames, options and the folder to write."""

    frames: tuple[PathLike, ...]
    output: PathLike


def export_with(**given: Unpack[Export]) -> Export:
    """Return an export with some options, and the defaults of the others.

    Parameters
    ----------
    **given : options by name
    """
    return cast("Export", {"frames": (), "output": None, **defaults_of(ExportOptions), **given})
