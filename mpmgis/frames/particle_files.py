"""Columns as files of other programs: .h5, .csv, .json, .gpkg, .parquet and .vtp.

.h5 (a frame), .csv and .parquet (GeoParquet) are written slab by slab in bounded memory; .gpkg,
.json and .vtp need the whole table in memory. Tables have a row per column and these fields: id, x, y [m, in the
CRS], z_bed, z_surface [m], thickness [m, vertical], area [m2, plan], mass [kg], volume [m3], u, v, w [m s-1].
"""

import json
import shutil
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyproj

from ..system.errors import OutputError
from ..system.optional_libraries import GEOPACKAGE, needed_for
from ..system.whole_files import whole_file
from .frame_files import write_frame_slabs
from .particles import Frame, Particles
from .text_rows import append_rows
from .vtp_file import write_vtp

# field of a table -> unit
UNITS = {
    "id": "1",
    "x": "m",
    "y": "m",
    "z_bed": "m",
    "z_surface": "m",
    "thickness": "m",
    "area": "m2",
    "mass": "kg",
    "volume": "m3",
    "u": "m s-1",
    "v": "m s-1",
    "w": "m s-1",
}
# [bytes] of a column on disk, about
_BYTES_PER_COLUMN = {".h5": 88, ".csv": 200, ".json": 220, ".gpkg": 160, ".parquet": 120, ".vtp": 104}
_WKB_POINT = np.dtype([("order", "u1"), ("kind", "<u4"), ("x", "<f8"), ("y", "<f8")])


