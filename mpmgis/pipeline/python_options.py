"""The options that Python callers may give by name, typed; tests hold them against what the commands take."""

from pathlib import Path
from typing import Literal, TypedDict

from ..errors import InputError


class ForeignOptions(TypedDict, total=False):
    """What another code's files do not say themselves (`mpmgis.io.foreign.terms.ForeignTerms`)."""

    reader: str
    crs: str
    origin: tuple[float, float, float]
    axes: tuple[str, str, str]
    times: tuple[float, ...]
    frame_step: float
    frames_per_second: float
    columns: tuple[tuple[str, str], ...]
    density: float
    particle_volume: float
    sidecar: str | Path


class AveragingOptions(ForeignOptions, total=False):
    """How frames are averaged: `mpmgis export-raster --help` tells each; `cell_size` is --cs-e, `time_step` --dt-e."""

    dem_band: int
    cell_size: float | Literal["auto"]
    time_step: float | Literal["auto"]
    extent: Literal["flow", "dtm"]
    percentile: float
    bed: Literal["bilinear", "plane"]
    min_depth: float
    standoff: float | Literal["auto"]
    products: tuple[str, ...]


class ExportOptions(AveragingOptions, total=False):
    """All options of `mpmgis export-raster`."""

    dem: str | Path
    overwrite: bool
    layout: Literal["steps", "stacks"]
    naming: Literal["mpmgis", "iseesnow"]
    cog: bool
    qgis: bool
    qgis_min: Literal["3.38", "3.22"]
    workers: int
    dask: str


class SeedingOptions(TypedDict, total=False):
    """All options of `mpmgis seed`."""

    crs: str
    dem_band: int
    thickness: float | str | Path
    thickness_mode: Literal["normal", "vertical"]
    surface: str | Path
    density: float
    velocity: tuple[float, float]
    per_cell: int
    count: int
    spacing: float
    points: Literal["lattice", "staggered", "jittered", "halton", "random"]
    mass: Literal["thickness", "equal", "paper"]
    refine_slope: float
    seed: int
    overwrite: bool


def require_known(options, kind, where):
    """Refuse a name that is none of the TypedDict `kind`'s."""
    known = kind.__annotations__
    for name in options:
        if name not in known:
            raise InputError(f"{where}: there is no option {name!r}; it takes {', '.join(sorted(known))}")
