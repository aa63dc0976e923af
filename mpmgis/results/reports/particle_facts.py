"""Collect facts about particle files: number, time, bounds, mass, speed."""

import json
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pyproj

from ...exchange.declarations import Declarations
from ...exchange.frame_georeferencing import (
    missing_declarations,
    named_columns,
    series_position,
    third_party_particles,
    times_of,
)
from ...exchange.frame_list import third_party_frames
from ...exchange.readers.delimited import LONGEST_HEADER, header_of
from ...exchange.readers.mapped_files import mapped
from ...exchange.readers.record_parsing import read_rows
from ...exchange.readers.vtk_xml import POINTS, read_array, read_layout
from ...frames.frame_digest import check_content
from ...frames.frame_files import read_frame, read_maxima
from ...frames.peaks import largest_peaks
from ...system.errors import FormatError, InputError, MpmgisError, one_line
from ...system.hdf5_reading import opened_whole
from ...system.optional_libraries import needed_for
from ...terrain.georeference import name_of
from ...terrain.vector_table import open_vector

PEAKS = {"thickness": "thickness_so_far", "speed": "speed_so_far"}  # solver maxima: name of the fact
NEEDED = ("x", "y", "z_bed", "mass", "volume", "u", "v", "w")  # required columns of a particle table
MOST_FRAMES_READ = 12  # of another code; of longer series only the first and the last


def frame_facts(path: Path) -> dict:
    """Return facts about a frame of mpmgis.

    Parameters
    ----------
    path : Path

    Returns
    -------
    dict
    """
    frame = read_frame(path, with_state=False)
    particles, origin = frame.particles, np.asarray(frame.origin)
    facts = {
        "reader": "mpmgis",
        "dimension": frame.dimension,
        "time": frame.time,
        "step": frame.step,
        "solver": frame.solver,
        "crs": name_of(frame.crs) if frame.crs is not None else None,
        **_sums(particles.position + origin, particles.velocity, particles.mass, particles.volume),
    }
    if frame.dimension == 2:
        facts["thickness"] = [float(particles.thickness.min()), float(particles.thickness.max())]
        facts["column_area"] = [float(particles.area.min()), float(particles.area.max())]
    facts |= {"dem": frame.dem, "digest": frame.digest, "arrays": list(particles.arrays())}
    kept = read_maxima(path)
    facts |= {fact: largest_peaks(kept)[name] for name, fact in PEAKS.items() if kept}
    with opened_whole(path) as file:
        facts["version"] = str(file.attrs.get("version", ""))
        facts["groups"] = sorted(set(file) - {"particles"})
    contents = check_content(path)
    if contents is not None:
        facts["contents"] = contents
    facts["header"] = dict(frame.header)
    return facts


def third_party_facts(paths: Sequence, reader: str, terms: Declarations) -> dict:
    """Return facts about files of another code; unknown facts are None.

    For several frames: facts of the last one, and number and mass of each.

    Parameters
    ----------
    paths : sequence of Path
    reader : str
        Name of the code.
    terms : Declarations
        Of the user.

    Returns
    -------
    dict

    Raises
    ------
    FormatError, InputError
        Unreadable files, or a declaration that does not fit.
    """
    frames, terms = third_party_frames(paths, reader, terms)
    try:
        times = times_of(frames, terms)
    except InputError:
        times = [None] * len(frames)  # the number of --times differs from that of the frames
    series = sorted(zip(frames, times, strict=True), key=lambda entry: series_position(entry[0]))
    if len(series) == 1:
        return {"kind": "particles", **_third_party_frame_facts(*series[0], reader, terms)}
    shown = series if len(series) <= MOST_FRAMES_READ else [series[0], series[-1]]
    read = [_third_party_frame_facts(frame, time, reader, terms) for frame, time in shown]
    facts = {"kind": "results", "frames": len(series), "first_time": read[0]["time"], **read[-1]}
    facts["series"] = [
        {"name": frame.path.name, **{key: some[key] for key in ("time", "n", "mass")}}
        for (frame, _), some in zip(shown, read, strict=True)
    ]
    lost = max(some["n"] for some in read) - read[-1]["n"]
    return facts | ({"lost": f"{lost} particles, between the largest of these frames and the last"} if lost else {})


def _third_party_frame_facts(frame, time, reader, terms):
    """Facts about one frame of another code."""
    particles = third_party_particles(frame, terms)
    origin = np.asarray(terms.origin or (0.0, 0.0, 0.0), float)
    facts = _sums(particles.position + origin, particles.velocity, particles.mass, particles.volume)
    if terms.axes is None or terms.origin is None:
        facts |= {"bbox": None, "elevation": None}
    for name in ("mass", "volume", "density", "max_speed"):
        if facts[name] is not None and not np.isfinite(facts[name]):
            facts[name] = None
    named = named_columns(frame, terms)
    own = frame.read(tuple(named[name] for name in "xyz"))
    return {
        "reader": reader,
        "dimension": 3,
        "time": time,
        "step": frame.number,
        "crs": name_of(terms.crs) if terms.crs is not None else None,
        **facts,
        "out_of_action": frame.count - facts["n"],
        "own_axes": {name: [float(own[named[name]].min()), float(own[named[name]].max())] for name in "xyz"},
        "cell_size": frame.cell_size,
        "particle_volume": frame.particle_volume,
        "arrays": list(frame.columns),
        "to_be_told": missing_declarations(frame, terms),
    }


