"""Reprojection of a DTM in degrees, feet or another CRS to a terrain in metres: its new grid, and the heights there.

The pixels are resampled by GDAL through `rasterio.vrt.WarpedVRT`, window by window, so that of a very large DTM no more
is read than is asked for. Heights are interpolated bilinearly, as everywhere in the program.
"""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyproj
from affine import Affine
from rasterio.enums import MaskFlags, Resampling
from rasterio.errors import RasterioError
from rasterio.io import DatasetReader
from rasterio.vrt import WarpedVRT
from rasterio.warp import calculate_default_transform, transform_bounds
from rasterio.windows import Window, from_bounds

from ..system.errors import FormatError, GeoreferenceError, InputError, innermost_reason
from ..system.messages import log
from .datum_shift import transformer_to
from .georeference import (
    AUTO,
    centre_of,
    horizontal,
    is_metric,
    is_true_to_scale,
    metric_equivalent,
    name_of,
    parse_crs,
    require_metric,
    require_true_degrees,
    same_place,
)
from .grid import Grid
from .raster_input import ONE_BAND, band_number, band_values, crs_of, grid_of, open_raster, transform_of
from .reprojection_record import Reprojection
from .undeclared_nodata import HEIGHTS, STORED, Role, undeclared_value

UNIT_METRES = {  # unit type of a band -> metres
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "international foot": 0.3048,
    "intlft": 0.3048,
    "us-ft": 1200 / 3937,
    "us survey foot": 1200 / 3937,
    "us survey feet": 1200 / 3937,
    "ftus": 1200 / 3937,
    "sftus": 1200 / 3937,
    "foot_us": 1200 / 3937,
    "us_survey_foot": 1200 / 3937,
    "us foot": 1200 / 3937,
    "km": 1000.0,
    "kilometre": 1000.0,
    "dm": 0.1,
    "cm": 0.01,
    "centimetre": 0.01,
    "mm": 0.001,
    "yd": 0.9144,
    "yard": 0.9144,
    "in": 0.0254,
    "inch": 0.0254,
    "fathom": 1.8288,
}
METRES = {"", "m", "metre", "metres", "meter", "meters"}
WIDEST = 12.0  # [deg] of longitude in which one UTM zone is used: lengths 0.6 % too long at its edges, at the equator
_MOST_PIXELS = 1e11  # of the new grid; more is no DTM but a CRS of another place
_DIGITS = 3  # significant digits of the size of the new cells
_SAME_UNIT = 1e-5  # [1] apart: feet of two definitions are the same for heights
_EXACT = 1e-6  # [pixel] of the coordinates that GDAL interpolates along a row; rasterio cannot be given 0


def planned_reprojection(
    source: DatasetReader, path: Path, band: int, crs: pyproj.CRS | None, to_crs: str
) -> Reprojection:
    """Return how an open DTM is brought to the CRS that `to_crs` asks for.

    Parameters
    ----------
    source : rasterio dataset
    path : Path
    band : int
    crs : pyproj.CRS or None
        Horizontal CRS of the DTM.
    to_crs : str
        ``auto``: a CRS in metres is kept where it is true to scale, otherwise the UTM zone of the DTM's centre, UPS
        beyond 84 N and 80 S; or ``EPSG:n``.

    Raises
    ------
    GeoreferenceError, InputError
    """
    if crs is None:
        raise GeoreferenceError(
            f"{path} is in a local frame, which has no place on the map: --to-crs needs its CRS (--crs EPSG:n)"
        )
    own = Grid(crs, transform_of(source, path, local=False), source.shape)
    require_true_degrees(crs, own.bounds, path)
    target = target_of(crs, own.bounds, path, to_crs)
    unit, factor = _height_unit(source, path, band, crs)
    resampled = not same_place(crs, target)
    grid = metric_grid(own, target, path) if resampled else own
    require_metric(target, grid.bounds, str(path))
    shift = ""
    if resampled:
        west, south, east, north = own.bounds
        _, shift = transformer_to(crs, target, (0.5 * (west + east), 0.5 * (south + north)), path)
    return Reprojection(to_crs, crs, target, grid, resampled, unit, factor, shift)


