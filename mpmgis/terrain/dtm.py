"""Digital terrain models (DTM): elevation rasters with checks of CRS, unit, nodata and slope."""

import math
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import pyproj
from rasterio.enums import ColorInterp
from rasterio.io import DatasetReader
from rasterio.windows import Window

from ..system.errors import GeoreferenceError, InputError, one_line
from ..system.messages import log
from ..system.source_names import file_of
from .elevation import Terrain
from .georeference import LOCAL, horizontal, name_of, parse_crs, require_metric, same_place, scale_command, warp_command
from .grid import Grid
from .nodata_fill import INTERPOLATE, filled
from .raster_input import band_number, band_values, crs_of, file_sha256, open_raster, transform_of
from .raster_scale import scale_line
from .terrain_reprojection import METRES, UNIT_METRES, planned_reprojection, warped_values
from .undeclared_nodata import HEIGHTS
from .walled_regions import largest_steps, walled_lines, walled_regions

_BELOW_EARTH = -12000.0  # [m] no elevation on Earth is lower
_ABOVE_EARTH = 9500.0  # [m] no elevation on Earth is higher
STEEP_DEGREES = 85.0  # [deg] steeper cells are hardly natural: wrong units or nodata
STEEP_SHARE = 0.01  # [1] of the cells; more steep ones are reported
READ_WHOLE = 25_000_000  # [pixels] up to here a DTM is always read and checked completely: 0.2 GB
BY_BLOCK = "it is read by block"  # for `whole_or_parts`
_COLOURS = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
_ROWS_AT_ONCE = 512  # whose slopes are computed together, to limit the memory


class WithoutCRS(GeoreferenceError):
    """A DTM has no CRS.

    Attributes
    ----------
    bounds : (float, float, float, float)
        West, south, east, north of the raster.
    """

    bounds: tuple[float, float, float, float] | None = None