def require_format(path: str | Path) -> None:
    """Raise unless the suffix of a file name is known and its library is installed.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    OutputError
        The suffix is unknown.
    InputError
        The library for it is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITERS:
        raise OutputError(f"{path}: format {suffix or 'without a suffix'} is unknown, expected {', '.join(_WRITERS)}")
    if suffix == ".parquet":
        with needed_for(f"{path}: Parquet", "parquet"):
            import pyarrow.parquet  # noqa: F401


def write_columns(path: str | Path, frame: Frame, count: int, slabs: Iterable[Particles]) -> None:
    """Write columns to `path` in the format of its suffix.

    Parameters
    ----------
    path : str or Path
    frame : Frame
        Everything but the particles: CRS, origin, header.
    count : int
        Number of columns.
    slabs : iterable of Particles

    Raises
    ------
    OutputError
        The suffix is unknown, or the disk has too little space.
    """
    require_format(path)
    _require_space(path, count)
    _WRITERS[Path(path).suffix.lower()](Path(path), frame, count, slabs)


def _require_space(path, count):
    """Refuse output that does not fit on the disk, before the work starts."""
    folder = Path(path).resolve().parent
    while not folder.exists():
        folder = folder.parent
    needed = count * _BYTES_PER_COLUMN[Path(path).suffix.lower()]
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise OutputError(
            f"{path}: {count} columns need about {needed / 1e6:.3g} MB, {free / 1e6:.3g} MB are free there; use "
            f"fewer columns, or give another -o"
        )


def column_table(particles: Particles, origin: tuple[float, float, float]) -> dict[str, np.ndarray]:
    """Return the fields of all tables, in map coordinates.

    Parameters
    ----------
    particles : Particles
    origin : (float, float, float) [m]
        Origin (E, N, H) of the positions.

    Returns
    -------
    dict
        Name of a field -> array[n].
    """
    x, y, z = (particles.position[:, axis] + origin[axis] for axis in range(3))
    values = (
        particles.id,
        x,
        y,
        z,
        z + particles.thickness,
        particles.thickness,
        particles.area,
        particles.mass,
        particles.volume,
        *particles.velocity.T,
    )
    return dict(zip(UNITS, values, strict=True))


def _whole_table(frame, slabs):
    parts = [column_table(particles, frame.origin) for particles in slabs]
    return {name: np.concatenate([part[name] for part in parts]) for name in UNITS}


def _record(frame: Frame) -> dict:
    """Return the metadata of a table: numbers, strings and lists."""
    crs = frame.crs.to_wkt() if frame.crs is not None else ""
    place = {"crs": crs, "dem": frame.dem, "dem_sha256": frame.dem_sha256}
    header = {k: v.tolist() if isinstance(v, (np.ndarray, np.generic)) else v for k, v in frame.header.items()}
    return {"format": "mpmgis-columns", "time": frame.time, **place, **header}


def _write_csv(path: Path, frame: Frame, count: int, slabs: Iterable[Particles]) -> None:
    with whole_file(path) as part, open(part, "wb") as sink:
        sink.write((",".join(UNITS) + "\n").encode())
        for particles in slabs:
            append_rows(sink, list(column_table(particles, frame.origin).values()), ",")


def _write_json(path: Path, frame: Frame, count: int, slabs: Iterable[Particles]) -> None:
    columns = _whole_table(frame, slabs)
    with whole_file(path) as part, open(part, "w", encoding="utf-8", newline="\n") as sink:
        sink.write('{"header": ' + json.dumps(_record(frame)) + ',\n"units": ' + json.dumps(UNITS))
        sink.write(f',\n"count": {count},\n"particles": {{')
        for number, (name, values) in enumerate(columns.items()):
            sink.write((",\n" if number else "\n") + json.dumps(name) + ": ")
            sink.write(json.dumps(values.tolist()))
        sink.write("}}\n")


def _write_gpkg(path: Path, frame: Frame, count: int, slabs: Iterable[Particles]) -> None:
    import geopandas  # 0.5 s; not needed by the other formats
    import shapely

    columns = _whole_table(frame, slabs)
    columns["id"] = columns["id"].astype(np.int64)  # GeoPackage has no unsigned integers
    points = shapely.points(columns["x"], columns["y"])
    rows = geopandas.GeoDataFrame(columns, geometry=points, crs=frame.crs)
    record = {name: json.dumps(value) for name, value in _record(frame).items()}
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a local frame has no CRS
        rows.to_file(
            part,
            layer="particles",
            driver="GPKG",
            engine="pyogrio",
            dataset_metadata=record,
            dataset_options=GEOPACKAGE,
        )


def _write_parquet(path: Path, frame: Frame, count: int, slabs: Iterable[Particles]) -> None:
    """Write GeoParquet 1.0 with WKB points, which QGIS and geopandas open as a layer."""
    import pyarrow
    import pyarrow.parquet

    crs = pyproj.CRS(frame.crs).to_json_dict() if frame.crs is not None else None
    geometry = {"encoding": "WKB", "geometry_types": ["Point"], "crs": crs}
    geo = {"version": "1.0.0", "primary_column": "geometry", "columns": {"geometry": geometry}}
    notes = {"geo": json.dumps(geo), "mpmgis": json.dumps(_record(frame))}
    with whole_file(path) as part:
        writer = None
        for particles in slabs:
            columns = column_table(particles, frame.origin)
            rows = pyarrow.table({**columns, "geometry": _wkb_points(columns["x"], columns["y"])})
            rows = rows.replace_schema_metadata(notes)
            writer = writer or pyarrow.parquet.ParquetWriter(part, rows.schema)
            writer.write_table(rows)
        writer.close()


def _wkb_points(x: np.ndarray, y: np.ndarray) -> object:
    """Return little-endian WKB points as an Arrow binary array."""
    import pyarrow

    points = np.empty(len(x), _WKB_POINT)
    points["order"], points["kind"], points["x"], points["y"] = 1, 1, x, y
    offsets = np.arange(len(x) + 1, dtype=np.int32) * _WKB_POINT.itemsize
    buffers = [None, pyarrow.py_buffer(offsets), pyarrow.py_buffer(points)]
    return pyarrow.Array.from_buffers(pyarrow.binary(), len(x), buffers)


def _write_vtp(path: Path, frame: Frame, count: int, slabs: Iterable[Particles]) -> None:
    """Write VTK PolyData with a vertex per column.

    Positions are relative to the field `origin`, for viewers with float32.
    """
    columns = _whole_table(frame, slabs)
    origin = np.array(frame.origin)
    points = np.column_stack([columns.pop("x"), columns.pop("y"), columns["z_bed"]]) - origin
    columns["velocity"] = np.column_stack([columns.pop(name) for name in ("u", "v", "w")])
    fields = {"TimeValue": [frame.time], "origin": origin.tolist()}
    write_vtp(path, points, columns, fields, json.dumps(_record(frame)))


_WRITERS = {
    ".h5": write_frame_slabs,
    ".csv": _write_csv,
    ".json": _write_json,
    ".gpkg": _write_gpkg,
    ".parquet": _write_parquet,
    ".vtp": _write_vtp,
}