def target_of(crs: pyproj.CRS, bounds: tuple[float, float, float, float], path: str | Path, to_crs: str) -> pyproj.CRS:
    """Return the CRS that `to_crs` means for a raster.

    Parameters
    ----------
    crs : pyproj.CRS
        Of the raster.
    bounds : (float, float, float, float)
        West, south, east, north in units of the CRS.
    path : str or Path
        For messages.
    to_crs : str
        ``auto`` or ``EPSG:n``.

    Raises
    ------
    GeoreferenceError
        With ``auto``: no longitude and latitude, or too wide for one UTM zone.
    InputError
        Not a projected CRS in metres.
    """
    if to_crs != AUTO:
        target = parse_crs(to_crs, "--to-crs")
        if target is None or not is_metric(horizontal(target)):
            raise InputError(f"--to-crs got {to_crs}, expected a projected CRS in metres, for example EPSG:32632")
        return horizontal(target)
    if is_metric(crs) and is_true_to_scale(crs, bounds):
        return crs
    longitude, latitude = centre_of(crs, bounds)
    if not (math.isfinite(longitude) and math.isfinite(latitude) and -90 <= latitude <= 90):
        raise GeoreferenceError(f"{path}: its centre in {name_of(crs)} has no longitude and latitude; check its CRS")
    wide = bounds[2] - bounds[0]
    if crs.is_geographic and wide > WIDEST and -80 <= latitude <= 84:
        raise GeoreferenceError(
            f"{path} covers {wide:.0f} degrees of longitude, too wide for one UTM zone (at most {WIDEST:g}); cut it to "
            "the site (rio clip), or name the projection: --to-crs EPSG:n"
        )
    return parse_crs(metric_equivalent(longitude, latitude), "--to-crs")


def _height_unit(source: DatasetReader, path: Path, band: int, crs: pyproj.CRS) -> tuple[str, float]:
    """Return (name of the unit of the heights, metres in one): by the band, by the vertical CRS, else metres.

    Refuse both if they contradict each other, and a map in feet without a unit of the heights.
    """
    named = (source.units[band - 1] or "").strip()
    by_band = 1.0 if named.lower() in METRES - {""} else UNIT_METRES.get(named.lower())
    up = next((axis for axis in _axes(source, path) if axis.direction in ("up", "down")), None)
    by_crs = None if up is None else up.unit_conversion_factor
    if None not in (by_band, by_crs) and abs(by_band / by_crs - 1.0) > _SAME_UNIT:
        raise GeoreferenceError(
            f"{path}: heights are in {named} by the band and in {up.unit_name} by the vertical CRS; correct one of them"
            f" (rio edit-info FILE --bidx {band} --units m, or --crs)"
        )
    if by_crs is not None:
        return up.unit_name, by_crs
    if by_band is not None:
        return named, by_band
    if named:
        raise GeoreferenceError(
            f"{path}: the unit {named!r} of its heights is unknown; name it (rio edit-info FILE --bidx {band} --units "
            "m, or ft, US survey foot)"
        )
    axis = crs.axis_info[0] if crs.axis_info else None
    if crs.is_projected and axis is not None and abs(axis.unit_conversion_factor - 1.0) > 1e-12:
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)}, whose unit is {axis.unit_name}, and nothing says what its heights are in; "
            f"name it: rio edit-info FILE --bidx {band} --units m (or ft, US survey foot)"
        )
    return "", 1.0


def _axes(source, path):
    crs = crs_of(source, path)
    return () if crs is None else crs.axis_info


def metric_grid(own: Grid, target: pyproj.CRS, path: str | Path) -> Grid:
    """Return a grid of north-up square cells in another CRS that covers a grid and is about as fine.

    Its cells are at multiples of their size.

    Parameters
    ----------
    own : Grid
    target : pyproj.CRS
        In metres.
    path : str or Path
        For messages.

    Raises
    ------
    GeoreferenceError
        It cannot be reprojected there, or becomes far too large.
    """
    west, south, east, north = own.bounds
    rows, columns = own.shape
    if own.is_rotated:  # pixels that cover the bounds
        rows, columns = (max(1, math.ceil(length / own.cell_size)) for length in (north - south, east - west))
    try:
        transform, width, height = calculate_default_transform(
            own.crs.to_wkt(), target.to_wkt(), columns, rows, west, south, east, north
        )
    except (RasterioError, ValueError) as error:
        raise _cannot(path, own.crs, target) from error
    side, west, north = transform.a, transform.c, transform.f
    east, south = west + side * width, north - side * height
    if not np.isfinite([side, west, north, east, south]).all() or side <= 0:
        raise _cannot(path, own.crs, target)
    side = float(f"{side:.{_DIGITS}g}")
    west, north = side * math.floor(west / side), side * math.ceil(north / side)
    shape = math.ceil((north - south) / side), math.ceil((east - west) / side)
    if shape[0] * shape[1] > min(_MOST_PIXELS, 100.0 * rows * columns + 1e6):
        raise GeoreferenceError(
            f"{path} in {name_of(target)} has {shape[0]} x {shape[1]} cells of {side:g} m, far more than in "
            f"{name_of(own.crs)}; give a CRS of its place: --to-crs auto"
        )
    return Grid.north_up(target, west, north, side, shape)


