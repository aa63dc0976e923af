"""Rasters that a run writes itself, in `maps/` of its folder, laid out as an export."""

import shutil
from contextlib import suppress
from pathlib import Path

import rasterio

from .. import system
from ..errors import OutputError
from .atomic import whole_file
from .lock import refuse_links
from .raster_output import NAMESPACE

MAPS, RASTERS, TERRAIN = "maps", "rasters", "dtm.tif"
_STEPS, _SUMMARIES = "*_[0-9][0-9][0-9][0-9]*.tif", ("max", "deposit", "bed", "surface")
_RASTERS = (TERRAIN, f"{RASTERS}/{_STEPS}", *(f"{RASTERS}/*_{word}.tif" for word in _SUMMARIES))
_OWN = (*_RASTERS, *(name.replace(".tif", ".qml") for name in _RASTERS))
_LEFT_OVER = tuple(f"{place}.*.part[0-9]*.{suffix}" for place in ("", f"{RASTERS}/") for suffix in ("tif", "qml"))


def map_files(folder):
    """Paths of the rasters of a run in its `folder`; files with other names are not of the run."""
    maps = Path(folder) / MAPS
    return sorted({path for pattern in (*_OWN, *_LEFT_OVER) for path in maps.glob(pattern)}) if maps.is_dir() else []


def refuse_other_maps(folder, record):
    """Refuse links in `maps/`, and a `maps/` that the run of the `record` did not write.

    Raises
    ------
    OutputError
    """
    maps = Path(folder) / MAPS
    if not maps.exists() and not maps.is_symlink():
        return
    refuse_links(folder, (MAPS,))
    if not maps.is_dir() or not has_rasters(record):
        raise OutputError(
            f"{maps} was not written by the run in {folder}, --overwrite will not replace it; move it, or give another "
            "-o"
        )
    refuse_links(maps)
    refuse_links(maps / RASTERS)


def has_rasters(record):
    """Whether the run of a `record` wrote rasters, and particles only for a restart."""
    output = (record.get("scene") or {}).get("output")
    return isinstance(output, dict) and output.get("rasters") is True


def run_of_maps(folder):
    """The folder of the run that wrote the rasters in `folder`; None for other folders."""
    place = Path(folder).resolve()
    return place.parent if place.name == MAPS and (place.parent / "run.json").is_file() else None


def remove_maps(folder):
    """Remove the rasters of a run in its `folder`, and folders that are then empty."""
    for path in map_files(folder):
        path.unlink()
    for place in (Path(folder) / MAPS / RASTERS, Path(folder) / MAPS):
        with suppress(OSError):
            place.rmdir()


def move_maps(source, folder):
    """Move the rasters of a run from the folder `source` to `folder`."""
    for path in map_files(source):
        if path.name.startswith("."):  # of a killed process
            continue
        place = Path(folder) / path.relative_to(source)
        place.parent.mkdir(parents=True, exist_ok=True)
        system.replace(path, place)


def assign_maps(folder, digest):
    """Set the `digest` of the scene in the rasters of the run in `folder`, each atomically."""
    for path in map_files(folder):
        if path.suffix != ".tif" or path.name.startswith("."):
            continue
        with whole_file(path) as part:
            shutil.copyfile(path, part)
            with rasterio.open(part, "r+") as target:
                if "digest" in target.tags(ns=NAMESPACE):
                    target.update_tags(ns=NAMESPACE, digest=digest)
