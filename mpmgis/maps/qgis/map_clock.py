"""Time scale of a run in QGIS: simulated seconds as whole QGIS seconds.

QGIS saves time ranges in whole seconds, and steps of 0.2 s would be lost when the project is saved. So time is
stretched: one simulated second becomes a minute, an hour or a day from a base date, for stacks, mesh, outlines and
project alike. The simulated time is in `t_s` columns, band names and the map title.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property

import numpy as np

from ...system.errors import InputError

BASE = datetime(2000, 1, 1, tzinfo=UTC)  # date of the simulated time 0
BASE_TEXT = "2000-01-01T00:00:00Z"
# QGIS seconds for one simulated second, and the same as text
STRETCHES = {60: "1 s = 1 min", 3600: "1 s = 1 hour", 86_400: "1 s = 1 day", 86_400_000: "1 ms = 1 day"}
SHORTEST_STEP = 2  # [QGIS s] a single layer is shown from 1 s after its step to 1 s before the next
ROUNDING = 0.01  # [1] largest rounding error of a time, as a share of the shortest step
LONGEST_RUN = 1900 * 365 * 86_400  # [QGIS s] dates stay between the years 100 and 3900
MOST_FRAMES = 5000  # [frames] of the temporal controller, for very unequal steps


@dataclass(frozen=True)
class Clock:
    """Steps on the stretched time line.

    Parameters
    ----------
    stretch : int
        QGIS seconds per simulated second.
    begins : tuple of int [QGIS s]
        Start of each step, from the base date.
    """

    stretch: int
    begins: tuple

    @classmethod
    def of(cls, times: Sequence) -> "Clock":
        """Choose the smallest stretch with whole steps of at least 2 QGIS seconds.

        Rounding errors up to a hundredth of the shortest step are allowed; else the largest possible stretch is used.

        Parameters
        ----------
        times : sequence of float [s]
            Increasing.

        Raises
        ------
        InputError
            No times, times not finite or not increasing, or steps too short for any stretch.
        """
        times = np.asarray(times, dtype=float)
        if times.size == 0 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
            raise InputError(f"times of the exported steps must be finite and increasing; got {_sample(times)}")
        fitting = [
            stretch
            for stretch in STRETCHES
            if _shortest(times, stretch) >= SHORTEST_STEP and np.abs(times).max() * stretch < LONGEST_RUN
        ]
        if not fitting:
            raise InputError(
                f"exported steps are {np.diff(times).min():.3g} s apart over {times[-1]:.6g} s, "
                "too close for whole seconds in QGIS; use a larger --dt-e, or --no-qgis"
            )
        stretch = next((stretch for stretch in fitting if _is_whole(times, stretch)), fitting[-1])
        return cls(stretch, tuple(int(second) for second in np.rint(times * stretch)))

    @cached_property
    def step(self) -> int:
        """Length of a controller frame [QGIS s]: the shortest step, but at most MOST_FRAMES frames.

        The last step is ignored: a run that comes to rest can end at any time between two frames.
        """
        if len(self.begins) == 1:
            return self.stretch
        steps = np.diff(self.begins)
        shortest = int(min(steps[:-1], default=steps[-1]))
        return max(shortest, -(-(self.begins[-1] - self.begins[0]) // MOST_FRAMES))

    @property
    def ends(self) -> tuple[int, ...]:
        """End of each step [QGIS s], tuple of int; the last one lasts a controller frame."""
        return (*self.begins[1:], self.begins[-1] + self.step)

    @property
    def label(self) -> str:
        """Time scale as text, for example "1 s = 1 min"."""
        return STRETCHES[self.stretch]

    @property
    def decimals(self) -> int:
        """Decimals of simulated seconds that distinguish consecutive steps."""
        step = self.step / self.stretch
        enough = max(1, int(np.ceil(-np.log10(step))) + 1)
        return next((n for n in range(enough) if abs(step * 10**n - round(step * 10**n)) < 1e-6), enough)


def stamp(second: int) -> str:
    """Return the ISO 8601 text in UTC of a time after the base date.

    Parameters
    ----------
    second : int [QGIS s]
    """
    return (BASE + timedelta(seconds=int(second))).strftime("%Y-%m-%dT%H:%M:%SZ")


def _shortest(times, stretch):
    return np.diff(np.rint(times * stretch)).min() if times.size > 1 else np.inf


def _is_whole(times, stretch):
    stretched = times * stretch
    return np.all(np.abs(stretched - np.rint(stretched)) <= ROUNDING * _shortest(times, stretch))


def _sample(times):
    return ", ".join(f"{t:g}" for t in times[:5]) + (", ..." if times.size > 5 else "") or "none"
