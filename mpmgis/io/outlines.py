"""The vector side of an exported run: outlines, release and thinned particles in one GeoPackage, with styles."""

import os
import sqlite3
from contextlib import closing

import numpy as np
import shapely

from ..errors import OutputError, one_line
from .clock import BASE, Clock
from .exported import moved_corner
from .markup import reference_text
from .symbols import (
    ENVELOPE,
    OUTLINE,
    RELEASE,
    outline_renderer,
    speed_renderer,
    vector_style_document,
)

PARTICLES_SHOWN = 300  # per step, about
UTC = 100  # GDAL's mark of a time in UTC
POINTS, POLYGONS = 0, 2  # QGIS' numbers of geometry types


def write_outlines(run, release=None, particles=None):
    """Write the GeoPackage of a run.

    Layers: `outline` (of the cells at least `run.min_depth` deep at each step, with depth, speed and area), `envelope`
    (of all steps together), `release`, `particles` (about 300 a step, the same ones throughout) and `layer_styles`.
    A layer with nothing in it is left out. Times are `t_s` (simulated seconds) and `t_qgis` to `t_qgis_end`
    (stretched, see `clock`).

    Parameters
    ----------
    run : ExportedRun
    release : sequence of shapely polygons, optional
        In the run's CRS. Without it the cells of a first step at time 0 are taken.
    particles : iterable of (time, ids, x, y, z, velocity), optional
        For exported steps in their order: time [s], ids uint64[n] or None, x, y, z float[n] [m], velocity
        float[n, 3] [m s-1]. Only the thinned ones are kept. Items at times that were not exported are skipped.

    Raises
    ------
    OutputError
        Where GDAL cannot write it.
    """
    clock = Clock.of(run.times)
    layers = {
        "outline": _outline_layer(run, clock),
        "envelope": _envelope_layer(run),
        "release": _release_layer(run, release),
        "particles": _particle_layer(run, clock, particles),
    }
    layers = {name: layer for name, layer in layers.items() if layer is not None}
    path = run.folder / run.outlines_file
    path.unlink(missing_ok=True)
    for name, (geometry, columns) in layers.items():
        _write_layer(path, name, geometry, columns, run.grid.crs, append=path.exists())
    try:
        _write_layer_styles(path, run, layers)
    except sqlite3.Error as error:
        raise OutputError(f"{path}: styles cannot be written ({one_line(error)}); is the disk full?") from error


def layer_names(path):
    """Tuple of str: the spatial layers of a GeoPackage, empty where there is none."""
    if not os.path.exists(path):
        return ()
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute("SELECT table_name FROM gpkg_contents WHERE data_type = 'features'").fetchall()
    return tuple(name for (name,) in rows)


def vector_renderer(layer, run):
    """`renderer-v2` of one of the GeoPackage's layers."""
    if layer == "particles":
        return speed_renderer(run)
    return outline_renderer({"outline": OUTLINE, "envelope": ENVELOPE, "release": RELEASE}[layer])


def geometry_type(layer):
    """QGIS' number and word for the geometry of one of the GeoPackage's layers."""
    return (POINTS, "Point") if layer == "particles" else (POLYGONS, "Polygon")


def mask_outline(mask, transform):
    """Valid MultiPolygon around the True cells of bool[rows, columns], holes kept; None where no cell is True."""
    from rasterio.features import shapes

    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size == 0:
        return None
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    inside = np.ascontiguousarray(mask[window])
    corner = moved_corner(transform, int(rows[0]), int(columns[0]))
    rings = [part["coordinates"] for part, _ in shapes(inside.view("uint8"), mask=inside, transform=corner)]
    return shapely.MultiPolygon([shapely.Polygon(ring[0], ring[1:]) for ring in rings])


