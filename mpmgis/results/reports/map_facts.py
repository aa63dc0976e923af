"""Collect facts about rasters, vector files, meshes and the folder of an export, for `mpmgis info`."""

import warnings
from pathlib import Path

import geopandas
import h5py
import netCDF4
import numpy as np
import pyproj
from affine import Affine

from ...exchange.readers.general_hdf5 import MAGIC
from ...exchange.readers.reader_list import head_of
from ...seeding.release_areas import USUAL_COLUMNS
from ...system.errors import FormatError, MpmgisError, one_line
from ...system.file_references import require_local
from ...system.hdf5_reading import opened_whole, require_memory
from ...system.messages import collected, muted
from ...system.optional_libraries import needed_for
from ...system.source_names import file_of, source_of
from ...terrain.dtm import read_terrain
from ...terrain.georeference import horizontal, name_of
from ...terrain.grid import Grid
from ...terrain.raster_input import open_raster
from ...terrain.raster_scale import scale_of, sidecars
from ...terrain.vector_table import PARQUET_SUFFIXES, open_vector, unreadable_vector
from .band_statistics import band_statistics
from .fact_table import Kind, ends
from .particle_facts import is_particle_layer, particle_table_facts

_NO_FORMAT = "not recognized as being in a supported file format"  # in the error of GDAL where no driver knows a file
LARGEST_TRIED_TERRAIN = 50_000_000  # [cells] larger rasters are not tested as a DTM
TAG_NAMESPACE = "mpmgis"


def map_facts(path: str | Path) -> dict:
    """Return facts about a vector file or a raster, with its `kind`.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict

    Raises
    ------
    FormatError
        Neither of them.
    """
    try:
        return _vector_facts(path)
    except FormatError as no_vector:
        try:
            return _raster_facts(path)
        except MpmgisError as no_raster:
            for error in (no_vector, no_raster):
                if _NO_FORMAT not in str(error):  # a driver knows the file and says what is wrong with it
                    raise error from None
            raise FormatError(
                f"{path}: unknown file type: neither particles nor a scene nor a map that GDAL reads"
            ) from no_vector


def _raster_facts(path, values=True):
    """Facts about a raster; `values`: its cells are read."""
    with open_raster(path) as source:
        grid = Grid(None, source.transform, source.shape)
        tags = source.tags(ns=TAG_NAMESPACE)
        placed = source.transform != Affine.identity()
        with np.errstate(over="ignore", invalid="ignore"):
            on_a_map = np.isfinite(grid.corners()).all()
        if not on_a_map:
            raise FormatError(f"{path}: invalid georeference (corners are not finite); set it again")
        facts = {
            "kind": "raster",
            "driver": source.driver,
            "size": {"columns": source.width, "rows": source.height},
            "cells": list(source.shape),  # rows, columns: for programs that read it
            "cell_size": [float(np.hypot(*grid.matrix[:, k])) for k in (0, 1)] if placed else None,
            "orientation": _orientation(source.transform) if placed else None,
            "bbox": list(grid.bounds) if placed else None,
            **_crs_facts(source.crs.to_wkt() if source.crs else None),
            "bands": [_band_facts(path, source, band, values) for band in source.indexes],
            "tags": tags,
            **({"beside": beside} if (beside := sidecars(source)) else {}),
        }
    if values and len(facts["bands"]) == 1 and not tags and np.prod(facts["cells"]) <= LARGEST_TRIED_TERRAIN:
        facts |= _as_terrain(path)
    return facts


def _orientation(transform):
    if transform.b or transform.d:
        return "rotated"
    return "north-up" if transform.e < 0 < transform.a else "south-up" if transform.a > 0 else "mirrored"


def _crs_facts(given):
    """Short name of a CRS and the unit of its coordinates; both None without a CRS or if PROJ cannot read it."""
    try:
        crs = pyproj.CRS.from_user_input(given) if given else None
    except pyproj.exceptions.CRSError:
        crs = None
    if crs is None:
        return {"crs": None, "map_unit": None}
    axes = horizontal(crs).axis_info
    return {"crs": name_of(crs), "map_unit": axes[0].unit_name if axes else None}


def _band_facts(path, source, band, values):
    """Name, unit, scale, range and share of valid cells of one band; of a large raster from a sample of its blocks."""
    description = source.descriptions[band - 1] or f"band {band}"
    name, _, unit = description.partition(" [")
    facts = {
        "name": name,
        "unit": source.units[band - 1] or unit.rstrip("]"),
        "type": source.dtypes[band - 1],
        "nodata": source.nodatavals[band - 1],
        **scale_of(source, band),
    }
    if not values:
        return facts
    found = band_statistics(source, path, band)
    facts |= {"min": found.low, "max": found.high, "valid_share": found.valid_share}
    if found.known_share < 1.0:
        facts["sampled_share"] = found.known_share
    return facts


def _as_terrain(path):
    """`as_terrain`: 'usable', or why the commands would reject it; `terrain_notes`: what they would report."""
    with muted(), collected() as said:
        try:
            read_terrain(path)
        except MpmgisError as error:
            return {"as_terrain": _without(path, one_line(error))}
    notes = [_without(path, line) for line in said]
    return {"as_terrain": "usable"} | ({"terrain_notes": notes} if notes else {})


