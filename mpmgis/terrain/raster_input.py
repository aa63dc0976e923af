"""Rasters of any kind as arrays on a Grid, with errors in one line."""

import hashlib
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from affine import Affine
from rasterio._err import CPLE_BaseError
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.io import DatasetReader
from rasterio.windows import Window

from ..system.disguised_files import require_undisguised
from ..system.errors import FormatError, GeoreferenceError, InputError, one_line
from ..system.memory import memory_lack
from ..system.messages import log
from .georeference import horizontal, warp_command
from .grid import Grid
from .raster_scale import scale_line
from .undeclared_nodata import STORED, Role, mask_undeclared
from .virtual_rasters import require_few_reads

_SMALLEST_PIXEL = 1e-9  # [m, or the map's unit] a smaller side is an invalid georeference
_FARTHEST = 1e14  # [m, or the map's unit] so is a larger product of coordinate and number of pixels
_GDAL_NAME = re.compile(r"/vsi|[A-Z][A-Z0-9_]+:")  # a virtual path or a subdataset, for example NETCDF:file.nc:height
_SURELY_READ = 25_000_000  # [pixels] for which the memory is not checked
_BYTES_PER_PIXEL = 20  # of a band that is read: numbers, mask, and a copy of both for a moment
ONE_BAND = "extract one: rio stack {path} --bidx N -o one.tif"  # where no option chooses a band
_VECTOR_SUFFIXES = (".shp", ".gpkg", ".geojson", ".json", ".fgb", ".parquet", ".kml", ".gml")


def read_raster(
    path: str | Path, role: Role, band: int | None = None, may_be_empty: bool = False
) -> tuple[np.ndarray, Grid]:
    """Read a band of any raster.

    Parameters
    ----------
    path : str or Path
    role : Role
        What it contains; values that mean nodata without being declared as such are NaN too.
    band : int, optional
        Counted from 1; required where there are several bands.
    may_be_empty : bool
        Nodata everywhere is no error.

    Returns
    -------
    values : float64[rows, columns]
        NaN for nodata.
    grid : Grid
        Its crs may be None.

    Raises
    ------
    FormatError, InputError
        Missing, unreadable, without a georeference, several bands without a band number, or nodata everywhere unless
        it `may_be_empty`.
    """
    path = Path(path)
    with open_raster(path) as source:
        band = band_number(source, path, band, option=ONE_BAND)
        if line := scale_line(source, path, band):
            log.info(line)
        return band_values(source, path, band, role, may_be_empty), grid_of(source, path)


def raster_files(path: str | Path) -> list[Path]:
    """Return the paths of all files that GDAL reads for a raster: sources of a virtual raster, masks, world files.

    Parameters
    ----------
    path : str or Path
    """
    with open_raster(path) as source:
        return [Path(name) for name in source.files]


def grid_of(source: DatasetReader, path: str | Path) -> Grid:
    """Return the Grid of an open raster; its crs is the horizontal CRS, None where the file has none.

    Parameters
    ----------
    source : rasterio dataset
    path : str or Path
        For messages.

    Raises
    ------
    GeoreferenceError
    """
    return Grid(horizontal(crs_of(source, path)), transform_of(source, path, local=True), source.shape)


@contextmanager
def open_raster(path: str | Path) -> Iterator[DatasetReader]:
    """Open a raster for this block; errors and warnings become one line.

    Parameters
    ----------
    path : str or Path

    Yields
    ------
    rasterio dataset

    Raises
    ------
    FormatError
        Missing, empty, no raster, truncated, damaged, or a disguised list of other files.
    """
    path = Path(path)
    if not _GDAL_NAME.match(str(path)):
        if not path.exists():
            raise FormatError(f"{path}: no such file")
        if path.is_file() and path.stat().st_size == 0:
            raise FormatError(f"{path} is empty (0 bytes), expected a raster")
        require_undisguised(path)
        require_few_reads(path)
        _require_directory(path)
    with warnings.catch_warnings(), _messages_of_any_bytes():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            source = rasterio.open(path)
        except (RasterioError, OSError, ValueError) as error:
            if path.is_dir():
                raise FormatError(f"{path} is a folder, expected a raster; give a file in it") from error
            reason = _reason(error, path)
            swapped = "; vector files are for releases, lines and areas: check whether two options are swapped"
            vector = path.suffix.lower() in _VECTOR_SUFFIXES
            raise FormatError(
                f"{path} is not a raster that GDAL can read, or is truncated ({reason}){swapped if vector else ''}"
            ) from error
        with source:
            if source.count == 0:
                raise FormatError(f"{path} contains no band; give one of its subdatasets (QGIS lists them)")
            try:
                yield source
            except CPLE_BaseError as error:  # any later access to the dataset can raise errors of GDAL
                raise FormatError(f"{path} is damaged ({_reason(error, path)}); copy or download it again") from error


