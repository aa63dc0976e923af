"""Thickness of a released snow slab, from the depth of new snow, the slope, the altitude and the wind.

Swiss guideline (Salm, Burkard and Gubler 1990, Mitteilung 47 of the SLF): d0 = d0* f(psi). No text of the guideline
could be read. Its factor follows from a criterion that can be checked: a slab of thickness d0 and specific weight g
fails where its shear stress reaches the strength, c and mu times the normal stress: d0 g (sin psi - mu cos psi) = c.
With mu = 0.202, and c from the thickness d0* at 28 degrees, f(psi) = (sin 28 - mu cos 28) / (sin psi - mu cos psi). The
numerator is the 0.291 of the guideline.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ...system.errors import InputError

FRICTION = 0.202  # [1] of the failure plane
STRENGTH = 0.291  # [1] sin(28 degrees) - FRICTION cos(28 degrees), as printed
REFERENCE_SLOPE = 28.0  # [degrees] where the factor is 1; it is not extrapolated to gentler slopes
GRADIENT = 0.05  # [m] of new snow in three days per 100 m of altitude, usual in the Swiss Alps
THICKEST_SNOW = 10.0  # [m] of new snow in three days; more is another unit


@dataclass(frozen=True)
class NewSnow:
    """New snow of three days by return period.

    Parameters
    ----------
    depths : dict of int to float [m]
        d0*, the thickness normal to a slope of 28 degrees, by return period [years]; 0 years: without one.
    altitude : float, optional [m]
        Where the depths apply. Without it they apply everywhere.
    gradient : float [m per 100 m]
        Increase of the depths above that altitude, and decrease below it.
    wind : float [m]
        Drifted snow that is added to the depths.
    wind_altitude : float, optional [m]
        Above which there is drifted snow. Without it there is everywhere.

    Raises
    ------
    InputError
        A value is outside its range.
    """

    depths: Mapping[int, float] = field(default_factory=dict)
    altitude: float | None = None
    gradient: float = GRADIENT
    wind: float = 0.0
    wind_altitude: float | None = None

    def __post_init__(self):
        for depth in self.depths.values():
            if not (math.isfinite(depth) and 0 < depth <= THICKEST_SNOW):
                centimetres = f" ({depth / 100:g} m if it is in cm)" if depth > THICKEST_SNOW else ""
                raise InputError(
                    f"`snow_depth` is {depth:g}{centimetres}, expected metres above 0, at most {THICKEST_SNOW:g}"
                )
        if not (math.isfinite(self.wind) and 0 <= self.wind <= THICKEST_SNOW):
            raise InputError(f"`wind` is {self.wind:g}, expected metres of drifted snow from 0 to {THICKEST_SNOW:g}")
        if not abs(self.gradient) <= 1.0:
            raise InputError(f"`snow_gradient` is {self.gradient:g}, expected metres per 100 m of altitude, at most 1")

    def thickness(self, slope: np.ndarray, elevation: np.ndarray) -> dict[int, np.ndarray]:
        """Return the thickness normal to the bed by return period: (d0* + altitude + wind) f(slope), at least 0.

        Parameters
        ----------
        slope : float64[n] [degrees]
            Mean slope of each area.
        elevation : float64[n] [m]
            Mean elevation of each area.

        Returns
        -------
        dict of int to float64[n] [m]
        """
        higher = 0.0 if self.altitude is None else self.gradient * (elevation - self.altitude) / 100.0
        drifted = self.wind if self.wind_altitude is None else np.where(elevation > self.wind_altitude, self.wind, 0.0)
        factor = slope_factor(slope)
        return {years: np.maximum(0.0, depth + higher + drifted) * factor for years, depth in self.depths.items()}


def slope_factor(slope: np.ndarray) -> np.ndarray:
    """Return the thickness of a slab on a slope over that on 28 degrees (Salm, Burkard and Gubler 1990).

    Parameters
    ----------
    slope : float64[n] [degrees]

    Returns
    -------
    float64[n] [1]
        STRENGTH / (sin - FRICTION cos), 1 up to 28 degrees.
    """
    steep = np.radians(np.maximum(slope, REFERENCE_SLOPE))
    return np.where(slope > REFERENCE_SLOPE, STRENGTH / (np.sin(steep) - FRICTION * np.cos(steep)), 1.0)


def parsed_depths(text: str | float | Mapping[int, float]) -> dict[int, float]:
    """Return the depths of new snow by return period.

    Parameters
    ----------
    text : str, float or dict of int to float [m]
        "30=0.9,300=1.5" (years and depth), or one number.

    Raises
    ------
    InputError
        It is neither, or a return period is given twice.
    """
    if isinstance(text, Mapping):
        return {int(years): float(depth) for years, depth in text.items()}
    found = {}
    for part in str(text).split(","):
        years, equals, depth = part.rpartition("=")
        try:
            key, value = (int(years) if equals else 0), float(depth)
        except ValueError:
            key = -1
        if key < 0 or (equals and key == 0):
            raise InputError(
                f"`snow_depth` is {text!r}, expected metres, or years and metres such as 30=0.9,100=1.2,300=1.5"
            )
        if key in found:
            raise InputError(f"`snow_depth` is {text!r}, which gives {key} years twice; keep one of them")
        found[key] = value
    if len(found) > 1 and 0 in found:
        raise InputError(f"`snow_depth` is {text!r}, expected a return period for each depth, such as 30=0.9,100=1.2")
    return found
