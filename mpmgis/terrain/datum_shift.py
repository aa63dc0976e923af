"""The operation by which PROJ transforms coordinates between two CRS, and how accurate it is."""

from collections.abc import Sequence
from pathlib import Path

import pyproj

from ..system.errors import GeoreferenceError, one_line
from .georeference import name_of

SILENT_ACCURACY = 1.0  # [m] a better operation is not reported
_BALLPARK = "ballpark"  # in PROJ's name of an operation that ignores the datums
_GEOCENTRIC = (
    6378137.0,
    298.257223,
)  # [m] axis and inverse flattening of GRS 80 and WGS 84: their datums differ by 1 m
_SAME_AXIS = 1.0  # [m] difference of the semi-major axes of two ellipsoids that count as the same
_SAME_FLATTENING = 1e-4  # [1] the same, of their inverse flattenings


def transformer_to(
    crs: pyproj.CRS, target: pyproj.CRS, place: Sequence[float], path: str | Path
) -> tuple[pyproj.Transformer, str]:
    """Return the transformer of coordinates from one CRS to another, and text on its operation for a message.

    Parameters
    ----------
    crs, target : pyproj.CRS
    place : (float, float)
        A point in `crs`, in the order (east, north): the operation depends on it.
    path : str or Path
        The file, for messages.

    Returns
    -------
    transformer : pyproj.Transformer
    shift : str
        "" where the operation is accurate to 1 m.

    Raises
    ------
    GeoreferenceError
        There is no transformation, for example from the CRS of another planet; or PROJ knows no relation between the
        two datums, and one is not on the ellipsoid of GRS 80 and WGS 84: places would be off by up to 200 m.
    """
    try:
        transformer = pyproj.Transformer.from_crs(crs, target, always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise GeoreferenceError(
            f"{path} is in {name_of(crs)} and cannot be reprojected to {name_of(target)}; check its CRS"
        ) from error
    return transformer, _shift_words(transformer, crs, target, place, path)


def _shift_words(transformer, crs, target, place, path):
    """Return text on the operation that a transformer uses at a place; "" where it is accurate to 1 m."""
    transformer.transform(*place)
    try:
        used = transformer.get_last_used_operation()
    except pyproj.exceptions.ProjError:  # outside all operations: the caller finds no coordinates
        return ""
    name = one_line(used.description or "")
    if _BALLPARK in name.lower():
        if not (_is_geocentric(crs) and _is_geocentric(target)):
            raise GeoreferenceError(
                f"{path} is in {name_of(crs)}, and the relation of its datum ({_datum(crs)}) to that of "
                f"{name_of(target)} ({_datum(target)}) is not known: places would be off by up to 200 m; give the file "
                "its true CRS (EPSG:n, QGIS: Assign projection)"
            )
        return f"; the relation of the datums {_datum(crs)} and {_datum(target)} is not known, they count as the same"
    if used.accuracy is None or used.accuracy <= SILENT_ACCURACY:
        return ""
    shifts = " + ".join(part for part in name.split(" + ") if " to " in part) or name
    return f" by '{shifts[:80]}', accurate to {used.accuracy:g} m"


def _datum(crs):
    return one_line(crs.datum.name)[:40] if crs.datum is not None else "none"


def _is_geocentric(crs):
    """Return whether the ellipsoid of a CRS is that of GRS 80 and WGS 84."""
    shape = crs.ellipsoid
    axis, flattening = _GEOCENTRIC
    return (
        shape is not None
        and abs(shape.semi_major_metre - axis) < _SAME_AXIS
        and abs(shape.inverse_flattening - flattening) < _SAME_FLATTENING
    )
