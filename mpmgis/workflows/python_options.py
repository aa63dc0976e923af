"""The options that Python callers may give by name, typed; tests hold them against what the commands take."""

import math
from numbers import Integral, Real
from pathlib import Path
from typing import Literal, TypedDict, get_args, get_origin, get_type_hints

from ..errors import InputError


class ForeignOptions(TypedDict, total=False):
    """What another code's files do not say themselves (`mpmgis.interop.declarations.Declarations`)."""

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
    north_up: bool
    paper: bool
    qgis: bool
    qgis_min: Literal["3.38", "3.22"]
    animation: str | Path
    kml: bool
    stac: bool
    workers: int
    dask: str


class SeedingOptions(TypedDict, total=False):
    """All options of `mpmgis seed`."""

    crs: str
    dem_band: int
    fill_nodata: Literal["interpolate"]
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


# what numbers may be, as the commands' own options have it
_ABOVE_ZERO = ("cell_size", "time_step", "density", "particle_volume", "frame_step", "frames_per_second", "dem_band",
               "workers", "percentile")  # fmt: skip
_NOT_NEGATIVE = ("min_depth",)
_AT_MOST = {"percentile": 100.0}


def require_known(options, kind, where):
    """Refuse a name that is none of the TypedDict `kind`'s, and a value that is none for it.

    Raises
    ------
    InputError
    """
    kinds = get_type_hints(kind)
    for name, value in options.items():
        if name not in kinds:
            raise InputError(f"{where}: there is no option {name!r}; it takes {', '.join(sorted(kinds))}")
        if not (_fits(value, kinds[name]) and _in_range(name, value)):
            raise InputError(f"{where}: {name} is {value!r}, wanted {_words(kinds[name])}{_range_words(name)}")


def _fits(value, kind):
    """Whether `value` is of the `kind` of an option's annotation; NaN and infinity are no numbers."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Literal:
        return isinstance(value, str) and value in parts
    if origin is tuple:
        of_any_length = len(parts) == 2 and parts[1] is Ellipsis
        kinds = (parts[0],) * len(value) if of_any_length and isinstance(value, (tuple, list)) else parts
        return isinstance(value, (tuple, list)) and len(value) == len(kinds) and all(map(_fits, value, kinds))
    if parts:
        return any(_fits(value, part) for part in parts)
    if kind in (int, float) and isinstance(value, bool):
        return False
    if kind is float:
        return isinstance(value, Real) and math.isfinite(value)
    return isinstance(value, Integral if kind is int else kind)


def _in_range(name, value):
    if not isinstance(value, Real):
        return True
    above = value > 0 if name in _ABOVE_ZERO else value >= 0 if name in _NOT_NEGATIVE else True
    return above and value <= _AT_MOST.get(name, math.inf)


def _words(kind):
    """What is wanted, in words: the choices, "a number", ..."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Literal:
        return " or ".join(map(repr, parts))
    if origin is tuple:
        if parts[-1] is Ellipsis:
            return f"a tuple of which each is {_words(parts[0])}"
        return f"a tuple of {len(parts)}, each {_words(parts[0])}"
    if parts:
        return " or ".join(map(_words, parts))
    return {float: "a number", int: "a whole number", bool: "True or False", str: "text", Path: "a Path"}[kind]


def _range_words(name):
    if name in _AT_MOST:
        return f" above 0 and up to {_AT_MOST[name]:g}"
    return " above 0" if name in _ABOVE_ZERO else " of at least 0" if name in _NOT_NEGATIVE else ""