def read_terrain(
    path: str | Path,
    crs: str | None = None,
    band: int | None = None,
    fill_nodata: str | None = None,
    to_crs: str | None = None,
) -> Terrain:
    """Read a DTM as a Terrain.

    Parameters
    ----------
    path : str or Path
        Any raster that GDAL reads; north-up, south-up, rotated, non-square.
    crs : str, optional
        ``EPSG:n`` or ``local`` (metres without a georeference) for a file without a CRS.
    band : int, optional
        Counted from 1; required where there are several bands.
    fill_nodata : {"interpolate"}, optional
        Treatment of holes in the DTM (`nodata_fill`).
    to_crs : str, optional
        ``auto`` or ``EPSG:n``: a DTM in another CRS is reprojected, heights in feet become metres.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    return TerrainFile(path, crs, band, fill_nodata, to_crs).whole()


class TerrainFile:
    """A DTM whose georeference is read at once and whose elevations are read and checked in parts, on demand.

    Parts have the same bits as the same parts of the whole `Terrain`.

    Parameters
    ----------
    path, crs, band, fill_nodata, to_crs : as for `read_terrain`

    Attributes
    ----------
    grid : Grid
        Of the whole file, in the CRS of the terrain.
    reprojection : Reprojection or None
    path : str
    fills : bool
        Whether holes are filled.
    fill : NodataFill or None
        Filled holes of the part that was read last.
    walled : tuple of WalledRegion
        Probably undeclared nodata in that part.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """

    def __init__(
        self,
        path: str | Path,
        crs: str | None = None,
        band: int | None = None,
        fill_nodata: str | None = None,
        to_crs: str | None = None,
    ):
        self._file, self.fills, self.fill, self.walled = path, fill_nodata == INTERPOLATE, None, ()
        self.path = str(path)
        with open_raster(path) as source:
            self._band = band_number(source, path, band, HEIGHTS)
            for line in filter(None, (scale_line(source, path, self._band), _picture_line(source, path, self._band))):
                log.info(line)
            crs = _terrain_crs(source, path, crs, to_crs)
            self.reprojection = None if to_crs is None else planned_reprojection(source, path, self._band, crs, to_crs)
            self.grid = self._grid(source, crs)
            if min(self.grid.shape) < 2:
                raise InputError(f"{path} has {source.height} x {source.width} cells, expected at least 2 x 2")
            if crs is not None and self.reprojection is None:
                require_metric(crs_of(source, path) or crs, self.grid.bounds, self.path)
        if self.reprojection is not None and (line := self.reprojection.line(self.path)):
            log.info(line)

    def _grid(self, source, crs):
        if self.reprojection is not None:
            return self.reprojection.grid
        _require_metres_up(source, self._file, self._band)
        return Grid(crs, transform_of(source, self._file, local=crs is None), source.shape)

    @property
    def pixels(self) -> int:
        """Number of pixels of the whole file."""
        return self.grid.shape[0] * self.grid.shape[1]

    @cached_property
    def sha256(self) -> str:
        """Hex digest of the whole file."""
        file = file_of(self._file)
        if not file.exists():  # in the network
            return ""
        about = file.stat()
        return _sha256(file.resolve(), about.st_size, about.st_mtime_ns, about.st_ino)

    def whole(self) -> Terrain:
        """Read all pixels as a Terrain.

        Raises
        ------
        FormatError, InputError
        """
        return self._terrain(self.grid, None)

    def part(self, rows: slice, columns: slice) -> Terrain:
        """Read a part of the pixels as a Terrain.

        Parameters
        ----------
        rows, columns : slice

        Raises
        ------
        FormatError, InputError
        """
        shape = rows.stop - rows.start, columns.stop - columns.start
        return self._terrain(self.grid.part(rows.start, columns.start, shape), Window.from_slices(rows, columns))

    def cropped(self, bounds: tuple[float, float, float, float], margin: int) -> Terrain:
        """Read the pixels that meet `bounds` and some around as a Terrain.

        Parameters
        ----------
        bounds : (float, float, float, float) [m]
            West, south, east, north.
        margin : int [pixels]
            Added on every side.

        Raises
        ------
        FormatError, InputError
        """
        return self.part(*self.grid.window(bounds, margin))

    def heights(self, rows: slice, columns: slice) -> np.ndarray:
        """Read the elevations of a part, which may be nodata everywhere; only their range is checked.

        Parameters
        ----------
        rows, columns : slice
            Within the raster.

        Returns
        -------
        float64[rows, columns] [m]
            NaN for nodata.

        Raises
        ------
        FormatError, InputError
        """
        with open_raster(self._file) as source:
            elevation = self._values(source, Window.from_slices(rows, columns), may_be_empty=True)
        if np.isfinite(elevation).any():
            require_heights(elevation, self._file)
        return elevation

    def _values(self, source, window, may_be_empty=False):
        if self.reprojection is None:
            return band_values(source, self._file, self._band, HEIGHTS, may_be_empty, window)
        return warped_values(source, self._file, self._band, self.reprojection, window, may_be_empty)

    def _terrain(self, grid, window):
        with open_raster(self._file) as source:
            elevation = self._values(source, window)
        require_heights(elevation, self._file)
        terrain = Terrain(grid, elevation, self.path, self.sha256, self.reprojection)
        if self.fills:
            terrain, self.fill = filled(terrain)
            for line in self.fill.lines(grid.cell_size):
                log.info(line)
        steps = largest_steps(terrain.elevation)
        self.walled = walled_regions(terrain.elevation, grid, steps)
        for line in walled_lines(self.walled, self._file):
            log.info(line)
        _warn_of_steep_cells(terrain, self._file, steps)
        return terrain


@lru_cache(maxsize=4)
def whole_or_parts(file: TerrainFile, how: str, in_parts: bool = False) -> Terrain | TerrainFile:
    """Read a DTM, or return the file of a very large one, of which the caller reads parts.

    To fill holes the whole DTM is read, because a part may not contain a whole hole.

    Parameters
    ----------
    file : TerrainFile
    how : str
        Says in a message which parts are read.
    in_parts : bool
        Whether parts are read whatever the size.

    Raises
    ------
    FormatError, InputError
    """
    if file.pixels <= READ_WHOLE and not in_parts:
        return file.whole()
    cells = f"{file.path} has {file.grid.shape[0]} x {file.grid.shape[1]} cells"
    if file.fills:
        log.info(f"{cells} and is read at once to fill its holes; without `fill_nodata` {how}")
        return file.whole()
    log.info(f"{cells}; {how}")
    return file


def _sha256(path: Path, size: int, changed: int, number: int) -> str:
    """Return the digest of a file, computed once for each state of it: many runs read windows of one large DTM."""
    return file_sha256(path)


def _terrain_crs(
    source: DatasetReader, path: str | Path, asked: str | None, to_crs: str | None = None
) -> pyproj.CRS | None:
    """Return the horizontal CRS of the DTM, None for a local frame; `asked` must not contradict the file."""
    own = crs_of(source, path)
    given = parse_crs(asked) if asked is not None else None
    if own is not None and own.is_engineering:  # declared as a local frame
        own = None
        asked = asked or LOCAL
        log.info(f"{path}: its CRS is a local frame; coordinates are metres without a georeference")
    if own is None:
        if asked is None:
            error = WithoutCRS(
                f"{path} has no CRS; give --crs EPSG:n, or --crs local for metres without a georeference"
            )
            error.bounds = tuple(source.bounds)
            raise error
        return horizontal(given)
    if asked is not None and (given is None or not same_place(own, given)):
        tag = "--unset-crs" if given is None else f"--crs {asked}"
        reproject = "" if given is None else f", or reproject it: {warp_command(path, asked)}"
        raise GeoreferenceError(
            f"{path} is already in {name_of(own)}, --crs {asked} is only for a DTM without a CRS; omit --crs, "
            f"or correct a wrong tag (rio edit-info FILE {tag}){reproject}"
        )
    plane = horizontal(own)
    if own.is_compound:
        log.info(
            f"{path}: its CRS includes a vertical datum ({one_line(own.name)}); elevations "
            f"{'are used unchanged' if to_crs is None else 'keep that datum'}, and results have the horizontal part"
            f"{f', {name_of(plane)}' if to_crs is None else ' alone'}"
        )
    return plane


def _require_metres_up(source: DatasetReader, path: str | Path, band: int) -> None:
    """Refuse a band with a known unit other than metre; report an unknown unit."""
    unit = (source.units[band - 1] or "").strip()
    factor = UNIT_METRES.get(unit.lower())
    if factor is not None:
        raise GeoreferenceError(
            f"{path}: elevations are in {unit}, expected metres; give --to-crs auto, or convert them, for example: "
            f"{scale_command(path, factor)}, and set the unit to m"
        )
    if unit.lower() not in METRES:
        log.info(f"{path}: unit {unit!r} is unknown, elevations are assumed to be in metres")


def _picture_line(source: DatasetReader, path: str | Path, band: int) -> str:
    """Return a message for a band of a picture: 8 bits, or a colour; "" for other bands."""
    colour = source.colorinterp[band - 1]
    if colour not in _COLOURS and source.dtypes[band - 1] != "uint8":
        return ""
    kind = (
        f"is the {colour.name} of a picture" if colour in _COLOURS else "has 8-bit numbers, as a picture or a hillshade"
    )
    return f"{path}: band {band} {kind}; expected elevations in metres: check that this is the DTM"


def require_heights(elevation: np.ndarray, path: str | Path) -> None:
    """Refuse elevations outside the range on Earth, and a raster without any.

    Parameters
    ----------
    elevation : float64[rows, columns] [m]
        NaN for nodata.
    path : str or Path
        For messages.

    Raises
    ------
    InputError
    """
    lowest, highest = (edge.reduce(elevation, axis=None) for edge in (np.fmin, np.fmax))
    if np.isnan(lowest):
        raise InputError(f"{path}: every cell is nodata")
    if lowest < _BELOW_EARTH or highest > _ABOVE_EARTH:
        raise InputError(
            f"{path}: elevations are from {lowest:g} to {highest:g}, expected metres between {_BELOW_EARTH:g} and "
            f"{_ABOVE_EARTH:g}; declare the nodata value (rio edit-info FILE --nodata N), or choose the band "
            "of the elevations"
        )


def _is_gentler(terrain: Terrain, steps: tuple[float, float], limit: float) -> bool:
    """Return whether no slope of a north-up DTM can exceed `limit` [1], from the `largest_steps` between two pixels.

    Differences at the rim are at most twice this step, and there are two directions. Much faster than all slopes.
    """
    if terrain.grid.is_rotated:
        return False
    sides = abs(terrain.grid.transform.e), abs(terrain.grid.transform.a)
    return 2.0 * math.hypot(*(step / side for step, side in zip(steps, sides, strict=True))) <= limit


def _warn_of_steep_cells(terrain, path, steps):
    """Warn where more than 1 % of the cells are steeper than 85 degrees: wrong units or nodata."""
    limit, steep, total = math.tan(math.radians(STEEP_DEGREES)), 0, 0
    if _is_gentler(terrain, steps, limit):
        return
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
