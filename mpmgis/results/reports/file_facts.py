"""Recognise any file or folder of the processing chain and collect facts about it, for `mpmgis info`.

FOLDERS and FILES list all kinds. The kind is detected from the contents; the suffix only decides what is tried first.
"""

import re
from pathlib import Path

import numpy as np

from ...exchange.declarations import FORMAT as SIDECAR_FORMAT
from ...exchange.declarations import SUFFIX, Declarations, read_sidecar
from ...exchange.frame_list import third_party_files
from ...exchange.readers.reader_list import OWN, reader_of
from ...exchange.writers.writer_list import SOLVER_FILES
from ...frames.frame_digest import check_kept, check_result
from ...frames.many_runs_folder import ENSEMBLE, MAPS, read_folder_record
from ...frames.run_folder import FRAME_PATTERN, RECORD_FILE, SCENE_FILE, read_record
from ...frames.run_maps import has_rasters
from ...scene import read_scene
from ...system.errors import FormatError, InputError, MpmgisError, one_line
from ...system.file_references import leads_to, require_local
from ...system.source_names import file_of, source_of
from ...terrain.georeference import name_of
from .fact_table import Kind, Seen, ends, plain
from .map_facts import EXPORT, GEOJSON, MAP_FILES, map_facts
from .particle_facts import PEAKS, frame_facts, particle_table_facts, third_party_facts
from .qgis_facts import QGIS_FILES

README = "README.txt"
CLOSE = 1e-6  # [1] tolerance of the mass in README.txt
_WRITTEN = re.compile(r"(\d+) points, (\S+) kg, .* from (.+), written for (.+) by mpmgis (\S+)\.")
LARGEST_CHECKED_RESULT = 20_000_000_000  # [bytes] of frames whose digest is checked


def _start(seen):
    """(writer, match of README.txt) of a folder with start files of a solver; None of another."""
    written = _WRITTEN.match(_first_line(seen.path / README))
    solver = next((files for files in SOLVER_FILES.values() if written and files.title == written[4]), None)
    return None if solver is None or not (seen.path / SUFFIX).is_file() else (solver, written)


