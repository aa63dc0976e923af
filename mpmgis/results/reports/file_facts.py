"""Collect facts about any file or folder of the processing chain, for `mpmgis info`.

Facts are a dictionary of numbers, strings, lists and dictionaries, in SI units; `kind` names the type of file. The
type is detected from the contents; the suffix only decides which reader is tried first.
"""

import json
import math
import re
from pathlib import Path
from xml.etree import ElementTree

import h5py
import netCDF4
import numpy as np

from ...exchange.declarations import FORMAT as SIDECAR_FORMAT
from ...exchange.declarations import SUFFIX, Declarations, find_sidecar, read_sidecar
from ...exchange.frame_list import third_party_files
from ...exchange.readers.general_hdf5 import MAGIC
from ...exchange.readers.reader_list import OWN, head_of, reader_of
from ...exchange.writers.writer_list import SOLVER_FILES
from ...frames.frame_digest import check_kept, check_result
from ...frames.many_runs_folder import ENSEMBLE, MAPS, read_folder_record
from ...frames.run_folder import FRAME_PATTERN, RECORD_FILE, SCENE_FILE, read_record
from ...frames.run_maps import has_rasters
from ...scene import read_scene
from ...system.errors import FormatError, InputError, MpmgisError, one_line
from ...system.file_references import leads_to, require_local
from ...system.hdf5_reading import opened_whole, require_memory
from ...system.source_names import file_of, source_of
from ...terrain.georeference import name_of
from .map_facts import project_facts, raster_facts, vector_facts
from .particle_facts import PEAKS, frame_facts, particle_table_facts, third_party_facts

README = "README.txt"
CLOSE = 1e-6  # [1] tolerance of the mass in README.txt
_NO_FORMAT = "not recognized as being in a supported file format"  # in the error of GDAL where no driver knows a file
_WRITTEN = re.compile(r"(\d+) points, (\S+) kg, .* from (.+), written for (.+) by mpmgis (\S+)\.")
HDF5_SUFFIXES = (".h5", ".hdf5", ".mat")  # of particles, whose arrays are listed where none has a usual name
LARGEST_CHECKED_RESULT = 20_000_000_000  # [bytes] of frames whose digest is checked


def start_facts(folder: str | Path) -> dict | None:
    """Return facts about the start files of a solver in `folder`; None if it is not such a folder.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    dict or None

    Raises
    ------
    FormatError
        Its files are damaged, or differ from README.txt.
    """
    folder = Path(folder)
    written = _WRITTEN.match(_first_line(folder / README))
    solver = next((files for files in SOLVER_FILES.values() if written and files.title == written[4]), None)
    if solver is None or not (folder / SUFFIX).is_file():
        return None
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
    if source.is_plain and not source.options:
        return _plain(_facts(source.file, terms))
    _reject_unused(path, terms)
    known = {"bytes": source.file.stat().st_size} if source.file.is_file() else {}
    return _plain({"file": str(source), **known, **_map_facts(str(source))})


def _facts(path, terms):
    if path.is_dir():
        return {"file": str(path), **_folder_facts(path, terms)}
    if not path.exists():
        raise FormatError(f"{path}: no such file or folder")
    if path.stat().st_size == 0:
        raise FormatError(f"{path} is empty (0 bytes)")
    described = bool(terms.columns) or find_sidecar(path) is not None or path.suffix.lower() in HDF5_SUFFIXES
    foreign = reader_of(path, terms.reader, lenient=described)
    if foreign != OWN:
        return {"file": str(path), "bytes": path.stat().st_size, **third_party_facts([path], foreign, terms)}
    _reject_unused(path, terms)
    known = _BY_SUFFIX.get(path.suffix.lower(), _map_facts)
    return {"file": str(path), "bytes": path.stat().st_size, **known(path)}


def _plain(value):
    """`value` for JSON: without arrays and bytes, and non-finite numbers as text."""
    if isinstance(value, dict):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _reject_unused(path, terms):
    unused = terms.only_for_third_party()
    if unused:
        raise InputError(f"{path} is not a particle file of another code; {', '.join(unused)} requires one; omit it")


