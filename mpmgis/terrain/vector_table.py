"""Vector files that GDAL reads, and GeoParquet, as columns and shapes without pandas."""

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely

from ..system.disguised_files import require_undisguised
from ..system.errors import FormatError, InputError, MpmgisError, has_control_characters, one_line
from ..system.messages import log
from ..system.optional_libraries import needed_for, pyogrio
from ..system.zip_archives import require_zip_fits
from .csv_features import SUFFIXES as CSV_SUFFIXES
from .csv_features import read_csv_features

LAYER = "|layername="  # as QGIS writes a source with several layers
KINDS = {"Polygon": "polygons", "LineString": "lines", "Point": "points"}  # of geometry, in words
FARTHEST = 1e9  # [m, or the map's unit] no place on Earth lies beyond
_GEOMETRY_TYPES = (
    *("Point", "LineString", "LinearRing", "Polygon"),
    *("MultiPoint", "MultiLineString", "MultiPolygon", "GeometryCollection"),
)  # by GEOS' numbers


@dataclass(frozen=True)
class VectorTable:
    """Features of a layer.

    Parameters
    ----------
    columns : dict of str to array[n]
    geometry : object[n] or None
        Of shapely.Geometry or None; None for a table without geometry.
    crs : pyproj.CRS or None
        None where the file has none.
    """

    columns: dict = field(default_factory=dict)
    geometry: np.ndarray | None = None
    crs: pyproj.CRS | None = None

    def __len__(self):
        arrays = [*self.columns.values(), *(() if self.geometry is None else (self.geometry,))]
        return len(arrays[0]) if arrays else 0

    @property
    def kinds(self) -> set[str]:
        """Names of the geometry types in the table."""
        return {_GEOMETRY_TYPES[number] for number in np.unique(shapely.get_type_id(self.geometry)) if number >= 0}

    @property
    def without_geometry(self) -> np.ndarray:
        """Features whose geometry is missing or empty, bool[n]."""
        return shapely.is_missing(self.geometry) | shapely.is_empty(self.geometry)

    def where(self, chosen: np.ndarray) -> "VectorTable":
        """Return the chosen features.

        Parameters
        ----------
        chosen : bool[n]
        """
        columns = {name: values[chosen] for name, values in self.columns.items()}
        return VectorTable(columns, self.geometry[chosen], self.crs)

    def rows(self) -> list[dict[str, Any]]:
        """Return a dict of column -> Python value for each feature."""
        columns = [values.tolist() for values in self.columns.values()]
        return [dict(zip(self.columns, row, strict=True)) for row in zip(*columns, strict=True)] or [{}] * len(self)


