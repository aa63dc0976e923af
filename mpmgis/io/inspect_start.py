"""Facts about a folder from which another solver starts (`--for`): what is in it, read from the solver's own files."""

import re
from pathlib import Path

import numpy as np

from ..errors import FormatError, MpmgisError, one_line
from ..geo.georeference import name_of
from .foreign.sidecar import SUFFIX, read_sidecar
from .foreign.terms import ForeignTerms
from .frame_list import foreign_files
from .inspect_particles import foreign_facts
from .solver_files.solvers import SOLVER_FILES

README = "README.txt"
CLOSE = 1e-6  # of the mass that README.txt tells
_WRITTEN = re.compile(r"(\d+) points, (\S+) kg, .* from (.+), written for (.+) by mpmgis (\S+)\.")


def start_facts(folder):
    """Facts about what a solver starts from in `folder`; None where it is no such folder.

    Raises
    ------
    FormatError
        Its files are damaged, or not as README.txt tells.
    """
    folder = Path(folder)
    written = _WRITTEN.match(_first_line(folder / README))
    solver = next((files for files in SOLVER_FILES.values() if written and files.title == written[4]), None)
    if solver is None or not (folder / SUFFIX).is_file():
        return None
    terms = read_sidecar(folder / SUFFIX)
    facts = _of_series(folder) if solver.finish is not None else _read_back(folder, solver, terms)
    told = int(written[1]), float(written[2])
    found = facts.pop("first_n", facts["n"]), facts.pop("first_mass", facts["mass"])
    if found[0] != told[0] or not np.isclose(found[1], told[1], rtol=CLOSE, atol=0):
        raise FormatError(
            f"{folder} holds {found[0]} points of {found[1]:.9g} kg, but its {README} tells of {told[0]} of "
            f"{told[1]:.9g} kg; it was changed, write it anew"
        )
    return {
        "kind": f"start of {solver.title}",
        **facts,
        "crs": name_of(terms.crs) if terms.crs is not None else None,
        "origin": list(terms.origin),
        "axes": list(terms.axes),
        "made_from": written[3],
        "version": written[5],
        "start": solver.start,
        "holds": sorted(file.name for file in folder.iterdir() if file.name[0] != "."),
    }


def _first_line(path):
    if not path.is_file():
        return ""
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.readline(1000)
    except OSError:
        return ""


def _of_series(folder):
    """Number, mass and place of the frames of points in a folder."""
    reader, files = foreign_files(folder)
    if not files:
        raise FormatError(f"{folder} holds no points any more; write it anew")
    facts = foreign_facts(files, reader, ForeignTerms())
    names = ("frames", "first_time", "time", "n", "mass", "volume", "bbox", "elevation", "max_speed", "series", "lost")
    first = (facts.get("series") or [facts])[0]
    kept = {name: facts[name] for name in names if name in facts}
    return kept | {"first_n": first["n"], "first_mass": first["mass"]}


def _read_back(folder, solver, terms):
    """Number, mass and place of the points that a solver's files hold."""
    try:
        place, volume = solver.read_back(folder, 0)
        low, high = place.min(axis=0) + terms.origin, place.max(axis=0) + terms.origin
        mass = float(volume.sum()) * terms.density
    except (MpmgisError, OSError, ValueError, LookupError, TypeError, StopIteration) as error:
        raise FormatError(f"{folder}: its files for {solver.title} cannot be read ({one_line(error)[:80]})") from error
    return {
        "n": len(place),
        "mass": mass,
        "volume": float(volume.sum()),
        "density": terms.density,
        "bbox": [low[0], low[1], high[0], high[1]],
        "elevation": [low[2], high[2]],
    }