def _folder_facts(path, terms):
    """Facts about a folder: frames of any code, or written by `export-raster`, `ensemble` or `--for`."""
    ensemble = read_folder_record(ENSEMBLE, path)
    if ensemble is not None:
        _reject_unused(path, terms)
        return _ensemble_facts(path, ensemble)
    start = start_facts(path)
    if start is not None:
        _reject_unused(path, terms)
        return start
    frames = sorted(path.glob(FRAME_PATTERN)) or sorted(path.glob("*.h5"))
    if any(reader_of(frame) == OWN for frame in frames):
        _reject_unused(path, terms)
        return _results_facts(path, frames)
    reader, files = third_party_files(path, terms.reader)
    if files:
        return third_party_facts(files, reader, terms)
    _reject_unused(path, terms)
    projects = sorted([*path.glob("*.qgz"), *path.glob("*.qgs")])
    rasters = sorted((path / "rasters").glob("*.tif")) + sorted((path / "rasters").glob("*.vrt"))
    if projects or rasters:
        return _export_facts(path, projects, rasters)
    raise FormatError(f"{path} has neither frames (*.h5) nor an export (rasters/, *.qgz); name a file in it")


def _ensemble_facts(path, record):
    """Plan, state and maps of an ensemble."""
    plan = record.get("plan") if isinstance(record.get("plan"), dict) else {}
    facts = {key: plan.get(key) for key in ("sampling", "samples", "seed", "vary", "exceed", "percentiles")}
    maps = sorted(file.name for file in (path / MAPS).glob("rasters/*.tif"))
    facts |= {"members": record.get("members"), "maps": maps, "plan_digest": record.get("digest")}
    known = {key: value for key, value in facts.items() if value not in (None, [], {})}
    return {"kind": "ensemble", "state": str(record.get("state", "unknown")), **known}


