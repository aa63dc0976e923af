"""Criteria of potential release areas, and their published values by scenario.

Method and values: Buehler et al. 2018, NHESS 18:3235, "Automated snow avalanche release area delineation". Of that
paper only the abstract could be read; slope, ruggedness, curvature and smallest area are those that two public
implementations of the method state.
"""

import math
from dataclasses import dataclass

from ...system.errors import InputError

WINDOW = 45.0  # [m] side of the window of ruggedness: 9 cells of 5 m


@dataclass(frozen=True)
class SlabCriteria:
    """Ground on which a snow slab can release.

    Parameters
    ----------
    slope_min, slope_max : float [degrees]
        Band of the slope; both limits belong to it.
    curvature : float [rad per 100 m]
        Largest turning of the contour lines, to both sides: 6 is a contour line with a radius of 17 m.
    ruggedness : float [1]
        Largest vector ruggedness measure in a window of WINDOW: 1 - |mean of the unit normals|.
    min_area : float [m2]
        Smallest plan area of a unit.
    ridge_angle : float [degrees]
        A ridge or gully at which the aspect turns by more, within WINDOW, divides units.

    Raises
    ------
    InputError
        A value is outside its range.
    """

    slope_min: float = 30.0
    slope_max: float = 60.0
    curvature: float = 6.0
    ruggedness: float = 0.06
    min_area: float = 500.0
    ridge_angle: float = 20.0

    def __post_init__(self):
        if not 0 < self.slope_min < self.slope_max < 90:
            raise InputError(
                f"`slope_min` is {self.slope_min:g} and `slope_max` {self.slope_max:g}, expected degrees between 0 and "
                "90, the first below the second"
            )
        for name in ("curvature", "ruggedness", "min_area", "ridge_angle"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"`{name}` is {value:g}, expected a number above 0")


SCENARIOS = {  # Buehler et al. 2018: return periods of 10 to 30 years, and of 100 to 300 years
    "frequent": SlabCriteria(),
    "extreme": SlabCriteria(slope_min=28.0, ruggedness=0.08),
}


def window_cells(side: float) -> int:
    """Return the cells along a window of WINDOW: an odd number, 3 or more.

    Parameters
    ----------
    side : float [m]
        Of a cell.
    """
    return 2 * max(1, round((WINDOW / side - 1) / 2)) + 1
