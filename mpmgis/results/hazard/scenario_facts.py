"""State facts about the results of a scenario for a hazard map: release, friction, and how the run ended."""

import math
from pathlib import Path

from ...frames.flow_end import FlowEnd
from ...frames.headline_numbers import ERROR_TAG, error_words
from ...frames.many_runs_folder import ENSEMBLE, read_folder_record
from ...frames.run_folder import read_record
from ...frames.run_maps import run_of_maps
from ...maps.averaging.result_bands import Result
from ...system.errors import MpmgisError
from ...terrain.elevation import Terrain
from ...terrain.raster_input import open_raster
from ...terrain.raster_output import NAMESPACE

TAGS = (  # of an export
    ("release", "release {}"),
    ("density", "density {} kg/m3"),
    ("digest", "digest {:.8}"),
    (ERROR_TAG, "numerical errors: {}"),
)
FRICTION_SKIPPED = ("law", "use")  # keys of [friction] that are no parameters


def facts_of(path: Path, result: Result | None = None) -> str:
    """Return release, friction and end of a run or ensemble, as text.

    For an export: what its tags name. "" where nothing is known.

    Parameters
    ----------
    path : Path
    result : Result, optional
        The opened results at the path, for the tags of an export.

    Returns
    -------
    str
    """
    record = _record_at(path)
    if isinstance(record.get("scene"), dict):
        return "; ".join(filter(None, _of_record(record)))
    return _of_tags(result)


def _record_at(path):
    """The record of the run or ensemble in a folder; {} for anything else."""
    try:
        record = read_folder_record(ENSEMBLE, path) if path.is_dir() else None
        return record or (read_record(run_of_maps(path) or path) if path.is_dir() else {})
    except MpmgisError:
        return {}


def unfinished_words(path: Path, end: FlowEnd | None) -> str:
    """Return why a run can give too low levels: it was stopped, or did not come to rest; "" for any other.

    Parameters
    ----------
    path : Path
        Folder of the run, or other results.
    end : FlowEnd or None
        State of the flow in its last step, where it is known.
    """
    record = _record_at(path)
    if record.get("state") not in (None, "finished"):
        return f"the run is {record['state']} at t = {record.get('time', math.nan):.4g} s"
    if end is None or end.came_to_rest:
        return ""
    return f"the flow did not come to rest: {end.words()}"


def _of_record(record):
    scene = record["scene"]
    release, friction = scene.get("release") or {}, scene.get("friction") or {}
    thickness, density = release.get("thickness"), release.get("density")
    yield f"release {Path(str(release['source'])).name}" if release.get("source") else ""
    yield f"thickness {thickness:g} m" if isinstance(thickness, int | float) else _measured(record, thickness)
    yield f"density {density:g} kg/m3" if isinstance(density, int | float) else ""
    numbers = (f"{name} {_text(value)}" for name, value in friction.items() if name not in FRICTION_SKIPPED)
    yield " ".join([str(friction.get("law", "")), *numbers]).strip()
    varied = (record.get("plan") or {}).get("vary") or {}
    yield f"varied: {', '.join(map(str, varied))}" if varied else ""
    yield f"ended: {record['reason']}" if record.get("reason") else ""
    yield f"digest {str(record['digest'])[:8]}" if record.get("digest") else ""
    errors = error_words(record.get("companion"))
    yield f"numerical errors: {errors}" if errors else ""


def _measured(record, source):
    """Return thickness and volume that a run took from a column or a raster; "" of a version without their record."""
    found = record.get("release")
    names = ("mean_thickness", "largest_thickness", "volume")
    if not isinstance(found, dict) or not all(isinstance(found.get(name), int | float) for name in names):
        return ""
    mean, largest, volume = (found[name] for name in names)
    named = f" from {Path(str(source)).name!r}" if source else ""
    return f"vertical thickness{named} {mean:.3g} m on average, {largest:.3g} m at most, volume {volume:.0f} m3"


def _text(value):
    return f"{value:g}" if isinstance(value, float) else str(value)


def _of_tags(result):
    band = None if result is None or isinstance(result.terrain, Terrain) else next(iter(result.bands.values()), None)
    if band is None:
        return ""
    with open_raster(band.path) as source:
        tags = source.tags(ns=NAMESPACE)
    return "; ".join(words.format(tags[name]) for name, words in TAGS if tags.get(name))