def _cannot(path: str | Path, crs: pyproj.CRS, target: pyproj.CRS) -> GeoreferenceError:
    return GeoreferenceError(
        f"{path} is in {name_of(crs)} and cannot be reprojected to {name_of(target)}; give a CRS of its place: "
        "--to-crs auto"
    )


def warped_values(
    source: DatasetReader,
    path: Path,
    band: int,
    plan: Reprojection,
    window: Window | None = None,
    may_be_empty: bool = False,
) -> np.ndarray:
    """Read the heights [m] of a DTM on the grid of its reprojection; NaN for nodata.

    Values that usually mean nodata count as such where the file declares none, before anything is interpolated.

    Parameters
    ----------
    source : rasterio dataset
    path : Path
        For messages.
    band : int
    plan : Reprojection
    window : rasterio.windows.Window, optional
        Part of the grid.
    may_be_empty : bool
        Nodata everywhere is no error.

    Returns
    -------
    float64[rows, columns] [m]

    Raises
    ------
    FormatError, InputError
    """
    if not plan.resampled:
        return band_values(source, path, band, HEIGHTS, may_be_empty, window) * plan.height_factor
    nodata, undeclared = _source_nodata(source, path, band, HEIGHTS, _pixels_under(source, plan, window))
    if undeclared:
        log.info(
            f"{path}: {undeclared} cells have the value {nodata:g}, which is not declared as nodata; used as nodata"
        )
    values = read_warped(source, path, band, plan.source, plan.grid, Resampling.bilinear, nodata, window)
    if not may_be_empty and not np.isfinite(values).any():
        where = " in the needed part" if window is not None else ""
        raise InputError(f"{path}: every cell{where} is nodata")
    return values * plan.height_factor


def read_warped(
    source: DatasetReader,
    path: str | Path,
    band: int,
    crs: pyproj.CRS,
    grid: Grid,
    resampling: Resampling,
    nodata: float | None = None,
    window: Window | None = None,
) -> np.ndarray:
    """Read a band on another grid, with scale and offset applied; NaN for nodata.

    Parameters
    ----------
    source : rasterio dataset
    path : str or Path
        For messages.
    band : int
    crs : pyproj.CRS
        Of the band.
    grid : Grid
    resampling : rasterio.enums.Resampling
    nodata : float, optional
        Value that means nodata.
    window : rasterio.windows.Window, optional
        Part of the grid.

    Returns
    -------
    float64[rows, columns]

    Raises
    ------
    FormatError
        It cannot be reprojected.
    """
    try:
        with _warped(source, crs, grid, resampling, nodata) as view:
            data = view.read(band, window=window, out_dtype="float64")
    except (RasterioError, OSError, ValueError) as error:
        raise FormatError(
            f"{path} cannot be reprojected to {name_of(grid.crs)} ({innermost_reason(error)[:120]})"
        ) from error
    data[~np.isfinite(data)] = np.nan
    scale, offset = source.scales[band - 1], source.offsets[band - 1]
    return data if (scale, offset) == (1.0, 0.0) else data * scale + offset