def _require_directory(path: Path) -> None:
    """Refuse a TIFF whose first directory is beyond its end: libtiff would write to stderr."""
    if not path.is_file():
        return
    with open(path, "rb") as handle:
        head, size = handle.read(16), path.stat().st_size
    order = {b"II": "little", b"MM": "big"}.get(head[:2])
    if order is None or len(head) < 16:
        return
    kind = int.from_bytes(head[2:4], order)
    offset = int.from_bytes(head[8:16] if kind == 43 else head[4:8], order) if kind in (42, 43) else 0
    if offset > size:
        raise FormatError(
            f"{path} is not a raster that GDAL can read, or is truncated (its directory is at byte {offset} of {size})"
        )


@contextmanager
def _messages_of_any_bytes():
    """Suppress UnicodeDecodeErrors of rasterio's log: GDAL's messages quote bytes of damaged files.

    Cython reports such an error through both hooks.
    """
    before = sys.excepthook, sys.unraisablehook

    def printed(kind, error, trace):
        if not isinstance(error, UnicodeDecodeError):
            before[0](kind, error, trace)

    def unraisable(report):
        if not isinstance(report.exc_value, UnicodeDecodeError):
            before[1](report)

    sys.excepthook, sys.unraisablehook = printed, unraisable
    try:
        yield
    finally:
        sys.excepthook, sys.unraisablehook = before


