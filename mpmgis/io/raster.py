"""Rasters in: a DTM with every refusal that design note D4 to D7 and D12 ask for, and any other raster."""

import hashlib
import math
import re
import sys
import warnings
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from affine import Affine
from rasterio._err import CPLE_BaseError
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window

from ..errors import FormatError, GeoreferenceError, InputError, one_line
from ..messages import log
from ..terrain.elevation import Terrain
from ..terrain.georeference import (
    LOCAL,
    horizontal,
    name_of,
    parse_crs,
    require_metric,
    same_place,
    scale_command,
    warp_command,
)
from ..terrain.grid import Grid
from .gdal_input import require_undisguised
from .nodata_fill import INTERPOLATE, filled

METRES = {"", "m", "metre", "metres", "meter", "meters"}
_OTHER_UNITS = {  # unit type of a band -> metres
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "international foot": 0.3048, "intlft": 0.3048,
    "us-ft": 1200 / 3937, "us survey foot": 1200 / 3937, "us survey feet": 1200 / 3937, "ftus": 1200 / 3937,
    "sftus": 1200 / 3937, "foot_us": 1200 / 3937, "us_survey_foot": 1200 / 3937, "us foot": 1200 / 3937,
    "km": 1000.0, "kilometre": 1000.0, "dm": 0.1, "cm": 0.01, "centimetre": 0.01, "mm": 0.001, "yd": 0.9144,
    "yard": 0.9144, "in": 0.0254, "inch": 0.0254, "fathom": 1.8288,
}  # fmt: skip
_USUAL_NODATA = (-9999.0, -32768.0, -32767.0, -99999.0)
_BELOW_EARTH, _ABOVE_EARTH = -12000.0, 9500.0  # [m] no bed of the Earth lies beyond
_SMALLEST_PIXEL, _FARTHEST = 1e-9, 1e14  # [m, or the map's unit]: side, and coordinate times number of pixels
STEEP_DEGREES, STEEP_SHARE = 85.0, 0.01  # design note D7
READ_WHOLE = 25_000_000  # pixels up to which a DTM is read and checked whole, whatever of it is needed: 0.2 GB
_ROWS_AT_ONCE = 512
_GDAL_NAME = re.compile(r"/vsi|[A-Z][A-Z0-9_]+:")  # a virtual path or a subdataset, for example NETCDF:file.nc:height


class WithoutCRS(GeoreferenceError):
    """A DTM that carries no CRS; `bounds` are its (west, south, east, north)."""

    bounds = None


