"""Rasters of any kind as arrays on a Grid, with errors in one line.

Every raster that the program reads is opened by `open_raster`.
"""

import hashlib
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from affine import Affine
from rasterio._err import CPLE_BaseError
from rasterio.env import Env
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.io import DatasetReader
from rasterio.windows import Window

from ..system.errors import FormatError, GeoreferenceError, InputError, innermost_reason, one_line
from ..system.file_references import TRUST, VRT_SUFFIXES, head_of, leads_to, require_local
from ..system.memory import memory_lack
from ..system.messages import log
from ..system.settled_databases import settled
from ..system.source_names import SourceName, file_of, source_of
from ..system.trusted_files import is_trusted
from ..system.zip_archives import is_zip, members, require_zip_fits
from .allowed_drivers import RASTER_DRIVERS, VRT, raster_settings
from .complete_files import require_complete
from .georeference import horizontal, warp_command
from .grid import Grid
from .raster_scale import scale_line
from .undeclared_nodata import STORED, Role, mask_undeclared
from .virtual_rasters import require_few_reads

_SMALLEST_PIXEL = 1e-9  # [m, or the map's unit] a smaller side is an invalid georeference
_FARTHEST = 1e14  # [m, or the map's unit] so is a larger product of coordinate and number of pixels
RASTER_SUFFIXES = {".tif", ".tiff", ".vrt", ".asc", ".img", ".nc", ".grd", ".hgt", ".bil", ".dem", ".sdat", ".jp2"}
_MARKS = {b"\xef\xbb\xbf": "UTF-8", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}  # byte-order marks of texts
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
    with open_raster(path) as source:
        band = band_number(source, path, band, role, option=ONE_BAND)
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
        return [file_of(name) for name in source.files]


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

    Only the drivers of `allowed_drivers` are used, and files lead nowhere (`file_references`), unless they are trusted.

    Parameters
    ----------
    path : str or Path
        Or a name of GDAL (`source_names`); a zip archive with one raster in it is that raster.

    Yields
    ------
    rasterio dataset

    Raises
    ------
    FormatError
        Missing, empty, no raster, truncated, damaged, in a format that is not read, or a file that leads to others.
    """
    source = source_of(path)
    if not source.elsewhere and not source.file.exists():
        raise FormatError(f"{path}: no such file")
    if source.file.is_file() and source.file.stat().st_size == 0:
        raise FormatError(f"{path} is empty (0 bytes), expected a raster")
    require_local(path)
    if source.is_plain:
        source = _raster_in(source, path)
        _require_directory(source.file)
        require_few_reads(source.file)
    with warnings.catch_warnings(), _messages_of_any_bytes(), Env(**raster_settings()), settled(source.file) as place:
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            dataset = DatasetReader(replace(source, file=place).base, driver=_drivers(source))
        except (RasterioError, OSError, ValueError) as error:
            raise FormatError(_unreadable(source, path, error)) from error
        with dataset:
            if dataset.count == 0:
                raise FormatError(
                    f"{path} contains no band; give one of its subdatasets: {_subdatasets(dataset, source)}"
                )
            if not source.part or source.driver:
                require_complete(dataset, place, path)
            if not is_trusted():
                _require_own_pixels(dataset, path)
            try:
                yield dataset
            except CPLE_BaseError as error:  # any later access to the dataset can raise errors of GDAL
                raise FormatError(f"{path} is damaged ({_reason(error, path)}); copy or download it again") from error


def _drivers(source):
    """Names of GDAL's drivers that may open a file; None for all."""
    if is_trusted():
        return None
    return [*RASTER_DRIVERS, VRT] if source.file.suffix.lower() in VRT_SUFFIXES else list(RASTER_DRIVERS)


def _raster_in(source: SourceName, path: str | Path) -> SourceName:
    """Return the only raster in a zip archive; `source` for other files."""
    if source.options or not is_zip(source.file):
        return source
    require_zip_fits(source.file)
    there = [name for name in members(source.file) if Path(name).suffix.lower() in RASTER_SUFFIXES]
    if len(there) != 1:
        found = f"{len(there)} rasters ({', '.join(there[:4])})" if there else "no raster"
        name = there[0] if there else "NAME.tif"
        raise FormatError(
            f"{path} contains {found}, expected one; give it as {replace(source, part=name)}, or unpack the archive"
        )
    found = replace(source, part=there[0])
    require_local(str(found))
    return found


def _subdatasets(dataset, source):
    """The names of the subdatasets, as this program reads them."""
    names = [str(source_of(name)) for name in dataset.subdatasets]
    shown = (name.replace(str(source.file.resolve()), str(source.file)) for name in names[:6])
    return ", ".join(shown) or "there is none"


def _require_own_pixels(dataset, path):
    """Refuse a raster whose overviews or coordinates are in other files, by its tags or those of its .aux.xml."""
    places = [dataset.tags(ns="OVERVIEWS").get("OVERVIEW_FILE", "")]
    if dataset.driver not in ("netCDF", VRT):
        places += [dataset.tags(ns="GEOLOCATION").get(f"{axis}_DATASET", "") for axis in "XY"]
    if dataset.driver == "HFA":
        folder = file_of(path).resolve().parent
        places += [name for name in dataset.files if not Path(name).resolve().is_relative_to(folder)]
    for place in places:
        if place and not place.startswith(":::BASE:::"):
            raise FormatError(f"{path} points at {one_line(place)[:120]}; if you trust it, {TRUST}")


def _unreadable(source, path, error):
    """The message for a file that the drivers do not open."""
    file, reason = source.file, _reason(error, path)
    if source.is_plain and file.is_dir():
        return f"{path} is a folder, expected a raster; give a file in it"
    if what := leads_to(file):
        return f"{path} {what}"
    if "database is locked" in innermost_reason(error):
        return f"{path} is locked by another program, for example by an edit in QGIS; save and close it there"
    mark = next((code for mark, code in _MARKS.items() if head_of(file).startswith(mark)), None)
    if mark is not None:
        return f"{path} is a text in {mark} with a byte-order mark, expected a raster; save it as plain text (ASCII)"
    if file.suffix.lower() in _VECTOR_SUFFIXES:
        reason += "); vector files are for releases, lines and areas: check whether two options are swapped"
    else:
        reason += ")" if is_trusted() else "); formats that the formats page does not name need --trust, or convert it"
    return f"{path} is not a raster that GDAL can read, or is truncated ({reason}"


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
    """Return the hex digest of a file, of the file of a subdataset, or of an archive; "" for folders and networks.

    Parameters
    ----------
    path : str or Path
    """
    path = file_of(path)
    if not path.is_file():
        return ""
    with open(path, "rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _reason(error, path):
    return innermost_reason(error).replace(str(path), Path(path).name)[:120]


def band_number(
    source: DatasetReader,
    path: str | Path,
    band: int | None,
    role: Role,
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
    role : Role
        What the raster contains.
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
    if source.colorinterp[band - 1] == rasterio.enums.ColorInterp.palette and not role.classes:
        raise InputError(
            f"{path} is an image with a palette, whose values are classes, expected numbers in metres; use the raster "
            "it was made from"
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
