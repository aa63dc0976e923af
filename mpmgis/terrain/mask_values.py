"""Masks and ids of areas in rasters: which cells are inside, and values that cannot be metres."""

from pathlib import Path

import numpy as np

from ..system.errors import InputError
from ..system.messages import log

FEW = 10  # different whole numbers up to which a raster is a mask or ids; more are a measured quantity
TRACE = 1e-6  # [1] of the largest value, or [m]: smaller values are rounding errors of 0
THICKEST = 1000.0  # [m] of a release or of erodible ground; more is another unit or another quantity
BYTE_MASK = 255.0  # value inside, in masks of pictures and of rasterio
_LISTED = 5  # values in a message


def is_mask(values: np.ndarray) -> bool:
    """Return whether values above 0 are a mask or ids of areas: few different ones, all of them whole numbers.

    Parameters
    ----------
    values : float64[n]
        Of the cells inside.
    """
    ids = ids_of(values)
    return len(ids) <= FEW and bool(np.all(ids == np.floor(ids)))


def ids_of(values: np.ndarray) -> np.ndarray:
    """Return the different values, at most FEW + 1 of them.

    Parameters
    ----------
    values : float64[n]
    """
    found = np.unique(values[:: max(1, values.size // 10_000)])
    return found if len(found) > FEW else np.unique(values)[: FEW + 1]


def listed(values: np.ndarray) -> str:
    """Return the first different values as text.

    Parameters
    ----------
    values : float64[n]
    """
    found = ids_of(values)
    return ", ".join(f"{value:g}" for value in found[:_LISTED]) + (", ..." if len(found) > _LISTED else "")


def inside_of(values: np.ndarray, path: str | Path) -> np.ndarray:
    """Return which cells of a mask are inside; report how many, and their values.

    Parameters
    ----------
    values : float64[rows, columns]
        NaN for nodata, 0 outside.
    path : str or Path
        For messages.

    Returns
    -------
    bool[rows, columns]

    Raises
    ------
    InputError
        No cell is inside, or cells of several classes leave none outside.
    """
    inside = without_traces(values, path)
    known = values[inside]
    if not known.size:
        raise InputError(f"{path}: all values are 0 or nodata, expected a mask")
    if inside.all() and is_mask(known) and known.min() < known.max():
        raise InputError(
            f"{path}: its values {listed(known)} leave no cell outside, expected 0 or nodata there; set the cells "
            "outside to 0, or declare their value as nodata (rio edit-info FILE --nodata N)"
        )
    share = known.size / values.size
    many = "; more than half: check which value is outside" if share > 0.5 else ""
    one = known.min() == known.max()
    what = f"a mask with the value{'' if one else 's'} {listed(known)}"
    log.info(f"{path}: {what} in {known.size} of {values.size} cells{many}")
    return inside


def without_traces(values: np.ndarray, path: str | Path, least: float | None = None) -> np.ndarray:
    """Return which cells have a value other than 0; values that are rounding errors of 0 are reported.

    Parameters
    ----------
    values : float64[rows, columns]
        NaN for nodata.
    path : str or Path
        For messages.
    least : float, optional
        Smaller absolute values are rounding errors; default TRACE of the largest value.

    Returns
    -------
    bool[rows, columns]
    """
    inside = np.isfinite(values) & (values != 0)
    if not inside.any():
        return inside
    sizes = np.abs(values)
    traces = inside & (sizes < (TRACE * np.nanmax(sizes) if least is None else least))
    count = int(np.count_nonzero(traces))
    if count:
        log.info(f"{path}: {count} cells have values up to {sizes[traces].max():.2g}, rounding errors of 0; used as 0")
    return inside & ~traces


def require_metres(values: np.ndarray, path: str | Path, remedy: str) -> None:
    """Refuse values above 0 that cannot be a thickness: a mask, ids of areas, or more than THICKEST.

    Parameters
    ----------
    values : float64[n] [m]
        Of the cells inside.
    path : str or Path
        For messages.
    remedy : str
        What to give for a mask.

    Raises
    ------
    InputError
    """
    if is_mask(values):
        raise InputError(f"{path} contains only 0 and {listed(values)}, i.e. a mask or ids of areas; {remedy}")
    require_thin(values, path)


def require_thin(values: np.ndarray, path: str | Path) -> None:
    """Refuse a thickness above THICKEST.

    Parameters
    ----------
    values : float64[...] [m]
        NaN where there is none.
    path : str or Path
        For messages.

    Raises
    ------
    InputError
    """
    with np.errstate(invalid="ignore"):
        thick = values > THICKEST
    if thick.any():
        raise InputError(
            f"{path}: thickness reaches {np.nanmax(values):.6g} in {int(np.count_nonzero(thick))} cells, expected at "
            f"most {THICKEST:g} metres; check its unit, and declare the nodata value (rio edit-info FILE --nodata N)"
        )