def read_terrain(path, crs=None, band=None, fill_nodata=None):
    """The DTM at `path`, or a refusal with its cure.

    Parameters
    ----------
    path : str or Path
        Any raster that GDAL reads; north-up, south-up, rotated, non-square.
    crs : str, optional
        ``EPSG:n`` or ``local`` (metres without a place) for a file that carries none.
    band : int, optional
        Counted from 1; needed where there are several.
    fill_nodata : {"interpolate"}, optional
        What to do with holes amid the DTM (`io.nodata_fill`).

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    return TerrainFile(path, crs, band, fill_nodata).whole()


class TerrainFile:
    """A DTM whose place is known and whose heights are read, and looked at, where they are asked for.

    Its pieces have the bits that the same pieces of the whole `Terrain` have.

    Parameters
    ----------
    path, crs, band, say, fill_nodata : as for `read_terrain`

    Attributes
    ----------
    grid : Grid
        Of the whole file.
    path : str
    fill : NodataFill or None
        What was filled of the piece that was read last.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """

    def __init__(self, path, crs=None, band=None, fill_nodata=None):
        self._file, self._say, self._fills, self.fill = Path(path), say, fill_nodata == INTERPOLATE, None
        self.path = str(self._file)
        with open_raster(path) as source:
            self._band = _band(source, path, band)
            crs = _terrain_crs(source, path, crs)
            _require_metres_up(source, path, self._band)
            self.grid = Grid(crs, _transform(source, path, local=crs is None), source.shape)
            if min(self.grid.shape) < 2:
                raise InputError(f"{path} has {source.height} x {source.width} cells, wanted at least 2 x 2")
            if crs is not None:
                require_metric(_crs(source, path) or crs, self.grid.bounds, self.path)

    @property
    def pixels(self):
        """Number of pixels of the whole file."""
        return self.grid.shape[0] * self.grid.shape[1]

    @cached_property
    def sha256(self):
        """Hex digest of the whole file."""
        return file_sha256(self._file)

    def whole(self):
        """The Terrain of all pixels."""
        return self._terrain(self.grid, None)

    def part(self, rows, columns):
        """The Terrain of two slices, of `rows` and of `columns`."""
        shape = rows.stop - rows.start, columns.stop - columns.start
        return self._terrain(self.grid.part(rows.start, columns.start, shape), Window.from_slices(rows, columns))

    def cropped(self, bounds, margin):
        """As `Terrain.cropped`."""
        return self.part(*self.grid.window(bounds, margin))

    def _terrain(self, grid, window):
        with open_raster(self._file) as source:
            elevation = _values(source, self._file, self._band, window=window)
        mask_false_heights(elevation, self._file)
        terrain = Terrain(grid, elevation, self.path, self.sha256)
        if self._fills:
            terrain, self.fill = filled(terrain)
            for line in self.fill.lines(grid.cell_size):
                log.info(line)
        _tell_of_cliffs(terrain, self._file)
        return terrain


def read_raster(path, band=None, may_be_empty=False):
    """(values float64[rows, columns] with NaN for nodata, Grid) of any raster; the grid's crs may be None.

    Raises
    ------
    FormatError, InputError
        Missing, unreadable, without a georeference, with several bands where none is named, or nodata everywhere
        unless it `may_be_empty`.
    """
    path = Path(path)
    with open_raster(path) as source:
        band = _band(source, path, band, option="a file with one band")
        return _values(source, path, band, may_be_empty), grid_of(source, path)


def raster_files(path):
    """Paths of all files that GDAL reads for the raster at `path`: sources of a virtual one, masks, world files."""
    with open_raster(path) as source:
        return [Path(name) for name in source.files]


def grid_of(source, path):
    """Grid of an open raster; its crs is the horizontal one, None where the file has none."""
    return Grid(horizontal(_crs(source, path)), _transform(source, path, local=True), source.shape)


@contextmanager
def open_raster(path):
    """rasterio's dataset at `path`, with its errors and warnings turned into one line."""
    path = Path(path)
    if not _GDAL_NAME.match(str(path)):
        if not path.exists():
            raise FormatError(f"{path}: no such file")
        if path.is_file() and path.stat().st_size == 0:
            raise FormatError(f"{path} is empty (0 bytes), wanted a raster")
        require_undisguised(path)
        _require_directory(path)
    with warnings.catch_warnings(), _messages_of_any_bytes():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            source = rasterio.open(path)
        except (RasterioError, OSError, ValueError) as error:
            reason = _reason(error, path)
            swapped = "; vector files are for releases, lines and areas: were two options swapped?"
            vector = path.suffix.lower() in _VECTOR_SUFFIXES
            raise FormatError(
                f"{path} is no raster that GDAL reads, or a truncated one ({reason}){swapped if vector else ''}"
            ) from error
        with source:
            if source.count == 0:
                raise FormatError(f"{path} holds no band; name one of its subdatasets (QGIS lists them)")
            try:
                yield source
            except CPLE_BaseError as error:  # what GDAL found wrong may be raised by any later look at the dataset
                raise FormatError(f"{path} is damaged ({_reason(error, path)}); copy or download it again") from error


_VECTOR_SUFFIXES = (".shp", ".gpkg", ".geojson", ".json", ".fgb", ".parquet", ".kml", ".gml")


def _require_directory(path):
    """Refuse a TIFF whose first directory lies beyond its end: libtiff itself writes to stderr about that."""
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
            f"{path} is no raster that GDAL reads, or a truncated one (its directory lies at byte {offset} of {size})"
        )


