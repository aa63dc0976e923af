"""Drivers of GDAL that read inputs, and its settings for them: no other driver, no network, nothing written.

Rasterio and pyogrio have a GDAL each. Rasterio passes the list of drivers to GDAL with every file. Pyogrio does not:
its other drivers are deregistered while a vector file is read, which takes 0.4 ms.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from ..system.optional_libraries import pyogrio
from ..system.trusted_files import is_trusted

RASTER_DRIVERS = {  # driver of GDAL: what the formats page calls it
    "GTiff": "GeoTIFF and COG",
    "AAIGrid": "ESRI ASCII grid",
    "GRASSASCIIGrid": "GRASS ASCII grid",
    "XYZ": "XYZ",
    "HFA": "Erdas Imagine",
    "netCDF": "NetCDF",
    "GPKG": "GeoPackage",
    "EHdr": "ESRI .bil and .flt",
    "ENVI": "ENVI",
    "SAGA": "SAGA",
    "AIG": "ESRI binary grid",
    "GSAG": "Surfer ASCII grid",
    "GSBG": "Surfer binary grid",
    "GS7BG": "Surfer 7 binary grid",
    "SRTMHGT": "SRTM .hgt",
    "DTED": "DTED",
    "USGSDEM": "USGS DEM",
    "JP2OpenJPEG": "JPEG 2000",
    "PNG": "PNG",
    "JPEG": "JPEG",
}
VECTOR_DRIVERS = {
    "GPKG": "GeoPackage",
    "ESRI Shapefile": "shapefile",
    "GeoJSON": "GeoJSON",
    "GeoJSONSeq": "GeoJSON sequence",
    "ESRIJSON": "ESRI JSON",
    "TopoJSON": "TopoJSON",
    "FlatGeobuf": "FlatGeobuf",
    "OpenFileGDB": "File Geodatabase",
    "MapInfo File": "MapInfo",
    "KML": "KML",
    "LIBKML": "KML and KMZ",
    "GML": "GML",
    "GPX": "GPX",
    "DXF": "DXF",
    "SQLite": "SpatiaLite",
    "CSV": "CSV with WKT",
}
VRT = "VRT"  # read where `file_references` finds a plain mosaic
_KEPT = {*RASTER_DRIVERS, *VECTOR_DRIVERS, VRT, "MEM", "Memory"}  # others may read rasters that are open now
_NOTHING_WRITTEN = {"CPL_VSIL_GZIP_WRITE_PROPERTIES": "NO"}
_DATABASES = {
    "SPATIALITE_LOAD": "NO",  # views of a database call no functions; SpatiaLite reads proj.db in the current folder
    "SQLITE_BUSY_TIMEOUT": "1000",  # [ms] until a locked database is refused
}
_NO_NETWORK = {  # a name in a file that a driver follows leads nowhere: no file has this suffix, no proxy answers
    "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": ".no-network",
    "GDAL_HTTP_PROXY": "http://127.0.0.1:9",
    "GDAL_HTTPS_PROXY": "http://127.0.0.1:9",
    "GDAL_HTTP_MAX_RETRY": "0",
}
_within = threading.RLock()
_depth = 0


def raster_settings() -> dict[str, str]:
    """Return GDAL's settings for rasters that are read now, for `rasterio.Env`."""
    return _NOTHING_WRITTEN | _DATABASES | ({} if is_trusted() else _NO_NETWORK)


@contextmanager
def vector_library() -> Iterator[ModuleType]:
    """Yield pyogrio; within this block its GDAL has the drivers of VECTOR_DRIVERS alone, if files are not trusted.

    Settings and drivers are those of the process. Blocks of several threads wait for each other.
    """
    global _depth
    library = pyogrio()
    from pyogrio.core import _register_drivers

    settings = _NOTHING_WRITTEN | _DATABASES | {"GDAL_PAM_ENABLED": "NO"}
    with _within:
        if not is_trusted():
            others = [name for name in library.list_drivers() if name not in _KEPT]
            settings |= _NO_NETWORK | {"OGR_SKIP": ",".join([*others, ""])}
        before = {name: library.get_gdal_config_option(name) for name in settings}
        if _depth == 0:
            library.set_gdal_config_options(settings)
            _register_drivers()
        _depth += 1
        try:
            yield library
        finally:
            _depth -= 1
            if _depth == 0:
                library.set_gdal_config_options(before)
                _register_drivers()
