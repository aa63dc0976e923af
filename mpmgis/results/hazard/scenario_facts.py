"""State facts about the results of a scenario for a hazard map: release, friction, and how the run ended."""

import math
from pathlib import Path

from ...frames.ensemble_folder import read_ensemble_record
from ...frames.headline_numbers import ERROR_TAG, error_words
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
MOVING_ENERGY = 0.01  # [1] of the peak of kinetic energy; more at the end of a run is reported
MOVING_SPEED = 0.1  # [m s-1] mean speed; more at the end of a run is reported
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
        record = read_ensemble_record(path) if path.is_dir() else None
        return record or (read_record(run_of_maps(path) or path) if path.is_dir() else {})
    except MpmgisError:
        return {}


def end_of_run(path: Path) -> str:
    """Return how a run ended that had not come to rest; "" for others, and where nothing is known of it.

    It moves if its kinetic energy is above MOVING_ENERGY of its peak, and its mass faster than MOVING_SPEED in the
    mean.

    Parameters
    ----------
    path : Path
        Folder of the run.
    """
    record = _record_at(path)
    if record.get("state") not in (None, "finished"):
        return f"is {record['state']}"
    names = ("kinetic_energy", "kinetic_energy_peak", "mass_now")
    energy, peak, mass = ((record.get("balances") or {}).get(name) for name in names)
    if not all(isinstance(value, int | float) for value in (energy, peak, mass)) or mass <= 0:
        return ""
    speed = math.sqrt(2.0 * energy / mass)
    if energy <= MOVING_ENERGY * peak or speed <= MOVING_SPEED:
        return ""
    return f"ended at t = {record.get('time', math.nan):.4g} s with a mean speed of {speed:.2g} m/s"


def _of_record(record):
    scene = record["scene"]
    release, friction = scene.get("release") or {}, scene.get("friction") or {}
    thickness, density = release.get("thickness"), release.get("density")
    yield f"release {Path(str(release['source'])).name}" if release.get("source") else ""
    yield f"thickness {thickness:g} m" if isinstance(thickness, int | float) else ""
    yield f"density {density:g} kg/m3" if isinstance(density, int | float) else ""
    numbers = (f"{name} {_text(value)}" for name, value in friction.items() if name not in FRICTION_SKIPPED)
    yield " ".join([str(friction.get("law", "")), *numbers]).strip()
    varied = (record.get("plan") or {}).get("vary") or {}
    yield f"varied: {', '.join(map(str, varied))}" if varied else ""
    yield f"ended: {record['reason']}" if record.get("reason") else ""
    yield f"digest {str(record['digest'])[:8]}" if record.get("digest") else ""
    errors = error_words(record.get("companion"))
    yield f"numerical errors: {errors}" if errors else ""


def _text(value):
    return f"{value:g}" if isinstance(value, float) else str(value)


def _of_tags(result):
    band = None if result is None or isinstance(result.terrain, Terrain) else next(iter(result.bands.values()), None)
    if band is None:
        return ""
    with open_raster(band.path) as source:
        tags = source.tags(ns=NAMESPACE)
    return "; ".join(words.format(tags[name]) for name, words in TAGS if tags.get(name))
