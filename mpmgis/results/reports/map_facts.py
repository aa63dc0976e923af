"""Collect facts about rasters, vector files and QGIS projects, for `mpmgis info`."""

import warnings
from pathlib import Path
from xml.etree import ElementTree

import geopandas
import numpy as np
import pyproj
from affine import Affine

from ...seeding.release_areas import USUAL_COLUMNS
from ...system.errors import FormatError, MpmgisError, one_line
from ...system.messages import collected, muted
from ...system.optional_libraries import needed_for
from ...system.source_names import file_of, source_of
from ...system.trusted_files import require_file
from ...system.zip_archives import opened_zip, require_unpacked
from ...terrain.dtm import read_terrain
from ...terrain.georeference import horizontal, name_of
from ...terrain.grid import Grid
from ...terrain.raster_input import open_raster
from ...terrain.raster_scale import scale_of, sidecars
from ...terrain.vector_table import PARQUET_SUFFIXES, open_vector, unreadable_vector
from .band_statistics import band_statistics
from .particle_facts import is_particle_layer, particle_table_facts

LARGEST_PROJECT = 100_000_000  # [bytes] of XML; projects with hundreds of layers have ten
MOST_LAYERS = 10_000  # of a project; more are a damaged or hostile file
_AT_ONCE = 1_000_000  # [bytes] of XML that are parsed together, to limit the memory
_CRS = ["qgis", "projectCrs", "spatialrefsys", "authid"]  # path of elements to the CRS of a project
LARGEST_TRIED_TERRAIN = 50_000_000  # [cells] larger rasters are not tested as a DTM
TAG_NAMESPACE = "mpmgis"


def project_facts(path: str | Path) -> dict:
    """Return version, CRS and layers of a QGIS project.

    Parameters
    ----------
    path : str or Path
        A .qgz or .qgs.

    Returns
    -------
    dict

    Raises
    ------
    FormatError
        Not a project, damaged, or too large.
    """
    path, found = Path(path), _Project()
    try:
        for part in _xml(path):
            found.parser.feed(part)
            if len(found.layers) > MOST_LAYERS:
                raise FormatError(f"{path} has more than {MOST_LAYERS} layers; it is not a project that QGIS opens")
        found.parser.close()
    except ElementTree.ParseError as error:
        raise FormatError(f"{path} is not a readable QGIS project ({one_line(error)[:80]})") from error
    if found.root != "qgis":
        raise FormatError(f"{path} is not a QGIS project: its root is <{one_line(found.root)[:40]}>, expected <qgis>")
    return {"kind": "QGIS project", "qgis": found.version, "crs": found.crs or None, "layers": found.layers}


def _xml(path):
    """The bytes of the project's XML, in parts."""
    if path.suffix.lower() != ".qgz":
        require_file(path)
        require_unpacked(path, path.stat().st_size, LARGEST_PROJECT)
        with open(path, "rb") as file:
            yield from iter(lambda: file.read(_AT_ONCE), b"")
        return
    with opened_zip(path, "QGIS project") as archive:
        inner = next((member for member in archive.infolist() if member.filename.endswith(".qgs")), None)
        if inner is None:
            raise FormatError(f"{path} has no .qgs, it is not a QGIS project")
        require_unpacked(f"{path}: {one_line(inner.filename)[:80]}", inner.file_size, LARGEST_PROJECT)
        with archive.open(inner) as file:
            yield from iter(lambda: file.read(_AT_ONCE), b"")


class _Project:
    """Parser target that keeps only the facts of a project."""

    def __init__(self):
        self.root = self.version = self.crs = ""
        self.layers, self.parser = [], ElementTree.XMLParser(target=self)
        self._path, self._text = [], None

    def start(self, tag, attributes):
        """An element begins."""
        if not self._path:
            self.root, self.version = tag, attributes.get("version", "")
        within = self._path[-1] if self._path else ""
        self._path.append(tag)
        if tag == "maplayer":
            self.layers.append({"name": "", "type": attributes.get("type", ""), "source": None})
        elif (within == "maplayer" and tag in ("layername", "datasource")) or self._path == _CRS:
            self._text = []

    def data(self, text):
        """A piece of text."""
        if self._text is not None:
            self._text.append(text)

    def end(self, tag):
        """An element ends."""
        if self._text is not None:
            text, self._text = "".join(self._text), None
            if self._path == _CRS:
                self.crs = text
            elif self._path[-2:-1] == ["maplayer"]:
                self.layers[-1]["name" if tag == "layername" else "source"] = text
        self._path.pop()

    def close(self):
        """End of the file."""


def raster_facts(path: str | Path, values: bool = True) -> dict:
    """Return facts about a raster.

    Parameters
    ----------
    path : str or Path
    values : bool
        Whether its cells are read.

    Returns
    -------
    dict

    Raises
    ------
    FormatError
        Unreadable, or with an invalid georeference.
    """
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


def vector_facts(path: str | Path) -> dict:
    """Return facts about a vector file, or about particles if its points are particles.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict

    Raises
    ------
    FormatError
        Not a vector file that GDAL reads.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            layers = list(_layers(path))
        except MpmgisError:
            raise
        except Exception as error:  # GDAL, Arrow and pandas raise different types
            raise FormatError(unreadable_vector(file_of(path), error)) from error
    if len(layers) == 1 and is_particle_layer(layers[0][1]):
        return particle_table_facts(file_of(path))
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
