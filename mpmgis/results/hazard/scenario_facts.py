"""State facts about the results of a scenario for a hazard map: release, friction, and how the run ended."""

import math
from pathlib import Path

from ...frames.flow_end import FlowEnd
from ...frames.headline_numbers import ERROR_TAG
from ...frames.many_runs_folder import ENSEMBLE, read_folder_record
from ...frames.run_facts import record_facts
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
QUANTITIES = ("release", "thickness", "vertical thickness", "volume", "density", "digest")


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
    facts = record_facts(_record_at(path))
    return "; ".join(_words(*fact) for fact in facts.items()) if facts else _of_tags(result)


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


def _words(name, text):
    """A fact as part of a sentence: quantities as "name value", the friction law without its name."""
    if name == "friction":
        return text
    return f"{name}{'' if name in QUANTITIES else ':'} {text}"


def _of_tags(result):
    band = None if result is None or isinstance(result.terrain, Terrain) else next(iter(result.bands.values()), None)
    if band is None:
        return ""
    with open_raster(band.path) as source:
        tags = source.tags(ns=NAMESPACE)
    return "; ".join(words.format(tags[name]) for name, words in TAGS if tags.get(name))
