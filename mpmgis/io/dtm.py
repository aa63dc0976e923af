"""Digital terrain models (DTM): elevation rasters with checks of CRS, unit, nodata and slope."""

import math
from functools import cached_property
from pathlib import Path

import numpy as np
from rasterio.windows import Window

from ..errors import GeoreferenceError, InputError, one_line
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
from .nodata_fill import INTERPOLATE, filled
from .raster import band_number, band_values, crs_of, file_sha256, open_raster, transform_of

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
STEEP_DEGREES, STEEP_SHARE = 85.0, 0.01  # design note D7
READ_WHOLE = 25_000_000  # pixels up to which a DTM is read and checked whole, whatever of it is needed: 0.2 GB
_ROWS_AT_ONCE = 512


class WithoutCRS(GeoreferenceError):
    """A DTM that carries no CRS; `bounds` are its (west, south, east, north)."""

    bounds = None


def read_terrain(path, crs=None, band=None, say=None, fill_nodata=None):
    """The DTM at `path`, or a refusal with its cure.

    Parameters
    ----------
    path : str or Path
        Any raster that GDAL reads; north-up, south-up, rotated, non-square.
    crs : str, optional
        ``EPSG:n`` or ``local`` (metres without a place) for a file that carries none.
    band : int, optional
        Counted from 1; needed where there are several.
    say : callable, optional
        Told in one line what the user should know.
    fill_nodata : {"interpolate"}, optional
        What to do with holes amid the DTM (`io.nodata_fill`).

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    return TerrainFile(path, crs, band, say, fill_nodata).whole()


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

    def __init__(self, path, crs=None, band=None, say=None, fill_nodata=None):
        say = say or (lambda text: None)
        self._file, self._say, self._fills, self.fill = Path(path), say, fill_nodata == INTERPOLATE, None
        self.path = str(self._file)
        with open_raster(path) as source:
            self._band = band_number(source, path, band)
            crs = _terrain_crs(source, path, crs, say)
            _require_metres_up(source, path, self._band, say)
            self.grid = Grid(crs, transform_of(source, path, local=crs is None), source.shape)
            if min(self.grid.shape) < 2:
                raise InputError(f"{path} has {source.height} x {source.width} cells, wanted at least 2 x 2")
            if crs is not None:
                require_metric(crs_of(source, path) or crs, self.grid.bounds, self.path, say)

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
            elevation = band_values(source, self._file, self._band, window=window)
        mask_false_heights(elevation, self._file, self._say)
        terrain = Terrain(grid, elevation, self.path, self.sha256)
        if self._fills:
            terrain, self.fill = filled(terrain)
            for line in self.fill.lines(grid.cell_size):
                self._say(line)
        _tell_of_cliffs(terrain, self._file, self._say)
        return terrain


def _terrain_crs(source, path, asked, say):
    """The DTM's horizontal CRS, None for a local frame; what was asked for must not contradict the file."""
    own = crs_of(source, path)
    given = parse_crs(asked) if asked is not None else None
    if own is not None and own.is_engineering:  # a local frame by its own word
        own = None
        asked = asked or LOCAL
        say(f"{path}: its CRS is a local frame; taken as metres without a place")
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
        say(
            f"{path}: its CRS names a vertical datum too ({one_line(own.name)}); heights are taken as they are, and "
            f"results carry the horizontal part, {name_of(plane)}"
        )
    return plane


def _require_metres_up(source, path, band, say):
    """Refuse a band whose unit is a known one but metre (D7); an unknown unit is said."""
    unit = (source.units[band - 1] or "").strip()
    factor = _OTHER_UNITS.get(unit.lower())
    if factor is not None:
        raise GeoreferenceError(
            f"{path}: heights are in {unit}, wanted metres; convert them, for example: "
            f"{scale_command(path, factor)}, and set the unit to m"
        )
    if unit.lower() not in METRES:
        say(f"{path}: unit {unit!r} is not known, heights are taken as metres")


def mask_false_heights(elevation, path, say):
    """Turn undeclared nodata into NaN, and say so; refuse heights that are none (D12)."""
    for value in _USUAL_NODATA:
        false = elevation == value
        count = int(false.sum())
        if count:
            elevation[false] = np.nan
            say(f"{path}: {count} cells hold {value:g}, though no such nodata value is declared; taken as no data")
    if not np.isfinite(elevation).any():
        raise InputError(f"{path}: every cell is nodata")
    lowest, highest = np.nanmin(elevation), np.nanmax(elevation)
    if lowest < _BELOW_EARTH or highest > _ABOVE_EARTH:
        raise InputError(
            f"{path}: heights reach from {lowest:g} to {highest:g}, wanted metres between {_BELOW_EARTH:g} and "
            f"{_ABOVE_EARTH:g}; declare its nodata value (rio edit-info FILE --nodata N), or choose the band "
            "that holds heights"
        )


def _tell_of_cliffs(terrain, path, say):
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
        say(
            f"{path}: {100 * steep / total:.1f} % of the cells are steeper than {STEEP_DEGREES:g} degrees; check its "
            f"units (feet, degrees) and its nodata value"
        )