def _sums(position, velocity, mass, volume):
    """Number, mass [kg], volume [m3], density [kg m-3], bounds [m] and largest speed [m s-1] of particles."""
    low, high = position.min(axis=0).tolist(), position.max(axis=0).tolist()
    return {
        "n": len(mass),
        "mass": float(mass.sum()),
        "volume": float(volume.sum()),
        "density": float(mass.sum() / volume.sum()) if volume.sum() > 0 else None,
        "bbox": [low[0], low[1], high[0], high[1]],
        "elevation": [low[2], high[2]],
        "max_speed": float(np.hypot(np.hypot(velocity[:, 0], velocity[:, 1]), velocity[:, 2]).max()),
    }


def is_particle_layer(table: object) -> bool:
    """Return whether a table of features has particles (position, velocity, mass).

    Parameters
    ----------
    table : GeoDataFrame
    """
    return set(NEEDED) <= set(table.columns)


def particle_table_facts(path: str | Path) -> dict:
    """Return facts about a seed file: .csv, .json, .gpkg, .parquet or .vtp.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict

    Raises
    ------
    FormatError
        Not readable, missing columns, or non-finite values.
    """
    path = Path(path)
    try:
        columns, record = _TABLES[path.suffix.lower()](path)
    except MpmgisError:
        raise
    except Exception as error:  # Arrow, GDAL, pandas and the XML parser raise different types
        reason = one_line(error).replace(str(path), path.name)[:100]
        raise FormatError(f"{path} is not a readable particle table ({reason})") from error
    values = {name: _numbers(path, columns, name) for name in NEEDED}
    facts = {
        "reader": "mpmgis",
        "format": path.suffix.lower()[1:],
        "dimension": 2 if "thickness" in columns else 3,
        "time": float(record.get("time", 0.0)),
        "crs": name_of(pyproj.CRS.from_wkt(record["crs"])) if record.get("crs") else None,
        **_sums(
            np.column_stack([values[name] for name in ("x", "y", "z_bed")]),
            np.column_stack([values[name] for name in ("u", "v", "w")]),
            values["mass"],
            values["volume"],
        ),
    }
    for name, key in (("thickness", "thickness"), ("area", "column_area")):
        if name in columns:
            some = _numbers(path, columns, name)
            facts[key] = [float(some.min()), float(some.max())]
    apart = ("format", "time", "crs", "dem", "dem_sha256")
    facts |= {"dem": record.get("dem", ""), "arrays": [name for name in columns if name != "geometry"]}
    return facts | {"header": {name: value for name, value in record.items() if name not in apart}}


def _numbers(path, columns, name):
    """float64[n] of one required, finite column."""
    if name not in columns:
        raise FormatError(f"{path} is not a particle table: it has no column {name!r} (expected {', '.join(NEEDED)})")
    try:
        values = np.asarray(columns[name], float)
    except (TypeError, ValueError) as error:
        raise FormatError(f"{path}: column {name!r} has {one_line(error)[:60]}, expected numbers") from error
    if values.ndim != 1 or values.size == 0:
        raise FormatError(f"{path}: column {name!r} has no numbers, expected one per particle")
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise FormatError(f"{path}: column {name!r} has {bad.size} NaN or infinite values, the first in row {bad[0]}")
    return values


def _csv_table(path):
    with mapped(path) as content:
        try:
            form = header_of(content[:LONGEST_HEADER])
        except ValueError as error:
            raise FormatError(f"{path} is not a table with a header ({error})") from None
    numbers = [name for name in (*NEEDED, "thickness", "area") if name in form.columns]
    read = partial(read_rows, path, form.start, None, form)
    try:
        return dict.fromkeys(form.columns) | read(numbers), {}
    except FormatError:
        wrong = [name for name in numbers if not _is_read(read, name)]
        if len(wrong) == len(numbers):
            raise
        raise FormatError(f"{path}: column {wrong[0]!r} has values that are not numbers") from None


def _is_read(read, name):
    """True if this column can be read."""
    try:
        read([name])
    except FormatError:
        return False
    return True


def _json_table(path):
    content = json.loads(path.read_text(encoding="utf-8"))
    columns = content.get("particles") if isinstance(content, dict) else None
    if not isinstance(columns, dict):
        raise FormatError(f"{path}: unknown JSON file: neither a run record nor particles nor GeoJSON")
    return columns, content.get("header", {})


def _parquet_table(path):
    with needed_for(f"{path}: Parquet", "parquet"):
        import pyarrow.parquet

    table = pyarrow.parquet.read_table(path, columns=None)
    notes = table.schema.metadata or {}
    columns = {name: table[name].to_numpy() for name in table.column_names if name != "geometry"}
    return columns, json.loads(notes.get(b"mpmgis", b"{}"))


def _gpkg_table(path):
    with open_vector(path) as (library, place):
        table = library.read_dataframe(place, read_geometry=False)
        notes = library.read_info(place)["dataset_metadata"] or {}
    return {name: table[name].to_numpy() for name in table.columns}, {k: json.loads(v) for k, v in notes.items()}


def _vtp_table(path):
    """Columns of a VTK PolyData file as written by mpmgis, and the record in its comment."""
    layout = read_layout(path)
    arrays = {name: read_array(path, layout, array) for name, array in (layout.pieces[0] | layout.fields).items()}
    places, velocity = arrays.pop(POINTS) + arrays.pop("origin").ravel(), arrays.pop("velocity")
    arrays.pop("TimeValue", None)
    columns = {name: values[:, 0] for name, values in arrays.items()}
    columns |= dict(zip(("x", "y", "z_bed"), places.T, strict=True)) | dict(zip("uvw", velocity.T, strict=True))
    with mapped(path) as content:
        comment = re.search(rb"<!-- (\{.*?\}) -->", content)
        return columns, json.loads(comment[1].replace(b"- -", b"--")) if comment else {}


_TABLES = {
    ".csv": _csv_table,
    ".json": _json_table,
    ".gpkg": _gpkg_table,
    ".parquet": _parquet_table,
    ".vtp": _vtp_table,
}
