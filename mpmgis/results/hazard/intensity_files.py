"""Write the files of an intensity classification: raster, style, polygons and table."""

import warnings
from pathlib import Path

import geopandas
import numpy as np
import rasterio
from rasterio.enums import ColorInterp

from ...maps.qgis.outlines import POLYGONS, mask_outline
from ...maps.qgis.raster_styles import class_pipe, style_document
from ...maps.qgis.vector_styles import class_renderer, vector_style_document, write_layer_styles
from ...system.csv_rows import write_records
from ...system.optional_libraries import GEOPACKAGE
from ...system.whole_files import whole_file
from ...terrain.grid import Grid
from ...terrain.raster_output import BLOCK, NAMESPACE
from .guideline_classes import Guideline

HEADINGS = ("class", "name", "when", "area_m2", "guideline", "source", "read_in")


def write_class_raster(path: Path, grid: Grid, numbers: np.ndarray, guideline: Guideline, tags: dict) -> None:
    """Write class numbers as GeoTIFF with the guideline's colours; 0 is nodata.

    Parameters
    ----------
    path : Path
    grid : Grid
    numbers : uint8[rows, columns]
    guideline : Guideline
    tags : dict of str to str
        Of the file.
    """
    crs = None if grid.crs is None else rasterio.crs.CRS.from_wkt(grid.crs.to_wkt())
    rows, columns = grid.shape
    profile = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": 1,
        "dtype": "uint8",
        "nodata": 0,
        "crs": crs,
        "transform": grid.transform,
        "compress": "deflate",
        "tiled": True,
        "blockxsize": BLOCK,
        "blockysize": BLOCK,
    }
    colours = {0: (0, 0, 0, 0)}
    for number, entry in enumerate(guideline.classes, start=1):
        colours[number] = (*(int(entry.colour[k : k + 2], 16) for k in (1, 3, 5)), 255)
    meaning = {f"class_{k}": f"{entry.name}: {entry.words()}" for k, entry in enumerate(guideline.classes, start=1)}
    with whole_file(path) as part, rasterio.open(part, "w", **profile) as target:
        target.write(numbers, 1)
        target.write_colormap(1, colours)
        target.colorinterp = [ColorInterp.palette]
        target.set_band_description(1, "intensity [1]")
        source = {"guideline": guideline.name, "title": guideline.title, "source": guideline.source}
        target.update_tags(ns=NAMESPACE, **source, **meaning, **tags)


def write_class_style(path: Path, guideline: Guideline) -> None:
    """Write the .qml of the raster for QGIS: colour and name of each class.

    Parameters
    ----------
    path : Path
    guideline : Guideline
    """
    with whole_file(path) as part:
        part.write_text(style_document(class_pipe(_entries(guideline))), encoding="utf-8", newline="\n")


def _entries(guideline):
    """(number, label, colour) of each class."""
    return [(k, f"{entry.name}: {entry.words()}", entry.colour) for k, entry in enumerate(guideline.classes, start=1)]


def write_class_polygons(path: Path, grid: Grid, numbers: np.ndarray, guideline: Guideline, areas: np.ndarray) -> None:
    """Write a GeoPackage with one multipolygon for each class that occurs, with its plan area.

    Parameters
    ----------
    path : Path
    grid : Grid
    numbers : uint8[rows, columns]
    guideline : Guideline
    areas : float64[classes] [m2]
        In plan.
    """
    rows = []
    for number, (entry, area) in enumerate(zip(guideline.classes, areas, strict=True), start=1):
        outline = mask_outline(numbers == number, grid.transform)
        if outline is not None:
            rows.append((*_record(number, entry, area, guideline), outline))
    columns = {name: [row[k] for row in rows] for k, name in enumerate(HEADINGS)}
    crs = None if grid.crs is None else grid.crs.to_wkt()
    table = geopandas.GeoDataFrame(columns, geometry=[row[-1] for row in rows], crs=crs)
    style = vector_style_document(class_renderer("class", _entries(guideline)), POLYGONS)
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a missing CRS is allowed
        table.to_file(part, layer="intensity", driver="GPKG", engine="pyogrio", dataset_options=GEOPACKAGE)
        write_layer_styles(part, {"intensity": style})


def write_class_table(path: Path, guideline: Guideline, areas: np.ndarray) -> None:
    """Write the areas of all classes as CSV.

    Parameters
    ----------
    path : Path
    guideline : Guideline
    areas : float64[classes] [m2]
        In plan.
    """
    rows = [
        _record(number, entry, area, guideline)
        for number, (entry, area) in enumerate(zip(guideline.classes, areas, strict=True), start=1)
    ]
    write_records(path, HEADINGS, rows)


def _record(number, entry, area, guideline):
    area = float(np.round(area, 6))
    return number, entry.name, entry.words(), area, guideline.name, guideline.source, entry.read_in