def reprojected_raster(
    path: str | Path, target: pyproj.CRS, role: Role, resampling: Resampling = Resampling.nearest
) -> tuple[np.ndarray, Grid]:
    """Read a raster with one band in another CRS.

    Masks and thicknesses keep their values and their area by the nearest pixel; heights are interpolated (bilinear).
    Values that mean nodata are left out; `read_raster` reports them.

    Parameters
    ----------
    path : str or Path
    target : pyproj.CRS
    role : Role
        What it contains.
    resampling : rasterio.enums.Resampling

    Returns
    -------
    values : float64[rows, columns]
        NaN for nodata.
    grid : Grid

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    with open_raster(path) as source:
        band = band_number(source, path, None, role, option=ONE_BAND)
        own = grid_of(source, path)
        grid = metric_grid(own, target, path)
        nodata, _ = _source_nodata(source, path, band, role, None)
        values = read_warped(source, path, band, own.crs, grid, resampling, nodata)
    rows, columns = grid.shape
    log.info(
        f"{path}: reprojected from {name_of(own.crs)} to {name_of(target)}, the terrain's CRS: {rows} x {columns} "
        f"cells of {grid.cell_size:.6g} m, {resampling.name}"
    )
    return values, grid


@contextmanager
def _warped(
    source: DatasetReader, crs: pyproj.CRS, grid: Grid, resampling: Resampling, nodata: float | None
) -> Iterator[WarpedVRT]:
    """Open the WarpedVRT of `source` on a Grid for this block; NaN where there is nothing.

    A file of real numbers that declares no nodata value has NaN as such.
    """
    masked = any({MaskFlags.per_dataset, MaskFlags.alpha} & set(flags) for flags in source.mask_flag_enums)
    if nodata is None and not masked and np.dtype(source.dtypes[0]).kind == "f":
        nodata = math.nan
    rows, columns = grid.shape
    with WarpedVRT(
        source,
        src_crs=_source_wkt(crs, source.bounds),
        src_nodata=nodata,
        crs=grid.crs.to_wkt(),
        transform=Affine(*grid.transform[:6]),
        width=columns,
        height=rows,
        nodata=math.nan,
        dtype="float64",
        resampling=resampling,
        tolerance=_EXACT,
        XSCALE=1,
        YSCALE=1,  # plain bilinear, for a part as for the whole
    ) as view:
        yield view


def _source_wkt(crs: pyproj.CRS, bounds: tuple[float, float, float, float]) -> str:
    """Return the WKT of a raster's CRS; across the antimeridian with the longitude that GDAL counts from."""
    if not crs.is_geographic or (bounds[0] >= -180.0 and bounds[2] <= 180.0):
        return crs.to_wkt()
    # with its code it would be read as that code alone; and GDAL keeps transformations by name, not by the longitude
    wkt = re.sub(r',AUTHORITY\["[^"]*","[^"]*"\]\]$', "]", crs.to_wkt("WKT1_GDAL").strip())
    centre = f"{0.5 * (bounds[0] + bounds[2]):.6f}"
    named = re.sub(r'^GEOGCS\["', f'GEOGCS["around {centre}: ', wkt)
    return f'{named[:-1]},EXTENSION["CENTER_LONG","{centre}"]]'


def _source_nodata(
    source: DatasetReader, path: str | Path, band: int, role: Role, pixels: Window | None
) -> tuple[float | None, int]:
    """Return the nodata value of a band, and how many of its `pixels` have it undeclared."""
    scaled = (source.scales[band - 1], source.offsets[band - 1]) != (1.0, 0.0)
    values = source.read(band, window=pixels)
    return undeclared_value(values, source.nodatavals[band - 1], path, STORED if scaled else role)


def _pixels_under(source: DatasetReader, plan: Reprojection, window: Window | None) -> Window | None:
    """Return the Window of the file that lies under a `window` of the new grid; None for the whole."""
    if window is None:
        return None
    t = plan.grid.transform
    west, north = t * (window.col_off, window.row_off)
    east, south = t * (window.col_off + window.width, window.row_off + window.height)
    bounds = transform_bounds(plan.target.to_wkt(), plan.source.to_wkt(), west, south, east, north)
    if plan.source.is_geographic and bounds[0] > bounds[2]:  # across the antimeridian
        bounds = (bounds[0], bounds[1], bounds[2] + 360.0, bounds[3])
    wrap = 360.0 * round((source.bounds[0] - bounds[0]) / 360.0) if plan.source.is_geographic else 0.0
    left, bottom, right, top = bounds[0] + wrap, bounds[1], bounds[2] + wrap, bounds[3]
    whole = Window(0, 0, source.width, source.height)
    try:
        near = from_bounds(left, bottom, right, top, source.transform).round_offsets().round_lengths()
        near = Window(near.col_off - 2, near.row_off - 2, near.width + 4, near.height + 4)
        return near.intersection(whole)
    except (RasterioError, ValueError):  # rotated, or apart
        return whole