@contextmanager
def _messages_of_any_bytes():
    """GDAL's messages quote a damaged file's bytes; where these are no UTF-8 rasterio fails to log them, unheard.

    Cython tells of such a failure twice, through either hook.
    """
    before = sys.excepthook, sys.unraisablehook

    def printed(kind, error, trace):
        if not isinstance(error, UnicodeDecodeError):
            before[0](kind, error, trace)

    def unraisable(told):
        if not isinstance(told.exc_value, UnicodeDecodeError):
            before[1](told)

    sys.excepthook, sys.unraisablehook = printed, unraisable
    try:
        yield
    finally:
        sys.excepthook, sys.unraisablehook = before


def file_sha256(path):
    """Hex digest of a file; '' for what is no plain file (a folder, a GDAL virtual path)."""
    path = Path(path)
    if not path.is_file():
        return ""
    with open(path, "rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _reason(error, path):
    return one_line(error).replace(str(path), path.name)[:120]


def _band(source, path, band, option="--dem-band N"):
    if band is None:
        if source.count > 1:
            raise InputError(f"{path} has {source.count} bands; say which holds the values with {option}")
        band = 1
    if not 1 <= band <= source.count:
        raise InputError(f"{path}: band {band} asked for, but it has {source.count} (counted from 1)")
    if source.colorinterp[band - 1] == rasterio.enums.ColorInterp.palette:
        raise InputError(
            f"{path} is a picture with a palette, wanted numbers in metres; use the raster it was made from"
        )
    if np.dtype(source.dtypes[band - 1]).kind not in "fiu":
        raise InputError(f"{path}: band {band} holds {source.dtypes[band - 1]}, wanted real numbers")
    return band


def _values(source, path, band, may_be_empty=False, window=None):
    """float64[rows, columns]: band values with scale and offset applied, NaN for nodata, mask and infinities."""
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
        data = data * scale + offset
    if not may_be_empty and not np.isfinite(data).any():
        where = ""
        if window is not None:
            last = window.row_off + window.height - 1, window.col_off + window.width - 1
            first = window.row_off, window.col_off
            where = f" in rows {first[0]} to {last[0]}, columns {first[1]} to {last[1]}, where it is needed,"
        raise InputError(f"{path}: every cell{where} is nodata")
    return data


def _transform(source, path, local):
    """The pixel-corner transform (GDAL honours AREA_OR_POINT); identity means that there is none."""
    t = source.transform
    numbers = np.array(t[:6], dtype=float)
    if not np.isfinite(numbers).all() or abs(t.a * t.e - t.b * t.d) <= 0:
        raise GeoreferenceError(
            f"{path}: its transform {tuple(numbers.tolist())} cannot be inverted; georeference it anew"
        )
    sides, farthest = np.hypot(numbers[[0, 1]], numbers[[3, 4]]), np.abs(numbers).max()
    if sides.min() < _SMALLEST_PIXEL or farthest * max(source.shape) > _FARTHEST:
        raise GeoreferenceError(
            f"{path}: its pixels of {sides[0]:.3g} x {sides[1]:.3g} at {t.c:.3g}, {t.f:.3g} lie on no map; "
            "georeference it anew"
        )
    if source.gcps[0] and t == Affine.identity():
        raise GeoreferenceError(
            f"{path} is placed by control points only; warp it first: {warp_command(path, 'EPSG:n')}"
        )
    if t == Affine.identity() and not local:
        raise GeoreferenceError(
            f"{path} has no georeference; give it one (QGIS: Raster, Georeferencer), or --crs local for pixels of 1 m"
        )
    return t


def _crs(source, path):
    if source.crs is None or not source.crs.to_wkt():
        return None
    try:
        crs = pyproj.CRS.from_user_input(source.crs.to_wkt())
    except pyproj.exceptions.CRSError as error:
        raise GeoreferenceError(
            f"{path}: its CRS cannot be read ({one_line(error)[:80]}); set it anew (rio edit-info FILE --crs EPSG:n)"
        ) from error
    epsg = crs.to_epsg()  # the register's own entry knows the area of use, a file's WKT does not
    registered = pyproj.CRS.from_epsg(epsg) if epsg else crs
    return registered if registered.equals(crs, ignore_axis_order=True) else crs


def _terrain_crs(source, path, asked):
    """The DTM's horizontal CRS, None for a local frame; what was asked for must not contradict the file."""
    own = _crs(source, path)
    given = parse_crs(asked) if asked is not None else None
    if own is not None and own.is_engineering:  # a local frame by its own word
        own = None
        asked = asked or LOCAL
        log.info(f"{path}: its CRS is a local frame; taken as metres without a place")
    if own is None:
        if asked is None:
            error = WithoutCRS(
                f"{path} has no CRS; name it with --crs EPSG:n, or --crs local for metres without a place (in "
                f"a scene: crs in [terrain])"
            )
            error.bounds = tuple(source.bounds)
            raise error
        return horizontal(given)
    if asked is not None and (given is None or not same_place(own, given)):
        tag = "--unset-crs" if given is None else f"--crs {asked}"
        reproject = "" if given is None else f", or reproject it: {warp_command(path, asked)}"
        raise GeoreferenceError(
            f"{path} is in {name_of(own)} already, --crs {asked} is only for a DTM that carries none; leave --crs out, "
            f"or correct a false tag (rio edit-info FILE {tag}){reproject}"
        )
    plane = horizontal(own)
    if own.is_compound:
        log.info(
            f"{path}: its CRS names a vertical datum too ({one_line(own.name)}); heights are taken as they are, and "
            f"results carry the horizontal part, {name_of(plane)}"
        )
    return plane


def _require_metres_up(source, path, band):
    """Refuse a band whose unit is a known one but metre (D7); an unknown unit is said."""
    unit = (source.units[band - 1] or "").strip()
    factor = _OTHER_UNITS.get(unit.lower())
    if factor is not None:
        raise GeoreferenceError(
            f"{path}: heights are in {unit}, wanted metres; convert them, for example: "
            f"{scale_command(path, factor)}, and set the unit to m"
        )
    if unit.lower() not in METRES:
        log.info(f"{path}: unit {unit!r} is not known, heights are taken as metres")


def mask_false_heights(elevation, path):
    """Turn undeclared nodata into NaN, and say so; refuse heights that are none (D12)."""
    for value in _USUAL_NODATA:
        false = elevation == value
        count = int(false.sum())
        if count:
            elevation[false] = np.nan
            log.info(f"{path}: {count} cells hold {value:g}, though no such nodata value is declared; taken as no data")
    if not np.isfinite(elevation).any():
        raise InputError(f"{path}: every cell is nodata")
    lowest, highest = np.nanmin(elevation), np.nanmax(elevation)
    if lowest < _BELOW_EARTH or highest > _ABOVE_EARTH:
        raise InputError(
            f"{path}: heights reach from {lowest:g} to {highest:g}, wanted metres between {_BELOW_EARTH:g} and "
            f"{_ABOVE_EARTH:g}; declare its nodata value (rio edit-info FILE --nodata N), or choose the band "
            "that holds heights"
        )


def _tell_of_cliffs(terrain, path):
    """Warn where more than 1 % of the cells are steeper than 85 degrees: a mix-up of units or nodata (D7)."""
    limit, steep, total = math.tan(math.radians(STEEP_DEGREES)), 0, 0
    rows = terrain.grid.shape[0]
    for first in range(0, rows, _ROWS_AT_ONCE):
        last = min(first + _ROWS_AT_ONCE, rows)
        low, high = max(first - 1, 0), min(last + 1, rows)
        heights = terrain.elevation[low:high]
        band = Terrain(Grid(None, terrain.grid.transform, heights.shape), heights)
        slope = np.hypot(band.gradient[..., 0], band.gradient[..., 1])[first - low : last - low]
        steep += int(np.count_nonzero(slope > limit))
        total += int(np.count_nonzero(np.isfinite(slope)))
    if total and steep > STEEP_SHARE * total:
        log.info(
            f"{path}: {100 * steep / total:.1f} % of the cells are steeper than {STEEP_DEGREES:g} degrees; check its "
            f"units (feet, degrees) and its nodata value"
        )