def _without(path, line):
    return line.removeprefix(f"{path} ").removeprefix(f"{path}: ")


def _vector_facts(path):
    """Facts about a vector file, or about particles if its points are particles."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            layers = list(_layers(path))
        except MpmgisError:
            raise
        except Exception as error:  # GDAL, Arrow and pandas raise different types
            raise FormatError(unreadable_vector(file_of(path), error)) from error
    if len(layers) == 1 and is_particle_layer(layers[0][1]):
        return {"kind": "particles", **particle_table_facts(file_of(path))}
    return {"kind": "vector", "layers": [_layer_facts(name, table) for name, table in layers]}


def _layers(path):
    """(name, table) of each layer of a vector file."""
    wanted = dict(source_of(path).options).get("layername")
    with open_vector(path) as (library, place):
        if file_of(path).suffix.lower() in PARQUET_SUFFIXES:
            with needed_for(f"{path}: Parquet", "parquet"):
                table = geopandas.read_parquet(path)
            yield file_of(path).stem, table
            return
        names = [name for name, _ in library.list_layers(place)]
        if wanted is not None and wanted not in names:
            raise FormatError(f"{path}: no layer of this name; there are {', '.join(names[:6]) or 'none'}")
        for name in names if wanted is None else [wanted]:
            yield name, library.read_dataframe(place, layer=name)


def _layer_facts(name, frame):
    """Geometry, columns, bounds and, for polygons, area and thickness of one layer."""
    facts = {"name": name, "features": len(frame), "columns": [str(c) for c in frame.columns]}
    if not isinstance(frame, geopandas.GeoDataFrame):
        return facts | {"geometry": None}
    shapes = frame.geometry
    present = shapes[~(shapes.isna() | shapes.is_empty)]
    facts["columns"].remove(shapes.name)
    facts |= {
        "geometry": ", ".join(sorted(set(present.geom_type))),
        **_crs_facts(frame.crs),
        "bbox": present.total_bounds.tolist() if len(present) else None,
    }
    planar = facts["map_unit"] in (None, "metre")
    if planar and len(present) and set(present.geom_type) <= {"Polygon", "MultiPolygon"}:
        usual = {str(c).lower(): c for c in frame.columns}
        column = next((usual[word] for word in USUAL_COLUMNS if word in usual), None)
        facts |= {"area": float(present.area.sum()), "thickness_column": column}
        if column is not None:
            facts["thickness"] = frame[column].tolist()
    return facts


def _mesh_facts(seen, found):
    """Dimensions, variables and times of a NetCDF file."""
    path = seen.path
    try:
        _require_own_values(path)
        with netCDF4.Dataset(path) as data:
            time = data.variables.get("t_s", data.variables.get("time"))  # t_s: simulated; time: stretched for QGIS
            times = [float(time[0]), float(time[-1])] if time is not None and time.size else []
            return {
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


def _exported(seen):
    """(projects, rasters) in the folder of an export; None of another."""
    projects = sorted([*seen.path.glob("*.qgz"), *seen.path.glob("*.qgs")])
    rasters = sorted((seen.path / "rasters").glob("*.tif")) + sorted((seen.path / "rasters").glob("*.vrt"))
    return (projects, rasters) if projects or rasters else None


def _export_facts(seen, found):
    """Facts about the folder of an export."""
    path, (projects, rasters) = seen.path, found
    for raster in rasters:
        require_local(raster, path)
    name = projects[0].stem if projects else rasters[0].stem.rsplit("_", 1)[0]
    steps = [raster for raster in rasters if raster.stem.rsplit("_", 1)[-1].isdigit()]
    facts = {"name": name, "project": projects[0].name if projects else None, "steps": len(steps)}
    summaries = {"maxima": f"{name}_max.tif", "deposit": f"{name}_deposit.tif", "last step": f"{name}_last.tif"}
    for what, file in summaries.items():
        if path / "rasters" / file in rasters:
            about = _raster_facts(path / "rasters" / file)
            facts |= {key: about[key] for key in ("cells", "cell_size", "bbox", "crs", "tags") if key not in facts}
            facts[what] = {band["name"]: [band["min"], band["max"]] for band in about["bands"]}
    if steps:
        times = [_raster_facts(step, values=False)["tags"].get("time") for step in (steps[0], steps[-1])]
        facts["times"] = [None if time is None else float(time) for time in times]
        facts["step_bands"] = [band["name"] for band in _raster_facts(steps[0], values=False)["bands"]]
    facts["others"] = sorted(file.name for file in path.iterdir() if file.is_file() and file.name[0] != ".")
    return facts


EXPORT = Kind("export", _exported, _export_facts)
GEOJSON = Kind(
    "vector",
    lambda seen: seen.content.get("type") in ("FeatureCollection", "Feature"),
    lambda seen, found: map_facts(seen.path),
)
MAP_FILES = (  # the last is tried for any other file
    Kind("mesh", ends(".nc"), _mesh_facts),
    Kind("raster", ends(".tif", ".tiff", ".asc", ".vrt", ".img"), lambda seen, found: _raster_facts(seen.path)),
    Kind("vector", lambda seen: True, lambda seen, found: map_facts(seen.path)),
)
