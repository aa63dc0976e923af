"""Coordinate reference systems: checks that coordinates are metres on a map, with the command that corrects them."""

import math
import warnings
from functools import lru_cache
from pathlib import PurePath

import numpy as np
import pyproj

from ..system.errors import GeoreferenceError, InputError, one_line
from ..system.messages import log

LOCAL = "local"  # word for metres without a georeference
AUTO = "auto"  # word for a metric CRS chosen for the place
_FAR_FROM_AREA_OF_USE = 0.02  # [1] scale error beyond which coordinates outside the area of use cannot be meant
_SAME_NUMBERS = 1e-3  # [m] two projections whose coordinates differ by less are the same
_FAR_OUTSIDE = 20.0  # [deg] outside the area of use in latitude or longitude: cannot be meant at any scale error
_OUTSIDE = 3.0  # [deg] outside the area of use: cannot be meant if the scale error is large too
LARGEST_SCALE_ERROR = 1e-2  # [1] at the site; with a larger one lengths are no metres
_LARGEST_SILENT_SCALE_ERROR = 1e-3  # [1] a larger one is reported: UTM has at most this within its zone
_UNIT_ROUNDING = 1e-12  # [1] a unit that differs by less from the metre is the metre
_UTM_NORTH = 84.0  # [deg] limits of UTM
_UTM_SOUTH = -80.0
_TURN = 360.0  # [deg] largest longitude
DIFFERENT_TEXTS = 16  # CRS that are kept: all frames of a run name the same one
_POLE = 90.0  # [deg] largest latitude
_WIDEST_IN_DEGREES = 5.0  # [deg] coordinates as small as degrees over a wider raster are metres
_NO_LONGITUDE = 400.0  # [deg] larger coordinates are not degrees; rasters may reach somewhat beyond 360
_NO_LATITUDE = 100.0  # [deg] larger coordinates are not degrees


def parse_crs(text: str, option: str = "--crs") -> pyproj.CRS | None:
    """Return the CRS that an option names; None for ``local`` (metres without a georeference).

    Parameters
    ----------
    text : str
    option : str
        Its name, for messages.

    Raises
    ------
    InputError
        Neither ``local`` nor ``EPSG:n`` with an n that exists.
    """
    word = str(text).strip()
    if word.lower() == LOCAL:
        return None
    authority, _, code = word.partition(":")
    if authority.upper() != "EPSG" or not code.isdigit():
        other = AUTO if option == "--to-crs" else LOCAL
        raise InputError(f"{option} got {word!r}, expected EPSG:n, for example EPSG:32632, or {other}")
    try:
        return pyproj.CRS.from_epsg(int(code))
    except pyproj.exceptions.CRSError as error:
        raise InputError(f"{option} got {word!r}, but PROJ has no such EPSG code; look it up at epsg.io") from error


@lru_cache(maxsize=DIFFERENT_TEXTS)
def crs_of_text(text: str) -> pyproj.CRS:
    """Return the CRS that a file names in its `crs`: `EPSG:n`, WKT or a PROJ string.

    Parameters
    ----------
    text : str

    Raises
    ------
    InputError
        None of these, or unknown to PROJ.
    """
    word = str(text).strip()
    try:
        if word.upper().startswith("EPSG:"):
            return parse_crs(word)
        if word.startswith("+"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FutureWarning)  # +init=epsg:n is old and still in use
                return pyproj.CRS.from_string(word)
        return pyproj.CRS.from_wkt(word)
    except (InputError, pyproj.exceptions.CRSError) as error:
        raise InputError(
            f"crs is {one_line(word)[:40]!r}, expected EPSG:n, WKT or a PROJ string ({one_line(error)[:60]})"
        ) from error


def name_of(crs: pyproj.CRS | None) -> str:
    """Return a short name of a CRS for messages: EPSG:n where it has one, else its name.

    Parameters
    ----------
    crs : pyproj.CRS or None
        None for a local frame.
    """
    if crs is None:
        return "a local frame"
    epsg = crs.to_epsg()
    return f"EPSG:{epsg}" if epsg else one_line(crs.name)