def file_sha256(path: str | Path) -> str:
    """Return the hex digest of a file; "" for folders and GDAL virtual paths.

    Parameters
    ----------
    path : str or Path
    """
    path = Path(path)
    if not path.is_file():
        return ""
    with open(path, "rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _reason(error, path):
    return one_line(error).replace(str(path), path.name)[:120]


def band_number(
    source: DatasetReader,
    path: str | Path,
    band: int | None,
    option: str = "choose the band of the elevation with --dem-band N",
) -> int:
    """Return the number of the band to read, counted from 1.

    Parameters
    ----------
    source : rasterio dataset
    path : str or Path
        For messages.
    band : int or None
        The band that was asked for.
    option : str
        How to choose a band, for messages.

    Raises
    ------
    InputError
        A palette, another type than numbers, no such band, or several bands and none asked for.
    """
    if band is None:
        if source.count > 1:
            raise InputError(f"{path} has {source.count} bands; {option.format(path=path)}")
        band = 1
    if not 1 <= band <= source.count:
        raise InputError(f"{path}: got band {band}, but it has {source.count} (counted from 1)")
    if source.colorinterp[band - 1] == rasterio.enums.ColorInterp.palette:
        raise InputError(
            f"{path} is an image with a palette, expected numbers in metres; use the raster it was made from"
        )
    if np.dtype(source.dtypes[band - 1]).kind not in "fiu":
        raise InputError(f"{path}: band {band} has type {source.dtypes[band - 1]}, expected real numbers")
    return band


def band_values(
    source: DatasetReader,
    path: str | Path,
    band: int,
    role: Role,
    may_be_empty: bool = False,
    window: Window | None = None,
) -> np.ndarray:
    """Read the values of a band with scale and offset applied, NaN for nodata, mask and infinities.

    Values that mean nodata without being declared as such are reported and NaN too.

    Parameters
    ----------
    source : rasterio dataset
    path : str or Path
        For messages.
    band : int
    role : Role
        What the raster contains.
    may_be_empty : bool
        Nodata everywhere is no error.
    window : rasterio.windows.Window, optional
        Only these pixels.

    Returns
    -------
    float64[rows, columns]

    Raises
    ------
    FormatError
        Truncated or damaged.
    InputError
        Nodata everywhere, or more cells than the memory can contain.
    """
    shape = source.shape if window is None else (int(window.height), int(window.width))
    _require_memory(shape, path)
    try:
        data = source.read(band, out_dtype="float64", window=window)
        valid = source.read_masks(band, window=window) != 0
    except (RasterioError, OSError, ValueError) as error:
        raise FormatError(
            f"{path} is truncated or damaged ({_reason(error, path)}); copy or download it again"
        ) from error
    data[~(valid & np.isfinite(data))] = np.nan
    scale, offset = source.scales[band - 1], source.offsets[band - 1]
    if (scale, offset) != (1.0, 0.0):
        mask_undeclared(data, path, STORED)
        data = data * scale + offset
    mask_undeclared(data, path, role)
    if not may_be_empty and not np.isfinite(data).any():
        where = ""
        if window is not None:
            last = window.row_off + window.height - 1, window.col_off + window.width - 1
            first = window.row_off, window.col_off
            where = f" in the needed rows {first[0]} to {last[0]}, columns {first[1]} to {last[1]}"
        raise InputError(f"{path}: every cell{where} is nodata")
    return data


def _require_memory(shape: tuple[int, int], path: str | Path) -> None:
    """Refuse to read more pixels than the free memory can contain."""
    if shape[0] * shape[1] > _SURELY_READ and (lack := memory_lack(shape[0] * shape[1] * _BYTES_PER_PIXEL)):
        raise InputError(
            f"{path}: {shape[0]} x {shape[1]} cells need {lack}; cut it to the site (rio clip, QGIS: Clip raster by "
            "extent)"
        )


def transform_of(source: DatasetReader, path: str | Path, local: bool) -> Affine:
    """Return the transform from pixel corners to the map (GDAL respects AREA_OR_POINT).

    Parameters
    ----------
    source : rasterio dataset
    path : str or Path
        For messages.
    local : bool
        The identity is accepted; otherwise it means no georeference.

    Raises
    ------
    GeoreferenceError
        None, not invertible, beyond any map, or only control points.
    """
    t = source.transform
    numbers = np.array(t[:6], dtype=float)
    if not np.isfinite(numbers).all() or abs(t.a * t.e - t.b * t.d) <= 0:
        raise GeoreferenceError(
            f"{path}: the transform {tuple(numbers.tolist())} cannot be inverted; georeference the raster again"
        )
    sides, farthest = np.hypot(numbers[[0, 1]], numbers[[3, 4]]), np.abs(numbers).max()
    if sides.min() < _SMALLEST_PIXEL or farthest * max(source.shape) > _FARTHEST:
        raise GeoreferenceError(
            f"{path}: invalid georeference (pixels of {sides[0]:.3g} x {sides[1]:.3g} at {t.c:.3g}, {t.f:.3g}); "
            "georeference the raster again"
        )
    if source.gcps[0] and t == Affine.identity():
        raise GeoreferenceError(
            f"{path} is georeferenced by control points only; warp it first: {warp_command(path, 'EPSG:n')}"
        )
    if t == Affine.identity() and not local:
        raise GeoreferenceError(
            f"{path} has no georeference; give it one (QGIS: Raster, Georeferencer), or --crs local for pixels of 1 m"
        )
    return t


def crs_of(source: DatasetReader, path: str | Path) -> pyproj.CRS | None:
    """Return the CRS of an open raster, the EPSG entry where there is one; None where the file has none.

    Parameters
    ----------
    source : rasterio dataset
    path : str or Path
        For messages.

    Raises
    ------
    GeoreferenceError
        It cannot be read.
    """
    if source.crs is None or not source.crs.to_wkt():
        return None
    try:
        crs = pyproj.CRS.from_user_input(source.crs.to_wkt())
    except pyproj.exceptions.CRSError as error:
        raise GeoreferenceError(
            f"{path}: its CRS cannot be read ({one_line(error)[:80]}); set it again (rio edit-info FILE --crs EPSG:n)"
        ) from error
    epsg = crs.to_epsg()  # the EPSG entry has the area of use, the WKT of a file has not
    registered = pyproj.CRS.from_epsg(epsg) if epsg else crs
    return registered if registered.equals(crs, ignore_axis_order=True) else crs