def _results_facts(path, frames):
    first, last = frame_facts(frames[0]), frame_facts(frames[-1])
    facts = {
        "kind": "results",
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


def _export_facts(path, projects, rasters):
    for raster in rasters:
        require_local(raster, path)
    name = projects[0].stem if projects else rasters[0].stem.rsplit("_", 1)[0]
    steps = [raster for raster in rasters if raster.stem.rsplit("_", 1)[-1].isdigit()]
    facts = {"kind": "export", "name": name, "project": projects[0].name if projects else None, "steps": len(steps)}
    summaries = {"maxima": f"{name}_max.tif", "deposit": f"{name}_deposit.tif", "last step": f"{name}_last.tif"}
    for what, file in summaries.items():
        if path / "rasters" / file in rasters:
            about = raster_facts(path / "rasters" / file)
            facts |= {key: about[key] for key in ("cells", "cell_size", "bbox", "crs", "tags") if key not in facts}
            facts[what] = {band["name"]: [band["min"], band["max"]] for band in about["bands"]}
    if steps:
        times = [raster_facts(step, values=False)["tags"].get("time") for step in (steps[0], steps[-1])]
        facts["times"] = [None if time is None else float(time) for time in times]
        facts["step_bands"] = [band["name"] for band in raster_facts(steps[0], values=False)["bands"]]
    facts["others"] = sorted(file.name for file in path.iterdir() if file.is_file() and file.name[0] != ".")
    return facts


def _read_json(path):
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        what = leads_to(path) or f"is not valid JSON ({one_line(error)[:80]})"
        raise FormatError(f"{path} {what}") from error


def _json_facts(path):
    """Facts about `run.json`, particles, or GeoJSON."""
    content = _read_json(path)
    if isinstance(content, dict) and content.get("format") == "mpmgis-run":
        version = content.get("format_version")
        if not isinstance(version, int) or version > 1:
            raise FormatError(f"{path}: format version {version!r}, expected at most 1; update mpmgis")
        return {"kind": "run record", **{name: value for name, value in content.items() if name != "scene"}}
    if isinstance(content, dict) and content.get("format") == SIDECAR_FORMAT:
        return _sidecar_facts(path)
    if isinstance(content, dict) and content.get("type") in ("FeatureCollection", "Feature"):
        return _map_facts(path)
    if not (isinstance(content, dict) and "format" in content) and (what := leads_to(path)):
        raise FormatError(f"{path} {what}")
    return particle_table_facts(path)


def _sidecar_facts(path):
    """Facts about a sidecar with declarations for files of other codes."""
    terms = vars(read_sidecar(path))
    set_terms = {k: v for k, v in terms.items() if v not in (None, ()) and k not in ("crs", "columns")}
    crs, columns = terms["crs"], dict(terms["columns"])
    return {"kind": "georeference", "crs": name_of(crs) if crs is not None else None, **set_terms, "columns": columns}


def _toml_facts(path):
    """Facts about a scene, and whether its files exist."""
    scene = read_scene(path)
    there = {name: _is_there(scene.path(name), path) for name in scene.files()}
    return {"kind": "scene", **scene.as_tables(), "files": there}


def _is_there(name, named_by):
    """Whether the file of a name in a scene exists; False for one elsewhere."""
    try:
        require_local(name, named_by)
    except FormatError:
        return False
    return file_of(name).exists()


def _style_facts(path):
    """Facts about a QGIS style: layer type, renderer and classes."""
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise FormatError(f"{path} is not a readable QGIS style ({one_line(error)[:80]})") from error
    renderers = {"raster": root.find("pipe/rasterrenderer"), "vector": root.find("renderer-v2")}
    layer = next((name for name, renderer in renderers.items() if renderer is not None), None)
    if root.tag != "qgis" or (layer is None and not root.get("styleCategories")):
        raise FormatError(f"{path} is not a QGIS style: it has <{root.tag}> without a renderer")
    renderer = renderers.get(layer)
    facts = {"kind": "QGIS style", "qgis": root.get("version", ""), "layer": layer}
    if renderer is not None:
        classes = [*renderer.iter("item"), *renderer.iter("paletteEntry"), *renderer.iter("category")]
        facts |= {"renderer": renderer.get("type", ""), "classes": [entry.get("label", "") for entry in classes]}
    return facts


def _mesh_facts(path):
    """Facts about a NetCDF file: dimensions, variables and times."""
    try:
        _require_own_values(path)
        with netCDF4.Dataset(path) as data:
            time = data.variables.get("t_s", data.variables.get("time"))  # t_s: simulated; time: stretched for QGIS
            times = [float(time[0]), float(time[-1])] if time is not None and time.size else []
            return {
                "kind": "mesh",
                "conventions": str(getattr(data, "Conventions", "")),
                "dimensions": {name: len(size) for name, size in data.dimensions.items()},
                "times": times,
                "variables": {name: str(getattr(values, "units", "")) for name, values in data.variables.items()},
            }
    except (OSError, RuntimeError) as error:
        raise FormatError(f"{path} is not a readable NetCDF file ({one_line(error)[:80]})") from error


def _require_own_values(path):
    """Reject a NetCDF-4 file with external data, or with time chunks larger than memory."""
    if head_of(path).startswith(MAGIC):
        with opened_whole(path) as file:
            for name in ("t_s", "time"):
                if isinstance(file.get(name), h5py.Dataset):
                    require_memory(f"{path}: {name}", 1, 8, file[name])


def _map_facts(path):
    """Facts about a vector file or a raster."""
    try:
        return vector_facts(path)
    except FormatError as no_vector:
        try:
            return raster_facts(path)
        except MpmgisError as no_raster:
            for error in (no_vector, no_raster):
                if _NO_FORMAT not in str(error):  # a driver knows the file and says what is wrong with it
                    raise error from None
            raise FormatError(
                f"{path}: unknown file type: neither particles nor a scene nor a map that GDAL reads"
            ) from no_vector


_BY_SUFFIX = {
    ".h5": frame_facts,
    ".hdf5": frame_facts,
    ".csv": particle_table_facts,
    ".vtp": particle_table_facts,
    ".json": _json_facts,
    ".toml": _toml_facts,
    ".qgz": project_facts,
    ".qgs": project_facts,
    ".qml": _style_facts,
    ".nc": _mesh_facts,
    **dict.fromkeys((".tif", ".tiff", ".asc", ".vrt", ".img"), raster_facts),
}
