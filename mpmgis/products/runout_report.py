"""What was found about a runout: as rows of a table, as a table over time, as plain facts."""

import math
from dataclasses import dataclass

import numpy as np

from .runout_figures import EnergyLine, Place, slope_angle

TIME_COLUMNS = (
    ("time", "s"), ("mass", "kg"), ("centre_E", "m"), ("centre_N", "m"), ("centre_elevation", "m"),
    ("centre_along", "m"), ("along_1_percent", "m"), ("along_50_percent", "m"), ("along_99_percent", "m"),
)  # fmt: skip
ENERGY_LINE_COLUMNS = (
    ("along", "m"), ("ground_length", "m"), ("E", "m"), ("N", "m"), ("elevation", "m"), ("energy_line", "m"),
    ("h_max", "m"), ("h_deposit", "m"),
)  # fmt: skip


@dataclass(frozen=True)
class RunoutFound:
    """What was found. Distances along the line are counted from its start.

    Parameters
    ----------
    name : str
    threshold : float [m]
        Of flow depth: cells above it were reached.
    line : float[n, 2] [m]
    line_source : str
    flow, deposit : EnergyLine
        To the farthest cell ever reached, and of the last frame (None where nothing lies that deep then).
    states : tuple of MassState
        One a frame; () where the result is an export, which does not know its particles.
    farthest_mass : Place or None
        On the line, where 99 % of the last frame's mass lie at or before.
    profile : tuple of float[k]
        The columns ENERGY_LINE_COLUMNS along the line.
    files : tuple of Path
    """

    name: str
    threshold: float
    line: np.ndarray
    line_source: str
    flow: EnergyLine
    deposit: EnergyLine | None
    states: tuple
    farthest_mass: Place | None
    profile: tuple
    files: tuple = ()

    @property
    def centre(self):
        """(distance along the line, drop, angle [degrees]) of the way of the centre of mass; None without frames."""
        if len(self.states) < 2:
            return None
        first, last = self.states[0], self.states[-1]
        travelled, drop = last.along - first.along, first.z - last.z
        return travelled, drop, slope_angle(drop, travelled)

    def rows(self):
        """(quantity, unit, value) of every figure."""
        rows = [*_line_rows("", self.flow), ("farthest_along_line", "m", self.flow.toe.along)]
        if self.deposit is not None:
            rows += _line_rows("deposit_", self.deposit)
        if self.centre is not None:
            travelled, drop, angle = self.centre
            rows += [("centre_of_mass_runout", "m", travelled), ("centre_of_mass_drop", "m", drop)]
            rows += [("centre_of_mass_angle", "degrees", angle), ("centre_of_mass_tangent", "1", _tangent(angle))]
        if self.farthest_mass is not None:
            length = self.farthest_mass.along - self.flow.top.along
            rows += [("runout_99_percent_of_mass", "m", length)]
            angle = slope_angle(self.flow.top.z - self.farthest_mass.z, length)
            rows += [("angle_99_percent_of_mass", "degrees", angle)]
        return rows

    def time_rows(self):
        """Rows of TIME_COLUMNS."""
        return [
            (state.time, state.mass, state.x, state.y, state.z, state.along, *map(float, state.quantiles))
            for state in self.states
        ]

    def facts(self):
        """Everything as plain numbers, lists and texts, None where there is no number."""
        named = {
            quantity if unit == "1" else f"{quantity}_{'deg' if unit == 'degrees' else unit}": _number(value)
            for quantity, unit, value in self.rows()
        }
        return {
            "name": self.name,
            "threshold_m": self.threshold,
            **named,
            "top": list(self.flow.top[1:]),
            "toe": list(self.flow.toe[1:]),
            "line": {"source": self.line_source, "vertices": self.line.tolist()},
            "files": [str(file) for file in self.files],
        }


def _line_rows(before, found):
    return [
        (f"{before}runout", "m", found.length),
        (f"{before}runout_straight", "m", found.straight),
        (f"{before}runout_along_ground", "m", found.ground),
        (f"{before}drop_height", "m", found.drop),
        (f"{before}energy_line_angle", "degrees", found.angle),
        (f"{before}energy_line_tangent", "1", _tangent(found.angle)),
    ]


def _tangent(angle):
    return math.tan(math.radians(angle))


def _number(value):
    return value if math.isfinite(value) else None