def thin(ids, total, wanted=PARTICLES_SHOWN):
    """bool[n]: about `wanted` of `total` particles, chosen by their ids alone, so that a choice holds for all steps.

    Ids are scrambled first (Knuth's multiplicative hash), since neighbours on the seeding lattice have nearby ids.
    """
    if total <= wanted:
        return np.ones(len(ids), dtype=bool)
    scrambled = (np.asarray(ids, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)
    return scrambled < np.uint64(2**32 * wanted / total)


def _outline_layer(run, clock):
    """(geometries, columns) of the outline of each step that has one; rasters are read one at a time."""
    geometry, kept = [], []
    for k, file in enumerate(run.step_files):
        depth, speed = run.read(file, ("h", "Ut"))
        mask = _deep(depth, run)
        outline = mask_outline(mask, run.flow_grid.transform)
        if outline is not None:
            geometry.append(outline)
            kept.append((k, np.count_nonzero(mask) * run.grid.cell_area, depth[mask].max(), _largest(speed, mask)))
    if not geometry:
        return None
    step, area, depth, speed = (np.array(column) for column in zip(*kept, strict=True))
    columns = {
        "step": step.astype(np.int32),
        "t_s": np.array(run.times, dtype=float)[step],
        **_spans(clock, step),
        "area_m2": area.astype(float),
        "h_max_m": depth.astype(float),
        "Ut_max_m_s": speed.astype(float),
    }
    return np.array(geometry, dtype=object), columns


def _deep(depth, run):
    """bool[rows, columns]: the cells that outlines enclose."""
    return (depth >= run.min_depth) & (depth > 0)


def _largest(values, mask):
    """Largest finite value within `mask`; NaN where there is none."""
    inside = np.nan if values is None else values[mask & np.isfinite(values)]
    return np.max(inside) if np.size(inside) else np.nan


def _envelope_layer(run):
    """(geometry, columns) of the cells that were ever at least `min_depth` deep."""
    (depth,) = run.read(run.maxima_file, ("h_max",))
    mask = _deep(depth, run)
    outline = mask_outline(mask, run.flow_grid.transform)
    if outline is None:
        return None
    columns = {
        "area_m2": np.array([np.count_nonzero(mask) * run.grid.cell_area]),
        "h_max_m": np.array([float(depth[mask].max())]),
        "min_depth_m": np.array([float(run.min_depth)]),
    }
    return np.array([outline], dtype=object), columns


def _release_layer(run, release):
    """(geometries, columns) of the release: as given, else the cells of a first step at time 0."""
    source = "release area"
    if release is None and run.times[0] == 0:
        (depth,) = run.read(run.step_files[0], ("h",))
        outline = mask_outline(_deep(depth, run), run.flow_grid.transform)
        source, release = "cells of the flow at t = 0 s", [outline] if outline is not None else []
    if not release:
        return None
    parts = [shapely.MultiPolygon(_polygons(part)) for part in release]
    columns = {
        "part": np.arange(1, len(parts) + 1, dtype=np.int32),
        "area_m2": np.array([part.area for part in parts]),
        "source": np.array([source] * len(parts), dtype=object),
    }
    return np.array(parts, dtype=object), columns


def _polygons(geometry):
    """List of the polygons in a valid form of any geometry."""
    pieces = shapely.get_parts(shapely.make_valid(geometry))
    return [polygon for piece in pieces for polygon in shapely.get_parts(piece) if polygon.geom_type == "Polygon"]


def _particle_layer(run, clock, particles):
    """(geometries, columns) of thinned particles at the exported steps."""
    if particles is None:
        return None
    steps = {float(time): k for k, time in enumerate(run.times)}
    total, kept = None, []
    for time, ids, x, y, z, velocity in particles:
        if float(time) not in steps:
            continue
        ids = np.arange(len(x), dtype=np.uint64) if ids is None else np.asarray(ids, dtype=np.uint64)
        total = len(ids) if total is None else total
        chosen = np.flatnonzero(thin(ids, total))
        place = np.stack([np.asarray(axis, float)[chosen] for axis in (x, y, z)], axis=1)
        kept.append((np.full(chosen.size, steps[float(time)]), ids[chosen], place, np.asarray(velocity)[chosen]))
    if not kept or not sum(len(entry[0]) for entry in kept):
        return None
    step, ids, place, velocity = (np.concatenate(column) for column in zip(*kept, strict=True))
    velocity = velocity.astype(float)
    columns = {
        "id": ids.astype(np.int64),
        "step": step.astype(np.int32),
        "t_s": np.array(run.times, dtype=float)[step],
        **_spans(clock, step),
        "speed": np.linalg.norm(velocity, axis=1),
        "v_E": velocity[:, 0],
        "v_N": velocity[:, 1],
        "v_up": velocity[:, 2],
    }
    return shapely.points(place), columns


def _spans(clock, step):
    """Columns of when steps show on the stretched clock, datetime64[ms]; `t_qgis_end` is a second before the next."""
    base = np.datetime64(BASE.replace(tzinfo=None), "ms")
    seconds = {"t_qgis": np.array(clock.begins), "t_qgis_end": np.array(clock.ends) - 1}
    return {name: base + value.astype(np.int64)[step] * np.timedelta64(1000, "ms") for name, value in seconds.items()}


def _write_layer(path, name, geometry, columns, crs, append):
    """Write one layer with pyogrio, which makes the file with the first and adds the others."""
    from pyogrio.errors import DataLayerError, DataSourceError
    from pyogrio.raw import write

    try:
        write(
            path,
            shapely.to_wkb(geometry, output_dimension=3 if name == "particles" else 2),
            list(columns.values()),
            list(columns),
            layer=name,
            driver="GPKG",
            geometry_type="Point Z" if name == "particles" else "MultiPolygon",
            crs=reference_text(crs),
            append=False,
            gdal_tz_offsets={key: np.full(len(geometry), UTC) for key in columns if key.startswith("t_qgis")},
            **({} if append else {"dataset_options": {"VERSION": "1.2"}}),
        )
    except (DataSourceError, DataLayerError) as error:
        raise OutputError(f"{path}: layer '{name}' cannot be written ({one_line(error)})") from error


def _write_layer_styles(path, run, layers):
    """Add the table from which QGIS takes a layer's default style when it is opened by itself."""
    if not layers:
        return
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(
            "CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT, f_table_catalog TEXT(256), "
            "f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256), styleName TEXT(30), "
            "styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30), "
            "update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))"
        )
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) "
            "VALUES ('layer_styles', 'attributes', 'layer_styles', 0)"
        )
        for name in layers:
            style = vector_style_document(vector_renderer(name, run), geometry_type(name)[0])
            database.execute(
                "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
                "styleName, styleQML, styleSLD, useAsDefault, description, owner) "
                "VALUES ('', '', ?, 'geom', 'mpmgis', ?, '', 1, 'written by mpmgis', 'mpmgis')",
                (name, style),
            )