def read_table(path: str | Path, kind: str = "Polygon", flag: str = "--release ") -> VectorTable:
    """Read a layer of a vector file; `file.gpkg|layername=name` selects the layer.

    Parameters
    ----------
    path : str or Path
    kind : {"Polygon", "LineString", "Point"}
        Geometry type of the layer to choose; other geometries in it are read too.
    flag : str
        Command-line option before the path, for messages.

    Raises
    ------
    FormatError
        No vector file, or no layer with geometry.
    InputError
        No such layer, several layers of that kind and none selected, or coordinates outside any map.
    """
    text, _, layer = str(path).partition(LAYER)
    source = Path(text)
    if not source.exists():
        raise FormatError(f"{source}: no such file")
    if source.is_file() and source.stat().st_size == 0:
        raise FormatError(f"{source} is empty (0 bytes), expected {KINDS[kind]}")
    require_undisguised(source)
    if source.is_file():
        require_zip_fits(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if source.suffix.lower() in (".parquet", ".geoparquet"):
                table = _parquet_table(source)
            elif source.is_file() and source.suffix.lower() in CSV_SUFFIXES:
                table = VectorTable(*read_csv_features(source))
            else:
                chosen = _require_layer(source, layer, kind) if layer else _only_layer(source, kind, flag)
                table = _ogr_table(source, chosen)
        except MpmgisError:
            raise
        except Exception as error:  # GDAL, Arrow and pandas raise different types
            raise FormatError(_unreadable(source, error)) from error
    if table.geometry is not None:
        _require_places(table.geometry, source)
    return table


def _ogr_table(source: Path, layer: str) -> VectorTable:
    """Read the VectorTable in a layer of a file that GDAL reads."""
    pyogrio()
    from pyogrio.raw import read

    about, _, shapes, values = read(source, layer=layer)
    columns = {str(name): array for name, array in zip(about["fields"], values, strict=True)}
    if shapes is None:
        return VectorTable(columns)
    crs = pyproj.CRS.from_user_input(about["crs"]) if about["crs"] else None
    return VectorTable(columns, shapely.from_wkb(shapes), crs)


def _parquet_table(source: Path) -> VectorTable:
    """Read the VectorTable in a GeoParquet file."""
    with needed_for(f"{source}: Parquet", "parquet"):
        import geopandas  # 0.5 s

        table = geopandas.read_parquet(source)
    columns = {str(name): _values(table[name]) for name in table.columns if name != table.geometry.name}
    return VectorTable(columns, table.geometry.to_numpy(), table.crs)


def _values(column: Any) -> np.ndarray:
    """Return the array of a pandas.Series; numbers with missing values as float64 with NaN."""
    if column.dtype.kind in "fiu" and column.hasnans:
        return column.to_numpy(dtype=float, na_value=np.nan)
    return column.to_numpy()


def _require_places(shapes, path):
    """Refuse coordinates that are not finite or outside any map."""
    farthest = np.abs(shapely.bounds(shapes[~(shapely.is_missing(shapes) | shapely.is_empty(shapes))])).max(initial=0.0)
    if not np.isfinite(farthest):
        raise InputError(f"{path}: some coordinates are NaN or infinite; repair the geometry (QGIS: Fix geometries)")
    if farthest > FARTHEST:
        raise InputError(
            f"{path}: coordinates reach {farthest:.3g}, expected below {FARTHEST:g}; repair the geometry, "
            "or copy the file again"
        )


def _only_layer(source: Path, kind: str, flag: str) -> str:
    """Return the name of the only layer of a kind; refuse several."""
    layers = pyogrio().list_layers(source)
    with_geometry = [name for name, found in layers if found is not None]
    right = [name for name, found in layers if found is not None and (kind in found or found == "Unknown")]
    choice = right or with_geometry
    if len(choice) > 1:
        raise InputError(
            f"{source} has {len(choice)} layers with {KINDS[kind]} ({', '.join(choice[:6])}); give one: "
            f"{flag}'{source.name}{LAYER}{choice[0]}'"
        )
    if not choice:
        raise FormatError(
            f"{source} contains no layer with geometry, expected {KINDS[kind]}; it is only a table, or damaged"
        )
    return choice[0]


def _require_layer(source: Path, layer: str, kind: str) -> str:
    """Refuse a layer that the file does not have; the message lists the existing layers."""
    there = [str(name) for name, _ in pyogrio().list_layers(source)]
    if layer not in there:
        raise InputError(f"{source} has no layer {layer!r} with {KINDS[kind]}; it has {', '.join(there[:6])}")
    return layer


def _unreadable(source, error):
    reason = one_line(error).partition(".; ")[0].replace(str(source), source.name)[:140]
    if source.suffix.lower() == ".shp" and not source.with_suffix(".shx").exists():
        parts = "copy all parts of the shapefile (.shp, .shx, .dbf, .prj)"
        return f"{source} cannot be read without its {source.stem}.shx; {parts}"
    return f"{source} is neither a vector file nor a raster that GDAL can read ({reason})"


def require_polygons(table: VectorTable, path: str | Path) -> VectorTable:
    """Return the features with geometry; refuse other types than polygons, report empty geometries.

    Parameters
    ----------
    table : VectorTable
    path : str or Path
        For messages.

    Raises
    ------
    InputError
    """
    if table.geometry is None:
        raise InputError(f"{path} contains a table without geometry, expected polygons")
    if len(table) == 0:
        raise InputError(f"{path} contains no feature, expected polygons")
    others = sorted(table.kinds - {"Polygon", "MultiPolygon"})
    if others:
        fix = "Lines to polygons" if any("Line" in kind for kind in others) else "Buffer"
        raise InputError(f"{path} contains {', '.join(others)}, expected polygons; convert them in QGIS: {fix}")
    empty = table.without_geometry
    if empty.all():
        raise InputError(f"{path}: all {len(table)} features have an empty geometry, expected polygons")
    if empty.any():
        log.info(f"{path}: {int(empty.sum())} of {len(table)} features have no geometry and are ignored")
        table = table.where(~empty)
    return table


def names_of(table: VectorTable, path: str | Path) -> list[str]:
    """Return the names of the features: the column 'name' where there is one, else the number in the file.

    Parameters
    ----------
    table : VectorTable
    path : str or Path
        For messages.

    Raises
    ------
    InputError
        A name contains control characters, which plots, tables and QGIS projects cannot contain.
    """
    column = next((c for c in table.columns if str(c).lower() == "name"), None)
    numbered = [f"feature {i + 1}" for i in range(len(table))]
    if column is None:
        return numbered
    for number, value in zip(numbered, table.columns[column], strict=True):
        if isinstance(value, str) and has_control_characters(value.strip()):
            raise InputError(f"{path}: {number} has the name {value[:60]!r} with control characters; rename it")
    return [
        str(value) if isinstance(value, str) and value.strip() else number
        for value, number in zip(table.columns[column], numbered, strict=True)
    ]
