"""Values of a raster that mean nodata without being declared as nodata, by what the raster contains."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..system.errors import InputError
from ..system.messages import log

NEGATIVE = (-9999.0, -32768.0, -32767.0, -99999.0, -999999.0, -9999999.0, -2147483648.0)  # of files of many programs
POSITIVE = (9999.0, 32767.0, 65535.0, 99999.0, 999999.0, 9999999.0)  # and the largest integers, also as float32
POSITIVE += (2147483647.0, 2147483648.0, 4294967295.0, 4294967296.0)
HUGE = 1e19  # a larger value, of either sign, is no quantity: 1e20, 9.97e36, 1.7e38, 3.4e38
_LISTED = 3  # values that are named one by one


class Role(NamedTuple):
    """Contents of a raster, as far as they decide which values mean nodata.

    Parameters
    ----------
    positive : bool
        The large numbers of POSITIVE are nodata too.
    least : float
        Smaller values can only be nodata.
    classes : bool
        Values may be numbers of classes with a colour table.
    """

    positive: bool = True
    least: float = -np.inf
    classes: bool = False


HEIGHTS = Role()  # of a terrain or of the surface of a release [m]
MASK = Role(least=0.0, classes=True)  # 0 outside, any other number inside
THICKNESS = Role()  # [m]; other negative values are refused with their place
PARAMETER = Role()  # of friction or of a forest
RESULT = Role(positive=False)  # of a simulation by any code, and measured changes
STORED = Role(positive=False)  # numbers before a scale and an offset are applied


def undeclared_values(values: np.ndarray, role: Role) -> list[float]:
    """Return the values that mean nodata, smallest first.

    Parameters
    ----------
    values : float64[...]
        NaN for declared nodata.
    role : Role
    """
    low, high = (edge.reduce(values, axis=None, initial=np.nan) for edge in (np.fmin, np.fmax))
    least = max(role.least, -HUGE)
    usual = [value for value in NEGATIVE if low <= value and value >= least]
    usual += [value for value in POSITIVE if role.positive and value <= high]
    found = [value for value in usual if (values == value).any()]
    with np.errstate(invalid="ignore"):
        if low < least:
            found.extend(np.unique(values[values < least]).tolist())
        if high > HUGE:
            found.extend(np.unique(values[values > HUGE]).tolist())
    return sorted(found)


def mask_undeclared(values: np.ndarray, path: str | Path, role: Role) -> None:
    """Set values that mean nodata to NaN, in place; report each with the number of its cells.

    Parameters
    ----------
    values : float64[...]
        Changed in place.
    path : str or Path
        For messages.
    role : Role
    """
    found = undeclared_values(values, role)
    counts = []
    for value in found:
        false = values == value
        counts.append(int(np.count_nonzero(false)))
        values[false] = np.nan
    for value, count in list(zip(found, counts, strict=True))[:_LISTED]:
        log.info(f"{path}: {count} cells have the value {value:g}, which is not declared as nodata; used as nodata")
    if len(found) > _LISTED:
        rest = f"{found[_LISTED]:g} to {found[-1]:g}"
        log.info(
            f"{path}: {sum(counts[_LISTED:])} more cells have values from {rest}, which are not declared as nodata; "
            "used as nodata"
        )


def undeclared_value(
    values: np.ndarray, declared: float | None, path: str | Path, role: Role
) -> tuple[float | None, int]:
    """Return the nodata value of pixels that will be resampled (None for none), and how many have it undeclared.

    Parameters
    ----------
    values : array
        As stored in the file.
    declared : float or None
        Nodata value that the file declares.
    path : str or Path
        For messages.
    role : Role

    Raises
    ------
    InputError
        Several values mean nodata: only one can be left out when values are interpolated.
    """
    numbers = np.asarray(values, float)
    found = [value for value in undeclared_values(numbers, role) if value != declared]
    if len(found) > (declared is None):
        raise InputError(
            f"{path} has cells of {' and of '.join(f'{value:g}' for value in found[:_LISTED])}, not declared as "
            "nodata; declare one value (rio edit-info FILE --nodata N) and replace the others by it"
        )
    if declared is not None or not found:
        return declared, 0
    return found[0], int(np.count_nonzero(numbers == found[0]))