def horizontal(crs: pyproj.CRS | None) -> pyproj.CRS | None:
    """Return the horizontal part of a CRS, without a vertical datum or a bound transformation.

    Parameters
    ----------
    crs : pyproj.CRS or None
        None stays None.
    """
    if crs is None:
        return None
    if crs.is_bound:
        return horizontal(crs.source_crs)
    if crs.is_compound:
        return horizontal(crs.sub_crs_list[0])
    return crs.to_2d() if len(crs.axis_info) == 3 else crs


def metric_equivalent(longitude: float, latitude: float) -> str:
    """Return the EPSG code of a metric CRS for a place: its UTM zone, or polar stereographic near the poles.

    Parameters
    ----------
    longitude, latitude : float [deg]
    """
    if latitude > _UTM_NORTH:
        return "EPSG:32661"
    if latitude < _UTM_SOUTH:
        return "EPSG:32761"
    zone = int((longitude + 180) // 6) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"


def warp_command(
    path: str | PurePath, crs: str | None = None, resampling: str = "bilinear", size: str | None = None
) -> str:
    """Return the command that creates `<name>_warped.tif` in the current folder from a raster.

    `rio` is part of rasterio and always available; the programs of GDAL are not.

    Parameters
    ----------
    path : str or Path
    crs : str, optional
        Code of the new CRS.
    resampling : str
    size : str, optional [m]
        Of the new pixels.
    """
    path = PurePath(path)
    options = [f"--dst-crs {crs}"] * (crs is not None) + [f"--res {size}"] * (size is not None)
    words = _quoted(path), _quoted(f"{path.stem}_warped.tif"), *options, f"--resampling {resampling}"
    return f"rio warp {' '.join(words)}"


def scale_command(path: str | PurePath, factor: float) -> str:
    """Return the command that creates `<name>_m.tif` in the current folder from a raster, its values times a factor.

    Parameters
    ----------
    path : str or Path
    factor : float [1]
    """
    path = PurePath(path)
    return f"rio calc '(* {factor:.10g} (read 1))' {_quoted(path)} {_quoted(f'{path.stem}_m.tif')}"


def _quoted(path):
    return f'"{path}"' if " " in str(path) else str(path)


def same_place(first: pyproj.CRS | None, second: pyproj.CRS | None) -> bool:
    """Return whether two CRS are one and the same on the map (vertical datum and axis order apart).

    Parameters
    ----------
    first, second : pyproj.CRS or None
        None for a local frame, which is the same only as another one.
    """
    if first is None or second is None:
        return first is second
    first, second = horizontal(first), horizontal(second)
    return first.equals(second, ignore_axis_order=True) or _same_but_for_the_datum(first, second)


def _same_but_for_the_datum(first: pyproj.CRS, second: pyproj.CRS) -> bool:
    """Return whether two projections give the same numbers and one of them, a PROJ string, does not name its datum."""
    if not (first.is_projected and second.is_projected):
        return False
    unnamed = [crs.datum is None or crs.datum.name.lower().startswith("unknown") for crs in (first, second)]
    area = next((crs.area_of_use for crs in (first, second) if crs.area_of_use is not None), None)
    if not any(unnamed) or area is None:
        return False
    longitude = np.array([area.west, area.east, 0.5 * (area.west + area.east)])
    latitude = np.array([area.south, area.north, 0.5 * (area.south + area.north)])
    try:
        places = [np.array(pyproj.Proj(crs)(longitude, latitude)) for crs in (first, second)]
    except pyproj.exceptions.ProjError:
        return False
    return bool(np.isfinite(places).all() and np.abs(places[0] - places[1]).max() < _SAME_NUMBERS)


def require_metric(crs: pyproj.CRS, bounds: tuple[float, float, float, float], where: str) -> None:
    """Refuse a CRS that is not a projection in metres, or coordinates that it cannot mean.

    Parameters
    ----------
    crs : pyproj.CRS
    bounds : (float, float, float, float)
        West, south, east, north in units of the CRS.
    where : str
        The file, for messages.

    Raises
    ------
    GeoreferenceError
        Geographic or geocentric, not in metres (horizontally or vertically), degrees under a projected tag,
        coordinates far outside the CRS's area of use, or lengths stretched by more than LARGEST_SCALE_ERROR.
    """
    plane = horizontal(crs)
    name = name_of(crs)
    centre = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
    require_true_degrees(crs, bounds, where)
    if plane.is_geographic or plane.is_geocentric:
        cure = _reprojection(where, *_longitude_latitude(plane, centre))
        unit = "degrees" if plane.is_geographic else "geocentric coordinates"
        raise GeoreferenceError(f"{where} is in {name} ({unit}); mpmgis needs metres. {cure}")
    if not plane.is_projected:
        raise GeoreferenceError(
            f"{where} is in {name}, which is not a map projection; if its coordinates are metres, remove the CRS "
            f"(rio edit-info FILE --unset-crs) and give --crs local or --crs EPSG:n"
        )
    _require_metres(plane, crs, where, centre)
    east, north = (max(abs(v) for v in bounds[first::2]) for first in (0, 1))
    if east <= _TURN and north <= _POLE and _span(bounds) < _WIDEST_IN_DEGREES:
        raise GeoreferenceError(
            f"{where} is tagged {name} (metres), but its coordinates {_pair(centre)} look like degrees; correct the "
            f"tag (rio edit-info FILE --crs EPSG:4326), then reproject, for example to "
            f"{metric_equivalent(*centre)}"
        )
    scale_error, area_error = _require_place(plane, centre, where, name)
    if scale_error > LARGEST_SCALE_ERROR:
        cure = _reprojection(where, *_longitude_latitude(plane, centre))
        raise GeoreferenceError(
            f"{where} is in {name}, which stretches lengths here by up to {100 * scale_error:.2f} %, so areas and "
            f"volumes would be off by {100 * area_error:.2f} %; expected at most {100 * LARGEST_SCALE_ERROR:g} %. "
            f"{cure}"
        )
    if scale_error > _LARGEST_SILENT_SCALE_ERROR:
        truer = metric_equivalent(*_longitude_latitude(plane, centre))
        advice = f"; a projection made for this place, for example {truer}, would be truer" if truer != name else ""
        log.info(
            f"{where}: {name} stretches lengths here by up to {100 * scale_error:.2f} %, so areas and volumes are off "
            f"by {100 * area_error:.2f} %{advice}"
        )


def require_true_degrees(crs: pyproj.CRS, bounds: tuple[float, float, float, float], where: str | PurePath) -> None:
    """Refuse a CRS in degrees for coordinates that are not degrees.

    Parameters
    ----------
    crs : pyproj.CRS
    bounds : (float, float, float, float)
        West, south, east, north in units of the CRS.
    where : str or Path
        The file, for messages.

    Raises
    ------
    GeoreferenceError
    """
    far = max(abs(v) for v in bounds[::2]) > _NO_LONGITUDE or max(abs(v) for v in bounds[1::2]) > _NO_LATITUDE
    if horizontal(crs).is_geographic and far:
        centre = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
        raise GeoreferenceError(
            f"{where} is tagged {name_of(crs)} (degrees), but its coordinates {_pair(centre)} are not degrees; give "
            f"the projection of the coordinates: --crs EPSG:n, or for a false tag rio edit-info FILE --crs EPSG:n"
        )


def is_metric(crs: pyproj.CRS) -> bool:
    """Return whether a CRS is a map projection whose axes are in metres.

    Parameters
    ----------
    crs : pyproj.CRS
    """
    return crs.is_projected and all(abs(axis.unit_conversion_factor - 1.0) <= _UNIT_ROUNDING for axis in crs.axis_info)


def is_true_to_scale(crs: pyproj.CRS, bounds: tuple[float, float, float, float]) -> bool:
    """Return whether a projected CRS stretches lengths in the middle of `bounds` by at most LARGEST_SCALE_ERROR.

    Parameters
    ----------
    crs : pyproj.CRS
    bounds : (float, float, float, float)
        West, south, east, north in units of the CRS.
    """
    longitude, latitude = centre_of(crs, bounds)
    if not (math.isfinite(longitude) and math.isfinite(latitude)):
        return True
    return _distortion(horizontal(crs), longitude, latitude)[0] <= LARGEST_SCALE_ERROR


def _distortion(plane: pyproj.CRS, longitude: float, latitude: float) -> tuple[float, float]:
    """Return (|k - 1|, areal scale - 1) at a place; zeros where PROJ knows none."""
    factors = pyproj.Proj(plane).get_factors(longitude, latitude)
    scales = np.array([factors.meridional_scale, factors.parallel_scale])
    known = np.isfinite(scales).all() and math.isfinite(factors.areal_scale)
    return (float(np.abs(scales - 1.0).max()), factors.areal_scale - 1.0) if known else (0.0, 0.0)


def centre_of(crs: pyproj.CRS, bounds: tuple[float, float, float, float]) -> tuple[float, float]:
    """Return the longitude and latitude [deg] in WGS 84 of the middle of `bounds`.

    Parameters
    ----------
    crs : pyproj.CRS
    bounds : (float, float, float, float)
        West, south, east, north in units of the CRS.

    Returns
    -------
    (float, float)
        Infinities where the CRS has none there.
    """
    return _longitude_latitude(horizontal(crs), (0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])))


