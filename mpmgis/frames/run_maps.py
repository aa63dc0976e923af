"""Rasters that a run writes itself, in `maps/` of its folder, laid out as an export."""

import re
import shutil
from contextlib import suppress
from pathlib import Path

import rasterio

from ..system import operating_system
from ..system.errors import FormatError, OutputError
from ..system.links import refuse_links
from ..system.whole_files import output_error, whole_file
from ..terrain.raster_input import open_raster
from ..terrain.raster_output import NAMESPACE
from .flow_end import DEPOSIT, LAST

MAPS, RASTERS, TERRAIN = "maps", "rasters", "dtm.tif"
_FIRST, _SUMMARIES = (
    "_0000.tif",
    ("max", DEPOSIT, LAST, "bed", "surface"),
)  # the first step is the first raster of a run
_OWN = re.compile(rf"(.*)_(\d{{4,}}|{'|'.join(_SUMMARIES)})\.(tif|qml)", re.DOTALL)
_LEFT_OVER = tuple(f"{place}.*.part[0-9]*.{suffix}" for place in ("", f"{RASTERS}/") for suffix in ("tif", "qml"))


def map_names(folder: str | Path) -> list[str]:
    """Return the names with which the rasters of a run begin, sorted; more than one only if files were added.

    Parameters
    ----------
    folder : str or Path
        Folder of the run.
    """
    first = sorted((Path(folder) / MAPS / RASTERS).glob(f"*{_FIRST}"))
    return [path.name.removesuffix(_FIRST) for path in first if _is_of_a_run(path)]


def _is_of_a_run(path: Path) -> bool:
    """Return whether a run or an export wrote the raster at `path`."""
    try:
        with open_raster(path) as source:
            return "digest" in source.tags(ns=NAMESPACE)
    except FormatError:
        return False


def map_files(folder: str | Path) -> list[Path]:
    """Return the paths of the rasters of a run, the first step last; files with other names are not of the run.

    Parameters
    ----------
    folder : str or Path
        Folder of the run.
    """
    maps = Path(folder) / MAPS
    if not maps.is_dir():
        return []
    names = {*map_names(folder), Path(folder).resolve().name}  # the latter if the first step is damaged
    left_over = (path for pattern in _LEFT_OVER for path in maps.glob(pattern))
    rasters = (path for path in (maps / RASTERS).glob("*") if _name_of(path) in names)
    terrain = (path for suffix in ("tif", "qml") for path in maps.glob(f"{Path(TERRAIN).stem}.{suffix}"))
    return sorted({*left_over, *rasters, *terrain}, key=lambda path: (path.name.endswith(_FIRST), path))


def _name_of(path: Path) -> str | None:
    """Return the name of the run in the name of one of its rasters; None for other files."""
    found = _OWN.fullmatch(path.name)
    return found and found[1]


def refuse_other_maps(folder: str | Path, record: dict) -> None:
    """Refuse links in `maps/`, and a `maps/` that the run of the record did not write.

    Parameters
    ----------
    folder : str or Path
        Folder of the run.
    record : dict
        Record of the run, empty where there is none.

    Raises
    ------
    OutputError
        `maps/` is a link, contains one, or is not of the run.
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


def has_rasters(record: dict) -> bool:
    """Return whether a run wrote rasters, and particles only for a restart.

    Parameters
    ----------
    record : dict
        Record of the run.
    """
    output = (record.get("scene") or {}).get("output")
    return isinstance(output, dict) and output.get("rasters") is True


def run_of_maps(folder: str | Path) -> Path | None:
    """Return the folder of the run that wrote the rasters in `folder`; None for other folders.

    Parameters
    ----------
    folder : str or Path
    """
    place = Path(folder).resolve()
    return place.parent if place.name == MAPS and (place.parent / "run.json").is_file() else None


def remove_maps(folder: str | Path) -> None:
    """Remove the rasters of a run, and folders that are then empty.

    Parameters
    ----------
    folder : str or Path
        Folder of the run.
    """
    for path in map_files(folder):
        path.unlink()
    for place in (Path(folder) / MAPS / RASTERS, Path(folder) / MAPS):
        with suppress(OSError):
            place.rmdir()


def remove_summaries(folder: str | Path, name: str) -> None:
    """Remove the rasters that summarise all steps of a run; a run that continues writes them again at its end.

    Parameters
    ----------
    folder : str or Path
        Folder of the run.
    name : str
        Name with which its rasters begin.

    Raises
    ------
    OutputError
        A raster cannot be removed.
    """
    for word in _SUMMARIES:
        for suffix in ("tif", "qml"):
            path = Path(folder) / MAPS / RASTERS / f"{name}_{word}.{suffix}"
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                raise output_error(path, error) from error


def move_maps(source: str | Path, folder: str | Path) -> None:
    """Move the rasters of a run to another folder.

    Parameters
    ----------
    source, folder : str or Path
        Folders of the run, old and new.
    """
    for path in map_files(source):
        if path.name.startswith("."):  # of a killed process
            continue
        place = Path(folder) / path.relative_to(source)
        place.parent.mkdir(parents=True, exist_ok=True)
        operating_system.replace(path, place)


def set_digest_of_maps(folder: str | Path, digest: str) -> None:
    """Set the digest of the scene in the rasters of a run, each atomically.

    Parameters
    ----------
    folder : str or Path
        Folder of the run.
    digest : str
    """
    for path in map_files(folder):
        _set_tags(path, {"digest": digest})


def tag_summaries(folder: str | Path, tags: dict) -> None:
    """Set tags of the rasters that summarise all steps of a run, each atomically.

    Parameters
    ----------
    folder : str or Path
        Folder of the run.
    tags : dict of str to str
    """
    for path in map_files(folder):
        found = _OWN.fullmatch(path.name)
        if found and found[2] in _SUMMARIES:
            _set_tags(path, tags)


def _set_tags(path, tags):
    """Set tags of a raster of a run, atomically; other files stay as they are, and those that have the tags."""
    if path.suffix != ".tif" or path.name.startswith("."):
        return
    with open_raster(path) as source:
        found = source.tags(ns=NAMESPACE)
    # those that have the tags are of a run that was killed after this: GDAL would append them again
    if "digest" not in found or tags.items() <= found.items():
        return
    with whole_file(path) as part:
        shutil.copyfile(path, part)
        with rasterio.open(part, "r+") as target:
            target.update_tags(ns=NAMESPACE, **tags)