def _start_facts(seen, found):
    """Facts about the start files of a solver, which must agree with README.txt."""
    folder, (solver, written) = seen.path, found
    terms = read_sidecar(folder / SUFFIX)
    facts = _of_series(folder) if solver.finish is not None else _read_back(folder, solver, terms)
    expected = int(written[1]), float(written[2])
    found = facts.pop("first_n", facts["n"]), facts.pop("first_mass", facts["mass"])
    if found[0] != expected[0] or not np.isclose(found[1], expected[1], rtol=CLOSE, atol=0):
        raise FormatError(
            f"{folder} has {found[0]} points with {found[1]:.9g} kg, expected {expected[0]} with {expected[1]:.9g} kg "
            f"({README}); it was changed, write it again"
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
    """Number, mass and bounds of the frames of points in a folder."""
    reader, files = third_party_files(folder)
    if not files:
        raise FormatError(f"{folder} has no points; write it again")
    facts = third_party_facts(files, reader, Declarations())
    names = ("frames", "first_time", "time", "n", "mass", "volume", "bbox", "elevation", "max_speed", "series", "lost")
    first = (facts.get("series") or [facts])[0]
    kept = {name: facts[name] for name in names if name in facts}
    return kept | {"first_n": first["n"], "first_mass": first["mass"]}


def _read_back(folder, solver, terms):
    """Number, mass and bounds of the points in a solver's files."""
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


def inspect(path: str | Path, terms: Declarations | None = None) -> dict:
    """Return facts about the file or folder at `path`.

    Parameters
    ----------
    path : str or Path
        Or a name of GDAL or QGIS (`source_names`).
    terms : Declarations, optional
        Declarations of the user for files of other codes.

    Returns
    -------
    dict
        Has at least `file` and `kind`. Any particle file has `reader`, `time` [s], `n`, `mass` [kg],
        `bbox` (west, south, east, north) [m] and `crs`.

    Raises
    ------
    FormatError
        Missing, empty, damaged, or of an unknown type.
    """
    source, terms = source_of(path), terms or Declarations()
    file = source.file
    size = {"bytes": file.stat().st_size} if file.is_file() else {}
    if not source.is_plain or source.options:  # a name of GDAL or QGIS
        _reject_unused(path, terms)
        return plain({"file": str(source), **size, **map_facts(str(source))})
    seen = Seen(file, terms)
    if not seen.is_folder and not file.exists():
        raise FormatError(f"{file}: no such file or folder")
    if size == {"bytes": 0}:
        raise FormatError(f"{file} is empty (0 bytes)")
    for kind in FOLDERS if seen.is_folder else FILES:
        found = kind.found(seen)
        if found is None or found is False:
            continue
        if not kind.takes_terms:
            _reject_unused(file, terms)
        return plain({"file": str(file), **size, "kind": kind.name, **kind.facts(seen, found)})
    raise FormatError(f"{file} has neither frames (*.h5) nor an export (rasters/, *.qgz); name a file in it")


def _reject_unused(path, terms):
    unused = terms.only_for_third_party()
    if unused:
        raise InputError(f"{path} is not a particle file of another code; {', '.join(unused)} requires one; omit it")


def _ensemble_facts(seen, record):
    """Plan, state and maps of an ensemble."""
    plan = record.get("plan") if isinstance(record.get("plan"), dict) else {}
    facts = {key: plan.get(key) for key in ("sampling", "samples", "seed", "vary", "exceed", "percentiles")}
    maps = sorted(file.name for file in (seen.path / MAPS).glob("rasters/*.tif"))
    facts |= {"members": record.get("members"), "maps": maps, "plan_digest": record.get("digest")}
    known = {key: value for key, value in facts.items() if value not in (None, [], {})}
    return {"state": str(record.get("state", "unknown")), **known}


def _own_frames(seen):
    """The frames of mpmgis in a folder; None without any."""
    frames = sorted(seen.path.glob(FRAME_PATTERN)) or sorted(seen.path.glob("*.h5"))
    return frames if any(reader_of(frame) == OWN for frame in frames) else None


def _results_facts(seen, frames):
    path, first, last = seen.path, frame_facts(frames[0]), frame_facts(frames[-1])
    facts = {
        "frames": len(frames),
        "first_time": first["time"],
        **{name: last[name] for name in ("time", "dimension", "solver", "n", "mass", "volume", "max_speed", "crs")},
        "bbox": last["bbox"],
        **{name: last[name] for name in PEAKS.values() if name in last},
        "mass_at_start": first["mass"],
        "reader": last["reader"],
        "files": {name: (path / name).exists() for name in (SCENE_FILE, RECORD_FILE, last["dem"] or "terrain.tif")},
    }
    if (path / RECORD_FILE).exists():
        record = read_record(path)
        facts |= {name: record[name] for name in ("state", "reason", "steps", "wall_seconds") if name in record}
        facts |= _digest_facts(frames, record)
    return facts


def _digest_facts(frames, record):
    """The digest of a run's result and its check against the frames; {} without a digest."""
    recorded, size = record.get("result_digest") or "", sum(frame.stat().st_size for frame in frames)
    if size > LARGEST_CHECKED_RESULT:
        found = f"not checked, {size / 1e9:.0f} GB"
    else:
        found = (check_kept if has_rasters(record) else check_result)(frames, recorded)
    return {} if found is None else {"result_digest": recorded, "frames_are": found}


def _other_frames(seen):
    """(reader, files) of the frames of another code in a folder; None without any."""
    reader, files = third_party_files(seen.path, seen.terms.reader)
    return (reader, files) if files else None


def _run_record_facts(seen, found):
    version = seen.content.get("format_version")
    if not isinstance(version, int) or version > 1:
        raise FormatError(f"{seen.path}: format version {version!r}, expected at most 1; update mpmgis")
    return {name: value for name, value in seen.content.items() if name != "scene"}


def _sidecar_facts(seen, found):
    """Facts about a sidecar with declarations for files of other codes."""
    terms = vars(read_sidecar(seen.path))
    set_terms = {k: v for k, v in terms.items() if v not in (None, ()) and k not in ("crs", "columns")}
    crs, columns = terms["crs"], dict(terms["columns"])
    return {"crs": name_of(crs) if crs is not None else None, **set_terms, "columns": columns}


def _json_particle_facts(seen, found):
    if "format" not in seen.content and (what := leads_to(seen.path)):
        raise FormatError(f"{seen.path} {what}")
    return particle_table_facts(seen.path)


def _scene_facts(seen, found):
    """Facts about a scene, and whether its files exist."""
    scene = read_scene(seen.path)
    there = {name: _is_there(scene.path(name), seen.path) for name in scene.files()}
    return {**scene.as_tables(), "files": there}


def _is_there(name, named_by):
    """Whether the file of a name in a scene exists; False for one elsewhere."""
    try:
        require_local(name, named_by)
    except FormatError:
        return False
    return file_of(name).exists()


def _is_json_format(name):
    return lambda seen: seen.content.get("format") == name


# in the order in which they are tried
FOLDERS = (
    Kind("ensemble", lambda seen: read_folder_record(ENSEMBLE, seen.path), _ensemble_facts),
    Kind("start", _start, _start_facts),
    Kind("results", _own_frames, _results_facts),
    Kind("results", _other_frames, lambda seen, found: third_party_facts(found[1], found[0], seen.terms), True),
    EXPORT,
)
FILES = (
    Kind(
        "particles",
        lambda seen: seen.reader != OWN,
        lambda seen, found: third_party_facts([seen.path], seen.reader, seen.terms),
        takes_terms=True,
    ),
    Kind("particles", ends(".h5", ".hdf5"), lambda seen, found: frame_facts(seen.path)),
    Kind("particles", ends(".csv", ".vtp"), lambda seen, found: particle_table_facts(seen.path)),
    Kind("run record", _is_json_format("mpmgis-run"), _run_record_facts),
    Kind("georeference", _is_json_format(SIDECAR_FORMAT), _sidecar_facts),
    GEOJSON,
    Kind("particles", ends(".json"), _json_particle_facts),
    Kind("scene", ends(".toml"), _scene_facts),
    *QGIS_FILES,
    *MAP_FILES,
)