def _span(bounds):
    return max(bounds[2] - bounds[0], bounds[3] - bounds[1])


def _pair(point):
    return f"({point[0]:.6g}, {point[1]:.6g})"


def _longitude_latitude(plane: pyproj.CRS, point: tuple[float, float]) -> tuple[float, float]:
    """Return the (longitude, latitude) in WGS 84 of a point, or infinities where the projection has none."""
    try:
        transformer = pyproj.Transformer.from_crs(plane, "EPSG:4326", always_xy=True)
        return transformer.transform(*point)
    except pyproj.exceptions.ProjError:
        return math.inf, math.inf


def _reprojection(where, longitude, latitude):
    if not (math.isfinite(longitude) and math.isfinite(latitude)):
        return f"Give --to-crs EPSG:n, or reproject it to a projected CRS in metres: {warp_command(where, 'EPSG:n')}"
    target = metric_equivalent(longitude, latitude)
    return f"Give --to-crs auto ({target}), or reproject it: {warp_command(where, target)}"


def _require_metres(plane: pyproj.CRS, crs: pyproj.CRS, where: str, centre: tuple[float, float]) -> None:
    """Refuse horizontal axes, or a vertical axis where the CRS has one, that are not in metres."""
    for axis in plane.axis_info:
        if abs(axis.unit_conversion_factor - 1.0) > _UNIT_ROUNDING:
            cure = _reprojection(where, *_longitude_latitude(plane, centre))
            raise GeoreferenceError(
                f"{where} is in {name_of(crs)}, whose unit is {axis.unit_name}, expected metre. {cure}"
            )
    for axis in crs.axis_info:
        if axis.direction in ("up", "down") and abs(axis.unit_conversion_factor - 1.0) > _UNIT_ROUNDING:
            raise GeoreferenceError(
                f"{where}: heights are in {axis.unit_name} (vertical CRS of {one_line(crs.name)}), expected metre; "
                f"give --to-crs auto, or convert them ({scale_command(where, axis.unit_conversion_factor)}) and give "
                "the result a CRS in metres"
            )


