"""Objects at risk: read from any vector file, and written with what reaches them."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import geopandas
import shapely

from ..maps.qgis.vector_styles import class_renderer, vector_style_document, write_layer_styles
from ..system.errors import InputError
from ..system.messages import log
from ..system.optional_libraries import GEOPACKAGE
from ..system.whole_files import whole_file
from ..terrain.grid import Grid
from ..terrain.spatial_inputs import Feature, repaired, to_terrain
from ..terrain.vector_table import names_of, read_table
from .object_cells import POLYGON, dimension_of

LAYERS = ("points", "lines", "polygons")  # of the GeoPackage, by dimension
CLASSES = [(1, "reached", "#c1272d"), (2, "not reached", "#2e8b57"), (3, "outside the terrain", "#8c8c8c")]
ATTRIBUTE = "class"  # with these numbers


def read_objects(path: str | Path, grid: Grid) -> list[Feature]:
    """Read points, lines and polygons in the CRS of a grid.

    Parameters
    ----------
    path : str or Path
    grid : Grid
        Of the terrain.

    Raises
    ------
    FormatError, GeoreferenceError
    InputError
        No feature with a geometry, or one of points, lines and polygons together.
    """
    table = read_table(path, kind="LineString", flag="")
    if table.geometry is None or table.without_geometry.all():
        raise InputError(f"{path} has no points, lines or polygons; give a layer of roads, masts, buildings, ...")
    if (missing := table.without_geometry).any():
        log.info(f"{path}: {int(missing.sum())} features have no geometry and are left out")
        table = table.where(~missing)
    assert table.geometry is not None
    names = names_of(table, path)
    shapes = to_terrain(table.geometry, table.crs, grid, path)
    return [
        Feature(name, _usable(shape, name, path), row, str(path))
        for name, shape, row in zip(names, shapes, table.rows(), strict=True)
    ]


def _usable(shape: shapely.Geometry, name: str, path: str | Path) -> shapely.Geometry:
    if shape.geom_type == "GeometryCollection":
        raise InputError(f"{path}: '{name}' is a collection of geometries; split it into points, lines and polygons")
    return repaired(shape, name, path) if dimension_of(shape) == POLYGON else shape


def write_objects(path: Path, objects: Sequence[Feature], found: Sequence[Mapping[str, Any]], grid: Grid) -> None:
    """Write a GeoPackage of the objects with their own attributes and what reaches them, a layer for each geometry.

    Parameters
    ----------
    path : Path
    objects : sequence of Feature
    found : sequence of dict
        Attribute -> value, one dict for each object.
    grid : Grid
        Its CRS is that of the objects.
    """
    theirs = [name for name in objects[0].columns if name.lower() != "fid"]
    results = {name.lower() for name in found[0]}
    own = [name for name in theirs if name.lower() not in results]
    if len(own) < len(theirs):
        log.info(f"{objects[0].path}: attributes with the name of a result are replaced by it")
    crs, styles = None if grid.crs is None else grid.crs.to_wkt(), {}
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a missing CRS is allowed
        for dimension, layer in enumerate(LAYERS):
            chosen = [k for k, one in enumerate(objects) if dimension_of(one.shape) == dimension]
            if not chosen:
                continue
            columns = {name: [objects[k].columns[name] for k in chosen] for name in own}
            columns |= {name: [found[k][name] for k in chosen] for name in found[0]}
            table = geopandas.GeoDataFrame(columns, geometry=[objects[k].shape for k in chosen], crs=crs)
            older = {} if part.exists() else {"dataset_options": GEOPACKAGE}
            table.to_file(part, layer=layer, driver="GPKG", engine="pyogrio", **older)
            styles[layer] = vector_style_document(class_renderer(ATTRIBUTE, CLASSES, dimension), dimension)
        write_layer_styles(part, styles)
