"""Release areas of a region: read as a table of parts, written one by one, and written with their results."""

import warnings
from dataclasses import dataclass

import numpy as np
import pyproj
import shapely

from ..errors import InputError
from ..messages import muted
from .atomic import whole_file
from .libraries import GEOPACKAGE, pyogrio
from .release_areas import parts_of
from .vector_table import read_table, require_polygons

LAYER, FOOTPRINTS = "areas", "footprints"


@dataclass(frozen=True)
class RegionAreas:
    """Release areas in the CRS of the DTM: `parts` (ReleasePart) and the `columns` of their table (name -> array)."""

    parts: list
    columns: dict
    crs: pyproj.CRS | None

    def column(self, name, option):
        """The values of a column; an error that names the `option` without it."""
        if name not in self.columns:
            known = ", ".join(self.columns) or "none"
            raise InputError(f"`{option}={name}`: the release areas have no such column; they have {known}")
        return self.columns[name]

    def frequencies(self, name):
        """float64[n]: numbers of at least 0 in the column `name`."""
        values = self.column(name, "frequency")
        if values.dtype.kind not in "fiu" or not (np.isfinite(values) & (values >= 0)).all():
            raise InputError(f"`frequency={name}`: expected a number of at least 0 for every release area")
        return values.astype(float)


def read_areas(path, terrain, thickness=None, surface=None):
    """The RegionAreas at `path`; `terrain` is a Terrain or TerrainFile, thickness as in `release_areas.read_release`.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    with muted():  # `parts_of` reads it again and reports what it ignores or repairs
        table = require_polygons(read_table(path, flag="--releases "), path)
    return RegionAreas(parts_of(path, terrain, thickness, surface), table.columns, terrain.grid.crs)


def write_area(path, shape, name, crs):
    """Write one release area, WKB `shape`, as FlatGeobuf; `crs` is WKT or None."""
    pyogrio()
    from pyogrio.raw import write

    kind = shapely.from_wkb(shape).geom_type
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a local frame has no CRS
        write(
            part, np.array([shape], object), [np.array([name], object)], ["name"], geometry_type=kind, crs=crs,
            driver="FlatGeobuf", layer=LAYER, SPATIAL_INDEX="NO",
        )  # fmt: skip


def write_areas(path, areas, results):
    """Write a GeoPackage of all areas with the columns of the input and `results` (name -> list)."""
    taken = {"fid", "geometry", *map(str.lower, results)}
    own = {name: values for name, values in areas.columns.items() if name.lower() not in taken}
    geometry = [part.polygon for part in areas.parts]
    _write_layer(path, LAYER, geometry, {**own, **results}, areas.crs)


def write_footprint_layer(path, shapes, columns, crs):
    """Write a GeoPackage of the footprints of areas: `shapes` with `columns` (name -> sequence)."""
    _write_layer(path, FOOTPRINTS, shapes, columns, crs)


def _write_layer(path, layer, shapes, columns, crs):
    import geopandas  # 0.5 s

    table = geopandas.GeoDataFrame(columns, geometry=shapes, crs=crs)
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a local frame has no CRS
        table.to_file(part, layer=layer, driver="GPKG", engine="pyogrio", dataset_options=GEOPACKAGE)
