"""What a kind of file is: how it is recognised and its table of facts; and the words of all facts on the screen.

The table of a kind has the value of each key, for JSON. NAMED has text, unit and form of each key, also of keys in
records, for the screen.
"""

import json
import math
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...exchange.declarations import Declarations, find_sidecar
from ...exchange.readers.reader_list import reader_of
from ...system.errors import FormatError, one_line
from ...system.file_references import leads_to

HDF5_SUFFIXES = (".h5", ".hdf5", ".mat")  # of particles, whose arrays are listed where none has a usual name
MAP = "unit of the map"  # in place of a unit: that of the coordinates
# forms of a fact on the screen: smallest to largest value; the same for each band; names of files and whether they
# are there; one line for each entry; a text that is not cut; not shown
RANGE, BANDS, EXISTS, LINES, WHOLE, HIDDEN = "range", "bands", "exists", "lines", "whole", "hidden"


class Words(NamedTuple):
    """How a fact is shown: text ("": its key with blanks), unit of its numbers, form."""

    text: str = ""
    unit: str = ""
    form: str = ""


def _all(unit, *keys):
    return dict.fromkeys(keys, Words(unit=unit))


TAKERS = (  # what energy is lost to
    *("ground", "eroded_mass", "barriers", "speed_limit", "mixing", "bends", "yielding", "affine_limit", "layers"),
    "forest",
)
NAMED = {
    **_all("s", "time", "first_time", "end_time", "frame_interval"),
    **_all("kg", "mass", "mass_at_start", "mass_start", "mass_now", "mass_out", "mass_detrained", "mass_at_rest"),
    **_all("kg", "mass_flowing", "reference_mass", "lightest_column", "heaviest_column"),
    **_all("m3", "volume", "reference_volume", "particle_volume"),
    **_all("m", "thickness_max", "thickness_max_now", "drop"),
    **_all("m s-1", "speed_max_now", "speed", "velocity", "speed_p999", "speed_p999_now"),
    **_all("m2", "area", "release_area", "footprint_area", "forest_area", "forest_broken_area"),
    **_all("J", "kinetic_energy", "kinetic_energy_peak", "potential_energy", "energy_lost", "energy_start"),
    **_all("J", "energy_released_later", "energy_entrained", "energy_lifted", "energy_returned", "energy_out"),
    **_all("J", "energy_of_volume_corrections", "ground_friction_work", *(f"energy_lost_to_{k}" for k in TAKERS)),
    **_all("degrees", "friction_angle", "bed_friction_angle"),
    **_all("kg m-3", "density"),
    **_all("m s-2", "xi"),
    **_all("(tangent)", "slope_median"),
    **_all(MAP, "cell_size"),
    "n": Words("particles"),
    "bbox": Words("W, S, E, N", MAP),
    "crs": Words("CRS"),
    "map_unit": Words(form=HIDDEN),
    "cells": Words(form=HIDDEN),  # see size
    "qgis": Words("QGIS"),
    "times": Words("", "s", RANGE),
    "wall_seconds": Words("computing time", "s"),
    "elevation": Words("", "m", RANGE),
    "thickness": Words("column thickness, vertical", "m", RANGE),
    "column_area": Words("", "m2", RANGE),
    "max_speed": Words("largest speed now", "m s-1"),
    "speed_so_far": Words("largest speed so far", "m s-1"),
    "thickness_so_far": Words("largest thickness so far, vertical", "m"),
    "own_axes": Words("its own axes"),
    "digest": Words("digest of the scene"),
    "result_digest": Words("digest of the result"),
    "frames_are": Words("its frames are"),
    "contents": Words("its arrays are"),
    "beside": Words("files beside it"),
    "files": Words(form=EXISTS),
    "to_be_told": Words(form=LINES),
    "as_terrain": Words(form=WHOLE),  # may contain a command to copy
    "terrain_notes": Words(form=LINES),
    **dict.fromkeys(("maxima", "deposit", "last step"), Words(form=BANDS)),
}


class Seen:
    """A file or folder, with what its kind is recognised by.

    Parameters
    ----------
    path : Path
    terms : Declarations
        Of the user.
    """

    def __init__(self, path: Path, terms: Declarations) -> None:
        self.path, self.terms = path, terms
        self.is_folder, self.suffix = path.is_dir(), path.suffix.lower()

    @cached_property
    def reader(self) -> str:
        """The reader of the particles in the file."""
        described = bool(self.terms.columns) or find_sidecar(self.path) is not None or self.suffix in HDF5_SUFFIXES
        return reader_of(self.path, self.terms.reader, lenient=described)

    @cached_property
    def content(self) -> dict:
        """The object in a JSON file; {} of other files and contents."""
        if self.suffix != ".json":
            return {}
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
        except (ValueError, RecursionError) as error:
            what = leads_to(self.path) or f"is not valid JSON ({one_line(error)[:80]})"
            raise FormatError(f"{self.path} {what}") from error
        return content if isinstance(content, dict) else {}


class Kind(NamedTuple):
    """A kind of file or folder.

    Attributes
    ----------
    name : str
    found : callable
        `found(seen)` returns what `facts` needs, or None or False for another kind.
    facts : callable
        `facts(seen, found)` returns the values by key, in SI units; a `kind` among them is in place of `name`.
    takes_terms : bool
        Declarations of the user are used.
    """

    name: str
    found: Callable[[Seen], Any]
    facts: Callable[[Seen, Any], dict[str, Any]]
    takes_terms: bool = False


def ends(*suffixes: str) -> Callable[[Seen], bool]:
    """Return a function that recognises a file by its suffix.

    Parameters
    ----------
    *suffixes : str
        In lower case.
    """
    return lambda seen: seen.suffix in suffixes


def plain(value: Any) -> Any:
    """Return a value for JSON: without arrays and bytes, and non-finite numbers as text.

    Parameters
    ----------
    value : object
    """
    if isinstance(value, dict):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
