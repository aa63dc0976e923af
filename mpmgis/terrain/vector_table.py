"""Vector files that GDAL reads, and GeoParquet, as columns and shapes without pandas.

Every vector file that the program reads is opened by `open_vector`.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely

from ..system.errors import FormatError, InputError, MpmgisError, has_control_characters, one_line
from ..system.file_references import head_of, leads_to, require_local
from ..system.messages import log
from ..system.optional_libraries import needed_for
from ..system.settled_databases import settled
from ..system.source_names import LAYER_OPTIONS, SourceName, source_of
from ..system.zip_archives import require_zip_fits
from .allowed_drivers import vector_library
from .unread_surfaces import SURFACES, unread_line

LAYER = "|layername="  # as QGIS writes a source with several layers
KINDS = {"Polygon": "polygons", "LineString": "lines", "Point": "points"}  # of geometry, in words
FARTHEST = 1e9  # [m, or the map's unit] no place on Earth lies beyond
CSV_SUFFIXES = (".csv", ".tsv")
PARQUET_SUFFIXES = (".parquet", ".geoparquet")
_GML = b"opengis.net/gml"  # near the beginning of a GML file
_READ_ONLY = "/vsicached?file="  # GDAL's prefix of files that it cannot change
_WINDOWS = "cp1252"  # encoding of a text that is not in the one that the file declares
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


@contextmanager
def open_vector(path: str | Path) -> Iterator[tuple[Any, str | Path]]:
    """Yield pyogrio and the name to give it for a vector file, for this block.

    In the block pyogrio has only the drivers of `allowed_drivers`, unless files are trusted; nothing is written.

    Parameters
    ----------
    path : str or Path
        Options of QGIS after a | are ignored.

    Yields
    ------
    library : module
    place : str or Path

    Raises
    ------
    FormatError
        Missing, empty, or a file that leads to others (`file_references`).
    """
    source = source_of(path)
    shown = str(path).partition("|")[0] if source.options else path
    if not source.elsewhere and not source.file.exists():
        raise FormatError(f"{shown}: no such file")
    if source.file.is_file() and source.file.stat().st_size == 0:
        raise FormatError(f"{shown} is empty (0 bytes), expected a vector file")
    require_local(path)
    if source.driver:
        raise FormatError(f"{shown} is a subdataset of a raster, expected a vector file; give {source.file}")
    if source.file.is_file():
        require_zip_fits(source.file)
    with vector_library() as library, settled(source.file) as place:
        if not source.is_plain:
            yield library, source.base
        elif _GML in head_of(place):  # GDAL writes a .gfs beside it
            yield library, f"{_READ_ONLY}{place.absolute()}"
        else:
            yield library, place


def read_table(path: str | Path, kind: str = "Polygon", flag: str = "--release ") -> VectorTable:
    """Read a layer of a vector file; `file.gpkg|layername=name` selects the layer.

    Parameters
    ----------
    path : str or Path
        The other options of QGIS (`|layerid=`, `|geometrytype=`, `|subset=`) are understood too.
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
    source = source_of(path)
    file = source.base if source.part else source.file
    chosen = _options(source, path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with open_vector(path) as (library, place):
                if source.file.suffix.lower() in PARQUET_SUFFIXES:
                    _require_no_options(chosen, path)
                    table = _parquet_table(source.file)
                elif source.file.is_file() and source.file.suffix.lower() in CSV_SUFFIXES:
                    from .csv_features import read_csv_features

                    _require_no_options(chosen, path)
                    table = VectorTable(*read_csv_features(source.file))
                else:
                    layer = _chosen_layer(library.list_layers(place), file, chosen, kind, flag)
                    table = _ogr_table(place, file, layer, chosen.get("subset"))
        except MpmgisError:
            raise
        except Exception as error:  # GDAL, Arrow and pandas raise different types
            raise FormatError(unreadable_vector(source.file, error)) from error
    if table.geometry is not None:
        if wanted := chosen.get("geometrytype"):
            table = _of_type(table, wanted, path)
        _require_places(table.geometry, file)
    return table


def _options(source: SourceName, path: str | Path) -> dict[str, str]:
    """Return the options of QGIS after a |, lower-case key -> value; refuse unknown ones."""
    chosen = {key.lower(): value for key, value in source.options}
    chosen.pop("uniquegeometrytype", None)  # how QGIS found the layer
    for key, value in chosen.items():
        if key not in LAYER_OPTIONS:
            expected = ", ".join(f"|{name}=" for name in LAYER_OPTIONS)
            raise InputError(f"{path}: the option |{key}= is not understood, expected {expected}; leave it out")
        if key == "subset" and re.match(r"\s*select\b", value, re.I):
            raise InputError(
                f'{path}: the subset is a whole query (SELECT ...), expected a condition such as "height" > 2; save '
                "the layer of QGIS as a file"
            )
    return chosen


def _require_no_options(chosen, path):
    if chosen:
        key = next(iter(chosen))
        raise InputError(f"{path}: the option |{key}= is not for Parquet; save the layer of QGIS as a GeoPackage")


def _of_type(table: VectorTable, wanted: str, path: str | Path) -> VectorTable:
    """Return the features of a geometry type as QGIS names it: Polygon, MultiPolygonZ, ..."""
    plain = re.sub(r"^multi|25d$|zm?$|m$", "", wanted.strip().lower())
    types = np.array([(name or "").lower().removeprefix("multi") for name in (*_GEOMETRY_TYPES, None)])
    if plain not in types:
        raise InputError(f"{path}: geometrytype={wanted} is not understood, expected Polygon, LineString or Point")
    found = table.where(types[shapely.get_type_id(table.geometry)] == plain)
    if len(found) == 0:
        raise InputError(f"{path}: no feature is of the type {wanted}; leave |geometrytype= out")
    return found


def _ogr_table(place: str | Path, file: str | Path, layer: str, subset: str | None) -> VectorTable:
    """Read the VectorTable in a layer of a file that GDAL reads, with the features that meet the SQL of `subset`."""
    about, _, shapes, values = _read(place, file, layer, subset)
    columns = {str(name): array for name, array in zip(about["fields"], values, strict=True)}
    if shapes is None:
        return VectorTable(columns)
    crs = pyproj.CRS.from_user_input(about["crs"]) if about["crs"] else None
    return VectorTable(columns, _shapes(shapes, file), crs)


def _read(place, file, layer, subset):
    """What pyogrio reads; a text in another encoding than the declared one is taken as that of Windows, and said."""
    from pyogrio.raw import read

    more = {} if subset is None else {"where": subset}
    try:
        return read(place, layer=layer, **more)
    except UnicodeDecodeError as error:
        wrong = error
    except (ValueError, RuntimeError) as error:  # pyogrio's errors are of both kinds
        if subset is None:
            raise
        reason = one_line(error)[:120]
        raise InputError(
            f"{file}: the subset {subset[:60]!r} is not a condition that GDAL understands ({reason})"
        ) from error
    found = read(place, layer=layer, encoding=_WINDOWS, **more)
    declared = Path(file).with_suffix(".cpg")
    source = f", as {declared.name} says" if declared.is_file() else ""
    log.info(
        f"{file}: its text is not in {wrong.encoding}{source}; read as {_WINDOWS} (Windows); check names with special "
        "letters"
    )
    return found


def _shapes(shapes: np.ndarray, file: str | Path) -> np.ndarray:
    """Return the geometries in WKB; refuse one that is damaged or that GEOS does not know, with its feature."""
    try:
        return shapely.from_wkb(shapes)
    except shapely.errors.GEOSException:
        pass
    for number, shape in enumerate(shapes, 1):
        try:
            shapely.from_wkb(shape)
        except shapely.errors.GEOSException as error:
            kind = int.from_bytes(shape[1:5], "little" if shape[0] else "big") & 0xFFFF
            if surface := SURFACES.get(kind % 1000):
                raise InputError(f"{file}: {unread_line(number, surface, Path(file).name)}") from error
            reason = one_line(error).partition(": ")[2] or one_line(error)
            raise InputError(
                f"{file}: the geometry of feature {number} is invalid ({reason[:80]}); repair it (QGIS: Fix geometries)"
            ) from error
    raise FormatError(f"{file}: its geometries cannot be read together; save the layer of QGIS again")


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


def _chosen_layer(layers: np.ndarray, file: str | Path, chosen: dict, kind: str, flag: str) -> str:
    """Return the name of the chosen layer, else of the only layer of a kind; refuse several."""
    there = [str(name) for name, _ in layers]
    if (name := chosen.get("layername")) is not None:
        if name not in there:
            raise InputError(f"{file} has no layer {name!r} with {KINDS[kind]}; it has {', '.join(there[:6])}")
        return name
    if (number := chosen.get("layerid")) is not None:
        if not number.isdecimal() or int(number) >= len(there):
            raise InputError(f"{file} has no layer of the number {number}; it has {len(there)}, counted from 0")
        return there[int(number)]
    with_geometry = [name for name, found in layers if found is not None]
    right = [name for name, found in layers if found is not None and (kind in found or found == "Unknown")]
    choice = right or with_geometry
    if len(choice) > 1:
        raise InputError(
            f"{file} has {len(choice)} layers with {KINDS[kind]} ({', '.join(choice[:6])}); give one: "
            f"{flag}'{Path(file).name}{LAYER}{choice[0]}'"
        )
    if not choice:
        raise FormatError(
            f"{file} contains no layer with geometry, expected {KINDS[kind]}; it is only a table, or damaged"
        )
    return choice[0]


def unreadable_vector(file: Path, error: BaseException) -> str:
    """Return the message for a vector file that pyogrio, shapely or Arrow cannot read.

    Parameters
    ----------
    file : Path
    error : BaseException
    """
    text = one_line(error)
    if "database is locked" in text:
        return f"{file} is locked by another program, for example by an edit in QGIS; save and close it there"
    if file.suffix.lower() == ".shp" and not file.with_suffix(".shx").exists():
        parts = "copy all parts of the shapefile (.shp, .shx, .dbf, .prj)"
        return f"{file} cannot be read without its {file.stem}.shx; {parts}"
    if what := leads_to(file):
        return f"{file} {what}"
    reason = text.partition(".; ")[0].replace(str(file.absolute()), file.name).replace(str(file), file.name)
    reason = reason.replace(_READ_ONLY, "")[:140]
    return f"{file} is neither a vector file nor a raster that GDAL can read ({reason})"


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