def _require_place(plane: pyproj.CRS, centre: tuple[float, float], where: str, name: str) -> tuple[float, float]:
    """Refuse coordinates that the CRS cannot mean; return (|k - 1|, areal scale - 1) at `centre`."""
    longitude, latitude = _longitude_latitude(plane, centre)
    if not (math.isfinite(longitude) and math.isfinite(latitude)):
        raise GeoreferenceError(
            f"{where} is tagged {name}, but its coordinates {_pair(centre)} lie nowhere in it; the tag is false: give "
            f"the file its true CRS (rio edit-info FILE --crs EPSG:n)"
        )
    scale_error, area_error = _distortion(plane, longitude, latitude)
    outside = _degrees_outside(plane.area_of_use, longitude, latitude)
    if outside > _FAR_OUTSIDE or (outside > _OUTSIDE and scale_error > _FAR_FROM_AREA_OF_USE):
        raise GeoreferenceError(
            f"{where} is tagged {name}, but its coordinates {_pair(centre)} lie {outside:.0f} degrees outside that "
            "CRS's "
            f"area of use ({plane.area_of_use.name.split(';')[0].split(' - ')[0][:60]}); the tag is false: give the "
            f"file its true CRS (rio edit-info FILE --crs EPSG:n)"
        )
    return scale_error, area_error


def _degrees_outside(area, longitude: float, latitude: float) -> float:
    """Return the distance [deg] of a place from an area of use; 0 inside, or if the CRS has none."""
    if area is None:
        return 0.0
    width = (area.east - area.west) % 360 or 360.0
    beyond = (longitude - area.west) % 360 - width
    east_west = 0.0 if beyond <= 0 else min(beyond, 360 - width - beyond)
    return max(east_west, area.south - latitude, latitude - area.north, 0.0)
